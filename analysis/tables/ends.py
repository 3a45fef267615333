"""How many undrained tests end before their strain: they liquefy, or become too stiff."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..quantities import EARLY_ENDS
from ..results.reader import Results
from .columns import with_interval

COLUMNS = ["family", "mu_iso", "end", "points", *with_interval("probability"), "first_strain_pct", "median_strain_pct",
           "last_strain_pct", "packings", "which"]  # fmt: skip
GOING_ON = "none"


def ends(results: Results) -> pd.DataFrame:
    """Per family and density of undrained tests: probability of each early end, and of none, with 95 % intervals.

    `end`: liquefied, stiff or none; `points`: number of points; strains of the first, the median (by probability) and
    the last of them, in %; `which`: their numbers.  The intervals are those of `pdem.proportion`.  Without columns for
    other tests, which cannot end so.
    """
    if not results.loading.is_undrained:
        return pd.DataFrame()
    rows = []
    for family in results.families:
        for mu_iso in results.family_densities(family):
            probability, ids = results.probability(mu_iso, family), results.family_points(family).id
            packings = len(np.unique(results.packing(mu_iso, family)[probability > 0]))
            gone: set[int] = set()
            for kind in EARLY_ENDS:
                ended = results.ended(kind, mu_iso, family)
                gone |= {*ended.point.tolist()}
                strains = _strains(ended.at, probability[np.searchsorted(ids, ended.point)])
                numbers = (*(float(v[-1]) for v in (ended.probability, ended.low, ended.high)), *strains)
                which = ", ".join(map(str, ended.point))
                rows.append((family, mu_iso, kind, len(ended.point), *numbers, packings, which))
            left = map(float, results.going_on(mu_iso, family))
            rest = [int(point) for point, own in zip(ids, probability, strict=True) if own > 0 and point not in gone]
            which = ", ".join(map(str, rest))
            rows.append((family, mu_iso, GOING_ON, len(rest), *left, *3 * (np.nan,), packings, which))
    return pd.DataFrame(rows, columns=COLUMNS)


def ends_along(results: Results) -> pd.DataFrame:
    """Probability along strain of having liquefied and of having become stiff, with 95 % intervals, per density."""
    if not results.loading.is_undrained:
        return pd.DataFrame()
    parts = []
    for mu_iso in results.family_densities():
        for kind in EARLY_ENDS:
            ended = results.ended(kind, mu_iso)
            columns = {"mu_iso": mu_iso, "end": kind, "eps_a_pct": 100 * ended.strain}
            numbers = zip(with_interval("probability"), (ended.probability, ended.low, ended.high), strict=True)
            parts.append(pd.DataFrame(columns | dict(numbers)))
    return pd.concat(parts, ignore_index=True)


def _strains(at: np.ndarray, probability: np.ndarray) -> tuple[float, float, float]:
    """First, median and last strain in %; NaN without any."""
    if not len(at):
        return np.nan, np.nan, np.nan
    order = np.argsort(at)
    share = np.cumsum(probability[order]) / probability.sum()
    return 100 * float(at.min()), 100 * float(at[order][np.searchsorted(share, 0.5)]), 100 * float(at.max())
