"""The probability of an event over weighted points in packings, with its interval.

Points are of unequal probability, and those of one packing may share what the packing does.  The interval of Korn and
Graubard (1998, Survey Methodology 24, 193-201) is that of Clopper and Pearson with the effective number of points:

    n* = p (1 - p) / V,   V = R / (R - 1) sum_r (sum_{q in r} P_q (y_q - p))^2  over R packings,

at most Kish's number 1 / sum P^2, multiplied by (t_{n - 1} / t_{R - 1})^2 for the few packings.  Where all points or
none show the event, V is zero and n* is Kish's number with the same factor.  With one packing the factor is 1, and the
interval does not contain what the points share through it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .weighted import normalised

LEVEL = 0.95


class Proportion(NamedTuple):
    """Probabilities (...,) with the ends of their 95 % intervals; NaN without any point."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


def proportion(event: ArrayLike, probability: ArrayLike, packing: ArrayLike | None = None) -> Proportion:
    """Probability that an event (..., Q) happens over points of probability (Q,), packing (Q,) of each.

    Points without probability do not count.  None: one packing for all.
    """
    weight = np.asarray(probability, float)
    used = weight > 0
    happens, weight = np.asarray(event, bool)[..., used].astype(float), normalised(weight[used])
    if not used.any():
        nothing = np.full(happens.shape[:-1], np.nan)
        return Proportion(nothing, nothing, nothing)
    p = np.clip(happens @ weight, 0.0, 1.0)
    kish = 1.0 / np.sum(weight**2)
    label = (
        np.zeros(len(weight), int) if packing is None else np.unique(np.asarray(packing)[used], return_inverse=True)[1]
    )
    count = int(label.max()) + 1
    n = np.full(p.shape, kish)
    if count > 1:
        of_packing = (label == np.arange(count)[:, None]).astype(float)
        sums = (weight * (happens - p[..., None])) @ of_packing.T
        variance = count / (count - 1) * np.sum(sums**2, axis=-1)
        mixed = (p > 1e-12) & (p < 1.0 - 1e-12)
        n = np.where(
            mixed & (variance > 0), np.minimum(kish, p * (1.0 - p) / np.where(variance > 0, variance, 1.0)), kish
        )
        from scipy import special  # late: reading results needs the rest of this module only

        ends = [special.stdtrit(degrees, 0.5 + LEVEL / 2) for degrees in (max(kish - 1.0, 1.0), count - 1.0)]
        n = n * min(1.0, (ends[0] / ends[1]) ** 2)
    return Proportion(p, *_clopper_pearson(p, n))


def _clopper_pearson(p: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the 95 % interval of a share p (...,) of n (...,) points, which need not be whole numbers."""
    from scipy import special

    tail, hits, misses = 0.5 - LEVEL / 2, n * p, n * (1.0 - p)
    with np.errstate(invalid="ignore"):
        low = np.where(hits > 1e-9, special.betaincinv(np.maximum(hits, 1e-9), misses + 1.0, tail), 0.0)
        high = np.where(misses > 1e-9, special.betaincinv(hits + 1.0, np.maximum(misses, 1e-9), 1.0 - tail), 1.0)
    return low, high
