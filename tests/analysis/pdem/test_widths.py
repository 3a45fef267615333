"""Kernel widths: many points keep the densest quarter, and two of a few points do not determine it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtri

from analysis.pdem import evolution, widths
from analysis.pdem.weighted import moments, quantiles


def normal(n: int) -> np.ndarray:
    """The middles of n classes of equal probability of a standard normal distribution, (1, n)."""
    return ndtri((np.arange(n) + 0.5) / n)[None]


def test_two_close_points_of_eight_do_not_determine_the_width():
    probability = np.array([[0.05, 0.1, 0.15, 0.2, 0.2, 0.15, 0.1, 0.05]])
    apart, close = normal(8), normal(8)
    close[0, 3:5] = -1e-4, 1e-4
    one, two = (widths.kernel_width(values, probability)[0] for values in (apart, close))
    assert two == pytest.approx(one, rel=0.05)
    n_eff = 1 / np.sum(probability**2)
    assert 0.8 < one / (0.9 * moments(apart, probability)[1][0] * n_eff**-0.2) <= 1.0
    pdf = evolution.state_pdf(close[0], probability[0])
    assert pdf.p.max() < 0.7  # that of a normal distribution with this standard deviation is 0.43


@pytest.mark.parametrize("n", [24, 25, 100])
def test_from_24_points_on_the_densest_quarter_determines_the_width(n):
    values, probability = np.exp(normal(n)), np.full((1, n), 1 / n)
    levels = quantiles(values, probability, np.linspace(0.05, 0.95, 37))[0]
    scale = np.min(levels[10:] - levels[:-10]) / 0.6373
    assert widths.kernel_width(values, probability)[0] == pytest.approx(0.9 * scale * n**-0.2, rel=1e-12)


def test_each_strain_has_the_share_of_its_own_points():
    values = np.vstack([normal(30), normal(30)])
    probability = np.full((2, 30), 1 / 30)
    probability[1, 8:] = 0.0
    probability[1, :8] = 1 / 8
    found = widths.kernel_width(values, probability)
    assert found[0] == widths.kernel_width(values[:1], probability[:1])[0]
    assert found[1] == pytest.approx(widths.kernel_width(values[1:, :8], probability[1:, :8])[0], rel=1e-12)


def test_points_of_one_value_have_no_width():
    assert widths.kernel_width(np.full((1, 8), 0.7), np.full((1, 8), 0.125))[0] == 0.0
