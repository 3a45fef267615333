"""What a copula family is made of, and how a rotation makes a new family from an old one.

Every function takes a probability together with its complement, (u, uc = 1 - u), so that logarithms stay exact in all
four corners of the unit square, and broadcasts over points and parameters alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


class CopulaError(ValueError):
    """A copula does not exist for these parameters, or cannot be fitted to these data."""


@dataclass(frozen=True)
class Family:
    """One bivariate family, exchangeable in u and v unless it is a rotation by 90 or 270 degrees.

    logpdf(u, uc, v, vc, *params), cdf(...) -> C, conditional(...) -> P(V <= v | U = u); inverse(u, uc, p, pc,
    *params) -> (v, vc); tau(*params) and from_tau(tau) -> first parameter. `to_free` and `from_free` map the
    parameters to unbounded coordinates in which the likelihood is nearly quadratic; `sign` is 1 or -1 if tau can have
    only that sign, else 0.
    """

    names: tuple[str, ...]
    bounds: tuple[tuple[float, float], ...]
    logpdf: Callable
    cdf: Callable
    conditional: Callable
    inverse: Callable
    tau: Callable
    from_tau: Callable
    to_free: Callable
    from_free: Callable
    sign: int = 0


def rotated(base: Family, degrees: int) -> Family:
    """The family turned by 90, 180 or 270 degrees: densities c(1-u, v), c(1-u, 1-v) and c(u, 1-v)."""
    turn_u, turn_v = degrees in (90, 180), degrees in (180, 270)

    def arguments(u, uc, v, vc):
        return (*((uc, u) if turn_u else (u, uc)), *((vc, v) if turn_v else (v, vc)))

    def cdf(u, uc, v, vc, *params):
        value = base.cdf(*arguments(u, uc, v, vc), *params)
        return {90: v - value, 180: u - vc + value, 270: u - value}[degrees]

    def conditional(u, uc, v, vc, *params):
        value = base.conditional(*arguments(u, uc, v, vc), *params)
        return 1.0 - value if turn_v else value

    def inverse(u, uc, p, pc, *params):
        value, complement = base.inverse(*arguments(u, uc, p, pc), *params)
        return (complement, value) if turn_v else (value, complement)

    sign = 1 if degrees == 180 else -1
    return Family(
        base.names,
        base.bounds,
        lambda u, uc, v, vc, *params: base.logpdf(*arguments(u, uc, v, vc), *params),
        cdf,
        conditional,
        inverse,
        lambda *params: sign * base.tau(*params),
        lambda tau: base.from_tau(sign * tau),
        base.to_free,
        base.from_free,
        sign,
    )


def log_of(u, uc):
    """ln u from u and its complement, exact near both ends."""
    return np.where(u < 0.5, np.log(u), np.log1p(-np.where(u < 0.5, 0.0, uc)))


def solve_conditional(conditional: Callable, logpdf: Callable, u, uc, p, pc, *params):
    """Invert P(V <= v | U = u) = p by Newton's method in logit v, safeguarded by bisection: returns (v, 1 - v)."""
    u, uc, p, pc, *params = np.broadcast_arrays(u, uc, p, pc, *params)
    shape = p.shape
    u, uc, p, pc, *params = (array.ravel() for array in (u, uc, p, pc, *params))
    low, high = np.full(p.shape, -700.0), np.full(p.shape, 700.0)
    y = np.clip(np.log(p) - np.log(pc), -690.0, 690.0)
    target = log_of(p, pc)
    active = np.arange(p.size)
    for _ in range(200):
        at, vs, vcs = y[active], _expit(y[active]), _expit(-y[active])
        arguments = (u[active], uc[active], vs, vcs, *(value[active] for value in params))
        value = np.maximum(conditional(*arguments), 1e-320)
        gap = np.log(value) - target[active]
        low[active] = np.where(gap < 0.0, at, low[active])
        high[active] = np.where(gap > 0.0, at, high[active])
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = at - gap * value / (np.exp(logpdf(*arguments)) * vs * vcs)
        inside = (step > low[active]) & (step < high[active])
        update = np.where(gap == 0.0, at, np.where(inside, step, 0.5 * (low[active] + high[active])))
        y[active] = update
        active = active[np.abs(update - at) > 4e-16 * np.abs(at) + 1e-15]
        if active.size == 0:
            break
    return _expit(y).reshape(shape), _expit(-y).reshape(shape)


def _expit(y):
    return np.where(y < 0.0, np.exp(np.minimum(y, 0.0)), 1.0) / (1.0 + np.exp(-np.abs(y)))
