"""The commands in order, from plan to report on synthetic products, and that nothing is done twice."""

import io
import json
import re
import resource
import shutil
import sys
from dataclasses import asdict

import h5py
import numpy as np
import pytest
import synthetic_results
from campaign_cases import finish, make_small, needs_batch

import analysis.figures
from analysis.errors_and_files import GrainScatterError
from analysis.figures import FIGURES
from analysis.results.reader import read_results
from analysis.runs.peak_critical import stress_ratio
from analysis.tables.registry import TABLES
from campaign import evaluate
from campaign.__main__ import main
from campaign.config import ConfigError, parse_config
from campaign.config_keys import SECTIONS
from campaign.folder import recorded_sums
from campaign.prepare import PlanError


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


def test_a_log_file_gets_every_line_when_it_is_printed(tmp_path, monkeypatch):
    log = io.TextIOWrapper(io.BytesIO())
    monkeypatch.setattr(sys, "stdout", log)
    assert main(["status", str(tmp_path / "none.toml")]) == 2
    assert log.line_buffering


def test_plan_warns_if_the_last_window_ends_before_the_critical_state(tmp_path):
    small = make_small(tmp_path, n=8)
    text = small.toml.read_text().replace("N = 64", "N = 200")
    for end, warned in ((0.28, True), (0.285, False)):
        small.toml.write_text(re.sub(r"strain_end = .*", f"strain_end = {end}", text))
        done = small.command("plan")
        assert done.returncode == 0 and ("none will be given" in done.stdout) == warned, done.stderr
        assert ("strain_end = 0.2825" in done.stdout) == warned


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


def test_a_number_leads_back_to_its_run_parameters_versions_and_seeds(tmp_path):
    """From one value of results.h5 to the product behind it, by what stands in results.h5 alone."""
    small = make_small(tmp_path, n=8)
    finish(small)
    assert small.command("analyse").returncode == 0
    results = read_results(small.folder / "results.h5")
    eta = results.response("eta", mu_iso=0.04)
    points = results.family_points()
    assert {"python", "numpy", "scipy", "pandas", "h5py", "matplotlib", "analysis code"} == {*results.attrs["versions"]}
    settings = results.attrs["settings"]  # defaults included
    assert (settings["inputs"]["seed"], settings["points"]["seed"], settings["assembly"]["packings"]) == (1, 1, [1])
    for k, point in enumerate(points):
        runs = results.runs
        (run,) = runs[(runs.stage == "shear") & (runs.mu_iso == 0.04) & (runs.point == point.id)].itertuples()
        with h5py.File(small.folder / "products" / f"{run.run_id}.h5") as product:
            ratio = stress_ratio(product["record/sigma"][()])
            assert np.interp(results.strain[-1], product["record/eps_a"][()], ratio) == pytest.approx(eta.values[-1, k])
            used, head = product["parameters"].attrs, product.attrs
            assert (used["mu_s"], used["G_p"], used["seed"]) == (point.mu_s, point.G_p, run.packing)
            assert (head["yade_version"], head["script_digest"], head["created"]) == (
                run.yade_version, run.script_digest, run.created)  # fmt: skip
            assert f"{run.run_id}.h5" in recorded_sums(small.folder / "products")


@needs_batch
def test_changed_config_keeps_what_it_does_not_touch_and_says_what_is_stale(tmp_path):
    small = finish(make_small(tmp_path))
    text, before = small.toml.read_text(), small.sums()
    small.toml.write_text(text + "[run]\njobs = 3\n[pdem]\ncells = 200\n")
    status = small.status()
    assert status["counts"]["total"]["done"] == 10 and status["stale"] == []
    small.toml.write_text(text.replace("strain_end = 0.1", "strain_end = 0.08"))
    status = small.status()
    assert status["counts"]["total"] | {"done": 6, "missing": 4, "total": 10} == status["counts"]["total"]
    assert status["stale"] == sorted(row.run_id for row in small.rows if row.stage == "shear")
    assert "stale: 4 products of earlier settings, kept and not used" in small.command("status").stdout
    refused = small.command("analyse")
    assert refused.returncode == 2 and "4 of 10 runs have no product yet" in refused.stderr
    assert small.command("run").returncode == 0
    assert len(small.started()) == 4 and not set(small.started()) & set(before)
    assert before.items() <= small.sums().items()
    small.toml.write_text(text)  # and back: everything is there
    assert small.total("done") == 10


def test_changed_setting_or_product_makes_results_anew(tmp_path):
    small = make_small(tmp_path)
    finish(small)
    digest = evaluate.results_digest(small.config, small.folder, small.rows)
    assert evaluate.results_digest(small.config, small.folder, small.rows) == digest
    path = small.product()
    path.write_bytes(path.read_bytes())
    assert evaluate.results_digest(small.config, small.folder, small.rows) != digest


