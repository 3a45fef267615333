"""Moments, quantiles and shares of a response against normal distributions, and the intervals that refits add."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import MEDIAN, SIGMA_LN, joint_inputs, sobol_normals
from scipy import stats

from analysis.surrogates import surrogate
from analysis.surrogates.distribution import error_of_inputs, moments_and_quantiles

INPUTS = joint_inputs(sobol_normals(100, 1))
SAMPLES = joint_inputs(sobol_normals(1024, 2))
PACKING = np.arange(100) % 20


def linear(inputs):
    """Responses (2, n), normal with means 2 and 5 and standard deviations 0.1 and 0.2 over the inputs."""
    u = np.log(inputs[:, 0] / MEDIAN[0]) / SIGMA_LN[0]
    return np.stack([2 + 0.1 * u, 5 - 0.2 * u])


def test_without_noise_the_distribution_is_normal_and_the_interval_is_a_point():
    found = moments_and_quantiles(surrogate.fit(INPUTS, linear(INPUTS), PACKING), SAMPLES, n=50)
    for k, normal in enumerate((stats.norm(2, 0.1), stats.norm(5, 0.2))):
        exact = [normal.mean(), normal.std(), *normal.ppf(found.levels)]
        assert found.denoised.value[k] == pytest.approx(exact, abs=0.03 * normal.std())
    assert found.as_simulated.value == pytest.approx(found.denoised.value, abs=2e-3)
    assert found.denoised.high - found.denoised.low == pytest.approx(np.zeros((2, 5)), abs=1e-5)
    assert found.shares.value[:, 0] == pytest.approx([1, 1])


def test_noise_widens_the_distribution_as_simulated_only_and_shares_add_up():
    rng = np.random.default_rng(1)
    values = linear(INPUTS)[1] + 0.1 * rng.normal(size=(40, 100)) + 0.1 * rng.normal(size=(40, 20))[:, PACKING]
    found = moments_and_quantiles(surrogate.fit(INPUTS, values, PACKING), SAMPLES, n=200)
    sd = np.sqrt(0.2**2 + 0.1**2 + 0.1**2)
    assert found.denoised.value[:, 1].mean() == pytest.approx(0.2, rel=0.03)
    assert found.as_simulated.value[:, 1].mean() == pytest.approx(sd, rel=0.04)
    assert found.as_simulated.value[:, 4].mean() == pytest.approx(5 + 1.645 * sd, abs=0.03)
    assert found.shares.value.mean(axis=0) == pytest.approx([4 / 6, 1 / 6, 1 / 6], abs=0.04)
    for estimate, exact in ((found.denoised, [5, 0.2]), (found.as_simulated, [5, sd])):
        held = (estimate.low[:, :2] <= exact) & (exact <= estimate.high[:, :2])
        assert np.all(held.mean(axis=0) >= 0.85)


def test_points_with_probabilities_and_samples_agree():
    model = surrogate.fit(INPUTS, linear(INPUTS), PACKING)
    twice = np.concatenate([SAMPLES, SAMPLES[:512]])
    weight = np.concatenate([np.full(512, 0.5), np.ones(512), np.full(512, 0.5)])
    plain, weighted = moments_and_quantiles(model, SAMPLES, n=20), moments_and_quantiles(model, twice, weight, n=20)
    assert weighted.denoised.value == pytest.approx(plain.denoised.value, abs=2e-3)


def test_refits_of_few_pairs_widen_the_interval_as_student():
    """Refits that shift ln mu_s by a normal: the half width of the mean is t sqrt(n / (n - 1)) times their sd."""
    model = surrogate.fit(INPUTS, linear(INPUTS), PACKING)
    shift = stats.norm.ppf((np.arange(200) + 0.5) / 200) * 0.3 * SIGMA_LN[0]
    refits = SAMPLES * np.exp(np.stack([shift, 0 * shift], axis=1))[:, None, :]
    for pairs in (12, 100):
        found = moments_and_quantiles(model, SAMPLES, refits=refits, pairs=pairs, n=400).denoised
        exact = stats.t.ppf(0.975, pairs - 1) * np.sqrt(pairs / (pairs - 1)) * 0.3 * np.array([0.1, 0.2])
        assert (found.high - found.low)[:, 0] / 2 == pytest.approx(exact, rel=0.03)
    with pytest.raises(ValueError, match="refits .* of None pairs"):
        moments_and_quantiles(model, SAMPLES, refits=refits)


def test_refitted_probabilities_of_the_points_move_the_mean_by_their_scatter():
    model = surrogate.fit(INPUTS, linear(INPUTS), PACKING)
    weights = np.random.default_rng(3).dirichlet(np.full(100, 50.0), 300)
    found = moments_and_quantiles(model, INPUTS, np.full(100, 0.01), refits=weights, pairs=1000, n=300).denoised
    exact = 1.96 * (weights @ linear(INPUTS).T).std(axis=0)
    assert (found.high - found.low)[:, 0] / 2 == pytest.approx(exact, rel=0.15)


@pytest.mark.parametrize("pairs", [12, 30])
def test_the_interval_of_a_quantile_covers_although_a_small_sample_hides_its_error(pairs):
    """Normal values, normal refits: 400 samples; 95 % are asked, and without scaling one in eight misses the truth."""
    rng, truth = np.random.default_rng(3), stats.norm.ppf(0.95)
    missed = np.zeros((400, 2), bool)
    for k in range(400):
        values = rng.normal(size=pairs)
        fit, refits = normal_statistics(values), normal_statistics(rng.choice(values, (200, pairs)))
        scaled = error_of_inputs(refits, fit, pairs)
        wide = stats.t.ppf(0.975, pairs - 1) / 1.96 * np.sqrt(pairs / (pairs - 1))
        plain = wide * (refits - refits.mean(axis=0))
        assert scaled[:, :2] == pytest.approx(plain[:, :2], rel=1e-4)  # mean and standard deviation are as before
        half = np.abs(np.quantile([scaled[:, 2], plain[:, 2]], [0.025, 0.975], axis=1)).max(axis=0)
        missed[k] = np.abs(fit[2] - truth) > half
    assert 0.92 <= 1 - missed[:, 0].mean() <= 0.98 and 1 - missed[:, 1].mean() < 0.92


def normal_statistics(values):
    """Mean, log of the standard deviation and 95 % quantile (..., 3) of a normal distribution fitted to values."""
    mean, sd = values.mean(axis=-1), values.std(axis=-1)
    return np.stack([mean, np.log(sd), mean + stats.norm.ppf(0.95) * sd], axis=-1)


@pytest.mark.parametrize("log_sd", [-745.0, -40.0])
def test_a_refit_without_scatter_does_not_dominate(log_sd):
    fit, refits = np.array([0.0, 0.0, 1.6]), np.array([[0.1, log_sd, 0.1], [-0.1, 0.0, 1.5]])
    assert np.abs(error_of_inputs(refits, fit, 1000)[:, 2]).max() < 10 * 1.6
