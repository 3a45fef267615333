"""Frank and Plackett copulas: one parameter each, both signs of dependence."""

from __future__ import annotations

import numpy as np
from scipy import special

from .family import Family

_SMALLEST_FRANK = 1e-5


def _both_signs(function, negative, turn):
    """Evaluate `function` of the positive branch; where `negative` holds, with u and its complement swapped."""

    def wrapped(u, uc, v, vc, theta):
        flip = negative(theta)
        return function(np.where(flip, uc, u), np.where(flip, u, uc), v, vc, turn(theta))

    return wrapped


def _frank_log_terms(u, uc, v, vc, k):
    """Logarithms of e^(-k u)(1 - e^(-k v)) and e^(-k v)(1 - e^(-k (1-v))), whose sum is the denominator of the PDF."""
    first = -k * u + np.log(-np.expm1(-k * v))
    return first, -k * v + np.log(-np.expm1(-k * vc))


def _frank_logpdf(u, uc, v, vc, k):
    log_sum = np.logaddexp(*_frank_log_terms(u, uc, v, vc, k))
    return np.log(k) + np.log(-np.expm1(-k)) - k * (u + v) - 2.0 * log_sum


def _frank_conditional(u, uc, v, vc, k):
    first, second = _frank_log_terms(u, uc, v, vc, k)
    return special.expit(first - second)


def _frank_inverse(u, uc, p, pc, k):
    share = pc * np.exp(-k * u) + p
    v = -np.log1p(p * np.expm1(-k) / share) / k
    vc = np.log1p(pc * np.exp(-k * u) * np.expm1(k) / share) / k
    return np.where(v < 0.5, v, 1.0 - vc), np.where(v < 0.5, 1.0 - v, vc)


def _frank_cdf(u, uc, v, vc, theta):
    """For theta < 0 every term is positive; for theta > 0 the upper corner uses the denominator of the PDF."""
    k = np.abs(theta)
    growing = np.log1p(np.expm1(k * u) * np.expm1(k * v) / np.expm1(k)) / k
    inner = np.expm1(-k * u) * np.expm1(-k * v) / -np.expm1(-k)
    upper = np.log(-np.expm1(-k)) - np.logaddexp(*_frank_log_terms(u, uc, v, vc, k))
    return np.where(theta < 0.0, growing, np.where(inner < 0.5, -np.log1p(-np.minimum(inner, 0.5)), upper) / k)


def _frank_tau(theta):
    """1 - 4 (1 - D_1(theta)) / theta with Debye's function of order 1; its series where theta is small."""
    theta = np.asarray(theta, dtype=float)
    k = np.maximum(np.abs(theta), 0.3)
    debye = (np.pi**2 / 6.0 - special.spence(-np.expm1(-k)) + k * np.log(-np.expm1(-k))) / k
    series = theta / 9.0 - theta**3 / 900.0 + theta**5 / 52920.0 - theta**7 / 2721600.0
    return np.where(np.abs(theta) < 0.3, series, np.sign(theta) * (1.0 - 4.0 * (1.0 - debye) / k))[()]


def _invert_tau(tau_of, low, high):
    """The inverse of tau_of by bisection between low and high; vectorised."""

    def from_tau(tau):
        tau = np.asarray(tau, dtype=float)
        a, b = np.full(tau.shape, low), np.full(tau.shape, high)
        for _ in range(55):
            middle = 0.5 * (a + b)
            below = tau_of(middle) < tau
            a, b = np.where(below, middle, a), np.where(below, b, middle)
        return 0.5 * (a + b)

    return from_tau


def _frank_negative(theta):
    return np.asarray(theta) < 0.0


def _frank_size(theta):
    return np.maximum(np.abs(theta), _SMALLEST_FRANK)


def _frank_inverse_both(u, uc, p, pc, theta):
    flip = _frank_negative(theta)
    return _frank_inverse(np.where(flip, uc, u), np.where(flip, u, uc), p, pc, _frank_size(theta))


FRANK = Family(
    names=("theta",),
    bounds=((-60.0, 60.0),),
    logpdf=_both_signs(_frank_logpdf, _frank_negative, _frank_size),
    cdf=lambda u, uc, v, vc, theta: _frank_cdf(
        u, uc, v, vc, np.where(_frank_negative(theta), -1.0, 1.0) * _frank_size(theta)
    ),
    conditional=_both_signs(_frank_conditional, _frank_negative, _frank_size),
    inverse=_frank_inverse_both,
    tau=_frank_tau,
    from_tau=_invert_tau(_frank_tau, -60.0, 60.0),
    to_free=lambda theta: (theta,),
    from_free=lambda t: (t,),
)


