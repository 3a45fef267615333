"""The last sections of the report: the paper's statements, the glossary, citation and licence, versions and "
"settings."""

from __future__ import annotations

import html

import numpy as np
import pandas as pd

from .. import __version__
from ..quantities import CRITICAL_BLOCK, CRITICAL_FROM, DRAINED, QUANTITIES, Loading, Quantity
from ..results.reader import Results
from ..tables import published
from . import loading_words, page, wording

#: Quantities of the glossary, in its order.
GLOSSARY = ("mu_s", "G_p", "mu_iso", "nu", "sigma_3", "d50", "sigma_ln", "eps_a", "eps_v", "p", "q", "eta", "phi",
            "e", "e_m", "Z", "Z_m", "Phi_dev", "G_0", "D_p", "I_G", "I_G_active", "I_G_stress", "I")  # fmt: skip
#: Words that are no quantities.
TERMS = {
    "peak": "state at the largest smoothed stress ratio of a test; see the section on peaks",
    "critical state": f"average from {100 * CRITICAL_FROM:g} % axial strain to the end of the test, over "
    f"{100 * CRITICAL_BLOCK:g} % of strain at least",
    "small strain": "probe of the packing before shear: a shear strain at constant volume so small that contacts "
    "hardly slide",
    "point": "pair of grain properties, or values of all random inputs, that stand for a part of their distribution, "
    "with the probability of that part",
    "noise": "what packings (all runs of a packing share it) and single runs add to the effect of the grain "
    "properties; a denoised value is without it",
    "PDF": "probability density function, here from the probability density evolution method (PDEM)",
    "coefficient of variation": "standard deviation over mean (COV)",
    "quantile": "value that is not exceeded with this probability",
    "Wasserstein distance": "mean horizontal distance of two distribution functions",
    "contacts": "N_c: number of contacts; N_0 and N_1: grains without and with one contact; n_i: direction of a "
    "contact; V_s: volume of the grains",
}


def claims(frame: pd.DataFrame, differences: list[str]) -> str:
    """HTML of the paper's statements with their verdicts, or one sentence where another test was made."""
    if differences:
        return page.paragraph(
            f"The statements of {published.REFERENCE} are about its own test. This campaign has "
            f"{page.listed(differences)}; therefore the statements are not judged here."
        )
    told = frame[np.isfinite(frame["value"])]
    counts = told["verdict"].value_counts()
    outcome = page.listed([f"{count} {verdict}" for verdict, count in counts.items()]) or "none can be judged"
    missing = len(frame) - len(told)
    left = (
        f" {page.plural(missing, 'statement is', 'statements are')} about quantities that this campaign lacks."
        if missing
        else ""
    )
    parts = [page.paragraph(f"{len(told)} statements of {published.REFERENCE}: {outcome}.{left}"),
             page.paragraph(wording.CLAIMS)]  # fmt: skip
    if not len(told):
        return parts[0]
    needed = [f"; would be decided by {words}" if words else "" for words in told["to_decide"]]
    shown = told.assign(value=_values(told, needed))
    columns = ["claim", "verdict", "value", "criterion", "number"]
    return "".join(parts) + page.table(
        shown[columns], "claims", "The paper's statements, each with a number", stack=True
    )


def _values(told: pd.DataFrame, needed: list[str]) -> list[str]:
    columns = (told["value"], told["low"], told["high"], needed)
    return [f"{page.number(v)} ({page.number(a)} … {page.number(b)}){n}" for v, a, b, n in zip(*columns, strict=True)]


def glossary(loading: Loading = DRAINED) -> str:
    """HTML of the symbols with their formulas, and of the terms, for a test."""
    symbols, terms = [*GLOSSARY], dict(TERMS)
    if loading.is_undrained:
        symbols = [symbol for symbol in GLOSSARY if symbol not in loading_words.NOT_UNDRAINED]
        after = symbols.index("eta")
        symbols[after:after] = loading_words.UNDRAINED
        terms |= loading_words.TERMS_UNDRAINED
    if loading.sign < 0:
        terms["peak"] = terms["peak"].replace("the largest smoothed", "the largest magnitude of the smoothed")
    quantities = [QUANTITIES[symbol] for symbol in symbols]
    meanings = [loading_words.meaning(loading, of.symbol, of.meaning).replace(" * ", " ") for of in quantities]
    rows = [("p'" if of.symbol == "p" else of.symbol, of.name, _unit(of), meaning)
            for of, meaning in zip(quantities, meanings, strict=True)]  # fmt: skip
    rows += [("", name[0].upper() + name[1:], "", meaning) for name, meaning in terms.items()]
    frame = pd.DataFrame(rows, columns=["symbol", "name", "unit", "meaning"])
    text = "Strains are logarithmic; compression is positive in stress and strain."
    if loading.sign < 0:
        text += " Only the axial strain is shown positive in extension."
    return page.paragraph(text) + page.table(
        frame, "glossary", "Symbols and terms", stack=True, headings={"unit": "Unit"}
    )


def _unit(quantity: Quantity) -> str:
    unit = quantity.shown_unit or quantity.unit
    return {"1": "–", "deg": "°", "kg/m3": "kg/m³"}.get(unit, unit)


def is_lammps(results: Results) -> bool:
    """Whether the runs were made by LAMMPS; all other runs are YADE's."""
    return any(str(version).startswith("LAMMPS") for version in results.runs["yade_version"])


def citation(results: Results) -> str:
    """HTML on how to cite, and the licence."""
    code = "LAMMPS (lammps.org)" if is_lammps(results) else "YADE (yade-dem.org)"
    return page.paragraphs([
        f"This tool: The grain-scatter authors, grain-scatter, version {__version__} (CITATION.cff has the entry).",
        f"The method: {published.REFERENCE}",
        f"Simulations by {code}; its documentation states how to cite it. For these numbers, add the name "
        "of this campaign and the date of its results, given below.",
        "Licence of grain-scatter: MIT.",
    ])  # fmt: skip


def settings(results: Results) -> str:
    """HTML of the versions behind the results, and the campaign file as it was used."""
    attrs = results.attrs
    yade = sorted(set(results.runs["yade_version"]) - {""})
    digests = [digest[:12] for digest in sorted(set(results.runs["script_digest"]) - {""})]
    rows = [("Results", attrs["created"]), *((name, text) for name, text in attrs["versions"].items())]
    rows += [
        ("LAMMPS" if is_lammps(results) else "YADE", ", ".join(yade).replace("LAMMPS ", "")),
        ("Digests of the run scripts", ", ".join(digests)),
    ]
    table = page.table(pd.DataFrame(rows, columns=["key", "text"]), "versions", "Versions of programs and results")
    return f"{table}<p>The campaign file:</p><pre>{html.escape(attrs['config']).replace('@', '&#64;')}</pre>"
