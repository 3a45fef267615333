"""Tables of a campaign as CSV files, in units a person reads, every row weighted by the points' probabilities."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import paper, weighted
from analysis.archive import CONSOLIDATED
from analysis.claims import claims_table
from analysis.collapse import collapsed_runs
from analysis.design import design_table
from analysis.friction_effect import friction_table
from analysis.input_bands import input_bands
from analysis.pooling import moment_bands, monte_carlo_along, monte_carlo_check, variance_sources
from analysis.quantities import QUANTITIES
from analysis.replay import stopping_replay
from analysis.results import STATES, read_results

LEVELS = (0.05, 0.5, 0.95)


def write_tables(results, folder) -> list[Path]:
    """Write <folder>/tables/<name>.csv for every table from results (a path or open); returns the paths."""
    results = read_results(results)
    target = Path(folder) / "tables"
    target.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, table in TABLES.items():
        paths.append(target / f"{name}.csv")
        part = paths[-1].with_suffix(f".{os.getpid()}.part")
        table(results).to_csv(part, index=False, float_format="%.6g")
        os.replace(part, paths[-1])
    return paths


def marginals(results) -> pd.DataFrame:
    """One row per property and family, best first: parameters with standard errors, AIC, BIC, test statistics."""
    rows = []
    for symbol, fits in results.inputs["marginals"].items():
        for rank, fit in enumerate(fits, start=1):
            errors = fit.get("se") or {}
            params = "; ".join(parameter(symbol, k, v, errors.get(k, np.nan)) for k, v in fit["params"].items())
            rest = {k: v for k, v in fit.items() if k not in ("family", "params", "se")}
            rows.append({"property": symbol, "rank": rank, "family": fit["family"], "parameters": params} | rest)
    return pd.DataFrame(rows)


def copulas(results) -> pd.DataFrame:
    """One row per copula family, best first: parameters with standard errors, pseudo-AIC, test of fit."""
    rows = []
    for rank, fit in enumerate(results.inputs["copulas"], start=1):
        errors = fit.get("se") or [np.nan] * len(fit["parameters"])
        names = fit.get("names") or [f"parameter {k + 1}" for k in range(len(fit["parameters"]))]
        params = "; ".join(f"{n} = {v:.5g} ± {e:.2g}" for n, v, e in zip(names, fit["parameters"], errors, strict=True))
        rest = {k: v for k, v in fit.items() if k not in ("family", "parameters", "names", "se", "interval")}
        rows.append({"rank": rank, "family": fit["family"], "parameters": params} | rest)
    return pd.DataFrame(rows)


def initial_state(results) -> pd.DataFrame:
    """e, e_m, Z and Z_m after consolidation per density (Table 3), beside the paper's, and before shear.

    Mean and COV are over the consolidations.  With one a packing (at least two, else no COV) the packings are a sample
    and COV is the sample standard deviation between them, R - 1 in its denominator, over the mean; with one a point
    both are weighted as the points are, as in every other table.  "before shear" is the average over the points, each
    at rest again with its own mu_s and G_p.
    """
    rows, runs = [], results.runs
    of_points = not (runs.loc[runs["stage"] == "consolidate", "point"] < 0).any()
    for mu_iso in results.family_densities():
        weight = results.weights(mu_iso)
        for symbol in CONSOLIDATED:
            (found, share), before = results.consolidated(symbol, mu_iso), results.state("initial", symbol, mu_iso)
            mean = float(found @ share) if len(found) else np.nan
            cov = np.nan
            if len(found) > 1:
                cov = float(weighted.cov(found, share) if of_points else found.std(ddof=1) / mean)
            theirs, their_cov = paper.INITIAL_STATE.get((symbol, mu_iso), (np.nan, np.nan))
            rows.append({"mu_iso": mu_iso, "quantity": symbol, "consolidations": len(found), "mean": mean,
                         "COV": cov, "paper mean": theirs, "paper COV": their_cov,
                         "difference (%)": 100 * (mean / theirs - 1),
                         "mean before shear": float(weighted.mean(before, weight)),
                         "COV before shear": float(weighted.cov(before, weight))})  # fmt: skip
    return pd.DataFrame(rows)


def responses_moments(results) -> pd.DataFrame:
    """Mean, standard deviation and quantiles of every response along strain, per family and density."""
    parts = []
    for family in results.families:
        for mu_iso in results.family_densities(family):
            for symbol in results.symbols(mu_iso, family):
                response = results.response(symbol, mu_iso, family)
                factor = response.quantity.shown_factor
                columns = {"family": family, "mu_iso": mu_iso, "quantity": QUANTITIES[symbol].heading,
                           "eps_a (%)": 100 * results.strain, "mean": factor * response.mean,
                           "standard deviation": factor * response.std}  # fmt: skip
                columns |= {f"{q:.0%} quantile": factor * response.quantile(q) for q in LEVELS}
                columns["share continued"] = response.extended @ response.probability
                parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def peak_critical(results) -> pd.DataFrame:
    """Moments, range and quantiles of every quantity at every state, per family and density, in shown units."""
    rows = []
    for family in results.families:
        for mu_iso in results.family_densities(family):
            weight = results.weights(mu_iso, family)
            for state in STATES:
                for symbol in results.state_symbols(state, mu_iso, family):
                    rows.append(_state_row(results, family, mu_iso, state, symbol, weight))
    return pd.DataFrame(rows)


def runs(results) -> pd.DataFrame:
    """One row per run of the plan: what became of it, its cost and its proofs, and whether its packing collapsed."""
    return results.runs.assign(collapsed=collapsed_runs(results))


def points(results) -> pd.DataFrame:
    """The representative points with their probabilities."""
    frame = results.points
    return frame.assign(G_p=frame["G_p"] * QUANTITIES["G_p"].shown_factor).rename(columns={"G_p": "G_p (GPa)"})


def parameter(symbol, name, value, error=np.nan) -> str:
    """A parameter with its standard error, in the shown unit if it is large enough to carry the property's unit."""
    quantity = QUANTITIES[symbol]
    carries = abs(value) * quantity.shown_factor > 1e-3 and quantity.shown_factor != 1.0
    factor, unit = (quantity.shown_factor, f" {quantity.shown_unit}") if carries else (1.0, "")
    spread = f" ± {error * factor:.2g}" if np.isfinite(error) else ""
    return f"{name} = {value * factor:.5g}{spread}{unit}"


