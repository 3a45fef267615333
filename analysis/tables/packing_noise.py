"""Packing noise: the scatter between replicate packings, and the error that all points of a density share.

All points of a density start from one packing, so part of a run's noise is common to them, and resampling the points
cannot show it.  Replicate packings at some points measure it and reduce it (`analysis.results.replicates`).
"""

from __future__ import annotations

import numpy as np

from ..results import replicates
from ..results.reader import Results
from ..surrogates import surrogate


def packing_scatter(results: Results, state: str, symbol: str, mu_iso: float, family: str = "coupled") -> float:
    """Standard deviation between packings at the same point, pooled over the points with several; NaN without any."""
    sets = results.state_replicates(state, symbol, mu_iso, family)
    if sets is None:
        return float("nan")
    several = np.isfinite(sets).sum(axis=0) > 1
    if not several.any():
        return float("nan")
    return float(np.sqrt(np.mean(np.nanvar(sets[:, several], axis=0, ddof=1))))


def own_error(results: Results, state: str, symbol: str, mu_iso: float, family: str = "coupled") -> tuple[float, int]:
    """Variance that packings add to single points beyond the offset that all points share, and degrees of freedom.

    It is the interaction of point and packing, from the points that several packings serve, divided by each point's
    number of packings and averaged over the points.  NaN and 0 without replicates.
    """
    sets = results.state_replicates(state, symbol, mu_iso, family)
    probability = results.probability(mu_iso, family)
    variance = np.nan if sets is None else replicates.variances(sets)[1]
    if sets is None or not np.isfinite(variance):
        return float("nan"), 0
    served = np.maximum(np.isfinite(sets).sum(axis=0), 1)
    freedom = np.prod(np.array(replicates.compared(sets).shape) - 1)
    return float(variance * np.sum(probability / served) / np.sum(probability)), int(freedom)


def common_curves(results: Results, symbol: str, mu_iso: float, family: str = "coupled") -> np.ndarray | None:
    """Curves (R, T) from which the error that all points may share is drawn: their sum times R standard normals.

    Each is the difference of one packing's mean curve over the shared points from the mean of all R packings, so that a
    draw varies along strain as packings do.  The variance of these differences is multiplied by the part
    k / R + a^2 (1 - 1/R) k (1 - k) that `replicates.level_variance` leaves for offsets of reliability k, at least by
    1 / R, by 1 where no offset is removed, and one standard error is added.  None without replicates.
    """
    sets = results.response(symbol, mu_iso, family).replicates
    probability = results.probability(mu_iso, family)
    if sets is None:
        return None
    used, both = replicates.shared(sets)
    count = int(used.sum())
    if count < 2 or not both.any():
        return None
    level, k = replicates.compared(sets).mean(axis=-1), replicates.offset_reliability(sets)
    alone = probability[~both].sum() / probability.sum()
    left = np.maximum(1 / count, k / count + alone**2 * (1 - 1 / count) * k * (1 - k))
    if both.sum() < replicates.FEWEST:  # nothing is levelled
        left = np.ones_like(k)
    return (level - level.mean(axis=0)) * np.sqrt(left * (1 + np.sqrt(2 / (count - 1))) / (count - 1))


def common_error(results: Results, state: str, symbol: str, family: str = "coupled") -> tuple[np.ndarray, float]:
    """Error (D,) that all points of a density may share, and its degrees of freedom.

    With replicate packings: the error of the level of all packings (`replicates.level_variance`).  The variance between
    packings in it is that of the mean over the shared points less the scatter of single runs, both pooled over the
    densities.  One standard error of this estimate is added, which widens it for few packings as Student's t would; the
    degrees of freedom are those of the packings.
    Without replicates: the standard error of one run, root mean square over the points, as if all of it were common,
    with infinite degrees of freedom.  NaN and 0 where it is not known.
    """
    densities = results.family_densities(family)
    sets = [results.state_replicates(state, symbol, m, family) for m in densities]
    if any(_is_compared(values) for values in sets):
        between, own, freedom = _pooled([values for values in sets if _is_compared(values)])
        variances = [between if values is None
                     else replicates.level_variance(values, results.probability(m, family), between, own)
                     for values, m in zip(sets, densities, strict=True)]  # fmt: skip
        return np.sqrt(variances), float(freedom)
    errors = [results.state_error(state, symbol, m, family) for m in densities]
    known = [e for e in errors if e is not None and np.isfinite(e).any()]
    if len(known) < len(densities):
        return np.full(len(densities), np.nan), 0.0
    return np.array([np.sqrt(np.nanmean(e**2)) for e in known]), float("inf")


def _is_compared(sets: np.ndarray | None) -> bool:
    """Whether sets (R, Q), or None, have points in two packings or more."""
    return sets is not None and bool(np.isfinite(replicates.variances(sets)[0]))


def _pooled(several):
    """Variance of packings with its standard error on top, of single runs, and degrees of freedom of the former."""
    found = np.array([replicates.variances(sets) for sets in several])
    sizes = np.array([replicates.compared(sets).shape for sets in several], float)
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


def values_drawn(
    results: Results, state: str, symbol: str, mu_iso: float, family: str = "coupled", n: int = 100, seed: int = 5
) -> np.ndarray:
    """Values (n, Q) of a quantity at a state, in which the points that were not simulated are drawn n times.

    Drawn from the predictive uncertainty of the response surface (`surrogate.Surrogate.draws`), without the scatter of
    single runs, as the filled values are.
    """
    values = np.tile(results.shown_state(state, symbol, mu_iso, family), (n, 1))
    filled = results.filled(mu_iso, family, state) & np.isfinite(values[0])
    if filled.any():
        inputs = results.family_points(family).x
        surface = surrogate.fit(inputs, np.where(filled, np.nan, values[0]))
        drawn = surface.draws(n, np.random.default_rng(seed))[:, 0] @ surface.basis(inputs).T
        values[:, filled] = drawn[:, filled]
    return values
