"""Sequential stopping: batches of points, spared runs, points filled by regression, and what a second run does."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
import synthetic_results as synthetic
import synthetic_runs
from campaign_cases import SUBMIT, slurm_of

from analysis.report import wording
from analysis.results.reader import read_results
from analysis.surrogates import stopping, surrogate
from analysis.surrogates.rotation import nested_order
from analysis.tables import evaluate as evaluate_tables
from campaign import batches, engine_slurm, evaluate
from campaign.config import ConfigError, parse_config, read_config
from campaign.config_checks import parse_share
from campaign.folder import write_failure
from campaign.plan import write_plan
from campaign.products import run_statuses, set_aside
from campaign.status import campaign_status, status_text

N, PACKINGS = 30, 4
TARGET = '[pdem]\nstop_when = "{}"\ncells = 64\n'


class Case:
    """A planned campaign of N points at one density whose engine writes synthetic products, noisy if asked."""

    def __init__(self, place, stop_when="5%", noise=0.0, n=N, more="", packings=PACKINGS):
        toml = synthetic_runs.write_config(place, n, TARGET.format(stop_when) + more)
        text = toml.read_text().replace("[0.001, 0.04]", "[0.04]").replace("= 0.1\n", "= 0.4\n")
        toml.write_text(text.replace("packings = [1]", f"packings = {packings}"))
        self.config, self.folder, self.noise = read_config(toml), place / "run", noise
        self.rows = synthetic_runs.planned(self.config, self.folder, n)
        write_plan(self.rows, self.folder)
        inputs = json.loads((self.folder / "inputs.json").read_text())
        inputs |= {"joint": INFO.joint.to_dict(), "pairs": INFO.pairs.tolist()}
        (self.folder / "inputs.json").write_text(json.dumps(inputs))
        self.batches, self.shown = [], []

    def engine(self, spared):
        statuses = run_statuses(self.folder, self.rows, spared=spared)
        to_run = [row for row in self.rows if statuses[row.run_id].status in ("missing", "refused")]
        set_aside(self.folder, [row.run_id for row in to_run])
        for row in to_run:
            write_product(self.folder, row, self.noise)
        self.batches.append(len({row.point for row in to_run} - {-1}))
        return len(to_run)

    def run(self, engine=None):
        return batches.run_in_steps(self.config, self.folder, self.rows, engine or self.engine, self.shown.append)

    def note(self):
        return json.loads((self.folder / batches.NOTE).read_text())

    def counts(self):
        return campaign_status(self.config, self.folder, self.rows)["counts"]["total"]


INFO = synthetic.campaign_info()


def write_product(folder, row, noise):
    """As synthetic_runs writes it, with an error of the packing on the whole curve of the stress ratio."""
    path = synthetic_runs.write_product(folder, row)
    if noise and row.stage == "shear":
        factor = 1 + noise * np.random.default_rng(row.point).standard_normal()
        with h5py.File(path, "r+") as file:
            sigma = file["record/sigma"]
            sigma[:, 2, 2] = sigma[:, 0, 0] + factor * (sigma[:, 2, 2] - sigma[:, 0, 0])
    return path


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A quiet campaign, run to its end and analysed."""
    case = Case(tmp_path_factory.mktemp("quiet"))
    case.added = case.run()
    case.line, case.frames = evaluate.analyse(case.config, case.folder, case.rows)
    return case


def test_quiet_runs_stop_early_and_the_rest_is_spared(stopped):
    note = stopped.note()
    assert note["reached"] and 12 <= note["used"] < N
    assert stopped.added == PACKINGS + 2 * note["used"]
    assert max(note["claimed"].values()) <= 0.05 and len(note["claimed"]) == 3
    assert [h["points"] for h in note["history"]] == sorted({h["points"] for h in note["history"]})
    counts = stopped.counts()
    assert counts["spared"] == 2 * (N - note["used"]) and counts["missing"] == 0
    assert counts["total"] == len(stopped.rows) == sum(v for k, v in counts.items() if k != "total")
    assert stopped.shown[-1].endswith("reached") and note["history"][-1]["sentence"] in stopped.shown[-1]
    text = status_text(campaign_status(stopped.config, stopped.folder, stopped.rows))
    assert "spared: " in text and "5.0% asked, reached" in text