def _state_row(results, family, mu_iso, state, symbol, weight):
    values = results.state(state, symbol, mu_iso, family) * QUANTITIES[symbol].shown_factor
    error = results.state_error(state, symbol, mu_iso, family)
    scatter = np.nan if error is None else weighted.mean(error**2, weight) ** 0.5 * QUANTITIES[symbol].shown_factor
    known = np.isfinite(values)
    low, high = (values[known].min(), values[known].max()) if known.any() else (np.nan, np.nan)
    row = {"family": family, "mu_iso": mu_iso, "state": state, "quantity": QUANTITIES[symbol].heading,
           "points": int(known.sum()), "mean": float(weighted.mean(values, weight)),
           "standard deviation": float(weighted.std(values, weight)),
           "COV": float(weighted.cov(values, weight)), "least": low, "largest": high}  # fmt: skip
    row |= {f"{q:.0%} quantile": float(weighted.quantile(values, weight, q)) for q in LEVELS}
    stated = (
        paper.STATE_RANGE.get((state, symbol, mu_iso), (np.nan, np.nan)) if family == "coupled" else (np.nan, np.nan)
    )
    return row | {"standard error of one run": float(scatter), "paper from": stated[0], "paper to": stated[1]}


#: File name without ending -> function of the open results that returns the frame.
TABLES = {
    "marginals": marginals,
    "copulas": copulas,
    "points": points,
    "initial_state": initial_state,
    "responses_moments": responses_moments,
    "peak_critical": peak_critical,
    "claims": claims_table,
    "design": design_table,
    "friction": friction_table,
    "variance_sources": variance_sources,
    "monte_carlo": monte_carlo_check,
    "input_bands": input_bands,
    "monte_carlo_along_strain": monte_carlo_along,
    "moment_bands": moment_bands,
    "stopping_replay": stopping_replay,
    "runs": runs,
}
