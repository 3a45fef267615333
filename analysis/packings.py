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


def shared(sets) -> tuple[np.ndarray, np.ndarray]:
    """Packings (R,) that are compared and the points (Q,) that all of these have, of sets (R, ..., Q).

    A packing is left out, the one with the fewest points first, while the others share fewer than three points: one
    whose runs failed does not keep the rest from being compared.
    """
    known = np.isfinite(sets).all(axis=tuple(range(1, sets.ndim - 1)))
    used = known.any(axis=1)
    while used.sum() > 2 and known[used].all(axis=0).sum() < FEWEST:
        used[np.flatnonzero(used)[np.argmin(known[used].sum(axis=1))]] = False
    return used, known[used].all(axis=0) if used.any() else np.zeros(known.shape[1], bool)


def compared(sets) -> np.ndarray:
    """The part (R', ..., S) of sets (R, ..., Q) that is in all packings compared."""
    used, both = shared(sets)
    return sets[used][..., both]


def variances(sets) -> tuple[np.ndarray, np.ndarray]:
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


def trust(sets) -> np.ndarray:
    """Share (...,) of a measured offset that is the packing's: b / (b + w / S), in [0, 1]; 0 if nothing is levelled.

    Along strain (R, T, Q) both variances are averaged over neighbouring rows, for single ones are noisy.
    """
    between, own = variances(sets)
    both = compared(sets)
    if len(both) < 2 or both.shape[-1] < FEWEST:
        return np.zeros(sets.shape[1:-1])
    if between.ndim:
        between, own = _neighbours(between), _neighbours(own)
    share = 1.0 - own / both.shape[-1] / np.where(between > 0, between, np.inf)
    return np.where(between > 0, np.clip(share, 0.0, 1.0), 0.0)


def offsets(sets) -> np.ndarray:
    """What each packing (R, ...) is off by from the level of all, as far as it is to be trusted; 0 if left out."""
    used, _ = shared(sets)
    found, share = np.zeros(sets.shape[:-1]), trust(sets)
    if np.any(share > 0):
        level = compared(sets).mean(axis=-1)
        found[used] = share * (level - level.mean(axis=0))
    return found


def average(sets) -> np.ndarray:
    """Average (..., Q) over the packings of what a point has in each, less that packing's offset.

    sets: (R, ..., Q), NaN where a point has no run; NaN where it has none in any packing.
    """
    levelled = sets - offsets(sets)[..., None]
    return weighted.mean(np.moveaxis(levelled, 0, -1), np.ones(len(sets)))


def level_variance(sets, weight, between, own) -> float:
    """Error variance of what `average` gives of sets (R, Q) that all points share.

    weight (Q,): the points' probabilities; between: the variance b of packings; own: w of single runs.  With a the
    probability of the points that not all R packings compared have, and k the trust in an offset known from S points:
    b / R + a^2 (1 - 1/R) ((1 - k)^2 b + k^2 w / S).  Without anything to compare, b.
    """
    used, both = shared(sets)
    count, k = int(used.sum()), float(trust(sets))
    if count < 2 or not both.any():
        return between
    alone = weight[~both].sum() / weight.sum()
    left = (1.0 - k) ** 2 * between + (k**2 * own / both.sum() if k > 0 else 0.0)
    return between / count + alone**2 * (1.0 - 1.0 / count) * left


def _neighbours(values):
    """Means of (T, ...) over up to NEIGHBOURS rows to either side."""
    rows = np.arange(len(values))
    near = np.abs(rows[:, None] - rows) <= NEIGHBOURS
    return (near / near.sum(axis=1, keepdims=True)) @ values
