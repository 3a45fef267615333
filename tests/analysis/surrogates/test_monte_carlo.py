"""Monte Carlo through a surface returns PDEM's object with the distribution that is known."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import MEDIAN, SIGMA_LN, joint_inputs, sobol_normals
from scipy import stats

from analysis.pdem import evolution
from analysis.surrogates import monte_carlo, surrogate

STRAIN = np.array([0.1, 0.2])


@pytest.fixture(scope="module")
def linear():
    """Responses linear in ln mu_s: normal under a lognormal mu_s."""
    inputs = joint_inputs(sobol_normals(128, 1))
    u = np.log(inputs[:, 0] / MEDIAN[0]) / SIGMA_LN[0]
    return inputs, surrogate.fit(inputs, np.stack([2 + 0.1 * u, 5 - 0.2 * u]))


def test_a_million_samples_give_the_normal_distribution(linear):
    samples = joint_inputs(np.random.default_rng(1).normal(size=(1_000_000, 2)))
    pdf = monte_carlo.monte_carlo(linear[1], samples, STRAIN)
    assert np.max(np.abs(pdf.p.sum(axis=1) * pdf.dx - 1)) < 1e-10
    assert pdf.mean == pytest.approx([2, 5], abs=1e-3) and pdf.std == pytest.approx([0.1, 0.2], rel=5e-3)
    levels = np.array([0.05, 0.5, 0.95])
    assert pdf.quantile(levels)[1] == pytest.approx(stats.norm(5, 0.2).ppf(levels), abs=2e-3)


def test_noise_adds_its_variance(linear):
    samples = joint_inputs(np.random.default_rng(2).normal(size=(50_000, 2)))
    pdf = monte_carlo.monte_carlo(linear[1], samples, STRAIN, noise=0.1, rng=np.random.default_rng(3))
    assert pdf.std == pytest.approx(np.hypot([0.1, 0.2], 0.1), rel=0.02)
    with pytest.raises(ValueError, match="noise needs an rng"):
        monte_carlo.monte_carlo(linear[1], samples, STRAIN, noise=0.1)


def test_the_cells_of_another_pdf_are_kept(linear):
    inputs, surface = linear
    other = evolution.evolve(surface.predict(inputs), np.full(128, 1 / 128), STRAIN)
    pdf = monte_carlo.monte_carlo(surface, inputs, STRAIN, like=other)
    assert pdf.x == pytest.approx(other.x)


def test_another_number_of_strains_is_refused(linear):
    with pytest.raises(ValueError, match="the surface has 2 strains, 3 were given"):
        monte_carlo.monte_carlo(linear[1], linear[0], [0.1, 0.2, 0.3])
