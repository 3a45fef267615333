"""Variance shares of dependent inputs against the linear-Gaussian closed form."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from analytic_cases import dem_like_states, joint_inputs, linear_gaussian_shapley, sobol_normals
from scipy import special
from scipy.stats import qmc

from analysis.surrogates import sensitivity, surrogate


@pytest.mark.parametrize("rho", [0.0, 0.5, -0.738])
def test_linear_gaussian_shares_are_the_closed_form(rho):
    z = sobol_normals(2**14, 1)
    x = np.stack([z[:, 0], rho * z[:, 0] + np.sqrt(1 - rho**2) * z[:, 1]], axis=1)
    pairs = [(2.0, -1.0), (1.0, 0.0), (1.0, 1.0)]
    shares = sensitivity.indices(x, np.stack([a * x[:, 0] + b * x[:, 1] for a, b in pairs]))
    for k, (a, b) in enumerate(pairs):
        exact = linear_gaussian_shapley(a, b, rho)
        assert shares.first[k] == pytest.approx([exact["first"], exact["second"]], abs=0.01)
        assert shares.shapley[k] == pytest.approx([exact["shapley_first"], 1 - exact["shapley_first"]], abs=0.01)
        assert shares.shared[k] == pytest.approx(exact["shared"], abs=0.02)
    assert shares.shapley.sum(axis=1) == pytest.approx(np.ones(3))


def test_a_product_of_independent_inputs_acts_only_together():
    x = sobol_normals(2**14, 2)
    shares = sensitivity.indices(x, x[:, 0] * x[:, 1])
    assert shares.first[0] == pytest.approx([0, 0], abs=0.02) and shares.shared[0] == pytest.approx(-1, abs=0.03)


def test_large_strain_response_is_friction_s_alone_once_friction_is_known():
    inputs = joint_inputs(sobol_normals(100, 3))
    surface = surrogate.fit(inputs, dem_like_states(inputs)["critical"])
    shares = sensitivity.from_surrogate(surface, joint_inputs(sobol_normals(2**13, 4)))
    assert shares.first[0, 0] > 0.99 and shares.alone[0, 1] < 0.01
    assert shares.first[0, 1] == pytest.approx(0.738**2, abs=0.06)


def test_a_constant_has_no_shares_and_too_few_samples_are_refused():
    x = sobol_normals(256, 1)
    assert np.all(np.isnan(sensitivity.indices(x, np.ones(256)).shapley))
    with pytest.raises(ValueError, match="1 responses for 50 samples|50 responses for 50 samples"):
        sensitivity.indices(x[:50], np.ones(50))


def linear_gaussian_shares(slopes, correlation):
    """First-order, independent total and Shapley shares (d,) of a linear response of normal inputs of unit variance."""
    d, total = len(slopes), slopes @ correlation @ slopes

    def explained(subset):
        part = correlation[:, list(subset)].T @ slopes
        return part @ np.linalg.solve(correlation[np.ix_(subset, subset)], part) / total if subset else 0.0

    def shapley(i):
        others = [k for k in range(d) if k != i]
        return sum(math.factorial(s) * math.factorial(d - s - 1) / math.factorial(d)
                   * (explained((*subset, i)) - explained(subset))
                   for s in range(d) for subset in itertools.combinations(others, s))  # fmt: skip

    every = range(d)
    without = [tuple(k for k in every if k != i) for i in every]
    return ([explained((i,)) for i in every], [1 - explained(rest) for rest in without], [shapley(i) for i in every])


@pytest.mark.parametrize("d", [3, 4])
@pytest.mark.parametrize("slopes", [(1.0, 0.5, -0.7, 0.4), (2.0, 0.0, 1.0, 0.0)])
def test_shares_of_three_and_four_dependent_inputs_are_the_closed_form(d, slopes):
    full = np.array([[1, -0.7, 0.3, 0.2], [-0.7, 1, -0.1, 0.4], [0.3, -0.1, 1, 0], [0.2, 0.4, 0, 1]])
    correlation, slopes = full[:d, :d], np.array(slopes[:d])
    x = special.ndtri(qmc.Sobol(d, seed=1).random(2**12)) @ np.linalg.cholesky(correlation).T
    shares = sensitivity.indices(x, x @ slopes)
    for found, exact in zip((shares.first, shares.alone, shares.shapley), linear_gaussian_shares(slopes, correlation),
                            strict=True):  # fmt: skip
        assert found[0] == pytest.approx(exact, abs=0.02)
    assert shares.shapley.sum() == pytest.approx(1.0) and shares.shared[0] == pytest.approx(1 - shares.alone.sum())


def test_the_definition_for_many_inputs_is_the_usual_one_for_two():
    slopes, correlation = np.array([2.0, -1.0]), np.array([[1.0, 0.5], [0.5, 1.0]])
    exact = linear_gaussian_shapley(2.0, -1.0, 0.5)
    first, _, shapley = linear_gaussian_shares(slopes, correlation)
    assert first == pytest.approx([exact["first"], exact["second"]])
    assert shapley[0] == pytest.approx(exact["shapley_first"])


def test_a_single_input_has_the_whole_variance():
    x = sobol_normals(256, 1)[:, :1]
    shares = sensitivity.indices(x, np.sin(x[:, 0]))
    assert (shares.first[0, 0], shares.alone[0, 0], shares.shapley[0, 0], shares.shared[0]) == (1.0, 1.0, 1.0, 0.0)


def test_three_inputs_that_act_only_together_share_a_negative_part():
    x = special.ndtri(qmc.Sobol(3, seed=1).random(2**13))
    shares = sensitivity.indices(x, x[:, 0] * x[:, 1])
    assert shares.shapley[0] == pytest.approx([0.5, 0.5, 0.0], abs=0.04) and shares.shared[0] < -0.9
