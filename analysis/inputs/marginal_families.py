"""The families of one-dimensional distributions: PDF, distribution function, quantiles and maximum likelihood.

Functions broadcast: parameters may be columns (R, 1) for samples (R, n).
"""

from __future__ import annotations

import numpy as np
from scipy import special

from .bounded_families import BOUNDED
from .family import MarginalError, MarginalFamily

__all__ = ["FAMILIES", "MarginalError", "MarginalFamily", "family_of"]

_LOG_SQRT_2PI = 0.5 * np.log(2.0 * np.pi)


def family_of(name: str) -> MarginalFamily:
    """The family of that name; raises MarginalError if there is none."""
    found = FAMILIES.get(name) or BOUNDED.get(name)
    if found is None:
        raise MarginalError(f"unknown marginal family {name!r}; known: {', '.join(FAMILIES)}")
    return found


def _normal_mle(x):
    return np.stack([x.mean(axis=1), x.std(axis=1)], axis=1)


_NORMAL = MarginalFamily(
    names=("mean", "sd"),
    positive_params=("sd",),
    positive=False,
    logpdf=lambda x, m, s: -0.5 * ((x - m) / s) ** 2 - np.log(s) - _LOG_SQRT_2PI,
    cdf=lambda x, m, s: special.ndtr((x - m) / s),
    sf=lambda x, m, s: special.ndtr((m - x) / s),
    ppf=lambda u, m, s: m + s * special.ndtri(u),
    mle=_normal_mle,
    moments=lambda m, s: (float(m), float(s) ** 2),
)


def _log(x):
    """ln x where x is positive; elsewhere ln 1e-300, where every distribution function is zero."""
    return np.log(np.maximum(x, 1e-300))


def _lognormal_mle(x):
    mean, sd = _normal_mle(np.log(x)).T
    return np.stack([np.exp(mean), sd], axis=1)


_LOGNORMAL = MarginalFamily(
    names=("median", "sigma_ln"),
    positive_params=("median", "sigma_ln"),
    positive=True,
    logpdf=lambda x, r, s: np.where(x > 0.0, _NORMAL.logpdf(_log(x), np.log(r), s) - _log(x), -np.inf),
    cdf=lambda x, r, s: special.ndtr((_log(x) - np.log(r)) / s),
    sf=lambda x, r, s: special.ndtr((np.log(r) - _log(x)) / s),
    ppf=lambda u, r, s: r * np.exp(s * special.ndtri(u)),
    mle=_lognormal_mle,
    moments=lambda r, s: (float(r * np.exp(0.5 * s * s)), float(r * r * np.exp(s * s) * np.expm1(s * s))),
)


def _gumbel_mle(x):
    """Largest-value Gumbel: beta solves beta = mean(x) - sum(x e^(-x/beta)) / sum(e^(-x/beta)), by Newton's method."""
    low = x.min(axis=1, keepdims=True)
    y = x - low
    mean = y.mean(axis=1)
    beta = np.sqrt(6.0) / np.pi * y.std(axis=1)
    for _ in range(60):
        weight = np.exp(-y / beta[:, None])
        total = weight.sum(axis=1)
        first = (y * weight).sum(axis=1) / total
        second = (y * y * weight).sum(axis=1) / total
        step = (beta - mean + first) / (1.0 + (second - first**2) / beta**2)
        beta = np.maximum(beta - step, 0.1 * beta)
        if np.all(np.abs(step) <= 1e-14 * beta):
            break
    location = low[:, 0] - beta * np.log(np.exp(-y / beta[:, None]).mean(axis=1))
    return np.stack([location, beta], axis=1)


_GUMBEL = MarginalFamily(
    names=("location", "scale"),
    positive_params=("scale",),
    positive=False,
    logpdf=lambda x, m, b: -(x - m) / b - np.exp(-(x - m) / b) - np.log(b),
    cdf=lambda x, m, b: np.exp(-np.exp(-(x - m) / b)),
    sf=lambda x, m, b: -np.expm1(-np.exp(-(x - m) / b)),
    ppf=lambda u, m, b: m - b * np.log(-np.log(u)),
    mle=_gumbel_mle,
    moments=lambda m, b: (float(m + b * np.euler_gamma), float(np.pi**2 / 6.0 * b * b)),
)


def _weibull_logpdf(x, k, scale):
    z = _log(x) - np.log(scale)
    return np.where(x > 0.0, np.log(k / scale) + (k - 1.0) * z - np.exp(k * z), -np.inf)


def _weibull_mle(x):
    """ln x is a smallest-value Gumbel variable, so -ln x is a largest-value one."""
    location, beta = _gumbel_mle(-np.log(x)).T
    return np.stack([1.0 / beta, np.exp(-location)], axis=1)


_WEIBULL = MarginalFamily(
    names=("shape", "scale"),
    positive_params=("shape", "scale"),
    positive=True,
    logpdf=_weibull_logpdf,
    cdf=lambda x, k, scale: -np.expm1(-((np.maximum(x, 0.0) / scale) ** k)),
    sf=lambda x, k, scale: np.exp(-((np.maximum(x, 0.0) / scale) ** k)),
    ppf=lambda u, k, scale: scale * (-np.log1p(-u)) ** (1.0 / k),
    mle=_weibull_mle,
    moments=lambda k, scale: (
        float(scale * special.gamma(1.0 + 1.0 / k)),
        float(scale**2 * (special.gamma(1.0 + 2.0 / k) - special.gamma(1.0 + 1.0 / k) ** 2)),
    ),
)


def _gamma_mle(x):
    """ln k - digamma(k) = ln mean(x) - mean(ln x), by Minka's (2002) generalised Newton steps."""
    mean = x.mean(axis=1)
    gap = np.log(mean) - np.log(x).mean(axis=1)
    k = (3.0 - gap + np.sqrt((gap - 3.0) ** 2 + 24.0 * gap)) / (12.0 * gap)
    for _ in range(30):
        slope = k * k * (1.0 / k - special.polygamma(1, k))
        update = 1.0 / (1.0 / k + (np.log(k) - special.digamma(k) - gap) / slope)
        done = np.all(np.abs(update - k) <= 1e-14 * k)
        k = update
        if done:
            break
    return np.stack([k, mean / k], axis=1)


def _gamma_logpdf(x, k, scale):
    value = (k - 1.0) * _log(x) - x / scale - k * np.log(scale) - special.gammaln(k)
    return np.where(x > 0.0, value, -np.inf)


_GAMMA = MarginalFamily(
    names=("shape", "scale"),
    positive_params=("shape", "scale"),
    positive=True,
    logpdf=_gamma_logpdf,
    cdf=lambda x, k, scale: special.gammainc(k, np.maximum(x, 0.0) / scale),
    sf=lambda x, k, scale: special.gammaincc(k, np.maximum(x, 0.0) / scale),
    ppf=lambda u, k, scale: scale * special.gammaincinv(k, u),
    mle=_gamma_mle,
    moments=lambda k, scale: (float(k * scale), float(k * scale**2)),
)

#: The families that are fitted to measured values; those of `bounded_families` are only stated.
FAMILIES: dict[str, MarginalFamily] = {
    "lognormal": _LOGNORMAL,
    "normal": _NORMAL,
    "gamma": _GAMMA,
    "weibull": _WEIBULL,
    "gumbel": _GUMBEL,
}
