"""Tables of the states: after consolidation, along strain, at the peak, at the critical state and of the probe."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..pdem import weighted
from ..quantities import CONSOLIDATED, DRAINED, QUANTITIES
from ..results.reader import STATES, Results
from . import published
from .columns import QUANTILES, named


def initial_state(results: Results) -> pd.DataFrame:
    """e, e_m, Z and Z_m after consolidation per density (Table 3), beside the paper's, and before shear.

    Mean and COV are over the consolidations.  With one consolidation per packing (at least two, else no COV) the
    packings are a sample and COV is the sample standard deviation between them, R - 1 in its denominator, over the
    mean.  With one per point both use the points' probabilities, as every other table does.  "before shear" is the
    average over the points, each at rest again with its own mu_s and G_p.
    """
    rows, runs = [], results.runs
    of_points = not (runs.loc[runs["stage"] == "consolidate", "point"] < 0).any()
    for mu_iso in results.family_densities():
        point_probability = results.probability(mu_iso)
        for symbol in CONSOLIDATED:
            values, probability = results.consolidated(symbol, mu_iso)
            before = results.shown_state("initial", symbol, mu_iso)
            mean = float(values @ probability) if len(values) else np.nan
            cov = np.nan
            if len(values) > 1:
                cov = float(weighted.cov(values, probability) if of_points else values.std(ddof=1) / mean)
            stated = published.INITIAL_STATE if results.loading == DRAINED else {}
            paper_mean, paper_cov = stated.get((symbol, mu_iso), (np.nan, np.nan))
            rows.append({
                "mu_iso": mu_iso,
                **named(symbol),
                "consolidations": len(values),
                "mean": mean,
                "COV": cov,
                "paper_mean": paper_mean,
                "paper_COV": paper_cov,
                "difference_pct": 100 * (mean / paper_mean - 1),
                "mean_before_shear": float(weighted.mean(before, point_probability)),
                "COV_before_shear": float(weighted.cov(before, point_probability)),
            })  # fmt: skip
    return pd.DataFrame(rows)


def responses_moments(results: Results) -> pd.DataFrame:
    """Mean, standard deviation and quantiles of every response along strain, per family and density.

    Undrained, they are those of the tests that go on, whose probability is `going_on`.
    """
    parts = []
    for family in results.families:
        for mu_iso in results.family_densities(family):
            for symbol in results.symbols(mu_iso, family):
                response = results.response(symbol, mu_iso, family)
                factor = response.quantity.shown_factor
                columns: dict[str, Any] = {"family": family, "mu_iso": mu_iso, **named(symbol)}
                columns |= {"eps_a_pct": 100 * results.strain, "mean": factor * response.mean}
                columns |= {"sd": factor * response.std}
                columns |= {name: factor * response.quantile(q) for name, q in QUANTILES.items()}
                columns["share_continued"] = response.extended @ response.probability
                if results.loading.is_undrained:
                    columns["going_on"] = np.isfinite(response.values) @ response.probability
                parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def peak_critical(results: Results) -> pd.DataFrame:
    """Moments, range and quantiles of every quantity at every state, per family and density, in displayed units.

    `standing` of the state: numbers of a state that was not reached are withheld.  Undrained, `holds_for` is the
    probability of the points that reached it: the numbers are conditional on it.
    """
    rows = []
    for family in results.families:
        for mu_iso in results.family_densities(family):
            probability = results.probability(mu_iso, family)
            for state in STATES:
                for symbol in results.state_symbols(state, mu_iso, family):
                    rows.append(_state_row(results, family, mu_iso, state, symbol, probability))
    return pd.DataFrame(rows)


def _state_row(
    results: Results, family: str, mu_iso: float, state: str, symbol: str, probability: np.ndarray
) -> dict[str, Any]:
    factor = QUANTITIES[symbol].shown_factor
    values = results.shown_state(state, symbol, mu_iso, family) * factor
    error = results.state_error(state, symbol, mu_iso, family)
    scatter = np.nan if error is None else weighted.mean(error**2, probability) ** 0.5 * factor
    known = np.isfinite(values)
    low, high = (values[known].min(), values[known].max()) if known.any() else (np.nan, np.nan)
    row = {
        "family": family,
        "mu_iso": mu_iso,
        "state": state,
        "standing": results.standing(state, mu_iso, family).status,
        **named(symbol),
        "points": int(known.sum()),
        "mean": float(weighted.mean(values, probability)),
        "sd": float(weighted.std(values, probability)),
        "COV": float(weighted.cov(values, probability)),
        "min": low,
        "max": high,
    }
    row |= {name: float(weighted.quantile(values, probability, q)) for name, q in QUANTILES.items()}
    unknown = (np.nan, np.nan)
    usual = family == "coupled" and results.loading == DRAINED
    stated = published.STATE_RANGE.get((state, symbol, mu_iso), unknown) if usual else unknown
    if results.loading.is_undrained:
        row["holds_for"] = results.holds_for(state, symbol, mu_iso, family)
    return row | {"run_standard_error": float(scatter), "paper_low": stated[0], "paper_high": stated[1]}
