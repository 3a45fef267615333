"""Grading curves and the grading index I_G, weighted by mass, by mass of the active particles, or by carried stress."""

from __future__ import annotations

import numpy as np

from ..errors_and_files import GrainScatterError


class GradingError(GrainScatterError):
    """Sizes or weights from which no grading can be computed."""


def grading_index(diameter: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Grading index I_G = exp of the weighted standard deviation of ln d.

    diameter (N,) m; weight (N,) in any unit, by default the particles' mass.  A weight of zero leaves a particle out.
    Computed from single particles, because sieve bins would widen the distribution.  Eqs. 19-20 (Guida et al. 2018);
    a common factor of all sizes cancels.  Raises GradingError for sizes that are not positive and for negative weights.
    """
    d, w = _checked(diameter, weight)
    share, x = w / np.sum(w), np.log(d)
    mean = np.dot(share, x)
    return float(np.exp(np.sqrt(np.dot(share, (x - mean) ** 2))))


def active_grading_index(diameter: np.ndarray, contacts: np.ndarray) -> float:
    """I_G by mass of the particles with at least two contacts: diameter (N,) m, contacts (N,) number of contacts."""
    return grading_index(diameter, np.where(contacts >= 2, np.asarray(diameter) ** 3, 0.0))


def stress_grading_index(diameter: np.ndarray, p_volume: np.ndarray) -> float:
    """I_G weighted by p_volume = p^(m) V^(m) (N,), each particle's share of the mean stress (Eq. 23)."""
    return grading_index(diameter, p_volume)


def grading_curve(diameter: np.ndarray, weight: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Sorted diameters (N,) m and the share (N,) of weight in particles not larger than each; the last share is 1.

    weight as in `grading_index`: mass, mass of the active particles, or p^(m) V^(m).
    """
    d, w = _checked(diameter, weight)
    order = np.argsort(d, kind="stable")
    finer = np.cumsum(w[order])
    return d[order], finer / finer[-1]


def size_at(diameter: np.ndarray, share: float, weight: np.ndarray | None = None) -> float:
    """Diameter (m) below which the given share of the weight lies: size_at(d, 0.5) is d50 and size_at(d, 0.1) is d10.

    Half of each particle counts as finer than itself; interpolated in ln d.
    """
    d, finer = grading_curve(diameter, weight)
    middle = finer - 0.5 * np.diff(finer, prepend=0.0)
    return float(np.exp(np.interp(share, middle, np.log(d))))


def uniformity(diameter: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Coefficient of uniformity C_u = d60 / d10."""
    return size_at(diameter, 0.6, weight) / size_at(diameter, 0.1, weight)


def _checked(diameter: np.ndarray, weight: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    d = np.asarray(diameter, float)
    w = d**3 if weight is None else np.asarray(weight, float)
    if d.ndim != 1 or d.shape != w.shape:
        raise GradingError(f"grading: diameters {d.shape} and weights {w.shape} are not two lists of the same length")
    if not np.all((d > 0.0) & np.isfinite(d)):
        raise GradingError(f"grading: diameter[{np.flatnonzero(~((d > 0.0) & np.isfinite(d)))[0]}] is not positive")
    if not np.all((w >= 0.0) & np.isfinite(w)) or np.sum(w) <= 0.0:
        raise GradingError(
            f"grading: weights run from {w.min():.3g} to {w.max():.3g}, none may be negative nor all zero"
        )
    return d, w
