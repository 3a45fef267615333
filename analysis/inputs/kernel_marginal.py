"""A marginal without a family: a kernel density of ln x, for values that no family fits, such as two humps.

f(x) = 1 / (n h x) sum_i phi((ln x - ln c_i) / h) with the centres c_i and the bandwidth h: a mixture of n lognormal
distributions.  Functions take x, h and the centres (n,), in the unit of x.  The centres are the measured values, moved
in ln x towards their mean so that mean and variance of ln x are those of the sample (Jones 1991); a plain
kernel density of ln x has a variance that is too large by h^2.
"""

from __future__ import annotations

import numpy as np
from scipy import interpolate, special

from .marginal_families import MarginalError, MarginalFamily

NAME = "kernel"
_SQRT_2PI = np.sqrt(2.0 * np.pi)
#: Cells of the histogram from which the bandwidth is computed, and elements of the largest temporary array.
_CELLS, _CHUNK = 1024, 2_000_000
#: Limits of normal scores, and points of the table in which a quantile is first looked up.
_LOWEST, _HIGHEST, _TABLE = -37.5, 8.5, 600
#: A step of Newton's method that is shorter is the last one: the next would be of the order of its square.
_NEAR = 1e-7


def bandwidth(x: np.ndarray) -> float:
    """Bandwidth h of positive values x (n,), in ln x: the direct plug-in of Sheather and Jones (1991), two stages.

    h = (1 / (2 sqrt(pi) n psi_4))^(1/5), where psi_4, the integral of f'' squared, is estimated with a pilot bandwidth
    from psi_6, and this one from the normal psi_8 (Wand and Jones 1995, Section 3.6.1).  Scale: the smaller of standard
    deviation and interquartile range / 1.349.  With ties h is at least half the median distance of distinct values, so
    that the gaps between most steps of rounded values are filled.
    """
    y = np.log(x)
    n = len(y)
    quarter, three = np.quantile(y, [0.25, 0.75])
    scale = float(min(np.std(y, ddof=1), (three - quarter) / 1.349)) or float(np.std(y, ddof=1))
    psi_8 = 105.0 / (32.0 * np.sqrt(np.pi) * scale**9)
    psi_6 = _functional(y, 6, (30.0 / (_SQRT_2PI * psi_8 * n)) ** (1.0 / 9.0))
    psi_4 = _functional(y, 4, (-6.0 / (_SQRT_2PI * psi_6 * n)) ** (1.0 / 7.0))
    h = float((1.0 / (2.0 * np.sqrt(np.pi) * psi_4 * n)) ** 0.2)
    distinct = np.unique(y)
    return h if distinct.size == n else max(h, 0.5 * float(np.median(np.diff(distinct))))


def _functional(y: np.ndarray, order: int, g: float) -> float:
    """psi_order: mean of the derivative of that order of the normal density of scale g over all differences of y (n,).

    The values are shared linearly between the two nearest points of a grid, so that only the differences on it count.
    """
    low = y.min()
    step = np.ptp(y) / (_CELLS - 1)
    place = (y - low) / step
    left = np.minimum(place.astype(int), _CELLS - 2)
    share = place - left
    count = np.bincount(left, 1.0 - share, _CELLS) + np.bincount(left + 1, share, _CELLS)
    pairs = np.correlate(count, count, "full")
    z = np.arange(1 - _CELLS, _CELLS) * step / g
    hermite = np.polynomial.hermite_e.hermeval(z, np.eye(order + 1)[order])
    density = np.exp(-0.5 * z * z) / _SQRT_2PI
    return float((pairs * hermite * density).sum() / (len(y) ** 2 * g ** (order + 1)))


def centres(x: np.ndarray, h: float) -> np.ndarray:
    """Centres (n,) of the kernels for values x (n,) and bandwidth h: mean and variance of ln x are kept if h allows."""
    y = np.log(x)
    mean, variance = y.mean(), y.var()
    return np.exp(mean + (y - mean) * np.sqrt(max(1.0 - h * h / variance, 0.0)))


