"""The laptop campaign in the repository: its figures and tables are those of its results file."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

import h5py
import laptop_plan
import numpy as np
import pandas as pd
import pytest
import report_pages
import start_of_shear
import synthetic_results as synthetic
from campaign_cases import finish, make_small

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "data"))

import make_laptop  # noqa: E402

from analysis.figures import write_figures  # noqa: E402
from analysis.results.reader import read_results  # noqa: E402
from analysis.runs import run_file  # noqa: E402
from analysis.runs.archive import Archive, run_summary  # noqa: E402
from analysis.tables import evaluate, write_tables  # noqa: E402
from campaign.evaluate import archive  # noqa: E402
from campaign.folder import write_failure  # noqa: E402
from campaign.plan import STAGES  # noqa: E402
from campaign.products import run_statuses  # noqa: E402

LAPTOP = ROOT / "data" / "laptop"
needs_laptop = pytest.mark.skipif(not (LAPTOP / "results.h5").exists(), reason="data/laptop holds no results yet")


@pytest.fixture(scope="module")
def frames():
    return evaluate(LAPTOP / "results.h5")


@needs_laptop
@pytest.mark.long
def test_the_committed_figures_are_those_of_the_results(frames, tmp_path):
    """To the last byte where matplotlib is the one they were drawn with; else that none is missing."""
    results = read_results(LAPTOP / "results.h5")
    drawn = write_figures(results, frames, tmp_path)
    assert {p.name for p in drawn} == {p.name for p in (LAPTOP / "figures").glob("*.png")}
    if results.attrs["versions"]["matplotlib"] == metadata.version("matplotlib"):
        assert [p.name for p in drawn if p.read_bytes() != (LAPTOP / "figures" / p.name).read_bytes()] == []


@needs_laptop
@pytest.mark.long
def test_the_committed_tables_are_those_of_the_results(frames, tmp_path):
    paths = write_tables(frames, tmp_path)
    pairs = [(pd.read_csv(path), pd.read_csv(LAPTOP / "tables" / path.name)) for path in paths]
    for ours, kept in pairs:
        pd.testing.assert_frame_equal(ours, kept, rtol=1e-4, atol=1e-9)


@needs_laptop
def test_the_committed_report_has_one_value_for_every_quoted_quantity():
    quote = pd.read_csv(LAPTOP / "tables" / "quote.csv")
    source = (LAPTOP / "report.html").read_text("utf-8")
    assert len(quote) == 30 and report_pages.problems(source, quote) == []


@needs_laptop
@pytest.mark.parametrize("path", sorted((LAPTOP / "example_runs").glob("*.h5")), ids=lambda p: p.name.split("_")[0])
def test_a_run_is_measured_as_the_archive_has_it(path):
    """The archive was written when the campaign ran: facts, states and curves of its runs must not change."""
    new, old = run_summary(run_file.read_run(path)), Archive(LAPTOP / "runs.h5")[path.stem]
    kept = old.facts | {"measured_by": ""}
    _assert_same({name: new.facts[name] for name in kept}, kept)
    for part in ("states", "errors", "drift", "responses"):
        _assert_same(*(getattr(one.states, part, {}) for one in (new, old)), part)


def _assert_same(ours, kept, name=""):
    """To 1e-12 with the numpy that the archive was written with: processors round sums in another order, as other
    versions do.
    """
    if isinstance(kept, Mapping):
        assert set(ours) == set(kept), name
        for key in kept:
            _assert_same(ours[key], kept[key], f"{name} {key}")
    elif isinstance(kept, str):
        assert ours == kept, name
    else:
        rtol, atol = (1e-12, 1e-13) if np.__version__ == "1.24.2" else (1e-9, 1e-12)
        np.testing.assert_allclose(np.asarray(ours, float), np.asarray(kept, float), rtol, atol, err_msg=name)


@needs_laptop
def test_the_plan_predicts_what_the_campaign_took():
    plan, runs = laptop_plan.planned(), read_results(LAPTOP / "results.h5").runs
    for stage, of_stage in runs.groupby("stage"):
        keys = zip(of_stage["stage"], of_stage["family"], of_stage["mu_iso"], of_stage["point"], strict=True)
        predicted, taken = sum(plan[key].cpu_seconds for key in keys), of_stage["cpu_seconds"].sum()
        assert predicted == pytest.approx(taken, rel=0.15), stage
    assert set(runs["stage"]) == set(STAGES)


@needs_laptop
def test_the_results_are_small_and_every_run_has_a_product_or_a_reason():
    assert (LAPTOP / "results.h5").stat().st_size <= make_laptop.LIMIT_MIB * 2**20
    runs = read_results(LAPTOP / "results.h5").runs
    assert set(runs["status"]) <= {"done", "failed", "spared"}
    assert (runs.loc[runs["status"] != "done", "reason"].str.len() > 0).all()


@needs_laptop
def test_the_deviatoric_stress_never_falls_at_the_start_of_shear():
    """In none of the shear runs, and each of them is one that the test would catch if it did.

    q over sigma_3 follows from eta, since sigma_3 is constant.
    """
    lowest, scatter = [], []
    for run_id, run in Archive(LAPTOP / "runs.h5").items():
        if run_id.startswith("shear"):
            eta = run.states.responses["eta"]
            q = 3.0 * eta / (3.0 - eta)
            of_run = start_of_shear.lowest_and_scatter(run.states.eps_a, q)
            lowest.append(of_run[0])
            scatter.append(of_run[1])
            assert not start_of_shear.falls(run.states.eps_a, q), f"{run_id}: q falls by {-of_run[0]:.3g} sigma_3"
            for share, caught in ((0.9, False), (1.1, True)):  # the record with such a fall in the first window
                changed = np.where(np.arange(len(q)) == 1, q[0] - share * of_run[1], q)
                assert start_of_shear.falls(run.states.eps_a, changed) == caught, run_id
    assert len(lowest) == 360
    print(f"lowest q - q at rest: {min(lowest):.3f} sigma_3 in the worst run, {np.median(lowest):.3f} in the median; "
          f"scatter {np.median(scatter):.3f}, at most {max(scatter):.3f}")  # fmt: skip
    assert min(lowest) > 0.0


@needs_laptop
def test_the_example_runs_are_one_chain():
    stages = {run.stage: run for run in map(run_file.read_run, (LAPTOP / "example_runs").glob("*.h5"))}
    assert set(stages) == {"consolidate", "probe", "shear"}
    assert Path(stages["shear"].parameters["start"]).stem == stages["probe"].path.stem


def test_filling_it_copies_results_and_one_chain_of_runs(tmp_path, monkeypatch):
    plan, points, info = synthetic.make_campaign(tmp_path / "run", n=3)
    from analysis.results.build import build_results

    build_results(tmp_path / "run", plan, points, info)
    monkeypatch.setattr(make_laptop, "report_of_file", lambda results, folder: f"{results} {folder}")
    target = tmp_path / "data" / "laptop"
    make_laptop.fill(tmp_path / "run", target)
    kept = {path.stem for path in (target / "example_runs").glob("*.h5")}
    middle = int(points.id[np.argmin(np.abs(points.mu_s - np.median(points.mu_s)))])
    rest = {f"{stage}_coupled_{middle}_iso0.04_s1" for stage in ("probe", "shear")}
    assert kept == {"consolidate_shared_-1_iso0.04_s1"} | rest
    assert (target / "results.h5").read_bytes() == (tmp_path / "run" / "results.h5").read_bytes()


def test_a_sitting_on_another_machine_starts_with_what_the_archive_keeps(tmp_path):
    small = finish(make_small(tmp_path))
    archive(small.folder, small.rows)
    write_failure(small.folder / "products", "shear_x", "blow-up")
    target, elsewhere = tmp_path / "data", tmp_path / "elsewhere"
    make_laptop.keep(small.folder, target)
    make_laptop.take_up(target, elsewhere)
    assert {s.status for s in run_statuses(elsewhere, small.rows).values()} == {"done"}
    assert (elsewhere / "products" / "shear_x.failed.json").exists()
    (elsewhere / "points.csv").write_text("another plan")
    make_laptop.take_up(target, elsewhere)
    assert (elsewhere / "points.csv").read_text() == "another plan"


def test_results_too_big_for_the_repository_are_refused(tmp_path, monkeypatch):
    shutil.copyfile(synthetic.example(), tmp_path / "results.h5")
    monkeypatch.setattr(make_laptop, "LIMIT_MIB", 0.01)
    with pytest.raises(SystemExit, match="limit 0.01 MiB"):
        make_laptop.fill(tmp_path, tmp_path / "target")
    assert not (tmp_path / "target").exists()


def test_the_results_file_names_the_versions_that_made_it():
    with h5py.File(synthetic.example()) as file:
        versions = json.loads(file.attrs["versions"])
    assert versions["h5py"] == h5py.__version__ and versions["numpy"] == np.__version__
    assert "matplotlib" in versions and "not installed" not in versions.values()
