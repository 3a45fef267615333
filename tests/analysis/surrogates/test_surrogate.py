"""The mixed model: exact where the answer is known, honest about noise and packings, indifferent to order and units."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import dem_like_paths, dem_like_states, joint_inputs, sobol_normals
from scipy import stats

from analysis.surrogates import surrogate

STRAIN = np.linspace(0.0, 0.4, 60)
INPUTS = joint_inputs(sobol_normals(100, 1))
PACKING = np.arange(100) % 20


@pytest.fixture(scope="module")
def campaign():
    """Paths (60, 100), own noise of 0.015 and packings of 0.01."""
    rng = np.random.default_rng(4)
    noise = 0.015 * rng.normal(size=(60, 100)) + 0.01 * rng.normal(size=(60, 20))[:, PACKING]
    smooth = dem_like_paths(INPUTS, STRAIN)
    return smooth, smooth + noise, surrogate.fit(INPUTS, smooth + noise, PACKING)


def test_twelve_runs_along_friction_give_the_logarithm_back():
    mu_s = np.geomspace(0.1, 0.6, 12)
    model = surrogate.fit(np.column_stack([mu_s, np.full(12, 25e9)]), np.log(mu_s))
    assert model.predict([[0.2, 25e9]]) == pytest.approx(np.log([[0.2]]), abs=1e-9)


def test_a_plane_and_a_bend_along_friction_come_back_exactly():
    u, v = np.log(INPUTS / [0.2, 25e9]).T
    values = np.stack([1 + 2 * u - 0.3 * v, 5 - v, u**2, 3 + 0 * u])
    model = surrogate.fit(INPUTS, values)
    assert model.predict(INPUTS) == pytest.approx(values, abs=1e-6)
    assert model.noise == pytest.approx(np.zeros(4), abs=1e-6) and np.all(model.loo_error < 1e-6)


def test_a_smooth_function_without_noise_is_followed():
    values = dem_like_states(INPUTS)["peak"]
    model = surrogate.fit(INPUTS, values, PACKING)
    other = joint_inputs(0.6 * sobol_normals(200, 5))
    error = model.predict(other)[0] - dem_like_states(other)["peak"]
    assert np.sqrt(np.mean(error**2)) < 0.005 * values.std() and model.noise[0] < 0.01 * values.std()


def test_smoothing_removes_four_fifths_of_the_noise_variance_and_both_kinds_of_noise_are_found(campaign):
    smooth, values, model = campaign
    late = slice(5, None)
    error, noise = (model.predict(INPUTS) - smooth)[late], (values - smooth)[late]
    assert np.mean(error**2) < 0.2 * np.mean(noise**2)
    assert np.mean(model.noise_own[late]) == pytest.approx(0.015, rel=0.05)
    assert np.sqrt(np.mean(model.noise_packing[late] ** 2)) == pytest.approx(0.01, rel=0.15)
    assert np.mean(model.noise[late]) == pytest.approx(np.hypot(0.015, 0.01), rel=0.1)
    for interval, true in ((model.own_interval, 0.015), (model.packing_interval, 0.01)):
        assert 0.85 <= np.mean((interval[late, 0] <= true) & (true <= interval[late, 1])) <= 1.0
    drawn = model.draws(200, np.random.default_rng(5)).predict(INPUTS)[:, late]
    assert np.sqrt(np.mean(drawn.var(axis=0))) == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.25)


def test_the_mean_of_noisy_packings_has_the_interval_of_student(campaign):
    """Packings that differ much more than runs: the level is known as well as their mean, with R - 1 degrees."""
    rng = np.random.default_rng(3)
    for count in (5, 10):
        packing = np.arange(100) % count
        values = 1 + rng.normal(size=(8, count))[:, packing] + 0.01 * rng.normal(size=(8, 100))
        levels = np.stack([values[:, packing == k].mean(axis=1) for k in range(count)], axis=1)
        exact = stats.t.ppf(0.975, count - 1) * levels.std(axis=1, ddof=1) / np.sqrt(count)
        drawn = surrogate.fit(INPUTS, values, packing).draws(2000, rng).predict(INPUTS).mean(axis=2)
        low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
        assert (high - low) / 2 == pytest.approx(exact, rel=0.15)
        assert (high + low) / 2 == pytest.approx(levels.mean(axis=1), abs=0.15 * exact.max())


def test_a_kink_is_followed_and_its_error_is_stated():
    rng = np.random.default_rng(6)
    u = np.log(INPUTS[:, 0])
    truth = np.maximum(u - np.quantile(u, 0.4), 0.0)
    values = truth + 0.1 * truth.std() * rng.normal(size=(50, 100))
    model = surrogate.fit(INPUTS, values, PACKING)
    drawn = model.draws(200, rng).predict(INPUTS)
    low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
    assert np.mean((low <= truth) & (truth <= high)) > 0.9
    assert np.sqrt(np.mean((model.predict(INPUTS) - truth) ** 2)) < 0.06 * truth.std()


def test_noise_that_grows_with_friction_is_found():
    rng = np.random.default_rng(7)
    u = np.log(INPUTS[:, 0])
    grown = np.exp(0.4 * (u - u.mean()) / u.std())
    values = u + 0.1 * grown / np.sqrt(np.mean(grown**2)) * rng.normal(size=(50, 100))
    model = surrogate.fit(INPUTS, values, PACKING)
    assert model.growth.mean() == pytest.approx(0.4, abs=0.06)
    assert model.noise_own.mean() == pytest.approx(0.1, rel=0.05)


def test_leave_one_out_residuals_are_close_to_those_of_refitting_without_the_run(campaign):
    rows = campaign[1][[20, 59]]
    model = surrogate.fit(INPUTS, rows)
    for k in (17, 60, 93):
        without = rows.copy()
        without[:, k] = np.nan
        again = rows[:, k] - surrogate.fit(INPUTS, without).predict(INPUTS[k : k + 1])[:, 0]
        assert model.loo[:, k] == pytest.approx(again, abs=0.15 * model.loo_error.max())


def test_order_of_the_points_labels_and_units_do_not_matter(campaign):
    rows, order = campaign[1][[10, 40]], np.random.default_rng(8).permutation(100)
    model = surrogate.fit(INPUTS, rows, PACKING)
    other = surrogate.fit(INPUTS[order] * [1.0, 1e-9], 1e3 * rows[:, order] - 7.0, [f"p{PACKING[k]}" for k in order])
    assert other.predict(INPUTS * [1.0, 1e-9]) == pytest.approx(1e3 * model.predict(INPUTS) - 7.0, abs=1e-3)
    for name in ("noise_packing", "noise_own", "noise", "loo_error"):
        assert getattr(other, name) == pytest.approx(1e3 * getattr(model, name), rel=1e-5)


def test_one_packing_cannot_be_known_and_one_run_per_packing_gives_the_sum(campaign):
    values = campaign[1][30]
    for packing in (None, np.zeros(100, int)):
        one = surrogate.fit(INPUTS, values, packing)
        assert one.packings == 1 and not one.knows_packings and np.isnan(one.noise_packing).all()
        assert one.noise_own == one.noise and np.isnan(one.packing_interval).all()
    every = surrogate.fit(INPUTS, values, np.arange(100))
    assert every.knows_packings and np.isnan(every.noise_own).all() and np.isnan(every.noise_packing).all()
    assert every.noise == pytest.approx(one.noise) and np.isfinite(every.noise_interval).all()


def test_missing_runs_are_left_out_of_their_rows_only(campaign):
    values = campaign[1].copy()
    values[10:20, 5] = np.nan
    model = surrogate.fit(INPUTS, values, PACKING)
    assert np.isnan(model.loo).sum() == 10 and np.isfinite(model.predict(INPUTS)).all()
    assert model.predict(INPUTS)[20:] == pytest.approx(campaign[2].predict(INPUTS)[20:], abs=1e-9)
    filled, missing = surrogate.fill(INPUTS, values, PACKING)
    assert np.array_equal(missing, np.isnan(values)) and np.array_equal(filled[~missing], values[~missing])
    assert np.max(np.abs(filled - campaign[0])[missing]) < 0.03


@pytest.mark.parametrize("count", [5, 8])
def test_few_points_have_wide_but_finite_errors(count):
    inputs = joint_inputs(sobol_normals(count, 9))
    values = dem_like_states(inputs)["peak"] + 0.01 * np.random.default_rng(1).normal(size=(4, count))
    model = surrogate.fit(inputs, values, np.arange(count) % 3)
    drawn = model.draws(100, np.random.default_rng(2))
    assert np.isfinite(model.predict(INPUTS)).all() and np.isfinite(drawn.predict(INPUTS)).all()
    assert np.all(model.noise_interval[:, 1] > 1.5 * model.noise)


def test_an_input_that_does_not_vary_has_no_effect():
    inputs = np.column_stack([np.full(20, 0.3), np.geomspace(1e10, 5e10, 20)])
    values = np.log(inputs[:, 1])
    model = surrogate.fit(inputs, values, np.arange(20) % 4)
    assert model.predict([[0.5, 2e10]]) == pytest.approx(np.log([[2e10]]), abs=1e-6)


def test_beyond_the_runs_the_surface_stays_at_its_bound():
    far = surrogate.fit(INPUTS, dem_like_states(INPUTS)["peak"]).predict([[50.0, 25e9], [500.0, 25e9 / 100]])
    assert np.isfinite(far).all()
    at = surrogate.fit(INPUTS, np.log(INPUTS[:, 0])).predict([[50.0, 25e9], [500.0, 25e9]])[0]
    assert at[0] <= at[1] < np.log(INPUTS[:, 0]).max() + 1.5 * np.log(INPUTS[:, 0]).std()


@pytest.mark.parametrize(
    ("inputs", "values", "packing", "message"),
    [
        (np.ones((4, 2)), np.ones(4), None, "values of 4 runs, at least 5"),
        (np.ones((6, 2)), np.ones(5), None, "do not match"),
        (np.ones((6, 2)), np.ones(6), np.ones(5), "do not match"),
        (-np.ones((6, 2)), np.ones(6), None, "an input is -1, all must be positive"),
    ],
)
def test_what_cannot_be_fitted_is_refused(inputs, values, packing, message):
    with pytest.raises(surrogate.SurrogateError, match=message):
        surrogate.fit(inputs, values, packing)
