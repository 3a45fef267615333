"""The fitted inputs in words, from the dictionary that inputs.json holds: one line per marginal, and the copula."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..quantities import QUANTITIES, parameter
from .independence import LEVEL, kendall
from .marginals import Marginal, verdict


def fit_lines(inputs: Mapping[str, Any]) -> list[str]:
    """Lines on the chosen marginals and copula: parameters, AIC against the next family, test, verdict; independence.

    `inputs` has `marginals` (symbol -> list of fits, smallest AIC first) and `copulas` (list of fits, chosen first);
    without them there are no lines.  `pairs` (list of pairs) may be left out.
    """
    lines = []
    for symbol, table in inputs.get("marginals", {}).items():
        if table:
            best = table[0]
            parameters = ", ".join(parameter(symbol, name, value) for name, value in best["params"].items())
            if best.get("values"):
                parameters += f", {len(best['values'])} centres"
            lines.append(f"{symbol}: {best['family']} ({parameters}); {_aic(table)}; {_marginal_test(best)}")
    if fits := inputs.get("copulas", []):
        best = fits[0]
        values = zip(best["names"], best["parameters"], strict=True)
        parameters = ", ".join(f"{name} = {value:.4g}" for name, value in values)
        named = f"{best['family']} ({parameters})" if parameters else best["family"]
        tau = "" if best.get("tau") is None else f", Kendall's tau {best['tau']:.3g}"
        lines.append(f"copula: {named}{tau}; {_aic(fits)}; {_copula_test(best)}")
        pairs = inputs.get("pairs")
        if pairs and len(pairs[0]) == 2:
            found = kendall(*zip(*pairs, strict=True))
            rejected = "rejected" if found.p <= LEVEL else "not rejected"
            lines.append(f"dependence: {found.text} of the pairs; independence {rejected}, {found.p_text}")
    return lines


def variable_range(symbol: str, values: np.ndarray) -> str:
    """Symbol, least and largest of the values (n,) in the displayed unit, such as "G_p 13.6 to 44.3 GPa"."""
    quantity = QUANTITIES[symbol]
    low, high = (quantity.shown_factor * float(end) for end in (np.min(values), np.max(values)))
    unit = f" {quantity.shown_unit}" if quantity.shown_unit else ""
    return f"{symbol} {low:.3g} to {high:.3g}{unit}" if high > low else f"{symbol} {low:.4g}{unit}"


def _aic(table: list[dict[str, Any]]) -> str:
    """AIC of the first fit against the one that the list names next."""
    if len(table) == 1:
        return "the only family tried"
    ours, theirs = table[0]["aic"], table[1]["aic"]
    other = table[1]["family"] + (" (rejected)" if table[1].get("accepted") is False else "")
    side = "below" if theirs >= ours else "above"
    return f"AIC {abs(theirs - ours):.1f} {side} the next, {other}"


def _marginal_test(fit: dict[str, Any]) -> str:
    if fit.get("ks_p_fitted") is None:
        return "not tested"
    result = verdict(Marginal.from_dict(fit))
    return f"KS D = {fit['ks']:.3f}, {_p(fit['ks_p_fitted'])}, AD = {fit['ad']:.2f}, {_p(fit['ad_p_fitted'])}: {result}"


def _copula_test(fit: dict[str, Any]) -> str:
    if fit.get("accepted") is None:
        return "not tested"
    result = "accepted" if fit["accepted"] else "rejected"
    return f"Cramer-von Mises S = {fit['S']:.3f}, {_p(fit['p_bootstrap'])}: {result}"


def _p(value: float) -> str:
    if not math.isfinite(value):
        return "p unknown"
    return f"p = {value:.2f}" if value >= 0.1 else f"p = {value:.3f}" if value >= 0.001 else "p < 0.001"
