"""Differences of campaigns: the interval of known models, names, settings, and what cannot be compared."""

import dataclasses

import numpy as np
import pytest
import synthetic_results

from analysis.results import models
from analysis.results.reader import read_results
from analysis.surrogates import distribution, surrogate
from analysis.tables import comparison as module
from analysis.tables import pooled_states
from analysis.tables.comparison import comparison, comparison_tables, settings, shared_packings


@pytest.fixture(scope="module")
def model():
    rng = np.random.default_rng(3)
    inputs = np.exp(rng.normal([-1.5, 24.0], [0.45, 0.35], (40, 2)))
    packing = np.arange(40) % 8
    values = 0.6 + 0.2 * np.log(inputs[:, 0]) + 0.02 * rng.normal(size=8)[packing] + 0.02 * rng.normal(size=40)
    return surrogate.fit(inputs, values, packing), inputs


def sampled(model, seed, refits=None):
    fitted, inputs = model
    refit = None if refits is None else np.stack([inputs * factor for factor in refits])
    rng = np.random.default_rng(seed)
    return distribution.sampled(fitted, inputs, refits=refit, pairs=None if refits is None else 40, n=400, rng=rng)


def half(estimate):
    return (estimate.high - estimate.low)[0] / 2


def test_independent_errors_of_two_models_add_in_squares(model):
    one, two = sampled(model, 1), sampled(model, 2)
    denoised, simulated = distribution.difference(one, two, same_inputs=True)
    single = distribution.moments_and_quantiles(*model, n=400, rng=np.random.default_rng(1))
    np.testing.assert_allclose(denoised.value, 0.0, atol=1e-12)
    assert half(denoised)[0] == pytest.approx(np.sqrt(2) * half(single.denoised)[0], rel=0.1)
    assert half(simulated)[1] == pytest.approx(np.sqrt(2) * half(single.as_simulated)[1], rel=0.15)


def test_the_error_of_inputs_that_both_share_cancels_and_that_of_others_does_not(model):
    """With the same model, a refit that scales mu_s moves both means alike."""
    scale = np.exp(0.3 * np.random.default_rng(5).normal(size=(200, 1))) * np.array([1.0, 0.0]) + np.array([0.0, 1.0])
    one, two = sampled(model, 1, scale), sampled(model, 2, scale)
    without = half(distribution.difference(sampled(model, 1), sampled(model, 2), True)[0])[0]
    shared = half(distribution.difference(one, two, same_inputs=True)[0])[0]
    apart = half(distribution.difference(one, two, same_inputs=False)[0])[0]
    single = np.quantile(np.abs(one.of_inputs[:, 0, 0, 0]), 0.95)
    assert shared == pytest.approx(without, rel=0.25)
    assert apart == pytest.approx(np.hypot(without, np.sqrt(2) * single), rel=0.25) and apart > 3 * shared


def test_a_shift_of_one_campaign_is_found_with_its_sign(model):
    fitted, inputs = model
    moved = dataclasses.replace(fitted, coefficients=fitted.coefficients + np.eye(fitted.basis.size)[0] * 0.3)
    two = distribution.sampled(moved, inputs, n=400, rng=np.random.default_rng(2))
    denoised, _ = distribution.difference(sampled(model, 1), two, True)
    np.testing.assert_allclose(denoised.value[0, [0, 2, 3, 4]], 0.3, rtol=1e-9)
    assert denoised.value[0, 1] == pytest.approx(0.0, abs=1e-12)


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(module, "POWER", 6)
    monkeypatch.setattr(models, "POWER", 6)
    monkeypatch.setattr(models, "REFITS", 10)
    monkeypatch.setattr(pooled_states, "POOLED", (("critical", "eta"), ("probe", "G_0")))


@pytest.fixture(scope="module")
def three():
    """Two seeds of one campaign, and one of two densities of which one is another."""
    example = synthetic_results.small_example
    paths = example((1, 2, 3)), example((5, 6, 7)), example((1, 2, 3), (0.04, 0.1))
    return [read_results(path) for path in paths]


def test_two_seeds_do_not_differ_and_other_densities_are_listed(three, quick):
    of = comparison(three)
    assert of.names == ("synthetic", "synthetic (2)", "synthetic (3)") and of.densities == (0.04, 0.1)
    tables = comparison_tables(of)
    differences = tables["differences"]
    assert set(differences["campaign"]) == {"synthetic (2)", "synthetic (3)"} and set(differences["mu_iso"]) == {0.04}
    seeds = differences[differences["campaign"] == "synthetic (2)"]
    assert len(seeds) == 2 * 2 * 5 and seeds["excludes_zero"].mean() <= 0.1
    np.testing.assert_allclose(seeds["difference"], seeds["value"] - seeds["reference"], atol=1e-12)
    stiffness = seeds[seeds["quantity"] == "G_0"]
    assert stiffness["unit"].eq("MPa").all() and stiffness["reference"].max() < 1000
    left = tables["not_compared"].values.tolist()
    assert ["mu_iso = 0.1", "synthetic", "This campaign has no such density."] in left
    assert set(tables["responses"]["campaign"]) == set(of.names)


def test_a_state_without_enough_runs_is_refused_with_a_sentence(three, quick):
    short = dataclasses.replace(three[1], _cache={})
    few = np.full(8, np.nan)
    few[:5] = 0.6
    object.__setattr__(short, "measured", lambda state, symbol, mu_iso, family="coupled": few)
    left = comparison_tables(comparison([three[0], short]))["not_compared"].values.tolist()
    reason = "It has values of 5 runs; at least 8 runs are needed."
    states = [f"{symbol}, {state}, mu_iso = 0.04" for state, symbol in pooled_states.POOLED]
    assert left == [[what, "synthetic (2)", reason] for what in states]


def test_settings_that_differ_are_rows_and_others_are_not(three):
    attrs = [dict(r.attrs) for r in three[:2]]
    attrs[0]["settings"] = {"shear": {"strain_end": 0.4, "windows": 0}, "run": {"jobs": 1}}
    attrs[1]["settings"] = {"shear": {"strain_end": 0.3, "windows": 0}, "run": {"jobs": 2}, "dem": {"damping": 0.1}}
    changed = [dataclasses.replace(r, attrs=a) for r, a in zip(three[:2], attrs, strict=True)]
    frame = settings(comparison(changed))
    assert frame.values.tolist() == [["shear.strain_end", "0.4", "0.3"], ["dem.damping", "not stated", "0.1"]]


def test_packings_that_two_campaigns_share_are_found_by_seed_and_grains(three):
    def with_grains(results, N):
        settings = {"assembly": {"N": N, "packings": [1, 2, 3]}}
        return dataclasses.replace(results, attrs=results.attrs | {"settings": settings})

    one, two, three = with_grains(three[0], 27), with_grains(three[0], 27), with_grains(three[1], 27)
    assert shared_packings(comparison([one, two, three])) == ["synthetic (2)"]
    assert shared_packings(comparison([one, with_grains(two, 64)])) == []
