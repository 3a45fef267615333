"""The normal distribution between two bounds: functions that hold in its far tails, moments and maximum likelihood.

All functions broadcast. mean and sd are those of the normal distribution before the truncation; low may be minus
infinity and high infinity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(100)
#: The quadrature ends where the PDF is exp(-_DEPTH) of its largest value.
_DEPTH = 60.0
#: The largest parent sd that `most_likely` gives, in widths of the interval: practically an exponential distribution.
_WIDEST = 10.0


def log_mass(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """ln(Phi(b) - Phi(a)) for a <= b, exact in both tails; minus infinity for a = b."""
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    upper = a > 0.0
    low, high = np.where(upper, -b, a), np.where(upper, -a, b)
    log_high = special.log_ndtr(high)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = np.where(low == -np.inf, -np.inf, special.log_ndtr(low) - log_high)
        return log_high + np.log(-np.expm1(np.minimum(gap, 0.0)))


def _scores(x, mean, sd, low, high):
    """Standard scores of x, moved into the bounds, and of the bounds."""
    x = np.clip(x, low, high)
    return (x - mean) / sd, (low - mean) / sd, (high - mean) / sd


def logpdf(x: ArrayLike, mean: ArrayLike, sd: ArrayLike, low: ArrayLike, high: ArrayLike) -> np.ndarray:
    """Log PDF at x, minus infinity outside the bounds."""
    x = np.asarray(x, dtype=float)
    z, a, b = _scores(x, mean, sd, low, high)
    value = -0.5 * z * z - 0.5 * np.log(2.0 * np.pi) - np.log(sd) - log_mass(a, b)
    return np.where((x >= low) & (x <= high), value, -np.inf)


def cdf(x: ArrayLike, mean: ArrayLike, sd: ArrayLike, low: ArrayLike, high: ArrayLike) -> np.ndarray:
    """P(X <= x)."""
    z, a, b = _scores(x, mean, sd, low, high)
    return np.minimum(np.exp(log_mass(a, z) - log_mass(a, b)), 1.0)


def sf(x: ArrayLike, mean: ArrayLike, sd: ArrayLike, low: ArrayLike, high: ArrayLike) -> np.ndarray:
    """P(X > x), accurate in the upper tail."""
    z, a, b = _scores(x, mean, sd, low, high)
    return np.minimum(np.exp(log_mass(z, b) - log_mass(a, b)), 1.0)


def ppf(u: ArrayLike, mean: ArrayLike, sd: ArrayLike, low: ArrayLike, high: ArrayLike) -> np.ndarray:
    """Quantile at probability u: from the lower or the upper tail of the normal distribution, whichever is smaller."""
    u = np.asarray(u, dtype=float)
    _, a, b = _scores(low, mean, sd, low, high)
    mass = log_mass(a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        below = np.logaddexp(special.log_ndtr(a), np.log(u) + mass)
        above = np.logaddexp(special.log_ndtr(-b), np.log1p(-u) + mass)
    lower = below < np.log(0.5)
    score = special.ndtri_exp(np.minimum(np.where(lower, below, above), 0.0))
    return np.clip(mean + sd * np.where(lower, score, -score), low, high)


def weighted_nodes(
    mean: ArrayLike, sd: ArrayLike, low: ArrayLike, high: ArrayLike, power: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (..., m) and weights (..., m) of sum 1 of a quadrature over the distribution; parameters have shape (...).

    With `power` p, expectations of exp(p x) are exact, too.
    """
    mean, sd, low, high = (np.asarray(v, dtype=float)[..., None] for v in np.broadcast_arrays(mean, sd, low, high))
    top = np.clip(mean, low, high)
    slope = np.abs(top - mean) / sd
    reach = sd * 2.0 * _DEPTH / (np.sqrt(slope**2 + 2.0 * _DEPTH) + slope)
    left, right = np.maximum(low, top - reach), np.minimum(high, top + reach + power * sd**2)
    y = 0.5 * (left + right) + 0.5 * (right - left) * _NODES
    weight = _WEIGHTS * np.exp(-0.5 * (y - top) * (y + top - 2.0 * mean) / sd**2)
    return y, weight / weight.sum(axis=-1, keepdims=True)


def most_likely(samples: np.ndarray, low: float, high: float) -> np.ndarray:
    """Parent mean and sd (R, 2) of the largest likelihood of each row of samples (R, n) between known bounds.

    Newton's method in the natural parameters of standardised values s, density ~ exp(t1 s + t2 s^2), in which the
    likelihood is concave. Where it increases up to t2 = 0 (values spread as evenly as a uniform or an exponential
    distribution), the parent's sd is ten times the width between the bounds.
    """
    centre, scale = samples.mean(axis=1), samples.std(axis=1)
    s = (samples - centre[:, None]) / scale[:, None]
    a, b = (low - centre) / scale, (high - centre) / scale
    seen = np.stack([s.mean(axis=1), (s * s).mean(axis=1)], axis=1)
    flattest = -0.5 / (_WIDEST * np.clip(b - a, 1.0, 1e3)) ** 2
    t = np.column_stack([np.zeros(len(s)), np.full(len(s), -0.5)])
    active = np.arange(len(s))
    for _ in range(200):
        at = t[active]
        y, weight = weighted_nodes(-0.5 * at[:, 0] / at[:, 1], np.sqrt(-0.5 / at[:, 1]), a[active], b[active])
        powers = np.stack([y, y * y], axis=1)
        expected = (powers * weight[:, None]).sum(axis=-1)
        off = powers - expected[..., None]
        curvature = np.einsum("rik,rjk,rk->rij", off, off, weight)
        slope = seen[active] - expected
        step = np.linalg.solve(curvature, slope[..., None])[..., 0]
        held = (at[:, 1] >= flattest[active]) & (step[:, 1] > 0.0)
        step[held] = np.column_stack([slope[held, 0] / curvature[held, 0, 0], np.zeros(held.sum())])
        # A step changes the parent's 1 / sd^2 at most by half, and t1 by a few units of the values' scatter.
        room = np.where(step[:, 1] > 0.0, 0.5 * np.abs(at[:, 1]), np.maximum(np.abs(at[:, 1]), 0.1))
        short = np.minimum(1.0, room / np.maximum(np.abs(step[:, 1]), 1e-300))
        step *= np.minimum(short, 3.0 / np.maximum(np.abs(step[:, 0]), 1e-300))[:, None]
        moved = at + step
        moved[:, 1] = np.minimum(moved[:, 1], flattest[active])
        t[active] = moved
        active = active[np.abs(moved - at).max(axis=1) > 1e-11 * (1.0 + np.abs(moved).max(axis=1))]
        if active.size == 0:
            break
    return np.column_stack([centre - 0.5 * scale * t[:, 0] / t[:, 1], scale * np.sqrt(-0.5 / t[:, 1])])
