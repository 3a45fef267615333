"""Intervals of the numbers behind the claims, and what they say about a limit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .claim_samples import DRAWS

#: Ends of a 95 % interval, as shares.
TAILS = (0.025, 0.975)
#: Draws of f are rougher than the error of a smooth f; the upper end of a distance allows for errors that have this
#: part of their roughness (tests/benchmarks/bench_distances.py).
ROUGH = 0.85
SUPPORTED, CONTRADICTED, INCONCLUSIVE = "supported", "contradicted", "inconclusive"


def verdict(low: float, high: float, sense: str, limit: float) -> str:
    """Verdict on an interval low ... high against "<= limit", ">= limit" or "|x| <= limit"."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return INCONCLUSIVE
    if sense == "|x| <=":
        return verdict(max(low, -high, 0.0), max(-low, high), "<=", limit)
    inside, outside = (high <= limit, low > limit) if sense == "<=" else (low >= limit, high < limit)
    return SUPPORTED if inside else CONTRADICTED if outside else INCONCLUSIVE


def times_to_decide(value: float, low: float, high: float, sense: str, limit: float) -> float:
    """Factor on the number of points that brings the interval to one side of the limit; NaN if it is already there."""
    if sense == "|x| <=" and value < 0:
        value, low, high = -value, -high, -low
    if sense == "|x| <=" and -low > limit:  # the far side of zero, too
        high = max(high, 2 * value - low)
    if not low <= limit <= high or value == limit:
        return np.nan
    return (((high if value < limit else low) - value) / (limit - value)) ** 2


def drawn(number: Callable[..., float]) -> tuple[float, float, float]:
    """Value of a number and its 95 % interval from the draws; NaN if more than a tenth cannot be computed."""
    numbers = np.array([number(draw=k) for k in range(DRAWS)])
    known = numbers[np.isfinite(numbers)]
    low, high = _tails(known) if len(known) >= 0.9 * len(numbers) else (np.nan, np.nan)
    return number(), low, high


def _tails(drawn: np.ndarray) -> np.ndarray:
    """Bounds (2, ...) that another draw exceeds in 2.5 % to either side, from draws along the last axis."""
    return np.quantile(drawn, TAILS, axis=-1, method="weibull")


def inverted(number: Callable[..., Any], draws: int = DRAWS // 2) -> tuple[float, float, float]:
    """Value and 95 % interval of a distance, which errors mostly increase.

    number(draw, scale, rough): the distance found, or with a scale that of a supposed truth (`Sample`), with the errors
    of a slice of draws or without.  The value is the true distance whose draws have the distance found as their mean;
    it is 0 if already errors alone give as much.  The interval inverts a test: a true distance is in it if the distance
    found lies within 95 % of its draws.
    """
    found, those = float(number()), slice(draws)
    alone = np.atleast_1d(number(draw=those, scale=0.0))
    if not np.isfinite(found) or not np.isfinite(alone).all():
        return found, np.nan, np.nan
    per_scale = max(float(number(scale=1.0)), 1e-12)
    within = np.linspace(0.0, 1.25 * found, 7) / per_scale
    top = found + 2.0 * np.quantile(alone, TAILS[1])
    beyond = np.array([0.0, *np.linspace(0.5 * found, top, 7)]) / per_scale
    full = np.array([alone, *(number(draw=those, scale=scale) for scale in within[1:])])
    smooth = np.array([number(draw=those, scale=scale, rough=ROUGH) for scale in beyond])
    ends = []
    for scales, limit in ((within, full.mean(axis=1)), (within, _tails(full)[1]), (beyond, _tails(smooth)[0])):
        true = [number(scale=scale) for scale in scales]
        ends.append(float(np.interp(found, np.maximum.accumulate(limit), true)))
    return ends[0], ends[1], ends[2]
