"""The flux-limited scheme: order, total variation, arrival."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import plain_tvd_loop

from analysis.pdem import tvd


def advected(cells_per_width: int, limiter: str, widths: float = 4.0):
    """PDF of width `cells_per_width` moved by `widths` of them at a constant velocity; the exact one beside it."""
    size = 20 * cells_per_width
    path = 8.0 * cells_per_width + np.linspace(0, widths * cells_per_width, 80 * cells_per_width + 1)[:, None]
    p, _ = tvd.transport(path, np.ones_like(path), cells_per_width, size, limiter)
    exact = tvd.kernel_cells(path[-1], np.array([cells_per_width]), np.zeros(1), size)[:, 0]
    return p, exact


@pytest.mark.parametrize("limiter", ["superbee", "vanleer", "minmod"])
def test_total_variation_never_grows_and_nothing_is_lost(limiter):
    p, _ = advected(4, limiter)
    assert np.all(np.diff(np.abs(np.diff(p, axis=1)).sum(axis=1)) < 1e-14)
    assert np.max(np.abs(p.sum(axis=1) - 1)) < 1e-13 and p.min() >= 0


@pytest.mark.parametrize("limiter", ["superbee", "vanleer", "minmod"])
def test_error_falls_with_the_second_order_where_the_pdf_is_smooth(limiter):
    errors = []
    for cells_per_width in (16, 32):
        p, exact = advected(cells_per_width, limiter)
        off = (np.arange(len(exact)) + 0.5) / cells_per_width - 12.0
        smooth = (np.abs(off) > 0.5) & (np.abs(off) < 2.5)
        errors.append(np.abs(p[-1] - exact)[smooth].sum())
    assert np.log2(errors[0] / errors[1]) > 1.8


@pytest.mark.parametrize("limiter", ["superbee", "vanleer", "minmod"])
def test_a_narrow_pdf_arrives_where_its_path_ends(limiter):
    rng = np.random.default_rng(2)
    path = 60 + 2 * rng.normal(size=(50, 7)).cumsum(axis=0)
    probability = np.eye(7)[[3] * 50]
    p, variance = tvd.transport(path, probability, 1.0, 200, limiter)
    mean = p @ (np.arange(200) + 0.5)
    assert np.max(np.abs(mean - path[:, 3])) < 0.35
    assert variance[0] == pytest.approx(1 + 1 / 12, abs=1e-3) and variance[0] < variance[-1] < 6.0**2


def test_moving_windows_change_nothing_against_the_plain_loop():
    rng = np.random.default_rng(3)
    path = 75 + 15 * np.sin(np.linspace(0, 7, 12)[:, None] + rng.normal(size=4)) + rng.normal(size=(12, 4))
    probability = np.broadcast_to(rng.dirichlet(np.ones(4)), path.shape)
    for width in (1.0, 4.0):
        expected, _ = plain_tvd_loop(path, probability, width, 150)
        p, _ = tvd.transport(path, probability, width, 150)
        assert np.max(np.abs(p - expected).sum(axis=1)) < 1e-6
