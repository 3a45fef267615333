"""Variance shares of dependent inputs against the linear-Gaussian closed form."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import dem_like_states, joint_inputs, linear_gaussian_shapley, sobol_normals

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
