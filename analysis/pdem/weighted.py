"""Statistics of points that carry probabilities: sums over the points, without a kernel and without a PDF.

The functions from `mean` to `wasserstein` take values (Q,) or (..., Q) and probabilities (Q,) of any sum; points whose
value is NaN drop out and the others keep their proportions.  `moments` and `quantiles` work row by row, with
probabilities that are `normalised` for every row already.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike


def normalised(probability: ArrayLike, known: np.ndarray | None = None) -> np.ndarray:
    """Probabilities (..., Q) divided by their sum over the last axis.

    known (..., Q), where given: points that are not known get the probability zero and the others keep their
    proportions.  Where the sum is zero the result is NaN.
    """
    probability = np.asarray(probability, float)
    if known is not None:
        probability = np.where(known, probability, 0.0)
    with np.errstate(invalid="ignore"):
        return probability / probability.sum(axis=-1, keepdims=True)


def mean(values: ArrayLike, probability: ArrayLike) -> np.ndarray:
    """Weighted mean over the last axis, sum_q P_q h_q / sum_q P_q over the finite values; NaN if there is none."""
    values = np.asarray(values, float)
    finite = np.isfinite(values)
    known_probability = finite * np.asarray(probability, float)
    total = known_probability.sum(axis=-1)
    known = np.where(finite, values, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (known_probability * known).sum(axis=-1) / total


def std(values: ArrayLike, probability: ArrayLike) -> np.ndarray:
    """Weighted standard deviation over the last axis, of the points themselves (no small-sample correction)."""
    centre = mean(values, probability)
    return np.sqrt(np.maximum(mean((np.asarray(values, float) - centre[..., None]) ** 2, probability), 0.0))


def cov(values: ArrayLike, probability: ArrayLike) -> np.ndarray:
    """Coefficient of variation over the last axis, std / |mean|."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return std(values, probability) / np.abs(mean(values, probability))


def quantile(values: ArrayLike, probability: ArrayLike, q: float | Sequence[float] | np.ndarray) -> np.ndarray:
    """Quantiles of points (Q,) at the levels q (...): the CDF is linear between the middles of the points' steps.

    Below the first and above the last middle the quantile is that of the first or last point (no extrapolation).
    `quantiles` has the same definition for many rows; its rounding differs in the last bit.
    """
    values, probability = _finite(values, probability)
    if len(values) == 0:
        return np.full(np.shape(q), np.nan)[()]
    order = np.argsort(values)
    middle = np.cumsum(probability[order]) - 0.5 * probability[order]
    return np.interp(q, middle, values[order])


def correlation(a: ArrayLike, b: ArrayLike, probability: ArrayLike) -> float:
    """Weighted Pearson correlation of two sets of values (Q,) at the same points; NaN if either is constant."""
    both = np.isfinite(a) & np.isfinite(b)
    a, b = np.where(both, a, np.nan), np.where(both, b, np.nan)
    spread = std(a, probability) * std(b, probability)
    product = mean((a - mean(a, probability)) * (b - mean(b, probability)), probability)
    return float(product / spread) if spread > 0 else float("nan")


def wasserstein(a: ArrayLike, b: ArrayLike, probability_a: ArrayLike, probability_b: ArrayLike) -> np.ndarray:
    """Wasserstein-1 distance of two weighted sets of values (..., Q): the area between their distribution functions."""
    values, steps = [], []
    for of_set, probability, sign in ((a, probability_a, 1.0), (b, probability_b, -1.0)):
        known = np.isfinite(of_set)
        values.append(np.where(known, of_set, 0.0))
        steps.append(sign * normalised(np.broadcast_to(probability, known.shape), known))
    both = np.concatenate(values, axis=-1)
    order = np.argsort(both, axis=-1)
    difference = np.cumsum(np.take_along_axis(np.concatenate(steps, axis=-1), order, axis=-1), axis=-1)[..., :-1]
    return np.sum(np.abs(difference) * np.diff(np.take_along_axis(both, order, axis=-1), axis=-1), axis=-1)


def moments(h: ArrayLike, probability: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (...,) over the last axis of values h (..., Q), from the sums of P_q h_q^k.

    probability (Q,) or (..., Q), which broadcasts with h, is `normalised` already and zero where a value is missing.
    `mean` and `std` divide by the sum afterwards instead of before, and differ from these in the last bit.
    """
    probability = np.asarray(probability, float)
    known = np.where(probability > 0, h, 0.0)
    centre = np.sum(probability * known, axis=-1)
    return centre, np.sqrt(np.sum(probability * (known - centre[..., None]) ** 2, axis=-1))


def quantiles(h: ArrayLike, probability: ArrayLike, levels: ArrayLike) -> np.ndarray:
    """Quantiles (T, n) of values h (T, Q) at the levels (n,): the CDF is linear between the middles of the steps.

    probability (Q,) or (T, Q) is `normalised` already and zero where a value is missing.
    """
    h, levels = np.asarray(h, float), np.asarray(levels, float)
    probability = np.broadcast_to(probability, h.shape)
    order = np.argsort(np.where(probability > 0, h, np.inf), axis=1)
    value, step = np.take_along_axis(h, order, axis=1), np.take_along_axis(probability, order, axis=1)
    middle = np.cumsum(step, axis=1) - 0.5 * step
    last = np.count_nonzero(step, axis=1) - 1
    rows = np.arange(len(h))
    result = np.empty((len(h), len(levels)))
    for k, level in enumerate(levels):
        right = np.minimum(np.count_nonzero((middle < level) & (step > 0), axis=1), last)
        left = np.maximum(right - 1, 0)
        gap = middle[rows, right] - middle[rows, left]
        part = np.clip((level - middle[rows, left]) / np.where(gap > 0, gap, 1.0), 0.0, 1.0)
        result[:, k] = value[rows, left] + part * (value[rows, right] - value[rows, left])
    return result


def _finite(values: ArrayLike, probability: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """The finite values of positive probability, and their probabilities normalised."""
    values, probability = np.asarray(values, float), np.asarray(probability, float)
    keep = np.isfinite(values) & (probability > 0)
    return values[keep], normalised(probability[keep])
