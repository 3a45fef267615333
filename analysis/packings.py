"""Runs of the same points in several packings, brought to one level: point + packing + the single run's own scatter.

The first packing serves all points, the others some of them.  What the first one is off by, over the points that all
packings serve, is taken off where it is alone, so that the other packings improve every point and not only their own;
but only the part of it that is not the scatter of single runs (the best linear predictor of a random packing).
"""

from __future__ import annotations

import numpy as np

from analysis import weighted

#: Shared points below which packings are not levelled: what single runs scatter by would do more harm.
FEWEST = 3
#: Rows to either side over which variances along strain are averaged.
NEIGHBOURS = 7


def shared(sets) -> np.ndarray:
    """Points (Q,) that have a number in every packing, of sets (R, ..., Q)."""
    return np.isfinite(sets).all(axis=tuple(range(sets.ndim - 1)))


def variances(sets) -> tuple[np.ndarray, np.ndarray]:
    """Between packings of the mean over the S shared points, and of single runs beyond point and packing; (...,) each.

    sets: (R, ..., Q), NaN where a point has no run.  The first estimates b + w / S with b the variance of packings and
    w the second, that of the interaction.  NaN where there are too few packings or shared points.
    """
    both = sets[..., shared(sets)]
    if len(both) < 2 or both.shape[-1] == 0:
        return np.full(sets.shape[1:-1], np.nan), np.full(sets.shape[1:-1], np.nan)
    level = both.mean(axis=-1, keepdims=True)
    between = level.var(axis=0, ddof=1)[..., 0]
    if both.shape[-1] < 2:
        return between, np.full(between.shape, np.nan)
    rest = both - level - both.mean(axis=0) + level.mean(axis=0)
    return between, np.sum(rest**2, axis=(0, -1)) / ((both.shape[0] - 1) * (both.shape[-1] - 1))


def trust(sets) -> np.ndarray:
    """Share (...,) of a measured offset that is the packing's: b / (b + w / S), in [0, 1]; 0 if nothing is levelled.

    Along strain (R, T, Q) both variances are averaged over neighbouring rows, for single ones are noisy.
    """
    between, own = variances(sets)
    count = shared(sets).sum()
    if count < FEWEST or len(sets) < 2:
        return np.zeros(sets.shape[1:-1])
    if between.ndim:
        between, own = _neighbours(between), _neighbours(own)
    return np.clip(1.0 - own / count / np.where(between > 0, between, np.inf), 0.0, 1.0) * (between > 0)


def offsets(sets) -> np.ndarray:
    """What each packing (R, ...) is off by from the level of all, as far as it is to be trusted."""
    both = sets[..., shared(sets)]
    share = trust(sets)
    if not np.any(share > 0):
        return np.zeros(sets.shape[:-1])
    level = both.mean(axis=-1)
    return share * (level - level.mean(axis=0))


def average(sets) -> np.ndarray:
    """Average (..., Q) over the packings of what a point has in each, less that packing's offset.

    sets: (R, ..., Q), NaN where a point has no run; NaN where it has none in any packing.
    """
    levelled = sets - offsets(sets)[..., None]
    return weighted.mean(np.moveaxis(levelled, 0, -1), np.ones(len(sets)))


def level_variance(sets, alone, between, own) -> float:
    """Error variance of what `average` gives of sets (R, Q) that all points share.

    alone: the probability of the points in one packing only; between: the variance b of packings; own: w of single
    runs.  With k the trust in an offset: b / R + alone^2 (1 - 1/R) ((1 - k)^2 b + k^2 w / S).
    """
    count, k = len(sets), float(trust(sets))
    left = (1.0 - k) ** 2 * between + (k**2 * own / shared(sets).sum() if k > 0 else 0.0)
    return between / count + alone**2 * (1.0 - 1.0 / count) * left


def _neighbours(values):
    """Means of (T, ...) over up to NEIGHBOURS rows to either side."""
    rows = np.arange(len(values))
    near = np.abs(rows[:, None] - rows) <= NEIGHBOURS
    return (near / near.sum(axis=1, keepdims=True)) @ values
