"""The functions that define a copula family, and the rotation of a family.

Every function takes a probability together with its complement (u, uc = 1 - u), so that logarithms are exact in all
four corners of the unit square.  Points and parameters broadcast.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors_and_files import GrainScatterError

#: Newton's steps from the start before every second one becomes a bisection.
_NEWTON_ALONE = 12


class CopulaError(GrainScatterError):
    """A copula does not exist for these parameters, or cannot be fitted to these data."""


@dataclass(frozen=True)
class Family:
    """One bivariate family, exchangeable in u and v unless it is a rotation by 90 or 270 degrees.

    names and bounds of the parameters; logpdf(u, uc, v, vc, *params), cdf(...) -> C, conditional(...) -> P(V <= v | U =
    u); inverse(u, uc, p, pc, *params) -> (v, vc); tau(*params) -> Kendall's tau and from_tau(tau) -> first parameter.
    `to_free` and `from_free` map the parameters to unbounded coordinates and back, in which the likelihood is nearly
    quadratic.  `sign` is 1 or -1 if tau can have only that sign, else 0.
    """

    names: tuple[str, ...]
    bounds: tuple[tuple[float, float], ...]
    logpdf: Callable[..., np.ndarray]
    cdf: Callable[..., np.ndarray]
    conditional: Callable[..., np.ndarray]
    inverse: Callable[..., tuple[np.ndarray, np.ndarray]]
    tau: Callable[..., Any]
    from_tau: Callable[[Any], Any]
    to_free: Callable[..., tuple[Any, ...]]
    from_free: Callable[..., tuple[Any, ...]]
    sign: int = 0


def rotated(base: Family, degrees: int) -> Family:
    """The family turned by 90, 180 or 270 degrees: PDFs c(1-u, v), c(1-u, 1-v) and c(u, 1-v)."""
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
        names=base.names,
        bounds=base.bounds,
        logpdf=lambda u, uc, v, vc, *params: base.logpdf(*arguments(u, uc, v, vc), *params),
        cdf=cdf,
        conditional=conditional,
        inverse=inverse,
        tau=lambda *params: sign * base.tau(*params),
        from_tau=lambda tau: base.from_tau(sign * tau),
        to_free=base.to_free,
        from_free=base.from_free,
        sign=sign,
    )


def log_of(u: np.ndarray, uc: np.ndarray) -> np.ndarray:
    """ln u from u and its complement uc, exact near both ends."""
    return np.where(u < 0.5, np.log(u), np.log1p(-np.where(u < 0.5, 0.0, uc)))


def solve_conditional(
    conditional: Callable[..., np.ndarray],
    logpdf: Callable[..., np.ndarray],
    u: np.ndarray,
    uc: np.ndarray,
    p: np.ndarray,
    pc: np.ndarray,
    *params: ArrayLike,
) -> tuple[np.ndarray, np.ndarray]:
    """Invert P(V <= v | U = u) = p by Newton's method in logit v, safeguarded by bisection: returns (v, 1 - v).

    Where Newton's steps change sides for long, every second step is a bisection.
    """
    arrays = np.broadcast_arrays(u, uc, p, pc, *params)
    shape = arrays[0].shape
    u, uc, p, pc, *values = (array.ravel() for array in arrays)
    low, high = np.full(p.shape, -700.0), np.full(p.shape, 700.0)
    y = np.clip(np.log(p) - np.log(pc), -690.0, 690.0)
    target = log_of(p, pc)
    active = np.arange(p.size)
    for iteration in range(200):
        at, vs, vcs = y[active], _expit(y[active]), _expit(-y[active])
        arguments = (u[active], uc[active], vs, vcs, *(column[active] for column in values))
        value = np.maximum(conditional(*arguments), 1e-320)
        gap = np.log(value) - target[active]
        low[active] = np.where(gap < 0.0, at, low[active])
        high[active] = np.where(gap > 0.0, at, high[active])
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = at - gap * value / (np.exp(logpdf(*arguments)) * vs * vcs)
        inside = (step > low[active]) & (step < high[active])
        if iteration > _NEWTON_ALONE and iteration % 2:
            inside[:] = False
        update = np.where(gap == 0.0, at, np.where(inside, step, 0.5 * (low[active] + high[active])))
        y[active] = update
        active = active[np.abs(update - at) > 4e-16 * np.abs(at) + 1e-15]
        if active.size == 0:
            break
    return _expit(y).reshape(shape), _expit(-y).reshape(shape)


def _expit(y: np.ndarray) -> np.ndarray:
    return np.where(y < 0.0, np.exp(np.minimum(y, 0.0)), 1.0) / (1.0 + np.exp(-np.abs(y)))
