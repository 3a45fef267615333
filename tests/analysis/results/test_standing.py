"""Standing of states: a test that ends early has no critical state, and a drift is judged over all points together."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
import synthetic_results as synthetic
from bench_standing import CASES, standings
from hdf5_files import changed_on_purpose

from analysis.results.build import build_results
from analysis.results.reader import NotReachedError, ResultsError, read_results
from analysis.results.standing import NOT_PROVEN, NOT_REACHED, PROVEN, critical_standing, peak_standing, pooled_drift
from analysis.tables import evaluate


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("n, packings", [(8, 1), (8, 4), (100, 1), (100, 20)])
def test_states_that_are_not_reached_are_withheld_and_steady_ones_are_not(case, n, packings):
    """Among 200 campaigns a share of 5 % is known to 3 % (two standard errors)."""
    shares = standings(case, n, packings, 1000, 200, seed=3)
    if case.startswith("too short"):
        assert shares[NOT_REACHED] == 1
    elif case == "long, still moving":
        assert shares[NOT_REACHED] >= 0.95 and shares[PROVEN] == 0
    else:
        assert shares[NOT_REACHED] <= 0.08


def test_a_steady_state_without_noise_is_proven_and_a_slow_drift_is_not_reached():
    strain, flat = np.linspace(0, 0.4, 81), np.ones((81, 5))
    running, probability = np.zeros((81, 5), bool), np.full(5, 0.2)
    standing = critical_standing(strain, {"eta": 0.65 * flat, "e": 0.63 * flat}, probability, running)
    assert standing.status == PROVEN and standing.shown and "limit 5 %" in standing.reason
    moving = 0.65 * flat * (1 + 0.5 * strain)[:, None]
    standing = critical_standing(strain, {"eta": moving, "e": 0.63 * flat}, probability, running)
    assert standing.status == NOT_REACHED and not standing.shown
    drift, error = pooled_drift(strain[50:], moving[50:], probability)
    middle = 1 + 0.5 * strain[50:].mean()
    assert drift == pytest.approx(0.5 * 0.15 / middle) and error == pytest.approx(0, abs=1e-12)


def test_one_run_proves_nothing_and_runs_that_stopped_as_steady_prove_it():
    strain, flat = np.linspace(0, 0.4, 81), np.full((81, 1), 0.65)
    values = {"eta": flat, "e": flat}
    assert critical_standing(strain, values, np.ones(1), np.zeros((81, 1), bool)).status == NOT_PROVEN
    extended = np.zeros((81, 1), bool)
    extended[70:] = True
    assert critical_standing(strain, values, np.ones(1), extended).status == PROVEN


def test_packings_are_the_clusters_that_give_the_error():
    """Four points in each of five packings, whose points share their drift."""
    rng = np.random.default_rng(1)
    strain = np.linspace(0.25, 0.4, 31)[1:]
    packing = np.repeat(np.arange(5), 4)
    values = 0.65 + 0.1 * rng.normal(size=5)[packing] * (strain - strain.mean())[:, None]
    drift, error = pooled_drift(strain, values, np.full(20, 0.05), packing)
    slopes = (values[-1] - values[0])[::4] / (strain[-1] - strain[0]) * 0.15 / values.mean()
    assert drift == pytest.approx(slopes.mean(), abs=1e-12)
    assert error == pytest.approx(1.4165 * slopes.std(ddof=1) / np.sqrt(5), rel=1e-3)


def test_error_of_a_drift_that_packings_share_covers_it():
    """|drift| exceeds 1.96 errors in 5 % of 600 campaigns of 40 points in 8 packings without a true drift."""
    rng = np.random.default_rng(2)
    strain = np.linspace(0.25, 0.4, 16)[1:]
    packing, probability = np.arange(40) % 8, rng.dirichlet(np.full(40, 8.0))
    outside = 0
    for _ in range(600):
        slope = rng.normal(size=8)[packing] + rng.normal(size=40)
        values = 1 + 0.1 * slope * (strain - strain.mean())[:, None]
        drift, error = pooled_drift(strain, values, probability, packing)
        outside += abs(drift) > 1.96 * error
    assert 0.025 < outside / 600 < 0.085


def test_a_maximum_at_the_end_is_no_peak():
    strain = np.linspace(0, 0.03, 61)
    assert peak_standing(strain, np.sqrt(strain)[:, None], np.ones(1)).status == NOT_REACHED
    strain = np.linspace(0, 0.4, 81)
    assert peak_standing(strain, np.sqrt(strain)[:, None], np.ones(1)).status == NOT_PROVEN
    humped = synthetic.eta(strain, 0.25, 0.001)
    assert peak_standing(strain, humped[:, None], np.ones(1)).status == PROVEN


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Eight points sheared to 20 % strain: a peak, and no critical state."""
    folder = tmp_path_factory.mktemp("short")
    points = synthetic.representative_points(8)
    plan = synthetic.plan_rows(folder, points, densities=(0.001, 0.1))
    for row in plan.itertuples():
        synthetic.write_run(row, noise=0.02, end=0.2, windows=60)
    return read_results(build_results(folder, plan, points, synthetic.campaign_info()))


def test_the_reader_withholds_what_was_not_reached_with_the_reason(short):
    assert short.standing("critical", 0.1).status == NOT_REACHED and short.standing("peak", 0.001).status == PROVEN
    with pytest.raises(NotReachedError, match=r"eta at the critical state .* not reached, the test ends at 20 % axial"):
        short.state("critical", "eta", 0.1)
    assert np.isfinite(short.state("critical", "eta", 0.1, withheld="show")).all()
    assert np.isnan(short.state("critical", "eta", 0.1, withheld="nan")).all()
    assert short.standing("probe", 0.1).shown and np.isfinite(short.state("probe", "G_0", 0.1)).all()
    with pytest.raises(ResultsError, match="no state 'residual'"):
        short.standing("residual", 0.1)


def test_no_table_shows_a_critical_state_that_was_not_reached(short):
    frames = evaluate(short)
    states = frames["peak_critical"].set_index(["state", "quantity", "mu_iso"]).sort_index()
    assert set(states.loc["critical", "standing"]) == {NOT_REACHED}
    assert states.loc["critical", ["mean", "sd", "min", "q95"]].isna().all(axis=None)
    assert states.loc[("peak", "eta", 0.001), "mean"] > 0.5
    angles = frames["design"].set_index(["state", "mu_iso"])
    assert angles.loc["critical", "mean_deg"].isna().all() and angles.loc["peak", "mean_deg"].notna().all()
    assert not (frames["moments"]["state"] == "critical").any() and (frames["moments"]["state"] == "peak").any()
    claims = frames["claims"]
    assert set(claims.loc[claims["claim"].str.contains("critical"), "verdict"]) == {"inconclusive"}
    assert not len(frames["friction"]) or not (frames["friction"]["state"] == "critical").any()


def test_results_of_earlier_versions_are_judged_from_their_curves(short, tmp_path):

    path = shutil.copy(short.path, tmp_path / "results.h5")
    with changed_on_purpose(path) as file:
        for state in ("peak", "critical"):
            for name in ("standing", "standing_reason"):
                del file[f"families/coupled/0.1/states/{state}"].attrs[name]
    again = read_results(path)
    for state in ("peak", "critical"):
        assert again.standing(state, 0.1) == short.standing(state, 0.1)
