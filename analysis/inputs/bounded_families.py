"""Distributions between a lower and an upper bound: uniform, triangular, truncated normal and truncated lognormal.

They are stated, never fitted to measured values: their bounds are known. Functions broadcast as those of
`marginal_families` do. `parent_...` are parameters of the normal or lognormal distribution before the truncation:

    truncated normal       F(x) = (Phi(z) - Phi(a)) / (Phi(b) - Phi(a)),  z = (x - parent_mean) / parent_sd,
    truncated lognormal    the same in ln x, with ln parent_median and parent_sigma_ln,

and a, b are the values of z at the bounds.
"""

from __future__ import annotations

import numpy as np

from .family import MarginalError, MarginalFamily
from .truncated_normal import cdf, logpdf, most_likely, ppf, sf, weighted_nodes


def _log(x):
    """ln x, minus infinity where x is not positive."""
    x = np.asarray(x, dtype=float)
    with np.errstate(divide="ignore"):
        return np.log(np.maximum(x, 0.0))


def _not_fitted(samples):
    raise MarginalError("a distribution with bounds is stated in [variables]; it is not fitted to measured values")


def _unordered(low, high):
    return "" if low < high else f"low = {low:g} must be below high = {high:g}"


_UNIFORM = MarginalFamily(
    names=("low", "high"),
    positive_params=(),
    positive=False,
    logpdf=lambda x, a, b: np.where((x >= a) & (x <= b), -np.log(b - a), -np.inf),
    cdf=lambda x, a, b: np.clip((x - a) / (b - a), 0.0, 1.0),
    sf=lambda x, a, b: np.clip((b - x) / (b - a), 0.0, 1.0),
    ppf=lambda u, a, b: a + u * (b - a),
    mle=_not_fitted,
    moments=lambda a, b: (float(0.5 * (a + b)), float((b - a) ** 2 / 12.0)),
    wrong=_unordered,
)


def _triangular_logpdf(x, low, mode, high):
    rising, falling = np.maximum(mode - low, 1e-300), np.maximum(high - mode, 1e-300)
    height = np.where(x < mode, (x - low) / rising, np.where(x > mode, (high - x) / falling, 1.0))
    return np.where((x >= low) & (x <= high), np.log(2.0 / (high - low)) + _log(height), -np.inf)


def _triangular_below(x, low, mode, high):
    """The distribution function between low and the mode, where the PDF increases."""
    return (np.clip(x, low, mode) - low) ** 2 / ((high - low) * np.maximum(mode - low, 1e-300))


def _triangular_above(x, low, mode, high):
    """One minus the distribution function between the mode and high, where the PDF decreases."""
    return (high - np.clip(x, mode, high)) ** 2 / ((high - low) * np.maximum(high - mode, 1e-300))


def _triangular_ppf(u, low, mode, high):
    width = high - low
    left = low + np.sqrt(u * width * (mode - low))
    right = high - np.sqrt((1.0 - u) * width * (high - mode))
    return np.where(u * width < mode - low, left, right)


def _triangular_moments(low, mode, high):
    spread = (high - low) ** 2 - (mode - low) * (high - mode)
    return float(low + ((mode - low) + (high - low)) / 3.0), float(spread / 18.0)


_TRIANGULAR = MarginalFamily(
    names=("low", "mode", "high"),
    positive_params=(),
    positive=False,
    logpdf=_triangular_logpdf,
    cdf=lambda x, a, c, b: np.where(x < c, _triangular_below(x, a, c, b), 1.0 - _triangular_above(x, a, c, b)),
    sf=lambda x, a, c, b: np.where(x < c, 1.0 - _triangular_below(x, a, c, b), _triangular_above(x, a, c, b)),
    ppf=_triangular_ppf,
    mle=_not_fitted,
    moments=_triangular_moments,
    wrong=lambda a, c, b: _unordered(a, b) or ("" if a <= c <= b else f"mode = {c:g} is outside [{a:g}, {b:g}]"),
)


def _truncated_moments(mean, sd, low, high):
    y, weight = weighted_nodes(mean, sd, low, high)
    centre = float(weight @ y)
    return centre, float(weight @ (y - centre) ** 2)


_TRUNCATED_NORMAL = MarginalFamily(
    names=("parent_mean", "parent_sd", "low", "high"),
    positive_params=("parent_sd",),
    positive=False,
    logpdf=logpdf,
    cdf=cdf,
    sf=sf,
    ppf=ppf,
    mle=_not_fitted,
    moments=_truncated_moments,
    wrong=lambda m, s, a, b: _unordered(a, b),
)


def _in_logarithms(function):
    """A function of the truncated normal distribution for ln x: parameters of the truncated lognormal, sign of x."""

    def of_logarithms(x, median, sigma_ln, low, high):
        return function(_log(x), np.log(median), sigma_ln, _log(low), _log(high))

    return of_logarithms


def _truncated_lognormal_logpdf(x, *params):
    inside = np.asarray(x) > 0.0
    logs = np.where(inside, _log(np.where(inside, x, 1.0)), 0.0)
    return np.where(inside, _in_logarithms(logpdf)(x, *params) - logs, -np.inf)


def _truncated_lognormal_ppf(u, median, sigma_ln, low, high):
    return np.clip(np.exp(ppf(u, np.log(median), sigma_ln, _log(low), _log(high))), low, high)


def _truncated_lognormal_moments(median, sigma_ln, low, high):
    y, weight = weighted_nodes(np.log(median), sigma_ln, _log(low), _log(high), power=2.0)
    centre = float(weight @ np.exp(y))
    return centre, float(weight @ (np.exp(y) - centre) ** 2)


_TRUNCATED_LOGNORMAL = MarginalFamily(
    names=("parent_median", "parent_sigma_ln", "low", "high"),
    positive_params=("parent_median", "parent_sigma_ln", "high"),
    positive=True,
    logpdf=_truncated_lognormal_logpdf,
    cdf=_in_logarithms(cdf),
    sf=_in_logarithms(sf),
    ppf=_truncated_lognormal_ppf,
    mle=_not_fitted,
    moments=_truncated_lognormal_moments,
    wrong=lambda m, s, a, b: f"low = {a:g} must not be negative" if a < 0.0 else _unordered(a, b),
)

BOUNDED: dict[str, MarginalFamily] = {
    "uniform": _UNIFORM,
    "triangular": _TRIANGULAR,
    "truncated_normal": _TRUNCATED_NORMAL,
    "truncated_lognormal": _TRUNCATED_LOGNORMAL,
}


def refit_rows(family: str, params: dict[str, float], samples: np.ndarray) -> np.ndarray:
    """Parameters (R, k) of a family of BOUNDED from every row of samples (R, n) of it.

    Uniform and triangular distributions keep their shape, and get the mean and the standard deviation of the row: the
    largest and the smallest value would show less scatter than the published figures of so many measurements have.
    Truncated distributions keep their bounds; the parameters of the parent have the largest likelihood.
    """
    if family == "truncated_normal":
        found = most_likely(samples, params["low"], params["high"])
        return np.column_stack([found, np.tile([params["low"], params["high"]], (len(found), 1))])
    if family == "truncated_lognormal":
        mean, sd = most_likely(np.log(samples), float(_log(params["low"])), float(_log(params["high"]))).T
        return np.column_stack([np.exp(mean), sd, np.tile([params["low"], params["high"]], (len(mean), 1))])
    values = np.array(list(params.values()))
    mean, variance = BOUNDED[family].moments(*values)
    scale = samples.std(axis=1) / np.sqrt(variance)
    return samples.mean(axis=1)[:, None] + scale[:, None] * (values - mean)