def test_first_points_are_the_beginning_of_the_nested_order(stopped):
    note = stopped.note()
    points = synthetic.representative_points(N)
    assert note["order"] == list(nested_order(points.x))
    made = {row.point for row in stopped.rows if (stopped.folder / row.product).exists()} - {-1}
    assert made == set(note["order"][: note["used"]])


def test_a_rerun_does_nothing(stopped):
    before, shown = (stopped.folder / batches.NOTE).read_text(), len(stopped.shown)
    assert stopped.run() == 0
    assert (stopped.folder / batches.NOTE).read_text() == before and len(stopped.shown) == shown
    line, frames = evaluate.analyse(stopped.config, stopped.folder, stopped.rows)
    assert "up to date" in line and frames is None


def test_spared_points_are_filled_close_to_the_truth_and_marked(stopped):
    results = read_results(stopped.folder / "results.h5")
    filled, note = results.filled(0.04), stopped.note()
    ids = results.family_points().id
    assert set(ids[filled]) == set(note["order"][note["used"] :])
    assert results.probability(0.04) == pytest.approx(results.family_points().probability)
    counts = results.counts(0.04)
    assert (counts["spared"], counts["failed"], counts["lost_probability"]) == (N - note["used"], 0, 0)
    truth = synthetic.critical_eta(results.family_points().mu_s)
    assert results.state("critical", "eta", 0.04) == pytest.approx(truth, abs=0.05 * truth.std() * 3)
    exact = synthetic.stiffness(results.family_points().G_p, 0.04)
    assert results.state("probe", "G_0", 0.04) == pytest.approx(exact, rel=0.01)
    measured, points = results.measured("critical", "eta", 0.04), results.family_points()
    assert (np.isnan(measured) == filled).all()
    model = surrogate.fit(points.x, measured, results.packing(0.04)).predict(points.x)[0]
    assert results.state("critical", "eta", 0.04) == pytest.approx(np.where(filled, model, measured), rel=1e-9)
    eta = results.response("eta", 0.04)
    assert np.isfinite(eta.values).all() and not eta.extended.any()
    with h5py.File(stopped.folder / "results.h5") as file:
        assert file["families/coupled/0.04/responses/eta"].attrs["filled"] == filled.sum()
    assert (results.runs["status"] == "spared").sum() == 2 * filled.sum()
    notes = " ".join(
        wording.run_notes(results, evaluate_tables(results, ("runs", "run_counts", "report_facts", "archived_runs")))
    )
    assert f"{filled.sum()} of {N} points were not run; a regression" in notes


def test_all_points_run_where_the_noise_is_too_big(tmp_path):
    case = Case(tmp_path, "2%", noise=0.15, n=16)
    case.run()
    note = case.note()
    assert case.counts()["done"] == len(case.rows) and not note["reached"] and note["used"] == 16
    assert case.batches[0] == 12 and sum(case.batches) == 16
    judged = len(note["history"])
    assert case.run() == 0 and len(case.note()["history"]) == judged == 3


def test_with_two_packings_nothing_is_claimed_and_all_points_run(tmp_path):
    case = Case(tmp_path, "50%", n=14, packings=2)
    case.run()
    note = case.note()
    assert not note["reached"] and note["used"] == 14 and case.counts()["done"] == len(case.rows)
    assert all(value is None for judged in note["history"] for value in judged["claimed"].values())
    assert "the error cannot be judged, because the runs use 2 packings, and 3 are needed" in case.shown[-1]


def test_without_a_target_all_run_at_once(tmp_path):
    case = Case(tmp_path, "", n=4)
    assert case.run() == len(case.rows) and case.batches == [4]
    assert not (case.folder / batches.NOTE).exists()


def test_a_decision_stands_but_not_for_another_target_or_other_runs(stopped):
    def of(text):
        config = parse_config(stopped.config.text.replace('"5%"', text), stopped.config.source)
        return len(batches.spared(config, stopped.folder, stopped.rows))

    assert of('"5%"') == 2 * (N - stopped.note()["used"])
    assert of('""') == of('"4%"') == 0
    assert not batches.spared(stopped.config, stopped.folder, stopped.rows[1:])


