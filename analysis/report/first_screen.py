"""The first screen: what was tested, the numbers to quote, how far they hold, and how to cite them."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from .. import __version__
from ..quantities import rounded
from ..results.models import runs_with_moments
from ..results.quote import OF_POINTS, WITHHELD
from ..results.reader import JUDGED_STATES, Results
from ..results.standing import NOT_PROVEN, NOT_REACHED, PROVEN
from ..tables import published
from . import conditions, input_words, loading_words, page, picture
from .headings import HEADINGS, quantity_words
from .symbols import marked

Frames = Mapping[str, pd.DataFrame]
STATES = {"peak": "Peak", "critical": "Critical state", "probe": "Small strain",
          "transformation": "Phase transformation", "strength": "10 % axial strain"}  # fmt: skip
#: Order of the rows of a table: states as they are reached.
ORDER = ("probe", "transformation", "peak", "strength", "critical")
#: Columns of the tables.
NAMES = ("mean", "sd", "q05", "q95")
#: What the quantities of the tables are, in a few words; the glossary has the formulas.
IN_WORDS = {
    "G_0": "small-strain stiffness G_0: the shear modulus",
    "eta": "stress ratio η = q / p', deviatoric stress divided by mean effective stress",
    "phi": "friction angle φ: mobilised, with zero cohesion",
    "D_p": "dilatancy D_p: plastic volumetric strain increment divided by plastic shear strain increment, positive "
    "where the soil dilates",
    "e": "void ratio e: volume of voids over volume of grains",
    "Z": "coordination number Z: contacts per grain",
}

DESIGN = (
    "These numbers hold for freely rotating spheres. Spheres are weaker than sand, because sand grains interlock: "
    "quartz sand has a critical friction angle of about 33° (Bolton 1986). Use the numbers only to compare how "
    "strongly the scatter of grain properties changes the soil. Do not use them as design values. The quantiles "
    "compare different soils: in each soil all grains have the same properties. They are no characteristic values of "
    "one deposit, since the variation inside a deposit is not included."
)
MEANING = (
    "The tables show the effect of the {kind} alone: the noise of packings and of single runs is removed from mean, "
    "standard deviation and quantiles. The uncertainty that remains (±) is {interval}. Each number is rounded to the "
    "precision of its uncertainty. tables/quote.csv has the same numbers, and the uncertainties of the quantiles."
)
ABOVE = (
    "Mean ± a: the true mean lies within ± a of the stated one with 95 % confidence. Standard deviation and quantiles "
    "describe the scatter between soils with different {kind}."
)


def first_screen(results: Results, frames: Frames, name: str) -> str:
    """HTML above the contents: the test, the numbers to quote and their limits, the citation, the size."""
    settings = results.attrs["settings"]
    stress = f" = {settings['consolidation']['sigma_3_kPa']:g} kPa" if settings else ""
    stress = " (random)" if "sigma_3" in results.points.names else stress
    drawn = picture.test_picture(results.diameters, stress, f"{100 * conditions.end_strain(results):.3g} %",
                                 results.loading)  # fmt: skip
    meaning = MEANING.format(kind=input_words.kind(results),
                             interval=input_words.interval_words(results, frames["report_facts"].iloc[0]))  # fmt: skip
    title = f"{results.loading.words.capitalize()}, simulated: campaign &quot;{marked(name)}&quot;"
    words = page.paragraphs([*conditions.tested(results, frames), *conditions.size_warning(frames)])
    quote = frames["quote"]
    symbols = "; ".join(text for symbol, text in IN_WORDS.items() if symbol in set(quote["quantity"]))
    above = ABOVE.format(kind=input_words.kind(results))
    notes = [f"Symbols: {symbols} (@table:glossary@).", meaning, *standing_words(quote)]
    notes += [*basis_words(results, frames), DESIGN]
    return (
        f'<h1>{title}</h1><div class="tested"><div>{words}{page.paragraph(cite_words(), "cite")}</div>'
        f"{drawn}</div><h2>Numbers to quote</h2>{page.paragraph(above)}{quote_tables(quote, frames['ends'])}"
        f"{page.paragraphs(notes)}{page.cards(_size(results, frames))}"
    )


def quote_tables(quote: pd.DataFrame, ends: pd.DataFrame) -> str:
    """HTML of one table per density; every cell of a number names it in the attribute data-quote.

    ends: the table of tests that ended early, for the states that not all of them reached.
    """
    parts = (_density(rows, f"quote{k}", ends) for k, (_, rows) in enumerate(quote.groupby("mu_iso"), start=1))
    return f'<div class="quotes">{"".join(parts)}</div>'


def _density(rows: pd.DataFrame, key: str, ends: pd.DataFrame) -> str:
    first = rows.iloc[0]
    words = f"{first['density'][0].upper()}{first['density'][1:]} (mu_iso = {first['mu_iso']:g})"
    if first["void_ratio"] == first["void_ratio"]:
        words += f", e = {first['void_ratio']:.3f} after consolidation"
    head = "".join(f"<th>{HEADINGS[name]}</th>" for name in NAMES)
    body = []
    for state in (state for state in ORDER if (rows["state"] == state).any()):
        part = rows[rows["state"] == state]
        judged = part.iloc[0]["standing"] if state in JUDGED_STATES else ""
        standing = marked("; ".join(filter(None, [judged, loading_words.holds_for(part, ends)])))
        limited = "" if standing == PROVEN else ' class="limited"'
        shown = f"<span{limited}>: {standing}</span>" if standing else ""
        body.append(f'<tr class="state"><th colspan="5">{STATES[state]}{shown}</th></tr>')
        for row in part.to_dict("records"):
            where = f"{row['mu_iso']:g}/{row['state']}/{row['quantity']}"
            cells = "".join(f'<td data-quote="{where}/{name}">{quoted(row, name)}</td>' for name in NAMES)
            words_of_row = quantity_words(row["quantity"]).removeprefix("small-strain ").replace(" at the peak", "")
            body.append(f'<tr><td class="text">{marked(words_of_row)}</td>{cells}</tr>')
    inner = f"{page.table_caption(key, words)}<thead><tr><th></th>{head}</tr></thead><tbody>{''.join(body)}</tbody>"
    return f'<div class="scroll"><table class="quote">{inner}</table></div>'


def quoted(row: Mapping[str, object], name: str) -> str:
    """HTML of a number of a row of the quote: mean and sd with their uncertainties, quantiles without."""
    if row["basis"] == WITHHELD:
        return "withheld"
    value, half = rounded(float(row[name]), float(row[f"{name}_pm"]))  # type: ignore[arg-type]
    return f"{value} <span>± {half}</span>" if half and name in ("mean", "sd") else value


def standing_words(quote: pd.DataFrame) -> list[str]:
    """Which states were not reached, or are not proven, and what that means."""
    states = quote.drop_duplicates(["mu_iso", "state"])
    meaning = {
        NOT_REACHED: "The tests did not reach it, and its numbers are withheld.",
        NOT_PROVEN: "Nothing in the runs contradicts this state, but there are too few runs, or too few spheres, to "
        "prove it. If the tests went on, these numbers could change.",
    }
    words = ["A state is called proven if the mean curves show it within their uncertainty: a peak before the end of "
             "the test, or a critical state in which stress and volume no longer change."]  # fmt: skip
    for state in ("peak", "critical"):
        for standing, consequence in meaning.items():
            named = states.loc[(states["state"] == state) & (states["standing"] == standing), "density"]
            if len(named):
                of = "" if named.iloc[0] == "one density" else f" ({page.listed(list(named))})"
                words.append(f"{STATES[state]}{of}: {standing}. {consequence} @table:standings@ gives the reasons.")
    return words


def basis_words(results: Results, frames: Frames) -> list[str]:
    """What is not in the uncertainties: too few runs, or too few packings."""
    quote, design = frames["quote"], frames["packing_design"].iloc[0]
    words = []
    if (quote["basis"] == OF_POINTS).any() and results.loading.is_undrained:
        words.append(
            f"Where no uncertainty is given, fewer than {runs_with_moments(results)} tests of the density reached the "
            "state, or a stress varies by more than a factor of 5 over the points, which no model of the runs follows. "
            "The numbers are then those of the points and contain the noise of the runs."
        )
    elif (quote["basis"] == OF_POINTS).any():
        words.append(f"Where no uncertainty is given, the density has fewer than {runs_with_moments(results)} runs. "
                     "The numbers are then those of the points and contain the noise of the runs.")  # fmt: skip
    elif not design["known"]:
        have = page.plural(int(design["packings"]), "packing", "packings")
        words.append(f"With {have} the noise of packings is not known, and the uncertainties do not contain it.")
    return words


def cite_words() -> str:
    """How to cite, in one sentence."""
    return f'Cite: grain-scatter {__version__} (see "How to cite" below), and for the method {published.REFERENCE}'


def _size(results: Results, frames: Frames) -> list[tuple[str, str]]:
    counts = frames["run_counts"].iloc[-1]
    done, planned = int(counts["done"]), int(counts["planned"])
    densities = len(results.densities)
    return [
        (f"{len(results.points)}", f"points ({input_words.points_words(results)})"),
        (f"{densities}", "density" if densities == 1 else "densities"),
        (f"{done:,}", "runs, all done" if done == planned else f"of {planned:,} runs done"),
        (conditions.particles(frames), "spheres per run"),
        (f"{counts['core_hours']:.3g}", "core-hours"),
    ]