def _plackett_root(u, uc, v, vc, theta):
    """R with R^2 = 1 + 2 eta (u (1-v) + v (1-u)) + eta^2 (u - v)^2, all terms positive for theta >= 1; and u - v."""
    eta = theta - 1.0
    difference = np.where(u < 0.5, u - v, vc - uc)
    return eta, np.sqrt(1.0 + 2.0 * eta * (u * vc + v * uc) + (eta * difference) ** 2)


def _plackett_logpdf(u, uc, v, vc, theta):
    eta, root = _plackett_root(u, uc, v, vc, theta)
    return np.log(theta) + np.log1p(eta * (u * vc + v * uc)) - 3.0 * np.log(root)


def _plackett_conditional(u, uc, v, vc, theta):
    eta, root = _plackett_root(u, uc, v, vc, theta)
    rest = 1.0 + eta * u - (theta + 1.0) * v
    small = 2.0 * theta * v * vc / (root * (root + np.abs(rest)))
    return np.where(rest > 0.0, small, 1.0 - small)


def _plackett_small_root(u, uc, p, pc, theta):
    """The smaller root v of theta v (1-v) = p (1-p) R^2."""
    eta, a = theta - 1.0, p * pc
    c = 2.0 * a * (u * theta**2 + uc) + theta * (1.0 - 2.0 * a)
    d = np.sqrt(theta) * np.sqrt(theta + 4.0 * a * u * uc * eta**2)
    return 2.0 * a * (1.0 + eta * u) ** 2 / (c + np.abs(pc - p) * d)


def _plackett_inverse(u, uc, p, pc, theta):
    flip = theta < 1.0
    a, ac, k = np.where(flip, uc, u), np.where(flip, u, uc), np.where(flip, 1.0 / theta, theta)
    v, vc = _plackett_small_root(a, ac, p, pc, k), _plackett_small_root(ac, a, pc, p, k)
    return np.where(p < 0.5, v, 1.0 - vc), np.where(p < 0.5, 1.0 - v, vc)


def _plackett_cdf(u, uc, v, vc, theta):
    """2 theta u v / (S + R) where S = 1 + (theta - 1)(u + v) is positive, (S - R) / (2 (theta - 1)) where it is not."""
    eta = theta - 1.0
    flip = theta < 1.0
    _, root = _plackett_root(np.where(flip, uc, u), np.where(flip, u, uc), v, vc, np.where(flip, 1.0 / theta, theta))
    root = np.where(flip, theta, 1.0) * root
    total = 1.0 + eta * (u + v)
    safe = np.where(total > 0.0, total + root, 1.0)
    return np.where(total > 0.0, 2.0 * theta * u * v / safe, (total - root) / np.where(eta == 0.0, 1.0, 2.0 * eta))


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_CELLS = special.ndtr(np.linspace(-7.0, 7.0, 9))
_CELLS[0], _CELLS[-1] = 0.0, 1.0
_GRID = (0.5 * (np.diff(_CELLS)[:, None] * _NODES + _CELLS[:-1, None] + _CELLS[1:, None])).ravel()
_GRID_WEIGHTS = (0.5 * np.diff(_CELLS)[:, None] * _WEIGHTS).ravel()


def _plackett_tau(theta):
    """1 - 4 times the integral of (dC/du)(dC/dv), by Gauss-Legendre quadrature: no closed form is known."""
    theta = np.asarray(theta, dtype=float)
    u, v = np.meshgrid(_GRID, _GRID, indexing="ij")
    weights = np.outer(_GRID_WEIGHTS, _GRID_WEIGHTS)

    def one(value):
        k = max(value, 1.0 / value)
        du = _plackett_conditional(u, 1.0 - u, v, 1.0 - v, k)
        return (1.0 if value >= 1.0 else -1.0) * (1.0 - 4.0 * float((weights * du * du.T).sum()))

    return np.array([one(value) for value in theta.ravel()]).reshape(theta.shape)[()]


def _plackett_from_tau(tau):
    """Start of the fit: the tetrachoric relation tau ~ 2/pi asin(rho) with theta = ((1+b)/(1-b))^(pi/2), b = rho."""
    b = np.clip(np.sin(0.5 * np.pi * np.asarray(tau, dtype=float)), -0.9999, 0.9999)
    return ((1.0 + b) / (1.0 - b)) ** (0.5 * np.pi)


def _plackett_negative(theta):
    return np.asarray(theta) < 1.0


def _plackett_size(theta):
    return np.where(np.asarray(theta) < 1.0, 1.0 / theta, theta)


PLACKETT = Family(
    names=("theta",),
    bounds=((1e-5, 1e5),),
    logpdf=_both_signs(_plackett_logpdf, _plackett_negative, _plackett_size),
    cdf=_plackett_cdf,
    conditional=_both_signs(_plackett_conditional, _plackett_negative, _plackett_size),
    inverse=_plackett_inverse,
    tau=_plackett_tau,
    from_tau=_plackett_from_tau,
    to_free=lambda theta: (np.log(theta),),
    from_free=lambda t: (np.exp(t),),
)
