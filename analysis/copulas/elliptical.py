"""Gaussian, Student t and independence copulas."""

from __future__ import annotations

import numpy as np
from scipy import special

from .family import Family

#: Above LARGEST_NU degrees of freedom Student's copula is practically the Gaussian one.
LARGEST_NU = 200.0
SMALLEST_NU = 1.0
_RHO = (-0.9999, 0.9999)


def normal_score(u: np.ndarray, uc: np.ndarray) -> np.ndarray:
    """Standard normal quantile of probabilities u with complements uc = 1 - u, exact in both tails."""
    lower = u < 0.5
    score = special.ndtri(np.where(lower, u, uc))
    return np.where(lower, score, -score)


def student_score(u: np.ndarray, uc: np.ndarray, nu: float | np.ndarray) -> np.ndarray:
    """Student t quantile of probabilities u with complements uc = 1 - u, nu >= 1 degrees of freedom.

    Starts from Hill's (1970) approximation and takes three steps of Newton's method.
    """
    lower = u < 0.5
    tail = np.maximum(np.where(lower, u, uc), 1e-120)
    score = -_hill_quantile(tail, nu)
    constant = special.gammaln(0.5 * (nu + 1.0)) - special.gammaln(0.5 * nu) - 0.5 * np.log(nu * np.pi)
    for _ in range(3):
        logpdf = constant - 0.5 * (nu + 1.0) * np.log1p(score**2 / nu)
        cdf = special.stdtr(nu, score)
        score = score + np.log(tail / cdf) * cdf * np.exp(-logpdf)
    return np.where(lower, score, -score)


def _hill_quantile(tail, nu):
    """Hill's Algorithm 396: |quantile| of a one-sided tail probability <= 1/2, to about five digits."""
    a = 1.0 / (nu - 0.5)
    b = (48.0 / a) ** 2
    c = ((20700.0 * a / b - 98.0) * a - 16.0) * a + 96.36
    d = ((94.5 / (b + c) - 3.0) / b + 1.0) * np.sqrt(0.5 * a * np.pi) * nu
    y = np.maximum((2.0 * d * tail) ** (2.0 / nu), 1e-300)
    x = special.ndtri(tail)
    c = c + np.where(nu < 5.0, 0.3 * (nu - 4.5) * (x + 0.6), 0.0)
    c = (((0.05 * d * x - 5.0) * x - 7.0) * x - 2.0) * x + b + c
    middle = (((((0.4 * x * x + 6.3) * x * x + 36.0) * x * x + 94.5) / c - x * x - 3.0) / b + 1.0) * x
    far = 1.0 / (((nu + 6.0) / (nu * y) - 0.089 * d - 0.822) * (nu + 2.0) * 3.0) + 0.5 / (nu + 4.0)
    far = (far * y - 1.0) * (nu + 1.0) / (nu + 2.0) + 1.0 / y
    square = np.where(y > 0.05 + a, np.expm1(np.minimum(a * middle * middle, 700.0)), far)
    return np.sqrt(nu * np.maximum(square, 0.0))


def gaussian_logpdf(x: np.ndarray, y: np.ndarray, rho: float | np.ndarray) -> np.ndarray:
    """Log PDF of the Gaussian copula at normal scores x, y."""
    r2 = (1.0 - rho) * (1.0 + rho)
    return -0.5 * np.log(r2) - rho * (rho * (x * x + y * y) - 2.0 * x * y) / (2.0 * r2)


def student_logpdf(x: np.ndarray, y: np.ndarray, rho: float | np.ndarray, nu: float | np.ndarray) -> np.ndarray:
    """Log PDF of Student's copula at Student scores x, y."""
    r2 = (1.0 - rho) * (1.0 + rho)
    constant = special.gammaln(0.5 * nu + 1.0) + special.gammaln(0.5 * nu) - 2.0 * special.gammaln(0.5 * (nu + 1.0))
    quadratic = ((x - y) ** 2 + 2.0 * (1.0 - rho) * x * y) / (nu * r2)
    marginals = np.log1p(x * x / nu) + np.log1p(y * y / nu)
    return constant - 0.5 * np.log(r2) - 0.5 * (nu + 2.0) * np.log1p(quadratic) + 0.5 * (nu + 1.0) * marginals


