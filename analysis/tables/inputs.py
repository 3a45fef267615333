"""Tables of the fitted marginals and copulas and of the representative points."""

from __future__ import annotations

import math

import pandas as pd

from ..inputs.variables import VARIABLES
from ..quantities import QUANTITIES, parameter, with_error
from ..results.reader import Results


def marginals(results: Results) -> pd.DataFrame:
    """One row per property and family, best first: parameters with standard errors, AIC, BIC, test statistics."""
    rows = []
    for symbol, fits in results.inputs["marginals"].items():
        for rank, fit in enumerate(fits, start=1):
            errors = fit.get("se") or {}
            params = "; ".join(parameter(symbol, k, v, errors.get(k, math.nan)) for k, v in fit["params"].items())
            rest = {k: v for k, v in fit.items() if k not in ("family", "params", "se", "values")}
            rows.append({"property": symbol, "rank": rank, "family": fit["family"], "parameters": params} | rest)
    return pd.DataFrame(rows)


def copulas(results: Results) -> pd.DataFrame:
    """One row per copula family, best first: parameters with standard errors, pseudo-AIC, test of fit."""
    rows = []
    for rank, fit in enumerate(results.inputs["copulas"], start=1):
        errors = fit.get("se") or [math.nan] * len(fit["parameters"])
        names = fit.get("names") or [f"parameter {k + 1}" for k in range(len(fit["parameters"]))]
        values = [with_error(v, e) if math.isfinite(e) else f"{v:.5g}"
                  for v, e in zip(fit["parameters"], errors, strict=True)]  # fmt: skip
        params = "; ".join(f"{name} = {value}" for name, value in zip(names, values, strict=True))
        rest = {k: v for k, v in fit.items() if k not in ("family", "parameters", "names", "se", "interval")}
        rows.append({"rank": rank, "family": fit["family"], "parameters": params} | rest)
    return pd.DataFrame(rows)


def points(results: Results) -> pd.DataFrame:
    """The representative points with their probabilities; inputs in the units of their columns, such as G_p_GPa."""
    chosen = results.points
    columns = {VARIABLES[s].column: chosen[s] * QUANTITIES[s].shown_factor for s in chosen.variables}
    return pd.DataFrame({"id": chosen.id, **columns, "probability": chosen.probability})
