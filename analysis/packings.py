"""Runs of the same points in several packings, brought to one level: point + packing, by least squares.

The first packing serves all points, the others some of them.  What the first one is off by, over the points that all
packings serve, is taken off where it is alone, so that the other packings improve every point and not only their own.
"""

from __future__ import annotations

import numpy as np

from analysis import weighted

#: Shared points below which packings are not levelled: what single runs scatter by would do more harm.
FEWEST = 3


def shared(sets) -> np.ndarray:
    """Points (Q,) that have a number in every packing, of sets (R, ..., Q)."""
    return np.isfinite(sets).all(axis=tuple(range(sets.ndim - 1)))


def offsets(sets) -> np.ndarray:
    """What each packing is off by (R, ...): its mean over the shared points less that of all packings.

    sets: (R, ..., Q), NaN where a point has no run.  Zero with fewer than three shared points.
    """
    both = shared(sets)
    if both.sum() < FEWEST:
        return np.zeros(sets.shape[:-1])
    level = sets[..., both].mean(axis=-1)
    return level - level.mean(axis=0)


def average(sets) -> np.ndarray:
    """Average (..., Q) over the packings of what a point has in each, less that packing's offset.

    sets: (R, ..., Q), NaN where a point has no run; NaN where it has none in any packing.
    """
    levelled = sets - offsets(sets)[..., None]
    return weighted.mean(np.moveaxis(levelled, 0, -1), np.ones(len(sets)))


def own_variance(sets) -> float:
    """Variance of single runs (R, Q) beyond point and packing (mean square of the interaction); NaN if unknown."""
    both = sets[:, shared(sets)]
    if min(both.shape) < 2:
        return float("nan")
    rest = both - both.mean(axis=0) - both.mean(axis=1, keepdims=True) + both.mean()
    return float(np.sum(rest**2) / ((both.shape[0] - 1) * (both.shape[1] - 1)))


def between_variance(sets) -> float:
    """Variance between packings (R, Q) of the mean over the shared points; NaN with fewer than two or none shared."""
    both = sets[:, shared(sets)]
    return float(both.mean(axis=1).var(ddof=1)) if len(both) > 1 and both.size else float("nan")


def level_variance(sets, alone) -> float:
    """Error variance of what `average` gives that all points share; `alone`: the share of points in one packing only.

    With variance B between R packings of the mean over S shared points, and W of single runs: B / R for the level of
    the packings, and W / S (alone^2 (1 - 1/R) - 1/R), where positive, for the offset known from S points only.
    B itself where packings are not levelled but some points are alone.
    """
    count, both, between = len(sets), shared(sets).sum(), between_variance(sets)
    if both < FEWEST:
        return between if alone > 0 else between / count
    return between / count + own_variance(sets) / both * max(alone**2 * (1 - 1 / count) - 1 / count, 0.0)
