"""What the page explore.html shows: values of the points and PDFs of every response, as simulated and denoised."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..pdem.conditional import evolve_known
from ..pdem.pdf import PDF
from ..quantities import QUANTITIES, responses_of
from ..results.models import curve_model
from ..results.reader import Results
from .columns import unit
from .moments import AS_SIMULATED, DENOISED

#: Largest number of cells of a PDF on the page; the cells of the results are averaged in equal groups.
CELLS = 200


def explore_data(results: Results) -> dict[str, Any]:
    """Everything that the page needs, ready for JSON; values in displayed units.

    `axial`: what strains are called. `sets`: one entry per family and density with its points, and by kind and response
    the values (T, Q) of the points and the PDF (T, X) with its first cell centre and cell width. Arrays are base64 of
    little-endian float32, by rows.
    """
    sets = list(_sets(results))
    there = {symbol for each in sets for symbol in each["kinds"][AS_SIMULATED]}
    usual = responses_of(results.loading.path)
    symbols = [symbol for symbol in QUANTITIES if symbol in there and symbol not in usual]
    symbols = [symbol for symbol in usual if symbol in there] + symbols
    inputs = [name for name in results.points.columns() if name not in ("id", "probability")]
    return {
        "campaign": str(results.attrs.get("campaign", "")),
        "created": str(results.attrs.get("created", "")),
        "strain": (100 * results.strain).tolist(),
        "axial": "Axial strain" if results.loading.sign > 0 else "Axial extension",
        "kinds": [AS_SIMULATED, DENOISED],
        "quantities": {name: _described(name) for name in (*symbols, *inputs)},
        "responses": symbols,
        "inputs": inputs,
        "sets": sets,
    }


def denoised_pdf(results: Results, symbol: str, mu_iso: float, family: str = "coupled") -> PDF | None:
    """PDF of a response along strain from the denoised values of the points, in SI units; None with too few runs.

    Undrained, the points whose tests go on.
    """
    model = curve_model(results, symbol, mu_iso, family)
    if model is None:
        return None
    probability, denoised = results.probability(mu_iso, family), model.predict(results.family_points(family).x)
    if results.loading.is_undrained:
        denoised = np.where(np.isfinite(results.response(symbol, mu_iso, family).values), denoised, np.nan)
    return evolve_known(denoised, probability, results.strain)


def _sets(results: Results) -> Iterator[dict[str, Any]]:
    for family in reversed(results.families):  # "coupled", where all inputs vary, comes first
        points = results.family_points(family)
        columns = points.columns()
        for mu_iso in results.family_densities(family):
            kinds: dict[str, dict[str, Any]] = {AS_SIMULATED: {}, DENOISED: {}}
            for symbol in results.symbols(mu_iso, family):
                kinds[AS_SIMULATED][symbol] = _packed(results.response(symbol, mu_iso, family).pdf, symbol)
                if (pdf := denoised_pdf(results, symbol, mu_iso, family)) is not None:
                    kinds[DENOISED][symbol] = _packed(pdf, symbol)
            shown = {name: (values * QUANTITIES[name].shown_factor).tolist()
                     for name, values in columns.items() if name not in ("id", "probability")}  # fmt: skip
            yield {
                "name": f"mu_iso = {mu_iso:g}" + ("" if family == "coupled" else f", only {family} varies"),
                "family": family,
                "mu_iso": mu_iso,
                "id": columns["id"].tolist(),
                "probability": results.probability(mu_iso, family).tolist(),
                "inputs": shown,
                "kinds": kinds,
            }


def _packed(pdf: PDF, symbol: str) -> dict[str, Any]:
    """Values (T, Q) and PDF (T, X) in displayed units. The PDF is averaged over groups of cells."""
    factor = QUANTITIES[symbol].shown_factor
    cells = pdf.p.shape[1]
    group = next(k for k in range(-(-cells // CELLS), cells + 1) if cells % k == 0)
    x = np.broadcast_to(pdf.x, pdf.p.shape).reshape(len(pdf.p), -1, group).mean(axis=2)
    p = pdf.p.reshape(len(pdf.p), -1, group).mean(axis=2)
    values = np.empty((0, 0)) if pdf.values is None else pdf.values
    return {
        "values": _base64(values * factor),
        "pdf": _base64(p / factor),
        "first": (x[:, 0] * factor).tolist(),
        "width": (pdf.dx * group * factor).tolist(),
        "bandwidth": (pdf.shown_width * factor).tolist(),
    }


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()


def _described(symbol: str) -> dict[str, str]:
    of = unit(symbol)
    return {"name": QUANTITIES[symbol].name, "label": QUANTITIES[symbol].name + ("" if of == "1" else f" ({of})"),
            "unit": "" if of == "1" else of}  # fmt: skip
