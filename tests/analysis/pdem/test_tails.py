"""Exceedance probabilities and quantiles of points: closed forms, tails, plateaus, coverage of their intervals."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import MEDIAN, RHO, SIGMA_LN, sobol_normals
from scipy.special import ndtri

from analysis.copulas import Copula
from analysis.inputs.joint import Joint
from analysis.inputs.marginals import Marginal
from analysis.pdem import evolution, tails, weighted
from analysis.points import select_points


def at_middles(n: int) -> np.ndarray:
    """Standard normal quantiles at the middles of n equal steps."""
    return ndtri((np.arange(n) + 0.5) / n)


@pytest.mark.parametrize("n", [50, 100, 4096])
def test_tails_of_a_normal_distribution_are_not_widened(n):
    values, probability, levels = at_middles(n), np.full(n, 1 / n), np.array([0.01, 0.05, 0.5, 0.95, 0.99])
    assert tails.exceedance(values, probability, ndtri(levels)) == pytest.approx(1 - levels, rel=0.06)
    assert tails.quantile(values, probability, levels) == pytest.approx(ndtri(levels), abs=0.05)
    shown = evolution.state_pdf(values, probability, rule="silverman", keep_spread=False)
    widened, limit = 1 - shown.cdf(ndtri(0.99))[0, 0], {50: 1.35, 100: 1.3, 4096: 1.05}[n]
    assert widened > 0.01 * limit


def test_quantiles_are_the_inverse_and_those_of_the_points_at_their_steps():
    rng = np.random.default_rng(2)
    values, probability = rng.normal(size=40), rng.dirichlet(np.full(40, 3.0))
    values[7] = np.nan
    levels = np.linspace(0.001, 0.999, 57)
    found = tails.quantile(values, probability, levels)
    assert tails.exceedance(values, probability, found) == pytest.approx(1 - levels, abs=1e-12)
    known = np.delete(probability, 7) / (1 - probability[7])
    order = np.argsort(np.delete(values, 7))
    middle = np.cumsum(known[order]) - 0.5 * known[order]
    assert tails.quantile(values, probability, middle) == pytest.approx(weighted.quantile(values, probability, middle))


def test_beyond_the_outermost_points_the_tail_is_exponential_with_their_mean_excess():
    values, probability = np.arange(6.0), np.full(6, 1 / 6)
    scale = np.mean([3.0 - 2.0, 4.0 - 2.0, 5.0 - 2.0])
    assert tails.exceedance(values, probability, [5.0, 5.0 + scale]) == pytest.approx([1 / 12, np.exp(-1) / 12])
    assert tails.exceedance(values, probability, -scale) == pytest.approx(1 - np.exp(-1) / 12)


def test_a_point_of_vanishing_probability_changes_nothing():
    values, probability = np.arange(8.0), np.full(8, 1 / 8)
    probability[[0, 7]] = 1e-30
    found = tails.exceedance(values, probability, [0.5, 3.4, 6.2])
    assert np.all(np.isfinite(found)) and found == pytest.approx([1.0, 0.52, 0.0], abs=0.09)
    assert np.all(np.isfinite(tails.exceedance_interval(values, probability, [0.5, 3.4, 6.2])))


def test_a_plateau_keeps_its_probability_and_nothing_lies_beyond_it():
    values, probability = np.minimum(at_middles(100), 0.5), np.full(100, 0.01)
    share = np.mean(values == 0.5)
    assert tails.exceedance(values, probability, [0.499, 0.5, 0.6]) == pytest.approx([share, 0.0, 0.0], abs=0.006)
    assert np.all(tails.quantile(values, probability, [1 - share + 0.01, 0.99, 1.0]) == 0.5)
    assert tails.exceedance([2.0], [1.0], [1.9, 2.0]) == pytest.approx([1.0, 0.0], abs=1e-12)


@pytest.fixture(scope="module")
def sets():
    """Independent normals (n, 2) and probabilities (n,) of points: 100 of `select_points`, and 1,024 of Sobol'."""
    marginals = (Marginal("lognormal", {"median": m, "sigma_ln": s}) for m, s in zip(MEDIAN, SIGMA_LN, strict=True))
    joint = Joint(tuple(marginals), Copula("gaussian", (RHO,)))
    chosen = [select_points(joint, 100, seed=seed) for seed in range(40)]
    return {
        100: [(joint.to_normal(points.x), points.probability) for points in chosen],
        1024: [(sobol_normals(1024, seed), np.full(1024, 1 / 1024)) for seed in range(40)],
    }


def covered(sets, noise: float, stated: float) -> tuple[float, float, float]:
    """Coverage of probabilities and of quantiles at 1, 5, 95, 99 %, and half the width at 99 %: sums of normals."""
    rng = np.random.default_rng(4)
    levels = np.array([0.01, 0.05, 0.95, 0.99])
    exact = np.hypot(1.0, noise) * ndtri(levels)
    hits, q_hits, width = [], [], []
    for z, probability in sets:
        for angle in (0.5, 0.9, 2.2):
            values = z @ [np.cos(angle), np.sin(angle)] + noise * rng.normal(size=len(z))
            low, high = tails.exceedance_interval(values, probability, exact, stated)
            hits.append((low <= 1 - levels) & (1 - levels <= high))
            width.append(0.5 * (high - low)[3] / 0.01)
            low, high = tails.quantile_interval(values, probability, levels, stated)
            q_hits.append((low <= exact) & (exact <= high))
    return float(np.mean(hits)), float(np.mean(q_hits)), float(np.mean(width))


@pytest.mark.parametrize(("n", "noise", "widest"), [(100, 0.0, 1.0), (1024, 0.0, 0.3), (100, 0.3, 2.0)])
def test_intervals_cover_and_are_no_wider_than_needed(sets, n, noise, widest):
    share, quantile, width = covered(sets[n], noise, noise)
    assert share > 0.92 and quantile > 0.92
    assert 0.3 * widest < width < widest


def test_noise_that_is_not_stated_is_not_covered(sets):
    assert covered(sets[100], 0.3, 0.0)[0] < 0.92
