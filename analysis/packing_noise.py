"""What the grains' arrangement adds to a number: scatter between replicate packings, and the error all points share.

All points of a density start from one packing, so part of a run's noise is common to them and no resampling of the
points can see it.  Replicate packings at some points tell how large it is, and lower it (`analysis.packings`).
"""

from __future__ import annotations

import numpy as np
from scipy import stats

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


def own_error(results, state, symbol, mu_iso, family="coupled") -> float:
    """What packings add to single points beyond the offset that all points share: mean variance of the averages.

    From the points that several packings serve (interaction of point and packing), divided by each point's number of
    packings and averaged with the points' weights; NaN without replicates.
    """
    results = read_results(results)
    sets, weight = results.state_replicates(state, symbol, mu_iso, family), results.weights(mu_iso, family)
    if sets is None:
        return float("nan")
    served = np.maximum(np.isfinite(sets).sum(axis=0), 1)
    return float(packings.own_variance(sets) * np.sum(weight / served) / np.sum(weight))


def common_error(results, state, symbol, family="coupled") -> tuple[np.ndarray, float]:
    """Error (D,) that all points of a density may share, and its degrees of freedom.

    With R replicate packings: that of the level of all packings (`packings.level_variance`), pooled over the D
    densities, widened by Student's t for its D (R - 1) degrees of freedom (so that 1.96 of it cover 95 %).
    Without replicates: one run's standard error, root mean square over the points, as if all of it were common; its
    degrees of freedom are infinite, or 0 where it is not known and the error is zero.
    """
    results = read_results(results)
    densities = results.family_densities(family)
    variances, freedom = [], 0
    for mu_iso in densities:
        sets = results.state_replicates(state, symbol, mu_iso, family)
        if sets is None or len(sets) < 2 or not packings.shared(sets).any():
            continue
        weight = results.weights(mu_iso, family)
        alone = weight[~packings.shared(sets)].sum() / weight.sum()
        variances.append(packings.level_variance(sets, alone))
        freedom += len(sets) - 1
    if variances:
        wider = stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)
        return np.full(len(densities), np.sqrt(np.mean(variances)) * wider), float(freedom)
    errors = [results.state_error(state, symbol, m, family) for m in densities]
    if any(e is None or not np.isfinite(e).any() for e in errors):
        return np.zeros(len(densities)), 0.0
    return np.array([np.sqrt(np.nanmean(e**2)) for e in errors]), float("inf")
