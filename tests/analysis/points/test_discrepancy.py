"""Discrepancy of weighted points by hand, and Voronoi probabilities against sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from analysis.copulas import Copula
from analysis.inputs.joint import Joint
from analysis.inputs.marginals import Marginal
from analysis.points import discrepancy, voronoi

JOINT = Joint(
    (
        Marginal("lognormal", {"median": 0.214, "sigma_ln": 0.469}),
        Marginal("lognormal", {"median": 25.7e9, "sigma_ln": 0.354}),
    ),
    Copula("gaussian", (-0.738,)),
)


def test_both_sides_of_a_jump_count():
    assert discrepancy.star_discrepancy(np.array([0.1]), np.array([1.0])) == pytest.approx(0.9)
    assert discrepancy.star_discrepancy(np.array([0.9]), np.array([1.0])) == pytest.approx(0.9)
    middles = (np.arange(10) + 0.5) / 10
    assert discrepancy.star_discrepancy(middles, np.full(10, 0.1)) == pytest.approx(0.05)


def test_coinciding_points_jump_once():
    twice = discrepancy.star_discrepancy(np.array([0.3, 0.3, 0.8]), np.array([0.25, 0.25, 0.5]))
    assert twice == pytest.approx(discrepancy.star_discrepancy(np.array([0.3, 0.8]), np.array([0.5, 0.5])))


def test_the_supremum_is_found_on_random_points():
    rng = np.random.default_rng(5)
    grid = np.linspace(0.0, 1.0, 200_001)
    for _ in range(20):
        u, p = rng.random(15), rng.dirichlet(np.ones(15))
        brute = max(np.abs((p[:, None] * (u[:, None] <= grid)).sum(axis=0) - grid))
        assert discrepancy.star_discrepancy(u, p) == pytest.approx(brute, abs=2e-5)


def test_discrepancy_sees_marginals_only_through_their_probabilities():
    rng = np.random.default_rng(6)
    x, p = JOINT.sample(40, rng), np.full(40, 1 / 40)
    expected = [discrepancy.star_discrepancy(u, p) for u in JOINT.uniforms(x).T]
    assert discrepancy.gf_discrepancy(x, p, JOINT) == pytest.approx(expected)


def test_moment_errors_vanish_for_a_fine_product_rule():
    t, w = np.polynomial.hermite_e.hermegauss(40)
    z = np.stack(np.meshgrid(t, t), axis=-1).reshape(-1, 2)
    p = np.outer(w, w).ravel() / w.sum() ** 2
    errors = discrepancy.moment_errors(JOINT.from_normal(z), p, JOINT)
    assert max(np.abs(value).max() for value in errors.values()) < 1e-8


def test_half_planes_and_quadrants_are_exact():
    assert voronoi.cell_probabilities(np.array([[-1.0, 0.0], [1.0, 0.0]])) == pytest.approx([0.5, 0.5], abs=1e-14)
    shifted = voronoi.cell_probabilities(np.array([[-1.0, 0.3], [2.0, 0.3]]))
    assert shifted == pytest.approx([special.ndtr(0.5), special.ndtr(-0.5)], abs=1e-14)
    corners = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    assert voronoi.cell_probabilities(corners) == pytest.approx([0.25] * 4, abs=1e-14)


def test_a_grid_of_cells_is_a_product_of_intervals():
    a = np.array([-2.0, -0.7, 0.1, 0.8, 2.5])
    edges = special.ndtr(np.concatenate([[-np.inf], 0.5 * (a[1:] + a[:-1]), [np.inf]]))
    z = np.stack(np.meshgrid(a, a, indexing="ij"), axis=-1).reshape(-1, 2) + 1e-13
    exact = np.outer(np.diff(edges), np.diff(edges)).ravel()
    assert voronoi.cell_probabilities(z) == pytest.approx(exact, abs=1e-11)


def test_exact_and_sampled_cells_agree():
    z = np.random.default_rng(3).normal(size=(60, 2))
    exact = voronoi.cell_probabilities(z)
    assert exact.sum() == pytest.approx(1.0, abs=1e-13)
    assert voronoi.sampled_cell_probabilities(z, samples=2**16) == pytest.approx(exact, abs=4e-4)


def test_coinciding_points_share_their_cell():
    z = np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    assert voronoi.cell_probabilities(z) == pytest.approx([0.5, 0.25, 0.25], abs=1e-14)
