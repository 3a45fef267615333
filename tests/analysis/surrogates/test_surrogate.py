"""Response surfaces: exact where the answer is known, honest about noise, indifferent to missing runs."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import dem_like_paths, dem_like_states, joint_inputs, sobol_normals

from analysis.surrogates import surrogate

STRAIN = np.linspace(0.0, 0.4, 60)


@pytest.fixture(scope="module")
def campaign():
    inputs = joint_inputs(sobol_normals(100, 1))
    return inputs, dem_like_paths(inputs, STRAIN), 0.015 * np.random.default_rng(4).normal(size=(60, 100))


def test_a_polynomial_in_the_logarithms_comes_back_exactly():
    inputs = joint_inputs(sobol_normals(40, 3))
    u, v = np.log(inputs / [0.2, 25e9]).T
    values = np.stack([1 + 2 * u - u**2 + 0.3 * u * v, 5 - v])
    surface = surrogate.fit(inputs, values)
    assert surface.predict(inputs) == pytest.approx(values, abs=1e-9)
    assert surface.loo_error == pytest.approx([0, 0], abs=1e-9)


@pytest.mark.parametrize("kind", ["polynomial", "gp"])
def test_leave_one_out_residuals_are_those_of_refitting_without_the_run(campaign, kind):
    inputs, smooth, noise = campaign
    rows = smooth[[20, 59]] + noise[[20, 59]]
    surface = surrogate.fit(inputs, rows, kind=kind)
    without = rows.copy()
    without[:, 17] = np.nan
    fitted = surrogate.regression.least_squares(surface.basis(inputs), without) if kind == "polynomial" else None
    if fitted is None:
        z = (np.log(inputs) - surface.centre) / surface.scale
        ratio = np.mean(surface.noise**2 / np.maximum(_kriging_variance(surface, rows, z), 1e-300))
        fitted = surrogate.regression._kriging(z, without, surface.length, ratio)
    again = rows[:, 17] - (fitted["coefficients"] @ surface.basis(inputs[17:18]).T)[:, 0]
    assert surface.loo[:, 17] == pytest.approx(again, rel=1e-6)


def _kriging_variance(surface, rows, z):
    """Process variance of the fitted Gaussian process: y' P y / (n - 3)."""
    residual = surface.coefficients[:, 3:]
    return np.sum(rows * residual, axis=1) / (rows.shape[1] - 3)


@pytest.mark.parametrize("kind", ["polynomial", "gp"])
def test_smoothing_removes_four_fifths_of_the_noise_variance_and_finds_its_size(campaign, kind):
    inputs, smooth, noise = campaign
    fitted, share, surface = surrogate.smoothed(inputs, smooth + noise, kind=kind)
    left = np.mean((fitted - smooth)[1:] ** 2) / np.mean(noise[1:] ** 2)
    assert left < 0.2
    assert np.mean(surface.noise[1:]) == pytest.approx(0.015, rel=0.05)
    assert share[-1] == pytest.approx(0.015**2 / np.var((smooth + noise)[-1], ddof=1), rel=0.2)
    drawn = surface.draws(200, np.random.default_rng(5)) @ surface.basis(inputs).T
    predicted = np.mean(drawn[:, 1:].var(axis=0)) ** 0.5
    assert predicted == pytest.approx(np.sqrt(np.mean((fitted - smooth)[1:] ** 2)), rel=0.3)


def test_missing_runs_are_left_out_of_their_strains_only(campaign):
    inputs, smooth, noise = campaign
    values = smooth + noise
    values[10:20, 5] = np.nan
    surface = surrogate.fit(inputs, values)
    assert np.isnan(surface.loo).sum() == 10 and surface.dof[0] == surface.dof[15] + 1
    assert np.all(np.isfinite(surface.predict(inputs)))


def test_beyond_the_runs_the_surface_stays_at_its_bound():
    inputs = joint_inputs(sobol_normals(30, 2))
    surface = surrogate.fit(inputs, dem_like_states(inputs)["peak"])
    far = surface.predict([[50.0, 25e9], [500.0, 25e9]])[0]
    assert far[0] == far[1]


@pytest.mark.parametrize(
    ("inputs", "values", "message"),
    [
        (np.ones((4, 2)), np.ones(4), "values of 4 runs, at least 5"),
        (np.ones((6, 2)), np.ones(5), "do not match"),
        (-np.ones((6, 2)), np.ones(6), "an input is -1, all must be positive"),
    ],
)
def test_what_cannot_be_fitted_is_refused(inputs, values, message):
    with pytest.raises(surrogate.SurrogateError, match=message):
        surrogate.fit(inputs, values)