def test_goes_on_after_an_engine_that_left_runs_undone(tmp_path):
    case = Case(tmp_path, "10%", n=14)

    def broken(spared):
        for row in [row for row in case.rows if row.run_id not in spared][:9]:
            write_product(case.folder, row, 0.0)
        return 9

    assert case.run(broken) == 9
    assert case.note()["history"] == [] and case.counts()["spared"] == 0
    case.run()
    assert case.note()["history"][0]["points"] == 12


def test_failed_runs_count_as_no_run(tmp_path):
    case = Case(tmp_path, "50%", n=14)
    first = [row for row in case.rows if row.stage == "shear" and row.point == 0][0]
    for row in case.rows:
        write_product(case.folder, row, 0.0)
    (case.folder / first.product).unlink()
    write_failure(case.folder / "products", first.run_id, "energy error 0.31 > 0.05")
    case.run()
    history = case.note()["history"]
    points = [h["points"] for h in history]
    assert case.note()["reached"]
    assert (points[-1] > 12) == (0 in case.note()["order"][:12])
    assert all(v is None for v in history[0]["claimed"].values()) == (len(history) > 1)


@pytest.mark.parametrize(
    "text", ["soon", "0%", "150%", "2", "-1%", "%", "nan", "", " ", "1", "100%", "5%%", "inf", "1,5%"]
)
def test_bad_targets_are_refused_by_name(text):
    if text:  # an empty text asks for no stopping
        with pytest.raises(ConfigError, match="pdem.stop_when = .* must be a share"):
            parse_config(f'[pdem]\nstop_when = "{text}"')
    with pytest.raises(ConfigError, match="must be a share"):
        parse_share(text)
    with pytest.raises(ValueError, match="stop_when"):
        stopping.parse_target(text)


@pytest.mark.parametrize("text", ["5%", " 2 % ", "0.05", "5e-2", "99.9%", ".5", "0.1 %", "1_0%"])
def test_good_targets_are_those_of_the_stopping_rule(text):
    assert parse_config(f'[pdem]\nstop_when = "{text}"').pdem.stop_when == text
    assert 0 < parse_share(text) == stopping.parse_target(text) < 1


def test_the_cluster_gets_one_batch_at_a_time(tmp_path, monkeypatch):
    """A stand-in for sbatch that numbers jobs; each submission is what an earlier one left to do."""
    case = Case(tmp_path, "2%", noise=0.15, n=14)
    monkeypatch.setenv("PATH", slurm_of(tmp_path, sbatch=SUBMIT, squeue="exit 0"))

    def submit():
        step = batches.next_step(case.config, case.folder, case.rows, case.shown.append)
        return step, engine_slurm.submit_missing(case.config, case.folder, case.rows, spared=step.spared)

    step, line = submit()
    assert not step.last and "4 consolidate" in line and "12 probe" in line and "12 shear" in line
    case.engine(step.spared)
    step, line = submit()
    assert not step.last and "2 probe" in line and "2 shear" in line and "consolidate" not in line
    case.engine(step.spared)
    step, line = submit()
    assert step.last and not step.spared and "nothing to submit" in line
    assert [h["points"] for h in case.note()["history"]] == [12, 14]


def test_what_runs_start_from_is_never_spared(tmp_path):
    """Two families, two packings, each point with its own consolidation."""
    more = "[families]\nG_p_only = true\n"
    case = Case(tmp_path, "5%", n=16, more=more, packings=2)
    text = case.config.text.replace("[consolidation]", "[consolidation]\nper_point = true")
    case.config = parse_config(text, case.config.source)
    case.rows = synthetic_runs.planned(case.config, case.folder, 16)
    step = batches.next_step(case.config, case.folder, case.rows)
    to_run = {row.run_id: row for row in case.rows if row.run_id not in step.spared}
    used = set(case.note()["order"][:12])
    assert all(row.start in to_run for row in to_run.values() if row.start)
    shear = [row for row in case.rows if row.stage == "shear"]
    assert {row.run_id for row in shear if row.point in used} == {r for r in to_run if r.startswith("shear")}
    assert len(to_run) < len(case.rows)
