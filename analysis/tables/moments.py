"""Mean, standard deviation and quantiles of the states with 95 % intervals, denoised and as simulated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from ..quantities import QUANTITIES
from ..results.models import state_moments
from ..results.quote import quoted
from ..results.reader import Results
from ..surrogates.distribution import Distribution
from .columns import QUANTILES, unit, with_interval
from .pooled_states import pooled

DENOISED, AS_SIMULATED = "denoised", "as simulated"
NUMBERS = ("mean", "sd", *QUANTILES)


def tabled(results: Results) -> list[tuple[str, str]]:
    """States and quantities of the table: those quoted (friction angles have a table of their own) and pooled."""
    return list(dict.fromkeys([*(of for of in quoted(results) if of[1] != "phi"), *pooled(results)]))


def moments(results: Results) -> pd.DataFrame:
    """Moments and quantiles of every state per density with 95 % intervals, twice, in displayed units.

    `kind`: "denoised", what the inputs do, from the model without the noise of packings and runs; "as simulated", what
    one specimen of the simulated number of spheres does.  The intervals contain the error of the model and that of the
    inputs (`inputs.measurements`), if the number of measurements behind them is known.  `runs_share`: share of the
    squared width of the interval of the mean that more or larger runs could remove; the rest is due to the number of
    measurements.  `packings`: their number; with one or two the intervals lack what all points share through them.
    """
    rows, undrained = [], results.loading.is_undrained
    for mu_iso in results.family_densities():
        for state, symbol in tabled(results):
            found = state_moments(results, state, symbol, mu_iso)
            if found is None:
                continue
            factor = QUANTITIES[symbol].shown_factor
            of_state = (mu_iso, state, symbol, unit(symbol))
            holds_for = (results.holds_for(state, symbol, mu_iso),) if undrained else ()
            for kind, numbers in kinds(found.distribution):
                rows.append((*of_state, kind, *(factor * numbers), found.runs_share, found.packings, *holds_for))
    columns = ["mu_iso", "state", "quantity", "unit", "kind", *(c for n in NUMBERS for c in with_interval(n))]
    return pd.DataFrame(rows, columns=[*columns, "runs_share", "packings", *(["holds_for"] if undrained else [])])


def kinds(found: Distribution) -> Iterator[tuple[str, np.ndarray]]:
    """Kind and its numbers, each followed by low and high."""
    for kind, estimate in ((DENOISED, found.denoised), (AS_SIMULATED, found.as_simulated)):
        yield kind, np.stack([estimate.value[0], estimate.low[0], estimate.high[0]], axis=1).ravel()
