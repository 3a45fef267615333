"""The report's tables of results and inputs: ranges, initial states, gradings, fitted distributions, points, runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from ..quantities import DRAINED, EARLY_ENDS, QUANTITIES, Loading
from ..results.reader import Results
from ..tables import published
from . import conditions, input_words, page, wording
from .headings import in_order, readable

Frames = Mapping[str, pd.DataFrame]
Names = Mapping[float, str]
ORDER = ["quantity", "state", "mu_iso"]


def ranges(frames: Frames, names: Names, is_papers_test: bool, loading: Loading = DRAINED) -> str:
    """HTML of the ranges over the points at peak and critical state, beside the paper's where its test was repeated."""
    frame, shown = frames["peak_critical"], ["eta", "p" if loading.is_undrained else "e", "Z"]
    frame = frame[(frame["family"] == "coupled") & frame["quantity"].isin(shown)]
    frame = in_order(frame[frame["state"].isin(["peak", "critical"])])
    here = [_range(a, b) if np.isfinite(a) else "withheld" for a, b in zip(frame["min"], frame["max"], strict=True)]
    paper = [_range(a, b) for a, b in zip(frame["paper_low"], frame["paper_high"], strict=True)]
    columns = [*ORDER, "here", *(["paper"] if is_papers_test else [])]
    caption = "Range over the points at peak and critical state, with the noise of their runs"
    caption += ", of the tests that reached the state" * loading.is_undrained
    if is_papers_test:
        caption += ", beside the range that the paper reads off its figures"
    return page.table(readable(frame.assign(here=here, paper=paper)[columns], names), "ranges", caption)


def _range(low: float, high: float) -> str:
    if abs(low) >= 100.0:
        return f"{low:,.0f} … {high:,.0f}"
    return f"{low:.2f} … {high:.2f}" if np.isfinite(low) else "–"


def ended_tests(frames: Frames, names: Names) -> str:
    """HTML of the tests that ended before their strain, with probabilities and intervals; "" for other paths."""
    frame = frames["ends"]
    if not len(frame):
        return ""
    frame = frame[frame["family"] == "coupled"]
    columns = (frame[f"{name}_strain_pct"] for name in ("first", "median", "last"))
    strains = [", ".join(map(page.number, row)) if np.isfinite(row[0]) else "–" for row in zip(*columns, strict=True)]
    words = {**EARLY_ENDS, "none": "went on to the last strain"}
    shown = frame[["mu_iso", "points"]].assign(end=[words[end] for end in frame["end"]], strains=strains,
                                               probability=page.intervals(frame, "probability"))  # fmt: skip
    shown = readable(shown[["mu_iso", "end", "points", "probability", "strains"]], names)
    packings = int(frame["packings"].min())
    text = (
        "The intervals are those of Clopper and Pearson with the effective number of points (Korn and Graubard 1998), "
        "which follows from the points' probabilities and from how much the packings differ. "
    )
    if packings == 1:
        text += "There is one packing; what all points share through it is not in the intervals."
    else:
        text += f"With {packings} packings, the factor for so few of them is in the intervals, which are then wide."
    return page.table(shown, "ends", "Tests that ended before their strain", stack=True) + page.paragraph(
        text + " tables/ends.csv names the points, tables/ends_along_strain.csv gives the probabilities along strain."
    )


def critical_lines(frames: Frames) -> str:
    """HTML of the fitted critical state lines; "" without any."""
    frame = frames["critical_lines"]
    if not len(frame):
        return ""
    text = (
        "Least squares in e over the points that reached the critical state. Grain properties move the line: the fit "
        "at given properties contains the logarithms of the inputs, too. Where p' is the response and e is given, as "
        "in undrained tests of one density, such a line is too flat."
    )
    return page.paragraph(text) + critical_line_table(frame)


