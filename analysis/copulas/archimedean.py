"""Clayton, Gumbel and Joe copulas for positive dependence; their rotations are for negative dependence."""

from __future__ import annotations

import numpy as np
from scipy import special

from .family import Family, log_of, solve_conditional


def _clayton_log_sum(a, b):
    """ln(e^a + e^b - 1) for a, b >= 0, without cancellation."""
    high, low = np.maximum(a, b), np.minimum(a, b)
    return high + np.log1p(-np.exp(low - high) * np.expm1(-low))


def _clayton_parts(u, uc, v, vc, theta):
    log_u, log_v = log_of(u, uc), log_of(v, vc)
    return log_u, log_v, _clayton_log_sum(-theta * log_u, -theta * log_v)


def _clayton_logpdf(u, uc, v, vc, theta):
    log_u, log_v, log_sum = _clayton_parts(u, uc, v, vc, theta)
    return np.log1p(theta) - (1.0 + theta) * (log_u + log_v) - (2.0 + 1.0 / theta) * log_sum


def _clayton_conditional(u, uc, v, vc, theta):
    log_u, _, log_sum = _clayton_parts(u, uc, v, vc, theta)
    return np.exp(-(1.0 + theta) * log_u - (1.0 + 1.0 / theta) * log_sum)


def _clayton_inverse(u, uc, p, pc, theta):
    a = -theta * log_of(u, uc)
    b = -theta / (1.0 + theta) * log_of(p, pc)
    log_v = -(np.logaddexp(0.0, a + np.log(-np.expm1(-b)) + b)) / theta
    return np.exp(log_v), -np.expm1(log_v)


CLAYTON = Family(
    names=("theta",),
    bounds=((1e-4, 50.0),),
    logpdf=_clayton_logpdf,
    cdf=lambda u, uc, v, vc, theta: np.exp(-_clayton_parts(u, uc, v, vc, theta)[2] / theta),
    conditional=_clayton_conditional,
    inverse=_clayton_inverse,
    tau=lambda theta: theta / (theta + 2.0),
    from_tau=lambda tau: 2.0 * tau / (1.0 - tau),
    to_free=lambda theta: (np.log(theta),),
    from_free=lambda t: (np.exp(t),),
    sign=1,
)


def _gumbel_parts(u, uc, v, vc, theta):
    """x = -ln u, y = -ln v, their logarithms, and ln t with t = (x^theta + y^theta)^(1/theta)."""
    x, y = -log_of(u, uc), -log_of(v, vc)
    log_x, log_y = np.log(x), np.log(y)
    return x, y, log_x, log_y, np.logaddexp(theta * log_x, theta * log_y) / theta


def _gumbel_logpdf(u, uc, v, vc, theta):
    x, y, log_x, log_y, log_t = _gumbel_parts(u, uc, v, vc, theta)
    t = np.exp(log_t)
    return x + y - t + (theta - 1.0) * (log_x + log_y) + (1.0 - 2.0 * theta) * log_t + np.log(t + theta - 1.0)


def _gumbel_conditional(u, uc, v, vc, theta):
    x, _, log_x, _, log_t = _gumbel_parts(u, uc, v, vc, theta)
    return np.exp(x - np.exp(log_t) + (theta - 1.0) * (log_x - log_t))


def _gumbel_inverse(u, uc, p, pc, theta):
    """With t = x e^d the equation is x (e^d - 1) + (theta - 1) d = -ln p, convex in d: Newton's method from above."""
    x, target = -log_of(u, uc), -log_of(p, pc)
    d = np.minimum(target / (x + theta - 1.0), np.log1p(target / x))
    for _ in range(60):
        step = (x * np.expm1(d) + (theta - 1.0) * d - target) / (x * np.exp(d) + theta - 1.0)
        d = np.maximum(d - step, 0.0)
        if np.all(np.abs(step) <= 1e-15 * d + 1e-300):
            break
    theta_d = np.maximum(theta * d, 1e-300)
    log_y = np.log(x) + d + np.log(-np.expm1(-theta_d)) / theta
    return np.exp(-np.exp(log_y)), -np.expm1(-np.exp(log_y))