@pytest.fixture
def drawn(monkeypatch):
    """The arguments of every call of the analysis from `campaign.evaluate`, by function; nothing is computed."""
    calls = {"evaluate": [], "write_report": []}

    def evaluate_tables(results):
        calls["evaluate"].append(results)
        return {"points": f"frame of {results}"}

    def write_report(results, frames, folder):
        calls["write_report"].append((results, frames))
        (folder / "report.html").write_text("<html>")
        return folder / "report.html"

    monkeypatch.setattr("analysis.results.read_results", lambda path: path.read_text())
    monkeypatch.setattr("analysis.tables.evaluate", evaluate_tables)
    monkeypatch.setattr("analysis.report.write_report", write_report)
    monkeypatch.setattr(evaluate, "_changed_setting", lambda config, path: "")
    return calls


def test_report_is_written_once_for_the_same_results(tmp_path, drawn):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "results.h5").write_text("results")
    config = parse_config("")
    assert "report.html" in evaluate.report(config, folder) and "up to date" in evaluate.report(config, folder)
    (folder / "results.h5").write_text("other results")
    assert "up to date" not in evaluate.report(config, folder)
    assert drawn["write_report"] == [(r, {"points": f"frame of {r}"}) for r in ("results", "other results")]


def test_a_report_of_other_settings_is_refused(tmp_path):
    """It once said "report.html is up to date" although results.h5 belonged to the settings before."""
    settings = {name: asdict(kind()) for name, kind in SECTIONS.items()}
    with h5py.File(tmp_path / "results.h5", "w") as file:
        file.attrs["settings"] = json.dumps(settings)
    (tmp_path / "report.html").write_text("<html>")
    with pytest.raises(
        PlanError, match=r"other settings \(shear.strain_end = 0.4, now 0.2\); `analyse` makes it again"
    ):
        evaluate.report(parse_config("[shear]\nstrain_end = 0.2\n"), tmp_path)
    assert evaluate._changed_setting(parse_config("[run]\njobs = 2\n"), tmp_path / "results.h5") == ""


def test_tables_that_are_handed_on_are_not_computed_again(tmp_path, drawn):
    (tmp_path / "results.h5").write_text("results")
    frames = {"points": "a frame"}
    evaluate.report(parse_config(""), tmp_path, frames)
    assert drawn == {"evaluate": [], "write_report": [("results", frames)]}


@pytest.mark.parametrize("error", [GrainScatterError("mu_s = -1 is below 0"), ConfigError("n = 1")])
def test_errors_of_use_end_in_one_line_and_others_in_a_traceback(tmp_path, error, monkeypatch, capsys):
    small = make_small(tmp_path)

    def run(*command):
        return main([command[0], str(small.toml), "--folder", str(small.folder)])

    def fail(raised):
        def planned(*_):
            raise raised

        monkeypatch.setattr("campaign.commands.read_planned_points", planned)

    fail(error)
    assert run("status") == 2 and capsys.readouterr().err == f"campaign: {error}\n"
    for bug in (ValueError("a bug"), RuntimeError("a bug"), KeyError("a bug")):
        fail(bug)
        with pytest.raises(type(bug)):
            run("status")


def test_a_results_file_alone_gives_the_same_report_wherever_it_lies(tmp_path, monkeypatch, capsys):
    """Tables, pictures and page, byte by byte; two figures stand for all, which data/laptop compares."""
    few = {name: FIGURES[name] for name in ("fig02_data_marginals", "fig10_coordination")}
    monkeypatch.setattr(analysis.figures, "FIGURES", few)
    written = []
    for place in (tmp_path / "one", tmp_path / "other"):
        place.mkdir()
        copy = shutil.copyfile(synthetic_results.example(noise=0.02), place / "results.h5")
        assert main(["report", str(copy)]) == 0
        tables = len(list((place / "tables").glob("*.csv")))
        assert f"{tables} tables" in capsys.readouterr().out and tables <= len(TABLES)
        written.append({str(p.relative_to(place)): p.read_bytes() for p in place.rglob("*") if p.is_file()})
    assert written[0] == written[1]
    assert {"report.html", "tables/claims.csv", "figures/fig10_coordination.png"} < set(written[0])


def test_figures_for_print_lie_beside_the_others_and_leave_the_report_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(analysis.figures, "FIGURES", {"fig02_data_marginals": FIGURES["fig02_data_marginals"]})
    results = shutil.copyfile(synthetic_results.example(noise=0.02), tmp_path / "results.h5")
    assert main(["report", str(results)]) == 0
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    capsys.readouterr()
    assert main(["report", str(results), "--figures", "pdf", "--columns", "1"]) == 0
    assert "1 figures for print (pdf, columns: 1)" in capsys.readouterr().out
    after = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    assert after.keys() - before.keys() == {tmp_path / "figures" / "print" / "fig02_data_marginals.pdf"}
    assert {p: after[p] for p in before} == before


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
