"""Noise of the packing: scatter between replicates, and the error that all points of a density share."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis.results import replicates
from analysis.results.build import build_results
from analysis.results.reader import Results, read_results
from analysis.tables import packing_noise
from analysis.tables.claim_statistics import drawn_sample, full_sample
from analysis.tables.claims import CONTRADICTED, INCONCLUSIVE, SUPPORTED, claims_table


@pytest.fixture(scope="module")
def replicated(tmp_path_factory):
    """Two points, three packings, 2 % noise."""
    folder = tmp_path_factory.mktemp("replicated")
    plan, points, info = synthetic.make_campaign(folder, n=2, noise=0.02, packings=(1, 2, 3))
    return read_results(build_results(folder, plan, points, info))


def test_packing_scatter_is_the_spread_between_packings(replicated):
    sets = replicated.state_replicates("critical", "eta", 0.1)
    exact = (sets.var(axis=0, ddof=1).mean()) ** 0.5
    assert packing_noise.packing_scatter(replicated, "critical", "eta", 0.1) == pytest.approx(exact)


@pytest.mark.parametrize(("between", "own"), [(0.05, 0.01), (0.02, 0.02), (0.0, 0.02)])
def test_the_common_error_covers_what_all_points_are_off_by(between, own, monkeypatch):
    """Thirty points, five of them in five packings; 1.96 errors cover 95 % of 600 levels."""
    rng = np.random.default_rng(3)
    results, covered = read_results(synthetic.example()), []
    monkeypatch.setattr(Results, "probability", lambda *_: np.full(30, 1 / 30))
    for _ in range(200):
        sets = {m: own * rng.normal(size=(5, 30)) + between * rng.normal(size=(5, 1)) for m in synthetic.DENSITIES}
        for values in sets.values():
            values[1:, 5:] = np.nan
        monkeypatch.setattr(Results, "state_replicates", lambda _, state, symbol, m, *rest, s=sets: s[m])
        error, freedom = packing_noise.common_error(results, "critical", "eta")
        off = np.array([replicates.average(values).mean() for values in sets.values()])
        single = own * np.sqrt(25 + 5 / 5) / 30
        covered.extend(np.abs(off) < 1.96 * np.hypot(error, single))
    assert freedom == 12
    assert 0.93 <= np.mean(covered) <= 0.999


def test_without_replicates_one_run_stands_for_it():
    results = read_results(synthetic.example(noise=0.02))
    error, freedom = packing_noise.common_error(results, "critical", "eta")
    exact = [np.sqrt(np.mean(results.state_error("critical", "eta", m) ** 2)) for m in synthetic.DENSITIES]
    assert error == pytest.approx(exact) and np.isinf(freedom)
    unknown, freedom = packing_noise.common_error(results, "probe", "G_0")
    assert np.isnan(unknown).all() and unknown.shape == (3,) and freedom == 0
    assert np.isnan(packing_noise.packing_scatter(results, "critical", "eta", 0.1))


def test_claims_shift_a_density_by_it(replicated):
    """The drawn mean scatters by the common error about that of the points drawn."""
    sample, rng = full_sample(replicated, "coupled"), np.random.default_rng(3)
    error, _ = packing_noise.common_error(replicated, "critical", "eta")
    values = np.stack([replicated.state("critical", "eta", m) for m in synthetic.DENSITIES])
    drawn = [drawn_sample(sample, rng) for _ in range(400)]
    shifts = np.array([(d.state("critical", "eta") - values[:, d.resample.index]).mean(axis=1) for d in drawn])
    assert shifts.std(axis=0) == pytest.approx(error, rel=0.15)


def test_own_error_is_free_of_what_all_points_share(monkeypatch):
    """Thirty points, ten of them in three packings, each packing off by 1, single points by 0.1."""
    rng = np.random.default_rng(4)
    found = []
    for _ in range(50):
        sets = np.full((3, 30), np.nan)
        sets[0], sets[:, :10] = rng.normal(size=30), rng.normal(size=10)
        sets += rng.normal(size=(3, 1)) + 0.1 * rng.normal(size=(3, 30))
        monkeypatch.setattr(Results, "state_replicates", lambda *_, s=sets: s)
        monkeypatch.setattr(Results, "probability", lambda *_: np.full(30, 1 / 30))
        found.append(packing_noise.own_error(read_results(synthetic.example()), "critical", "eta", 0.04))
    found, freedom = np.transpose(found)
    assert (freedom == 18).all() and np.mean(found) == pytest.approx(0.01 * (10 / 3 + 20) / 30, rel=0.1)


def test_table_3_claims_rest_on_the_scatter_of_consolidations(replicated):
    table = claims_table(replicated, n_boot=40).set_index("claim")
    assert table.loc["e and e_m grow and Z and Z_m fall with mu_iso", "verdict"] == SUPPORTED
    assert table.loc["The initial states are those of Table 3", "verdict"] == CONTRADICTED
    assert table.loc["Initial states of one density hardly vary (COV at most 0.011)", "verdict"] == INCONCLUSIVE


def test_a_drawn_error_along_strain_scatters_as_the_mean_of_the_packings(monkeypatch):
    """Five packings whose mean curves are independent at two strains: standard deviations 1 and 3 of each."""
    rng = np.random.default_rng(2)
    variance = []
    for _ in range(300):
        sets = np.array([1.0, 3.0])[:, None] * rng.normal(size=(5, 2, 1)) + np.zeros(6)
        monkeypatch.setattr(Results, "response", lambda *_, s=sets: SimpleNamespace(replicates=s))
        monkeypatch.setattr(Results, "probability", lambda *_: np.full(6, 1 / 6))
        curves = packing_noise.common_curves(read_results(synthetic.example()), "eta", 0.04)
        variance.append(np.sum(curves**2, axis=0))
    widened = 1 + np.sqrt(2 / 4)  # one standard error of the variance on top
    assert np.mean(variance, axis=0) == pytest.approx(widened * np.array([1, 9]) / 5, rel=0.15)


def test_without_replicates_nothing_tells_the_error_along_strain():
    results = read_results(synthetic.example())
    assert packing_noise.common_curves(results, "eta", 0.04) is None
    sample = drawn_sample(full_sample(results, "coupled"), np.random.default_rng(1))
    assert np.isnan(sample.curve("eta")).all()