def _nodes(count: int = 320, reach: float = 3.15) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Double-exponential quadrature on [0, 1]: distances from the left end and from the right end, weights."""
    t = np.linspace(-reach, reach, count)
    s = 0.5 * np.pi * np.sinh(t)
    left, right = special.expit(2.0 * s), special.expit(-2.0 * s)
    return left, right, (t[1] - t[0]) * np.pi * np.cosh(t) * left * right


_LEFT, _RIGHT, _WEIGHT = _nodes()


def _orthant(x, y, rho, nu, lower_bound):
    """P(X <= x, Y <= y): the Frechet lower bound plus the integral over the correlation from -1 to rho (Plackett 1954).

    With r = sin(theta), dP/dtheta = (1 + (x^2 + y^2 - 2 x y r) / (nu cos^2 theta))^(-nu/2) / (2 pi), or its exponential
    limit for the Gaussian (nu = None).  The integrand is positive, so there is no cancellation in the corners.
    """
    x, y, rho, lower_bound = (
        np.asarray(a, dtype=float)[..., None] for a in np.broadcast_arrays(x, y, rho, lower_bound)
    )
    span = np.arcsin(rho) + 0.5 * np.pi
    angle = span * _LEFT
    cos2 = np.sin(angle) ** 2
    quadratic = ((x + y) ** 2 - 4.0 * x * y * np.sin(0.5 * angle) ** 2) / np.maximum(cos2, 1e-300)
    quadratic = np.where(np.isnan(quadratic), np.inf, quadratic)
    if nu is None:
        integrand = np.exp(-0.5 * quadratic)
    else:
        nu = np.asarray(nu, dtype=float)[..., None]
        integrand = np.exp(-0.5 * nu * np.log1p(quadratic / nu))
    return lower_bound[..., 0] + (span * integrand * _WEIGHT).sum(axis=-1) / (2.0 * np.pi)


def _gaussian_cdf(u, uc, v, vc, rho):
    return _orthant(normal_score(u, uc), normal_score(v, vc), rho, None, np.maximum(0.0, u - vc))


def _gaussian_conditional(u, uc, v, vc, rho):
    return special.ndtr((normal_score(v, vc) - rho * normal_score(u, uc)) / np.sqrt((1.0 - rho) * (1.0 + rho)))


def _gaussian_inverse(u, uc, p, pc, rho):
    y = rho * normal_score(u, uc) + np.sqrt((1.0 - rho) * (1.0 + rho)) * normal_score(p, pc)
    return special.ndtr(y), special.ndtr(-y)


def _student_cdf(u, uc, v, vc, rho, nu):
    return _orthant(student_score(u, uc, nu), student_score(v, vc, nu), rho, nu, np.maximum(0.0, u - vc))


def _student_conditional(u, uc, v, vc, rho, nu):
    x, y = student_score(u, uc, nu), student_score(v, vc, nu)
    return special.stdtr(nu + 1.0, (y - rho * x) * np.sqrt((nu + 1.0) / ((nu + x * x) * (1.0 - rho) * (1.0 + rho))))


def _student_inverse(u, uc, p, pc, rho, nu):
    x = student_score(u, uc, nu)
    scale = np.sqrt((nu + x * x) * (1.0 - rho) * (1.0 + rho) / (nu + 1.0))
    y = rho * x + scale * student_score(p, pc, nu + 1.0)
    return special.stdtr(nu, y), special.stdtr(nu, -y)


def _elliptical_tau(rho, *_):
    return 2.0 / np.pi * np.arcsin(rho)


GAUSSIAN = Family(
    names=("rho",),
    bounds=(_RHO,),
    logpdf=lambda u, uc, v, vc, rho: gaussian_logpdf(normal_score(u, uc), normal_score(v, vc), rho),
    cdf=_gaussian_cdf,
    conditional=_gaussian_conditional,
    inverse=_gaussian_inverse,
    tau=_elliptical_tau,
    from_tau=lambda tau: np.sin(0.5 * np.pi * tau),
    to_free=lambda rho: (np.arctanh(rho),),
    from_free=lambda t: (np.tanh(t),),
)

STUDENT = Family(
    names=("rho", "nu"),
    bounds=(_RHO, (SMALLEST_NU, LARGEST_NU)),
    logpdf=lambda u, uc, v, vc, rho, nu: student_logpdf(student_score(u, uc, nu), student_score(v, vc, nu), rho, nu),
    cdf=_student_cdf,
    conditional=_student_conditional,
    inverse=_student_inverse,
    tau=_elliptical_tau,
    from_tau=lambda tau: np.sin(0.5 * np.pi * tau),
    to_free=lambda rho, nu: (np.arctanh(rho), 1.0 / nu),
    from_free=lambda t, k: (np.tanh(t), 1.0 / k),
)

INDEPENDENCE = Family(
    names=(),
    bounds=(),
    logpdf=lambda u, uc, v, vc: 0.0 * (u + v),
    cdf=lambda u, uc, v, vc: u * v,
    conditional=lambda u, uc, v, vc: v + 0.0 * u,
    inverse=lambda u, uc, p, pc: (p + 0.0 * u, pc + 0.0 * u),
    tau=lambda: 0.0,
    from_tau=lambda tau: 0.0,
    to_free=lambda: (),
    from_free=lambda: (),
)
