"""Parameters of a truncated normal or lognormal distribution from two figures of the truncated distribution.

For every parent sd there is one parent mean that gives the first figure (mean, median or a quantile), because all of
them increase with the parent mean; the second figure then is an equation for the parent sd.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import optimize

from . import truncated_normal
from .family import MarginalError
from .figures_stated import probability_of
from .marginal_families import family_of
from .marginals import Marginal

#: Range of the parent's sd, in units of the first figure and of the width between the bounds; and points on it.
_NARROWEST, _WIDEST, _GRID = 1e-3, 20.0, 61
#: Range of ln parent_median, beyond which it is no number.
_LARGEST_LOG = 600.0


def truncated(family: str, figures: dict[str, float], low: float, high: float) -> list[Marginal] | None:
    """All distributions between low and high with two figures of their own; None if these determine none.

    Raises MarginalError if there is none, with the range of the second figure.
    """
    if set(figures) == {"sd", "cov"}:
        figures = {"mean": figures["sd"] / figures["cov"], "sd": figures["sd"]}
    places = [name for name in figures if name == "mean" or probability_of(name) is not None]
    if not places:
        return None
    first = places[0]
    second = next(name for name in figures if name != first)
    place, value = figures[first], figures[second]
    if not low < place < high:
        raise MarginalError(f"{first} = {place:g} is outside [low, high] = [{low:g}, {high:g}]")
    logs = family == "truncated_lognormal"
    a, b = ((math.log(low) if low > 0.0 else -math.inf), math.log(high)) if logs else (low, high)
    centre = math.log(place) if logs else place
    width = b - max(a, centre - 20.0) if logs else b - a

    def mean_of(sd: np.ndarray) -> np.ndarray:
        return _parent_mean(first, place, sd, centre, (a, b), logs)

    def off(log_sd: float) -> float:
        sd = np.array([math.exp(log_sd)])
        return float(_figure(second, mean_of(sd), sd, a, b, logs)[0]) - value

    grid = np.linspace(math.log(_NARROWEST * (1.0 if logs else place)), math.log(_WIDEST * width), _GRID)
    gap = _figure(second, mean_of(np.exp(grid)), np.exp(grid), a, b, logs) - value
    found = []
    for k in np.flatnonzero(gap[:-1] * gap[1:] <= 0.0):
        sd = math.exp(optimize.brentq(off, grid[k], grid[k + 1], xtol=1e-14))
        mean = float(mean_of(np.array([sd]))[0])
        params = (math.exp(mean) if logs else mean, sd, low, high)
        found.append(Marginal(family, dict(zip(family_of(family).names, params, strict=True))))
    if not found:
        raise MarginalError(
            f"{second} = {value:g} is outside [{value + np.nanmin(gap):.4g}, {value + np.nanmax(gap):.4g}], what a "
            f"{family} distribution between {low:g} and {high:g} with {first} = {place:g} can have"
        )
    return found


def _figure(name: str, mean: np.ndarray, sd: np.ndarray, a: float, b: float, logs: bool) -> np.ndarray:
    """A figure (m,) of truncated distributions with parents (m,); with `logs` they are those of ln x."""
    if (probability := probability_of(name)) is not None:
        quantile = truncated_normal.ppf(probability, mean, sd, a, b)
        return np.exp(quantile) if logs else quantile
    y, weight = truncated_normal.weighted_nodes(mean, sd, a, b, power=2.0 if logs and name != "sigma_ln" else 0.0)
    x = np.exp(y) if logs and name != "sigma_ln" else y
    centre = (weight * x).sum(axis=-1)
    if name == "mean":
        return centre
    spread = np.sqrt((weight * (x - centre[..., None]) ** 2).sum(axis=-1))
    return spread / centre if name == "cov" else spread


def _parent_mean(
    first: str, place: float, sd: np.ndarray, centre: float, bounds: tuple[float, float], logs: bool
) -> np.ndarray:
    """The parent means (m,) for which the figure `first` is `place`; NaN where none is a number.

    Brackets by growing steps, then the rule of false position, Illinois variant.
    """

    def off(mean: np.ndarray) -> np.ndarray:
        return _figure(first, mean, sd, *bounds, logs) - place

    limit = _LARGEST_LOG if logs else 1e9 * (abs(centre) + sd)
    low, high, step = np.full(sd.shape, centre), np.full(sd.shape, centre), sd.copy()
    gap_low, gap_high = off(low), off(high)
    for _ in range(80):
        down, up = (gap_low > 0.0) & (np.abs(low) < limit), (gap_high < 0.0) & (np.abs(high) < limit)
        if not (down | up).any():
            break
        low, high, step = np.where(down, low - step, low), np.where(up, high + step, high), 2.0 * step
        gap_low, gap_high = off(low), off(high)
    mean = np.where(gap_low == 0.0, low, high)
    side = np.zeros(sd.shape)
    for _ in range(200):
        slope = gap_high - gap_low
        update = np.where(slope > 0.0, (low * gap_high - high * gap_low) / np.where(slope > 0.0, slope, 1.0), mean)
        done = np.all(np.abs(update - mean) <= 4e-16 * (np.abs(mean) + sd))
        mean, gap = update, off(update)
        if done:
            break
        right = gap > 0.0
        gap_low = np.where(right & (side > 0.0), 0.5 * gap_low, gap_low)
        gap_high = np.where(~right & (side < 0.0), 0.5 * gap_high, gap_high)
        low, gap_low = np.where(right, low, mean), np.where(right, gap_low, gap)
        high, gap_high = np.where(right, mean, high), np.where(right, gap, gap_high)
        side = np.where(right, 1.0, -1.0)
    return np.where(np.abs(mean) < limit, mean, np.nan)