GUMBEL = Family(
    names=("theta",),
    bounds=((1.0 + 1e-5, 50.0),),
    logpdf=_gumbel_logpdf,
    cdf=lambda u, uc, v, vc, theta: np.exp(-np.exp(_gumbel_parts(u, uc, v, vc, theta)[4])),
    conditional=_gumbel_conditional,
    inverse=_gumbel_inverse,
    tau=lambda theta: 1.0 - 1.0 / theta,
    from_tau=lambda tau: 1.0 / (1.0 - tau),
    to_free=lambda theta: (np.log(theta - 1.0),),
    from_free=lambda t: (1.0 + np.exp(t),),
    sign=1,
)


def _joe_parts(u, uc, v, vc, theta):
    """ln(1-u), ln(1-v), 1 - (1-v)^theta and ln s with s = 1 - (1 - (1-u)^theta)(1 - (1-v)^theta)."""
    log_uc, log_vc = log_of(uc, u), log_of(vc, v)
    one_a, one_b = -np.expm1(theta * log_uc), -np.expm1(theta * log_vc)
    product = one_a * one_b
    high, low = theta * np.maximum(log_uc, log_vc), theta * np.minimum(log_uc, log_vc)
    tiny = high + np.log1p(-np.exp(low - high) * np.expm1(high))
    return log_uc, log_vc, one_b, np.where(product < 0.5, np.log1p(-np.minimum(product, 0.5)), tiny)


def _joe_logpdf(u, uc, v, vc, theta):
    log_uc, log_vc, _, log_s = _joe_parts(u, uc, v, vc, theta)
    return (1.0 / theta - 2.0) * log_s + (theta - 1.0) * (log_uc + log_vc) + np.log(theta - 1.0 + np.exp(log_s))


def _joe_conditional(u, uc, v, vc, theta):
    log_uc, _, one_b, log_s = _joe_parts(u, uc, v, vc, theta)
    return np.exp((1.0 / theta - 1.0) * log_s + (theta - 1.0) * log_uc) * one_b


def _joe_tau(theta):
    theta = np.asarray(theta, dtype=float)
    near = np.abs(theta - 2.0) < 1e-5
    safe = np.where(near, 3.0, theta)
    exact = 1.0 + 2.0 / (2.0 - safe) * (special.digamma(2.0) - special.digamma(2.0 / safe + 1.0))
    around = 1.0 - special.polygamma(1, 2.0) + (theta - 2.0) * _JOE_SLOPE
    return np.where(near, around, exact)[()]


#: d tau / d theta at theta = 2, from the expansion of the digamma difference.
_JOE_SLOPE = 0.5 * special.polygamma(1, 2.0) + 0.25 * special.polygamma(2, 2.0)


def _joe_from_tau(tau):
    tau = np.asarray(tau, dtype=float)
    low, high = np.full(tau.shape, 1.0), np.full(tau.shape, 60.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = _joe_tau(middle) < tau
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


JOE = Family(
    names=("theta",),
    bounds=((1.0 + 1e-5, 50.0),),
    logpdf=_joe_logpdf,
    cdf=lambda u, uc, v, vc, theta: -np.expm1(_joe_parts(u, uc, v, vc, theta)[3] / theta),
    conditional=_joe_conditional,
    inverse=lambda u, uc, p, pc, theta: solve_conditional(_joe_conditional, _joe_logpdf, u, uc, p, pc, theta),
    tau=_joe_tau,
    from_tau=_joe_from_tau,
    to_free=lambda theta: (np.log(theta - 1.0),),
    from_free=lambda t: (1.0 + np.exp(t),),
    sign=1,
)
