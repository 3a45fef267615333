"""The flux-limited scheme: order, total variation, arrival."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import tvd


def advected(cells_per_width, limiter, distance=4.0, steps=40):
    """L1 error of a normal density moved `distance` widths in equal moves, on a mesh of so many cells a width."""
    start = 8.0 * cells_per_width
    path = start + np.linspace(0, distance, steps * cells_per_width + 1)[:, None] * cells_per_width
    weight = np.ones_like(path)
    p, _ = tvd.transport(path, weight, cells_per_width, limiter)(20 * cells_per_width)
    size = 20 * cells_per_width
    exact = tvd.kernel_cells(path[-1], np.array([cells_per_width]), np.zeros(1), size)[:, 0]
    return np.abs(p[-1] - exact), p


@pytest.mark.parametrize("limiter", ["superbee", "vanleer", "minmod"])
def test_total_variation_never_grows(limiter):
    _, p = advected(4, limiter)
    variation = np.abs(np.diff(p, axis=1)).sum(axis=1)
    assert np.all(np.diff(variation) < 1e-14)


@pytest.mark.parametrize("limiter", ["superbee", "vanleer"])
def test_a_narrow_density_arrives_where_its_path_ends(limiter):
    rng = np.random.default_rng(2)
    path = 60 + 20 * rng.normal(size=(50, 7)).cumsum(axis=0) * 0.1
    weight = np.eye(7)[[3] * 50]
    p, variance = tvd.transport(path, weight, 1.0, limiter)(200)
    mean = p @ (np.arange(200) + 0.5)
    assert np.max(np.abs(mean - path[:, 3])) < 0.35
    assert np.all(variance[1:] > 0.9) and variance[-1] < 6.0**2