def left_out_loglik(x: np.ndarray, h: float) -> float:
    """Sum of the log PDF at each value of x (n,) of a kernel density of the others: -2 of it is comparable with an AIC.

    Both estimate the log-likelihood of other values of the same distribution (Stone 1977).
    """
    y = np.log(x)
    n, total = len(y), 0.0
    for part in np.array_split(np.arange(n), max(1, n * n // _CHUNK)):
        z = (y[part, None] - y) / h
        z[np.arange(len(part)), part] = np.inf
        total += float((special.logsumexp(-0.5 * z * z, axis=1)).sum())
    return total - n * float(np.log((n - 1) * h * _SQRT_2PI)) - float(y.sum())


def _of_kernels(function, x, h, c):
    """Mean over the kernels of function(z) with z = (ln x - ln c) / h, of the shape of x; x below 0 is at ln 1e-300."""
    y = np.log(np.maximum(np.asarray(x, dtype=float), 1e-300))
    flat, at = y.ravel(), np.log(c)
    out = np.empty(flat.shape)
    for part in np.array_split(np.arange(flat.size), max(1, flat.size * at.size // _CHUNK)):
        out[part] = function((flat[part, None] - at) / h)
    return out.reshape(y.shape)


def _mean_log_normal(z):
    return special.logsumexp(-0.5 * z * z, axis=1) - np.log(z.shape[1])


def _logpdf(x, h, c):
    y = np.log(np.maximum(x, 1e-300))
    return np.where(x > 0.0, _of_kernels(_mean_log_normal, x, h, c) - np.log(h * _SQRT_2PI) - y, -np.inf)


def _cdf(x, h, c):
    return _of_kernels(lambda z: special.ndtr(z).mean(axis=1), x, h, c)


def _sf(x, h, c):
    return _of_kernels(lambda z: special.ndtr(-z).mean(axis=1), x, h, c)


def _score_and_slope(y, upper, h, c):
    """Normal score of the distribution function at y = ln x, from the upper tail where `upper`, and its slope in y."""
    sign = np.where(upper, -1.0, 1.0)
    at = np.log(c)
    tail, density = np.empty((2, y.size))
    for part in np.array_split(np.arange(y.size), max(1, y.size * at.size // _CHUNK)):
        z = (y[part, None] - at) / h
        tail[part] = special.ndtr(sign[part, None] * z).mean(axis=1)
        density[part] = np.exp(-0.5 * z * z).mean(axis=1)
    score = special.ndtri(np.clip(tail, 1e-310, 1.0 - 2.0**-53))
    return sign * score, density / h * np.exp(0.5 * score**2)


def _ppf(u, h, c):
    """Quantiles: a cubic interpolation in a table of normal scores along ln x, then Newton's method in the score."""
    u = np.asarray(u, dtype=float)
    unique, index = np.unique(u.ravel(), return_inverse=True)
    wanted = np.clip(special.ndtri(unique), _LOWEST, _HIGHEST)
    table = np.linspace(np.log(c.min()) + _LOWEST * h, np.log(c.max()) + _HIGHEST * h, _TABLE)
    scores, slopes = _score_and_slope(table, table > np.log(np.median(c)), h, c)
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(scores)) > 0.0]) & (slopes > 0.0)
    table, scores, slopes = table[rising], scores[rising], slopes[rising]
    place = np.clip(np.searchsorted(scores, wanted), 1, len(table) - 1)
    low, high = table[place - 1].copy(), table[place].copy()
    y = np.clip(interpolate.CubicHermiteSpline(scores, table, 1.0 / slopes)(wanted), low, high)
    active = np.arange(y.size)
    for _ in range(60):
        at = y[active]
        score, slope = _score_and_slope(at, wanted[active] > 0.0, h, c)
        gap = score - wanted[active]
        low[active], high[active] = np.where(gap < 0.0, at, low[active]), np.where(gap > 0.0, at, high[active])
        step = at - gap / np.maximum(slope, 1e-300)
        inside = (step >= low[active]) & (step <= high[active])
        y[active] = np.where(gap == 0.0, at, np.where(inside, step, 0.5 * (low[active] + high[active])))
        active = active[np.abs(y[active] - at) > _NEAR * np.maximum(np.abs(at), 1.0)]
        if not active.size:
            break
    quantile = np.exp(y)[index].reshape(u.shape)
    return np.where(u <= 0.0, 0.0, np.where(u >= 1.0, np.inf, quantile))


def _moments(h, c):
    mean = float(c.mean() * np.exp(0.5 * h * h))
    return mean, float((c**2).mean() * np.exp(2.0 * h * h)) - mean**2


def _no_rows(samples):
    raise MarginalError("kernel: has no maximum-likelihood parameters")


KERNEL = MarginalFamily(
    names=("bandwidth_ln",),
    positive_params=("bandwidth_ln",),
    positive=True,
    logpdf=_logpdf,
    cdf=_cdf,
    sf=_sf,
    ppf=_ppf,
    mle=_no_rows,
    moments=_moments,
)
