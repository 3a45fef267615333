"""The commands in order, end to end on products in closed form, and that nothing is done twice."""

import json
import resource
import shutil

import h5py
import pytest
import synthetic_results
from campaign_cases import finish, make_small

from analysis.figures import FIGURES
from campaign import evaluate
from campaign.__main__ import main


def test_help_names_every_command(tmp_path):
    small = make_small(tmp_path)
    text = small.command("plan", "--help").stdout
    assert "--folder" in text and "runs/<name>" in text


def test_plan_predicts_the_cost_before_anything_is_spent(tmp_path):
    small = make_small(tmp_path, n=8)
    done = small.command("plan")
    assert done.returncode == 0, done.stderr
    assert "8 points kept, 34 runs" in done.stdout and "core-hours" in done.stdout
    assert not list((small.folder).glob("products/*.h5"))
    for name in ("points.csv", "config.toml", "tables/plan.csv", "batch/shear.table", "assembly_1.h5"):
        assert (small.folder / name).exists(), name


def test_missing_lists_run_ids_and_nothing_else(tmp_path):
    small = make_small(tmp_path)
    finish(small, small.rows[4])
    assert small.command("missing").stdout == f"{small.rows[4].run_id}\n"


def test_analyse_waits_for_the_last_run(tmp_path):
    small = make_small(tmp_path)
    finish(small, small.rows[-1])
    done = small.command("analyse")
    assert done.returncode == 2 and small.rows[-1].run_id in done.stderr
    assert not (small.folder / "results.h5").exists()


def test_results_know_where_they_come_from_and_are_made_once(tmp_path):
    small = make_small(tmp_path, n=8)
    finish(small)
    fits = json.loads((small.folder / "inputs.json").read_text())
    done = small.command("analyse")
    assert done.returncode == 0, done.stderr
    with h5py.File(small.folder / "results.h5", "r") as file:
        assert file.attrs["campaign"] == "small" and file.attrs["config"] == small.toml.read_text()
        assert {name.decode() for name in file["runs/run_id"]} == {r.run_id for r in small.rows}
        assert file["inputs/pairs"].shape == (len(fits["pairs"]), 2)
    stamp = (small.folder / "results.h5").stat().st_mtime_ns
    assert "up to date" in small.command("analyse").stdout
    assert (small.folder / "results.h5").stat().st_mtime_ns == stamp


def test_changed_setting_or_product_makes_results_anew(tmp_path):
    small = make_small(tmp_path)
    finish(small)
    digest = evaluate._digest(small.config, small.folder, small.rows)
    assert evaluate._digest(small.config, small.folder, small.rows) == digest
    path = small.product()
    path.write_bytes(path.read_bytes())
    assert evaluate._digest(small.config, small.folder, small.rows) != digest


def test_report_is_written_once_for_the_same_results(tmp_path, monkeypatch):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "results.h5").write_bytes(b"results")
    written = []

    def write_report(results, place):
        written.append(results)
        (place / "report.html").write_text("<html>")
        return place / "report.html"

    monkeypatch.setattr("analysis.report.write_report", write_report)
    assert "report.html" in evaluate.report(None, folder) and "up to date" in evaluate.report(None, folder)
    (folder / "results.h5").write_bytes(b"other results")
    assert "up to date" not in evaluate.report(None, folder)
    assert len(written) == 2


def test_a_results_file_alone_gives_the_same_report_wherever_it_lies(tmp_path, monkeypatch, capsys):
    """Tables, pictures and page, byte by byte; two figures stand for all, which data/laptop compares."""
    for name in set(FIGURES) - {"fig02_data_marginals", "fig10_coordination"}:
        monkeypatch.delitem(FIGURES, name)
    written = []
    for place in (tmp_path / "one", tmp_path / "other"):
        place.mkdir()
        copy = shutil.copyfile(synthetic_results.example(noise=0.02), place / "results.h5")
        assert main(["report", str(copy)]) == 0
        assert "14 tables" in capsys.readouterr().out
        written.append({str(p.relative_to(place)): p.read_bytes() for p in place.rglob("*") if p.is_file()})
    assert written[0] == written[1]
    assert {"report.html", "tables/claims.csv", "figures/fig10_coordination.png"} < set(written[0])


def test_a_results_file_that_is_none_ends_in_one_line(tmp_path, capsys):
    (tmp_path / "results.h5").write_text("nothing")
    assert main(["report", str(tmp_path / "results.h5")]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not (tmp_path / "tables").exists()


@pytest.mark.long
def test_all_again_takes_less_than_five_cpu_seconds_and_starts_nothing(tmp_path):
    """CPU seconds of the whole second command, as a promise to whoever types it again."""
    small = make_small(tmp_path, n=8, fitted=True)
    finish(small)
    first = small.command("all", "--quiet")
    assert first.returncode == 0, first.stderr
    assert (small.folder / "report.html").exists()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    second = small.command("all", "--quiet")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert second.returncode == 0 and small.started() == []
    assert second.stdout.count("up to date") == 2
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 5.0
