"""What the grains' arrangement adds to a number: scatter between replicate packings, and the error all points share.

All points of a density start from one packing, so part of a run's noise is common to them and no resampling of the
points can see it.  Replicate packings at some points tell how large it is, and lower it (`analysis.packings`).
"""

from __future__ import annotations

import numpy as np

from analysis import packings
from analysis.results import read_results


def packing_scatter(results, state, symbol, mu_iso, family="coupled") -> float:
    """Standard deviation between packings at the same point, pooled over the points with several; NaN without any."""
    sets = results.state_replicates(state, symbol, mu_iso, family)
    if sets is None:
        return float("nan")
    several = np.isfinite(sets).sum(axis=0) > 1
    if not several.any():
        return float("nan")
    return float(np.sqrt(np.mean(np.nanvar(sets[:, several], axis=0, ddof=1))))


def own_error(results, state, symbol, mu_iso, family="coupled") -> tuple[float, int]:
    """What packings add to single points beyond the offset that all points share: mean variance of the averages.

    From the points that several packings serve (interaction of point and packing), divided by each point's number of
    packings and averaged with the points' weights; and the degrees of freedom of this estimate.  NaN and 0 without
    replicates.
    """
    results = read_results(results)
    sets, weight = results.state_replicates(state, symbol, mu_iso, family), results.weights(mu_iso, family)
    variance = np.nan if sets is None else packings.variances(sets)[1]
    if not np.isfinite(variance):
        return float("nan"), 0
    served = np.maximum(np.isfinite(sets).sum(axis=0), 1)
    freedom = np.prod(np.array(packings.compared(sets).shape) - 1)
    return float(variance * np.sum(weight / served) / np.sum(weight)), int(freedom)


def common_curves(results, symbol, mu_iso, family="coupled") -> np.ndarray | None:
    """Curves (R, T) that, times R independent standard normals and added up, draw the error that all points may share.

    What each packing's mean curve over the shared points differs by from that of all R, so that a draw wiggles along
    strain as packings do.  Its variance is, of the variance of such differences, the share k / R + a^2 (1 - 1/R) k
    (1 - k) that `packings.level_variance` leaves with a trust k in the offsets, but at least that of a mean of R, all
    of it where nothing is levelled, and one standard error on top.  None without replicates.
    """
    results = read_results(results)
    sets, weight = results.response(symbol, mu_iso, family).replicates, results.weights(mu_iso, family)
    if sets is None:
        return None
    used, both = packings.shared(sets)
    count = int(used.sum())
    if count < 2 or not both.any():
        return None
    level, k = packings.compared(sets).mean(axis=-1), packings.trust(sets)
    alone = weight[~both].sum() / weight.sum()
    left = np.maximum(1 / count, k / count + alone**2 * (1 - 1 / count) * k * (1 - k))
    if both.sum() < packings.FEWEST:  # nothing is levelled
        left = np.ones_like(k)
    return (level - level.mean(axis=0)) * np.sqrt(left * (1 + np.sqrt(2 / (count - 1))) / (count - 1))


def common_error(results, state, symbol, family="coupled") -> tuple[np.ndarray, float]:
    """Error (D,) that all points of a density may share, and its degrees of freedom.

    With replicate packings: that of the level of all packings (`packings.level_variance`).  The variance of packings in
    it is what the mean over the shared points differs by between them less what single runs scatter by, both pooled
    over the densities, and one standard error of this estimate on top, which widens it for few packings as Student's t
    would; its degrees of freedom are those of the packings.
    Without replicates: one run's standard error, root mean square over the points, as if all of it were common; its
    degrees of freedom are infinite.  NaN and 0 where nothing tells it.
    """
    results = read_results(results)
    densities = results.family_densities(family)
    sets = [results.state_replicates(state, symbol, m, family) for m in densities]
    if any(_is_compared(values) for values in sets):
        between, own, freedom = _pooled([values for values in sets if _is_compared(values)])
        variances = [between if values is None
                     else packings.level_variance(values, results.weights(m, family), between, own)
                     for values, m in zip(sets, densities, strict=True)]  # fmt: skip
        return np.sqrt(variances), float(freedom)
    errors = [results.state_error(state, symbol, m, family) for m in densities]
    if any(e is None or not np.isfinite(e).any() for e in errors):
        return np.full(len(densities), np.nan), 0.0
    return np.array([np.sqrt(np.nanmean(e**2)) for e in errors]), float("inf")


def _is_compared(sets) -> bool:
    """Whether sets (R, Q), or None, have points in two packings or more."""
    return sets is not None and bool(np.isfinite(packings.variances(sets)[0]))


def _pooled(several):
    """Variance of packings with its standard error on top, of single runs, and degrees of freedom of the former."""
    found = np.array([packings.variances(sets) for sets in several])
    sizes = np.array([packings.compared(sets).shape for sets in several], float)
    counts = sizes - [1, 0]
    between, freedom = np.average(found[:, 0], weights=counts[:, 0]), counts[:, 0].sum()
    within = counts[:, 0] * (counts[:, 1] - 1)
    if not within.sum():
        return between * (1 + np.sqrt(2 / freedom)), np.nan, freedom
    known = within > 0
    own = np.average(found[known, 1], weights=within[known])
    mean_own = own * np.average(1 / counts[:, 1], weights=counts[:, 0])
    error = np.sqrt(2 * between**2 / freedom + 2 * mean_own**2 / within.sum())
    return max(between - mean_own, 0.0) + error, own, freedom
