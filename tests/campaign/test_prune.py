"""`prune` lists what no planned run uses, and removes exactly that."""

import pytest
from campaign_cases import finish, make_small

from campaign.__main__ import main
from campaign.folder import exclusive, record_sum, recorded_sums, write_failure
from campaign.products import run_statuses, set_aside


@pytest.fixture
def case(tmp_path):
    """A finished campaign with a stale product, what a stale run left, a refused product and one refused before."""
    case = finish(make_small(tmp_path))
    products = case.folder / "products"
    (products / "shear_old_1.h5").write_bytes(b"stale")
    (products / "shear_old_1.checkpoint").write_bytes(b"half of it")
    write_failure(products, "shear_old_2", "blew up")
    for path in products.glob("*.h5"):
        record_sum(path)
    refused = case.product(-1)
    set_aside(case.folder, [case.rows[-2].run_id])
    refused.write_bytes(b"damaged")
    case.names = {"products/shear_old_1.h5", "products/shear_old_1.checkpoint", "products/shear_old_2.failed.json",
                  f"products/{refused.name}", f"products/refused/{case.rows[-2].run_id}.1.h5"}  # fmt: skip
    return case


def prune(case, *options):
    return main(["prune", str(case.toml), "--folder", str(case.folder), *options])


def files(case):
    return {str(p.relative_to(case.folder)) for p in case.folder.rglob("*") if p.is_file()}


def test_it_lists_every_file_with_the_reason_and_removes_none(case, capsys):
    before = files(case)
    assert prune(case) == 0
    lines = capsys.readouterr().out.splitlines()
    assert {line.split(": ")[0] for line in lines[:-2]} == case.names
    assert any("stale: a product of earlier settings" in line for line in lines)
    assert any("refused: cannot be read as a run file" in line or "refused: its bytes" in line for line in lines)
    assert lines[-2].startswith("run: 5 files, 0.") and lines[-1] == "`prune --yes` removes them"
    assert before <= files(case)


def test_with_yes_exactly_these_are_gone_and_every_checksum_has_its_file(case, capsys):
    before = files(case)
    assert prune(case, "--yes") == 0 and capsys.readouterr().out.endswith("removed\n")
    assert before - files(case) == case.names
    products = case.folder / "products"
    assert recorded_sums(products).keys() == {p.name for p in products.glob("*.h5")}
    words = [status.status for status in run_statuses(case.folder, case.rows).values()]
    assert words.count("done") == 8 and words.count("missing") == 2
    assert prune(case, "--yes") == 0 and "0 files" in capsys.readouterr().out


def test_scripts_of_runs_in_lammps_go_once_no_planned_run_has_them(case, capsys):
    """Also those of runs that failed or were killed, which have no product."""
    products = case.folder / "products"
    kept, gone = (products / f"{name}.lammps" for name in (case.rows[0].run_id, "shear_old_3"))
    for folder in (kept, gone):
        folder.mkdir()
        (folder / "in.lammps").write_text("run 0\n")
    assert prune(case) == 0
    assert "products/shear_old_3.lammps: stale: the scripts of a run of earlier settings" in capsys.readouterr().out
    assert prune(case, "--yes") == 0 and kept.exists() and not gone.exists()


def test_nothing_is_removed_while_a_run_is_at_work(case, capsys):
    before = files(case)
    with exclusive(case.folder / ".lock"):
        assert prune(case, "--yes") == 2
    assert "another `run` is at work here" in capsys.readouterr().err and before <= files(case)


def test_without_a_plan_nothing_is_stale(tmp_path, capsys):
    case = make_small(tmp_path)
    (case.folder / "points.csv").unlink()
    assert prune(case, "--yes") == 2 and "has no plan yet" in capsys.readouterr().err
