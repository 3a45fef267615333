"""Claims: verdicts follow the interval, and numbers are those of synthetic campaigns with known answers."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import synthetic_results as synthetic

from analysis import claim_numbers as numbers
from analysis import paper, weighted
from analysis.claims import HELD, NOT_HELD, OPEN, claims_table, verdict
from analysis.responses import build_results
from analysis.results import read_results


@pytest.fixture(scope="module")
def results():
    return read_results(synthetic.example())


@pytest.fixture(scope="module")
def table(results):
    """Claims of the noise-free example, keyed by the claim's words."""
    return claims_table(results, n_boot=40).set_index("claim")


@pytest.mark.parametrize("low, high, sense, limit, outcome", [
    (0.1, 0.2, "<=", 0.25, HELD), (0.3, 0.4, "<=", 0.25, NOT_HELD), (0.2, 0.3, "<=", 0.25, OPEN),
    (0.6, 0.7, ">=", 0.5, HELD), (0.3, 0.4, ">=", 0.5, NOT_HELD), (0.4, 0.6, ">=", 0.5, OPEN),
    (np.nan, 0.4, ">=", 0.5, OPEN), (0.5, 0.5, ">=", 0.5, HELD), (-0.1, 0.2, "|x| <=", 0.25, HELD),
    (-0.4, -0.3, "|x| <=", 0.25, NOT_HELD), (-0.3, 0.1, "|x| <=", 0.25, OPEN),
])  # fmt: skip
def test_the_verdict_follows_the_whole_interval(low, high, sense, limit, outcome):
    assert verdict(low, high, sense, limit) == outcome


def test_closed_forms_that_forget_the_density_are_held(table):
    for words in ("stress ratio coincide", "void ratio coincide"):
        rows = table[table.index.str.contains(words)]
        assert len(rows) and (rows["verdict"] == HELD).all() and (rows["value"] < 0.05).all()
    peak = table.loc[table.index.str.contains("At the peak the PDFs"), "verdict"]
    told = peak.index.str.contains("stress ratio")  # of the others one packing does not tell what packings add
    assert (peak[told] == HELD).all() and (peak[~told] == OPEN).all() and told.sum() == 1


def test_the_peak_distance_is_the_wasserstein_distance_over_the_spread(results, table):
    a, b = (results.state("peak", "eta", mu_iso) for mu_iso in (0.001, 0.1))
    w = results.weights(0.04)
    exact = weighted.wasserstein(a, b, w, w) / np.mean([weighted.std(a, w), weighted.std(b, w)])
    assert table.loc["At the peak the PDFs of the stress ratio differ between densities", "value"] == pytest.approx(
        exact
    )


def test_the_coordination_number_has_to_forget_the_density_at_the_peak_too(results, table):
    """In the closed form it does so at the critical state only."""
    w = results.weights(0.04)
    at = {state: [results.state(state, "Z", m) for m in (0.001, 0.1)] for state in ("peak", "critical")}
    exact = {state: weighted.wasserstein(a, b, w, w) / np.mean([weighted.std(a, w), weighted.std(b, w)])
             for state, (a, b) in at.items()}  # fmt: skip
    row = table.loc["The coordination number forgets the density"]
    assert exact["critical"] < 0.01 and row["value"] == pytest.approx(exact["peak"]) and row["verdict"] == OPEN


def test_stiffness_claims(table):
    assert table.loc["Dense samples have the higher G_0", "value"] == pytest.approx(1.12 / 0.88 - 1)
    assert table.loc["G_p moves the small-strain stiffness", "value"] == pytest.approx(2 / 3)
    alone = table.loc["G_p alone hardly moves the stress ratio at large strain"]
    assert alone["value"] == pytest.approx(0, abs=1e-9) and alone["verdict"] == HELD and "mu_s fixed" in alone["number"]


def test_correlations_of_the_critical_state(results, table):
    eta, e, Z, w = (*(results.state("critical", s, 0.04) for s in ("eta", "e", "Z")), results.weights(0.04))
    value = table.loc["A higher critical eta goes with a larger void ratio", "value"]
    assert value == pytest.approx(weighted.correlation(eta, e, w), abs=1e-3)
    value = table.loc["A higher critical eta goes with a smaller coordination number", "value"]
    assert value == pytest.approx(-weighted.correlation(eta, Z, w), abs=1e-3)


def test_the_steady_strain_is_that_of_the_closed_form(results, table):
    weight, strain = results.weights(0.001), results.strain
    mu_s = results.family_points()["mu_s"]
    mean = np.array([synthetic.eta(strain, m, 0.001) for m in mu_s]).T @ weight
    off = np.flatnonzero(abs(mean / mean[strain >= 0.3].mean() - 1) > 0.03)
    assert table.loc["The critical state is reached by 25 % strain", "value"] == pytest.approx(strain[off[-1] + 1])


def test_noise_that_lets_a_mean_leave_its_range_late_refutes_nothing(results, monkeypatch):
    monkeypatch.setattr(numbers, "steady_strain", lambda samples, **_: 0.4)
    monkeypatch.setattr(numbers, "stiffness_exponent", lambda samples: 0.0)
    table = claims_table(results, n_boot=2).set_index("claim")
    assert (table.loc[table.index.str.contains("by 25 % strain"), "verdict"] == OPEN).all()
    assert table.loc["G_p moves the small-strain stiffness", "verdict"] == NOT_HELD


def test_table_3_and_grading(table):
    mine = max(abs((1.02 * synthetic.E_0[m] + 0.035) / paper.INITIAL_STATE[("e_m", m)][0] - 1) for m in (0.001, 0.1))
    row = table.loc["The initial states are those of Table 3"]
    assert row["value"] == pytest.approx(mine, rel=1e-3) and row["verdict"] == OPEN  # one packing has no error
    row = table.loc["e and e_m grow and Z and Z_m fall with mu_iso"]
    assert row["value"] > 0.02 and row["verdict"] == OPEN
    assert table.loc["I_G_active and I_G_stress hardly vary (COV about 0.001)", "verdict"] == HELD


def test_the_interval_holds_the_value_and_is_repeatable(results, table):
    again = claims_table(results, n_boot=40).set_index("claim")
    assert again.equals(table)
    smooth = table[~table["number"].str.contains("largest|least|Wasserstein") & table["from"].notna()]
    assert ((smooth["from"] <= smooth["value"] + 1e-9) & (smooth["value"] <= smooth["to"] + 1e-9)).all()


@pytest.mark.parametrize("packings, noise, outcome", [
    ((1,), 0.02, OPEN), ((1,), 1e-4, OPEN), ((1, 2, 3), 1e-3, NOT_HELD)])  # fmt: skip
def test_only_replicates_let_densities_that_differ_refute_a_claim(tmp_path, packings, noise, outcome):
    """Three densities that differ at the critical state: one packing does not tell whether it is the packing."""
    plan, points, settings = synthetic.make_campaign(tmp_path, n=5, noise=noise, packings=packings)
    path = build_results(tmp_path, plan, points, settings)
    with h5py.File(path, "r+") as file:
        for mu_iso, shift in zip(synthetic.DENSITIES, (-1.0, 1.2, 0.3), strict=True):
            states = file[f"families/coupled/{mu_iso:g}/states/critical"]
            states["eta"][...] = synthetic.critical_eta(points["mu_s"].to_numpy()) + 0.03 * shift
    claim = "At the critical state the PDFs of the stress ratio coincide for all densities"
    row = claims_table(path, n_boot=40).set_index("claim").loc[claim]
    assert row["value"] > 0.5 and row["verdict"] == outcome
