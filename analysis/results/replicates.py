"""Two-way random-effects model (point + packing + residual) that removes the offset of each replicate packing.

The first packing serves all points, the others serve some of them.  The offset of the first packing, measured over the
points that all packings serve, is subtracted at all its points.  Only the part that is not scatter of single runs is
subtracted (the best linear predictor of a random effect), so that the other packings improve every point.
"""

from __future__ import annotations

import numpy as np

from ..pdem import weighted

#: Shared points below which packings are not levelled: what single runs scatter by would do more harm.
FEWEST = 3
#: Rows to either side over which variances along strain are averaged.
NEIGHBOURS = 7


def shared(sets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Packings (R,) that are compared and the points (Q,) that all of these have, of sets (R, ..., Q).

    While the packings share fewer than three points, the one with the fewest points is left out, so that a packing
    whose runs failed does not prevent the comparison of the others.
    """
    known = np.isfinite(sets).all(axis=tuple(range(1, sets.ndim - 1)))
    used = known.any(axis=1)
    while used.sum() > 2 and known[used].all(axis=0).sum() < FEWEST:
        used[np.flatnonzero(used)[np.argmin(known[used].sum(axis=1))]] = False
    return used, known[used].all(axis=0) if used.any() else np.zeros(known.shape[1], bool)


def compared(sets: np.ndarray) -> np.ndarray:
    """The part (R', ..., S) of sets (R, ..., Q) that is in all packings compared."""
    used, both = shared(sets)
    return sets[used][..., both]


def variances(sets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Between packings of the mean over the S shared points, and of single runs beyond point and packing; (...,) each.

    sets: (R, ..., Q), NaN where a point has no run.  The first estimates b + w / S with b the variance of packings and
    w the second, that of the interaction.  NaN where there are too few packings or shared points.
    """
    both = compared(sets)
    unknown = np.full(sets.shape[1:-1], np.nan)
    if len(both) < 2 or both.shape[-1] == 0:
        return unknown, unknown
    level = both.mean(axis=-1, keepdims=True)
    between = level.var(axis=0, ddof=1)[..., 0]
    if both.shape[-1] < 2:
        return between, unknown
    rest = both - level - both.mean(axis=0) + level.mean(axis=0)
    return between, np.sum(rest**2, axis=(0, -1)) / ((both.shape[0] - 1) * (both.shape[-1] - 1))


def offset_reliability(sets: np.ndarray) -> np.ndarray:
    """Share (...,) of a measured offset that belongs to the packing: b / (b + w / S), in [0, 1]; 0 if none is removed.

    Along strain (R, T, Q) both variances are averaged over neighbouring rows, because single rows are noisy.
    """
    between, own = variances(sets)
    both = compared(sets)
    if len(both) < 2 or both.shape[-1] < FEWEST:
        return np.zeros(sets.shape[1:-1])
    if between.ndim:
        between, own = _neighbours(between), _neighbours(own)
    share = 1.0 - own / both.shape[-1] / np.where(between > 0, between, np.inf)
    return np.where(between > 0, np.clip(share, 0.0, 1.0), 0.0)


def offsets(sets: np.ndarray) -> np.ndarray:
    """Offset of each packing (R, ...) from the level of all, times its reliability; 0 for a packing left out."""
    used, _ = shared(sets)
    removed, reliability = np.zeros(sets.shape[:-1]), offset_reliability(sets)
    if np.any(reliability > 0):
        level = compared(sets).mean(axis=-1)
        removed[used] = reliability * (level - level.mean(axis=0))
    return removed


def average(sets: np.ndarray) -> np.ndarray:
    """Average (..., Q) of each point over its packings, each less that packing's offset.

    sets: (R, ..., Q), NaN where a point has no run; NaN where it has none in any packing.
    """
    levelled = sets - offsets(sets)[..., None]
    return weighted.mean(np.moveaxis(levelled, 0, -1), np.ones(len(sets)))


def level_variance(sets: np.ndarray, probability: np.ndarray, between: float, own: float) -> float:
    """Error variance of what `average` gives of sets (R, Q) that all points share.

    probability (Q,) of the points; between: the variance b of packings; own: w of single runs.  With a the
    probability of the points that not all R packings compared have, and k the reliability of an offset measured at S
    points: b / R + a^2 (1 - 1/R) ((1 - k)^2 b + k^2 w / S).  Without anything to compare, b.
    """
    used, both = shared(sets)
    count, k = int(used.sum()), float(offset_reliability(sets))
    if count < 2 or not both.any():
        return between
    alone = probability[~both].sum() / probability.sum()
    left = (1.0 - k) ** 2 * between + (k**2 * own / both.sum() if k > 0 else 0.0)
    return between / count + alone**2 * (1.0 - 1.0 / count) * left


def _neighbours(values):
    """Means of (T, ...) over up to NEIGHBOURS rows to either side."""
    rows = np.arange(len(values))
    near = np.abs(rows[:, None] - rows) <= NEIGHBOURS
    return (near / near.sum(axis=1, keepdims=True)) @ values
