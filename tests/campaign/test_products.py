"""What counts as the product of a run, what a second check costs, and what is set aside."""

import json
import os

import pytest
import synthetic_runs
from campaign_cases import finish, make_small

from campaign import products
from campaign.folder import SUMS, exclusive, file_sum, record_sum, recorded_sums, write_failure
from campaign.products import run_statuses, set_aside, stale, write_blocked
from campaign.run_one import RETRY_STEP


@pytest.fixture
def small(tmp_path):
    return finish(make_small(tmp_path))


def words(small, **options):
    return {run_id: s.status for run_id, s in run_statuses(small.folder, small.rows, **options).items()}


def test_all_there(small):
    statuses = run_statuses(small.folder, small.rows)
    assert list(statuses) == [r.run_id for r in small.rows]
    assert {s.status for s in statuses.values()} == {"done"}
    assert statuses[small.rows[0].run_id].facts["cpu_seconds"] == 2.0


def test_second_check_opens_no_product(small, monkeypatch):
    first = words(small)
    monkeypatch.setattr(products, "inspect_product", lambda *_: pytest.fail("opened again"))
    monkeypatch.setattr(products, "file_sum", lambda *_: pytest.fail("read again"))
    assert words(small) == first


def test_rehash_finds_what_size_and_times_do_not_show(small):
    words(small)
    path = small.product()
    checked = small.folder / "products" / products.CHECKED
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    entries = json.loads(checked.read_text())
    entries[small.rows[-1].run_id]["stamp"] = products.file_stamp(path)
    checked.write_text(json.dumps(entries))
    assert words(small)[small.rows[-1].run_id] == "done"
    assert words(small, rehash=True)[small.rows[-1].run_id] == "refused"


def test_a_product_made_again_is_running_until_its_checksum_is_recorded(small):
    """Between writing a product and recording its checksum the run holds its lock; an older checksum is still there."""
    row, path = small.rows[-1], small.product()
    record_sum(path)
    synthetic_runs.write_product(small.folder, row, path, cpu_seconds=3.0)
    with exclusive(path.with_name(f".{row.run_id}.lock")):
        assert words(small)[row.run_id] == "running"
        record_sum(path)
    assert words(small)[row.run_id] == "done"


@pytest.mark.parametrize("change", [{"G_p": 1e9}, {"sigma_3": 2e5}, {"heterogeneity": "grain"}, {"strain_end": 0.2}])
def test_other_parameters_are_refused_by_name(small, change):
    row = small.rows[-1]
    synthetic_runs.write_product(small.folder, row, small.product(), **change)
    status = run_statuses(small.folder, small.rows)[row.run_id]
    assert status.status == "refused" and status.reason.startswith(f"belongs to another plan: {next(iter(change))} = ")


def test_retried_with_a_smaller_step_is_the_plans_run(small):
    row = small.rows[-1]
    step = row.values["timestep_factor"]
    synthetic_runs.write_product(small.folder, row, small.product(), timestep_factor=step * RETRY_STEP)
    status = run_statuses(small.folder, small.rows)[row.run_id]
    assert status.status == "done" and status.facts["retried"]
    synthetic_runs.write_product(small.folder, row, small.product(), timestep_factor=step * 0.7)
    assert run_statuses(small.folder, small.rows)[row.run_id].status == "refused"


def test_checksums_are_those_of_sha256sum(small):
    words(small)
    products_folder = small.folder / "products"
    assert set(recorded_sums(products_folder)) == {f"{r.run_id}.h5" for r in small.rows}
    assert os.system(f"cd {products_folder} && sha256sum --quiet --check SHA256SUMS") == 0


def test_last_line_of_a_name_counts_and_a_damaged_line_does_not(tmp_path):
    path = tmp_path / "a.h5"
    for content in (b"1", b"2"):
        path.write_bytes(content)
        record_sum(path)
    (tmp_path / SUMS).open("a").write("abc  a.h5\nhalf a li")
    assert recorded_sums(tmp_path) == {"a.h5": file_sum(path)}


def test_failed_missing_and_blocked(tmp_path):
    small = make_small(tmp_path)
    first = small.rows[0]
    write_failure(small.folder / "products", first.run_id, "Z still varies\nby 0.02")
    statuses = run_statuses(small.folder, small.rows)
    assert (statuses[first.run_id].status, statuses[first.run_id].reason) == ("failed", "Z still varies by 0.02")
    count = [s.status for s in statuses.values()]
    assert (count.count("failed"), count.count("missing")) == (5, 5)
    write_blocked(small.folder, statuses)
    assert len(list((small.folder / "products").glob("*.failed.json"))) == 5
    assert {r: s.status for r, s in run_statuses(small.folder, small.rows).items()} == {
        r: s.status for r, s in statuses.items()
    }
    set_aside(small.folder, [first.run_id])
    assert {s.status for s in run_statuses(small.folder, small.rows).values()} == {"missing"}


def test_set_aside_keeps_every_version(small):
    row = small.rows[-1]
    for _ in range(2):
        set_aside(small.folder, [row.run_id])
        synthetic_runs.write_product(small.folder, row, small.folder / small.rows[-2].product)
    kept = sorted(p.name for p in (small.folder / "products" / "refused").iterdir())
    assert kept == [f"{row.run_id}.1.h5", f"{row.run_id}.2.h5"]


def test_products_of_an_earlier_plan_are_stale_not_used(small):
    rest = [r for r in small.rows if r.stage != "shear"]
    assert stale(small.folder, rest) == sorted(r.run_id for r in small.rows if r.stage == "shear")
    assert set(run_statuses(small.folder, rest)) == {r.run_id for r in rest}


def test_lock_of_a_dead_process_does_not_count_as_running(tmp_path):
    small = make_small(tmp_path)
    (small.folder / "products").mkdir()
    (small.folder / "products" / f".{small.rows[0].run_id}.lock").write_text("")
    assert run_statuses(small.folder, small.rows)[small.rows[0].run_id].status == "missing"