def critical_line_table(frame: pd.DataFrame) -> str:
    """HTML of the table of critical state lines."""
    pressures = zip(frame["p_low_kPa"], frame["p_high_kPa"], strict=True)
    columns = [
        "fitted_to",
        "points",
        "range",
        "e_100",
        "slope",
        "scatter",
        "slope_given_inputs",
        "scatter_given_inputs",
    ]
    errors = zip(frame["slope"], frame["slope_error"], strict=True)
    shown = frame.assign(range=[f"{low:,.0f} … {high:,.0f}" for low, high in pressures],
                         slope=[f"{page.number(a)} (error {page.number(b, 2)})" for a, b in errors])  # fmt: skip
    return page.table(shown[columns], "critical_lines", "Critical state line, e against ln p'", stack=True)


def extension_strength(frames: Frames, names: Names) -> str:
    """HTML of the strength in extension and what it means in compression; "" for compression."""
    frame = frames["extension_strength"]
    if not len(frame):
        return ""
    surfaces = [name.removesuffix("_compression") for name in frame if name.endswith("_compression")]
    heads = {f"{name}_compression": f"Stress ratio eta in compression, {name}" for name in surfaces}
    text = (
        f"The stress ratio that the same soil would have in compression if the surface of {' or of '.join(surfaces)} "
        "held, from the mean over the points. `compare` with a campaign in compression shows which one does."
    )
    caption = "Stress ratio in extension, and the one in compression on the same surface"
    return page.paragraph(text) + page.table(readable(frame, names), "extension_strength", caption, headings=heads)


def initial(frames: Frames, names: Names, is_papers_test: bool) -> str:
    """HTML of the states after consolidation, beside the paper's Table 3 where its test was repeated."""
    frame = in_order(frames["initial_state"])
    shown = frame[["quantity", "mu_iso"]].assign(here=_with_cov(frame["mean"], frame["COV"]))
    caption = "State after consolidation: mean, coefficient of variation in brackets"
    if is_papers_test:
        shown["paper"] = _with_cov(frame["paper_mean"], frame["paper_COV"])
        shown["difference_pct"] = [f"{v:+.1f}" if np.isfinite(v) else "–" for v in frame["difference_pct"]]
        caption += ", beside Table 3 of the paper"
    shown["before_shear"] = _with_cov(frame["mean_before_shear"], frame["COV_before_shear"])
    facts, collapse = frames["report_facts"].iloc[0], frames["packing_collapse"]
    text = page.paragraph(wording.initial_states(facts, collapse, names, is_papers_test))
    return text + page.table(readable(shown, names), "initial_state", caption, digits=2)


def gradings(results: Results, frames: Frames, names: Names, is_papers_test: bool) -> str:
    """HTML of the grading indices of the grains that carry stress; "" without any."""
    frame = frames["peak_critical"]
    frame = frame[(frame["family"] == "coupled") & frame["quantity"].isin(["I_G_active", "I_G_stress"])]
    frame = in_order(frame[frame["state"].isin(["peak", "critical"]) & frame["mean"].notna()])
    if not len(frame):
        return ""
    caption = (
        f"Grading indices of the grains that carry stress; I_G of all grains: {results.grading.get('I_G', np.nan):.4f}"
    )
    if is_papers_test:
        caption += (f"; the paper has about {published.GRADING_INDEX} for both, with a coefficient of variation of "
                    f"about {published.GRADING_INDEX_COV:g}")  # fmt: skip
    return page.table(readable(frame[[*ORDER, "mean", "COV"]], names), "gradings", caption, digits=4)


