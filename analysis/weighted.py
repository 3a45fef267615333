"""Statistics of points that carry probabilities: no density, no kernel, just sums over the points.

Every function takes values (Q,) or (..., Q) and probabilities (Q,); points whose value is NaN drop out and the rest
keep their proportions.
"""

from __future__ import annotations

import numpy as np


def mean(values, probability):
    """Weighted mean over the last axis, sum_q P_q h_q / sum_q P_q over the finite values; NaN if there is none."""
    values = np.asarray(values, float)
    finite = np.isfinite(values)
    share = finite * np.asarray(probability, float)
    total = share.sum(axis=-1)
    known = np.where(finite, values, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (share * known).sum(axis=-1) / total


def std(values, probability):
    """Weighted standard deviation over the last axis, of the points themselves (no small-sample correction)."""
    centre = mean(values, probability)
    return np.sqrt(np.maximum(mean((np.asarray(values, float) - centre[..., None]) ** 2, probability), 0.0))


def cov(values, probability):
    """Coefficient of variation over the last axis, std / |mean|."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return std(values, probability) / np.abs(mean(values, probability))


def quantile(values, probability, q):
    """Quantiles of points (Q,) at q (...), linear between the middles of the points' probability steps.

    The first and the last point stand for the tails beyond their half steps: nothing is extrapolated.
    """
    values, probability = _finite(values, probability)
    if len(values) == 0:
        return np.full(np.shape(q), np.nan)[()]
    order = np.argsort(values)
    middle = np.cumsum(probability[order]) - 0.5 * probability[order]
    return np.interp(q, middle, values[order])


def correlation(a, b, probability):
    """Weighted Pearson correlation of two sets of values (Q,) at the same points; NaN if either is constant."""
    both = np.isfinite(a) & np.isfinite(b)
    a, b = np.where(both, a, np.nan), np.where(both, b, np.nan)
    spread = std(a, probability) * std(b, probability)
    product = mean((a - mean(a, probability)) * (b - mean(b, probability)), probability)
    return float(product / spread) if spread > 0 else float("nan")


def wasserstein(a, b, probability_a, probability_b):
    """Wasserstein-1 distance between two weighted sets of values, the area between their distribution functions."""
    a, probability_a = _finite(a, probability_a)
    b, probability_b = _finite(b, probability_b)
    both = np.sort(np.concatenate([a, b]))
    if len(a) == 0 or len(b) == 0:
        return float("nan")
    difference = _steps(both[:-1], a, probability_a) - _steps(both[:-1], b, probability_b)
    return float(np.sum(np.abs(difference) * np.diff(both)))


def _steps(x, values, probability):
    order = np.argsort(values)
    return np.concatenate([[0.0], np.cumsum(probability[order])])[np.searchsorted(values[order], x, side="right")]


def _finite(values, probability):
    values, probability = np.asarray(values, float), np.asarray(probability, float)
    keep = np.isfinite(values) & (probability > 0)
    total = probability[keep].sum()
    return values[keep], probability[keep] / (total if total > 0 else 1.0)
