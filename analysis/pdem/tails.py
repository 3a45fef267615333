"""Exceedance probabilities and quantiles of points that carry probabilities, with intervals; no kernel enters.

The distribution function F passes through the middles of the points' steps, as in `weighted.quantile`.  Between the
points the logarithm of the tail probability (of F below the median, of 1 - F above it) is linear.  Beyond the outermost
points the tail is exponential; its scale is the mean excess of the three outermost points.

Intervals: the estimated probability p has the variance of m random samples, p (1 - p) / m.  Two parts determine m.
Representative points have a smaller variance than n = 1 / sum P^2 random ones, by the factor 0.16 or, if that is less,
0.6 / sqrt(n p (1 - p)); `tests/benchmarks/bench_tails.py` tests both numbers.  The own noise of a run moves points
across the threshold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .weighted import normalised

LEVEL = 0.95
#: Points at each end whose mean excess gives the scale of the exponential tail.
_OUTERMOST = 3
#: Logarithm of the tail probability at which the exponential tail ends.
_END = 36.0
#: Variance of an exceedance probability from representative points over that from random ones: for few points beyond
#: the threshold, and times sqrt(n p (1 - p)) for many.
_FEW, _MANY = 0.16, 0.6


def exceedance(values: ArrayLike, probability: ArrayLike, threshold: ArrayLike) -> np.ndarray:
    """Probability (n,) that values (Q,) with probabilities (Q,) exceed `threshold` (n,); points without a value drop
    out.
    """
    x, tail = _curve(*_sorted(values, probability))
    at = np.interp(np.asarray(threshold, float), x, tail)
    return np.where(at < 0, 1.0 - 0.5 * np.exp(np.minimum(at, 0.0)), 0.5 * np.exp(-np.maximum(at, 0.0)))


def quantile(values: ArrayLike, probability: ArrayLike, level: ArrayLike) -> np.ndarray:
    """Quantiles of values (Q,) with probabilities (Q,) at the levels (n,): the inverse of 1 - `exceedance`."""
    x, tail = _curve(*_sorted(values, probability))
    below = np.asarray(level, float)
    return np.interp(_log_tail(below, 1.0 - below), tail, x)


def exceedance_interval(
    values: ArrayLike, probability: ArrayLike, threshold: ArrayLike, noise: float = 0.0, level: float = LEVEL
) -> tuple[np.ndarray, np.ndarray]:
    """Interval low, high (n,) of the probability that a response exceeds `threshold` (n,), from one set of points.

    values (Q,), probability (Q,) of points of `select_points`; points that were drawn at random leave more.  noise: the
    standard deviation of a single run's own noise in the values, in their unit.  The interval is for a response that
    depends on several inputs, and is too wide where one input alone determines it.
    """
    threshold = np.asarray(threshold, float)
    share = exceedance(values, probability, threshold)
    return _interval(share, _random_samples(share, threshold, values, probability, noise), level)


def quantile_interval(
    values: ArrayLike, probability: ArrayLike, quantile_level: ArrayLike, noise: float = 0.0, level: float = LEVEL
) -> tuple[np.ndarray, np.ndarray]:
    """Interval low, high (n,) of the quantiles at `quantile_level` (n,), from the interval of the distribution function
    there (Woodruff 1952); the other arguments as in `exceedance_interval`.
    """
    share = 1.0 - np.asarray(quantile_level, float)
    threshold = quantile(values, probability, quantile_level)
    low, high = _interval(share, _random_samples(share, threshold, values, probability, noise), level)
    return quantile(values, probability, 1.0 - high), quantile(values, probability, 1.0 - low)


def _sorted(values: ArrayLike, probability: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """The values of the points that have one, ascending, and their probabilities normalised."""
    values, probability = np.asarray(values, float), np.asarray(probability, float)
    known = np.isfinite(values) & (probability > 0)
    order = np.argsort(values[known], kind="stable")
    return values[known][order], normalised(probability[known][order])


def _log_tail(below: np.ndarray, above: np.ndarray) -> np.ndarray:
    """ln 2F below the median and -ln 2(1 - F) above it, for F = `below` (n,) and 1 - F = `above` (n,)."""
    with np.errstate(divide="ignore"):
        return np.where(below < 0.5, np.log(2.0 * below), -np.log(2.0 * above))


def _curve(x: np.ndarray, probability: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and `_log_tail` (n + 2,) at the points and at the ends of the exponential tails."""
    count = min(_OUTERMOST, len(x) - 1)
    scales = [0.0, 0.0]
    if count > 0:
        scales = [
            float(np.average(x[count] - x[:count], weights=probability[:count])),
            float(np.average(x[-count:] - x[-count - 1], weights=probability[-count:])),
        ]
    below, above = np.cumsum(probability), np.cumsum(probability[::-1])[::-1]
    tail = _log_tail(below - 0.5 * probability, above - 0.5 * probability)
    x = np.concatenate([[x[0] - _END * scales[0]], x, [x[-1] + _END * scales[1]]])
    return x, np.concatenate([[tail[0] - _END], tail, [tail[-1] + _END]])


def _random_samples(
    share: np.ndarray, threshold: np.ndarray, values: ArrayLike, probability: ArrayLike, noise: float
) -> np.ndarray:
    """Number (n,) of random samples that would know the probabilities `share` (n,) as well as the points do."""
    from scipy.special import ndtr

    x, weight = _sorted(values, probability)
    points = 1.0 / np.sum(weight**2)
    share = np.clip(share, 0.5 / points, 1.0 - 0.5 / points)
    random = share * (1.0 - share) / points
    variance = random * np.minimum(_FEW, _MANY / (points * np.sqrt(random)))
    if noise > 0:
        off = np.abs(x - np.asarray(threshold)[..., None]) / (np.sqrt(2.0) * noise)
        variance = variance + 0.5 * ndtr(-off) @ weight**2
    return points * random / np.minimum(variance, random)


def _interval(share: np.ndarray, samples: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Jeffreys' interval low, high (n,) of a probability that `samples` (n,) random samples estimate as `share`."""
    from scipy.special import betaincinv

    tails = 0.5 - 0.5 * level, 0.5 + 0.5 * level
    low, high = (betaincinv(samples * share + 0.5, samples * (1.0 - share) + 0.5, tail) for tail in tails)
    return np.minimum(low, share), np.maximum(high, share)