def inputs(results: Results, frames: Frames, is_papers_test: bool) -> str:
    """HTML of the source of the inputs, their marginals and copulas, and the points."""
    measured, pair = input_words.are_measured(results), input_words.is_pair_of_friction_and_modulus(results)
    against_paper = is_papers_test and measured
    facts = frames["report_facts"].iloc[0]
    source = wording.source(results) if measured and pair else input_words.inputs_source(results, facts)
    parts = [page.paragraphs([source, *wording.input_warnings(results)])]
    if len(frames["marginals"]):
        of_marginals = ("property", "family", "parameters", "aic", "bic", "ks", "ks_critical", "ks_critical_fitted",
                        "ad", "ad_critical_fitted")  # fmt: skip
        shown = _columns(frames["marginals"], of_marginals).rename(columns={"family": "distribution"})
        if not measured:
            shown = shown.dropna(axis=1, how="all").rename(columns={"parameters": "given_parameters"})
        shown = shown.assign(distribution=shown["distribution"].str.replace("_", " ")).replace(
            "parent_", "parent ", regex=True
        )
        caption = "Marginal distributions, smallest AIC first" if measured else "Marginal distributions, as given"
        caption += " (Table 1 of the paper)" * against_paper
        parts.append(page.table(shown, "marginals", caption, stack=True))
        if {"ks_critical", "ks_critical_fitted"} <= {*shown}:
            parts.append(page.paragraph(wording.LIMITS))
        if against_paper:
            parts.append(page.paragraph(wording.marginals_against_paper(results)))
    if len(frames["copulas"]):
        of_copulas = ("family", "parameters", "aic", "bic", "tau", "S", "p_bootstrap", "p_paper", "accepted")
        shown = _columns(frames["copulas"], of_copulas if against_paper else of_copulas[:-2] + of_copulas[-1:])
        shown = shown.rename(columns={"family": "copula", "tau": "kendall"})
        shown = shown if measured else shown.rename(columns={"parameters": "given_parameters"})
        caption = "Copulas, smallest AIC first" if measured else "The copula that was given"
        caption += " (Table 2 of the paper)" * against_paper
        parts.append(page.table(shown, "copulas", caption, stack=True))
        if measured:
            parts.append(page.paragraph(wording.copula_chosen(results)))
        if against_paper:
            parts.append(page.paragraph(wording.copulas_against_paper()))
    return "".join((*parts, page.paragraph(_points(results, is_papers_test))))


def _points(results: Results, is_papers_test: bool) -> str:
    """How the points were chosen and what they span."""
    words = {"method": "method", "discrepancy": "largest distance of the marginal distribution functions",
             "seed": "random seed"}  # fmt: skip
    attrs = results.inputs["points"]
    facts = "; ".join(f"{word}: {_plain(attrs[name])}" for name, word in words.items() if name in attrs)
    spans = page.listed(
        [
            f"{s} from {_shown(s, results.points[s].min())} to {_shown(s, results.points[s].max())}"
            for s in results.points.names
        ]
    )
    text = f"The {page.plural(len(results.points), 'point has', 'points have')} {spans}" + (
        f" ({facts})." if facts else "."
    )
    if is_papers_test:
        text += " The paper's 100 points span 0.15 to 0.65 and 16 to 61 GPa; its own lognormals reach lower."
    return text


def runs(results: Results, frames: Frames) -> str:
    """HTML of the numbers of runs, the accuracy asked for, failures and early stops."""
    counts = frames["run_counts"]
    zero = [name for name in ("failed", "spared", "steady_early") if not counts[name].any()]
    shown = readable(counts.drop(columns=zero), {})
    table = page.table(shown, "run_counts", "Runs by stage", stack=True)
    return table + page.paragraphs([conditions.accuracy(results, frames), *wording.run_notes(results, frames)])


def _columns(frame: pd.DataFrame, names: Iterable[str]) -> pd.DataFrame:
    return frame[[name for name in names if name in frame]]


def _with_cov(mean: Iterable[float], cov: Iterable[float]) -> list[str]:
    """Means with their coefficient of variation in brackets, where there is one."""
    return [page.number(m) + (f" ({page.number(round(c, 4), 2)})" if np.isfinite(c) else "")
            for m, c in zip(mean, cov, strict=True)]  # fmt: skip


def _shown(symbol: str, value: float) -> str:
    quantity = QUANTITIES[symbol]
    unit = quantity.shown_unit or quantity.unit
    return f"{value * quantity.shown_factor:.3g}" + ("" if unit in ("", "1") else f" {unit}")


def _plain(value: Any) -> str:
    return " and ".join(f"{v:.2g}" for v in np.atleast_1d(value)) if np.asarray(value).dtype.kind == "f" else str(value)
