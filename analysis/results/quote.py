"""The numbers to quote: one row per density, state and quantity, rounded by their uncertainties.

The report shows these numbers wherever it shows one of these quantities, and `tables/quote.csv` holds them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..pdem import weighted
from ..quantities import QUANTITIES, rounded
from .densities import density_names
from .friction_angle import friction_angle
from .models import ANGLE, state_moments
from .reader import Results

#: States and quantities that are quoted, in the order of the table.
QUOTED = (
    ("peak", "eta"), ("peak", ANGLE), ("peak", "D_p"), ("peak", "e"), ("peak", "Z"),
    ("critical", "eta"), ("critical", ANGLE), ("critical", "e"), ("critical", "Z"), ("probe", "G_0"),
)  # fmt: skip
#: Those of undrained tests.
QUOTED_UNDRAINED = (
    ("transformation", "p"), ("transformation", "eta"), ("peak", "eta"), ("peak", ANGLE),
    *(("strength", symbol) for symbol in ("s_u", "q", "p", "u")),
    *(("critical", symbol) for symbol in ("eta", ANGLE, "p", "q", "u", "e", "Z")), ("probe", "G_0"),
)  # fmt: skip
#: Columns of a number and its uncertainty, and the quantile of each (None: moments).
NUMBERS = {"mean": None, "sd": None, "q05": 0.05, "q95": 0.95}
COLUMNS = ["density", "mu_iso", "void_ratio", "state", "standing", "quantity", "unit",
           *(column for name in NUMBERS for column in (name, f"{name}_pm")), "basis"]  # fmt: skip
#: Where the numbers of a row come from.
OF_MODEL, OF_POINTS, WITHHELD, OF_NONE = "model of all runs", "points", "withheld", "no test reached it"


def quoted(results: Results) -> tuple[tuple[str, str], ...]:
    """States and quantities that are quoted of a campaign."""
    return QUOTED_UNDRAINED if results.loading.is_undrained else QUOTED


def quote(results: Results) -> pd.DataFrame:
    """Numbers to quote of every density, in displayed units.

    `density`: its name; `void_ratio`: mean after consolidation; `standing` of the state.  `mean`, `sd` (standard
    deviation) and quantiles `q05`, `q95` describe the effect of the grain properties, without the noise of packings and
    runs; `<name>_pm` is the half width of the 95 % interval (the larger side).  A number and its uncertainty are
    rounded together (`quantities.rounded`).  `basis`: "model of all runs"; "points" where a density has too few runs
    (fewer than 8 for up to three inputs; then the uncertainty is not known and the numbers contain the noise of the
    runs), and for stresses of undrained tests that vary by more than a factor 5; "withheld" where the state was not
    reached; "no test reached it" where no test went on so far.  Undrained, `holds_for` is the probability of the points
    that reached the state: all numbers of the row are conditional on it.
    """
    rows = []
    densities = results.family_densities()
    for mu_iso, name in density_names(densities).items():
        of_density = {"density": name, "mu_iso": mu_iso, "void_ratio": _void_ratio(results, mu_iso)}
        for state, symbol in quoted(results):
            if ("eta" if symbol == ANGLE else symbol) in results.state_symbols(state, mu_iso):
                rows.append(of_density | _row(results, state, symbol, mu_iso))
    return pd.DataFrame(rows, columns=[*COLUMNS, *(["holds_for"] if results.loading.is_undrained else [])])


def _row(results: Results, state: str, symbol: str, mu_iso: float) -> dict[str, Any]:
    quantity, standing = QUANTITIES[symbol], results.standing(state, mu_iso)
    holds_for = results.holds_for(state, "eta" if symbol == ANGLE else symbol, mu_iso)
    found = state_moments(results, state, symbol, mu_iso)
    if found is not None:
        estimate = found.distribution.denoised
        columns = [0, 1, *(2 + found.distribution.levels.index(q) for q in NUMBERS.values() if q is not None)]
        value, low, high = (part[0, columns] for part in (estimate.value, estimate.low, estimate.high))
        numbers, basis = np.stack([value, np.maximum(high - value, value - low)], axis=1), OF_MODEL
    else:
        numbers = _of_points(results, state, symbol, mu_iso)
        basis = WITHHELD if not standing.shown else OF_POINTS if holds_for > 0 else OF_NONE
    row: dict[str, Any] = {"state": state, "standing": standing.status, "quantity": symbol}
    row["unit"] = quantity.shown_unit or quantity.unit
    for name, (number, half) in zip(NUMBERS, quantity.shown_factor * numbers, strict=True):
        row[name], row[f"{name}_pm"] = _as_numbers(*rounded(number, half))
    return row | {"basis": basis, "holds_for": round(holds_for, 4)}


def _of_points(results: Results, state: str, symbol: str, mu_iso: float) -> np.ndarray:
    """Moments and quantiles (4, 2) of the points, without uncertainties; NaN where the state is withheld.

    A single point has no scatter: only its value is given.
    """
    values = results.shown_state(state, "eta" if symbol == ANGLE else symbol, mu_iso)
    values = friction_angle(values, results.loading.direction) if symbol == ANGLE else values
    probability = results.probability(mu_iso)
    moments = [float(weighted.mean(values, probability)), float(weighted.std(values, probability))]
    moments += [float(weighted.quantile(values, probability, q)) for q in NUMBERS.values() if q is not None]
    if np.count_nonzero(np.isfinite(values) & (probability > 0)) < 2:
        moments[1:] = [np.nan] * (len(moments) - 1)
    return np.stack([moments, np.full(len(moments), np.nan)], axis=1)


def _void_ratio(results: Results, mu_iso: float) -> float:
    """Mean void ratio after consolidation, to three decimals; NaN without a consolidation."""
    values, probability = results.consolidated("e", mu_iso)
    return round(float(values @ probability), 3) if len(values) else np.nan


def _as_numbers(value: str, half: str) -> tuple[float, float]:
    return tuple(float(text) if text not in ("", "–") else np.nan for text in (value, half))  # type: ignore[return-value]
