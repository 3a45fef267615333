"""The report as one self-contained HTML page: the numbers to quote, then pictures, tables, and how far to trust "
"them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ..errors_and_files import atomic_write
from ..figures import write_figures
from ..quantities import DRAINED
from ..results.reader import Results, ResultsError, read_results
from ..tables import DERIVED_TABLES, REPORT_TABLES, TABLES
from . import conditions, first_screen, friction, input_words, numbers, page, reference, reliability
from .captions import caption
from .page import Section

#: Every table; the report shows most of them.
NEEDED = {*TABLES, *REPORT_TABLES, *DERIVED_TABLES}
PICTURES, TABLED, TRUST = "Pictures", "Tables", "How far to trust the numbers"
PAPER, REFERENCE = "The paper", "Terms, citation and settings"


class Content(NamedTuple):
    """What the page is made of: open results, frames as `evaluate` returns them, figure name -> PNG."""

    results: Results
    frames: Mapping[str, pd.DataFrame]
    figures: Mapping[str, Path]


def write_report(results: str | Path | Results, frames: Mapping[str, pd.DataFrame], folder: str | Path) -> Path:
    """Draw all figures into <folder>/figures and write <folder>/report.html.

    Parameters
    ----------
    results : str, Path or Results
        results.h5, or results that are already open.
    frames : mapping of str to pandas.DataFrame
        As `evaluate` returns them for these results.
    folder : str or Path
        Where the page and the figures go.

    Returns
    -------
    Path
        The page. It embeds its pictures, needs no network, and is written whole or not at all.

    Examples
    --------
    >>> import tempfile
    >>> page = write_report("runs/demo/results.h5", evaluate("runs/demo/results.h5"), tempfile.mkdtemp())
    >>> page.name
    'report.html'
    """
    results = read_results(results)
    if missing := sorted(NEEDED - set(frames)):
        raise ResultsError(f"the report needs all tables; missing: {', '.join(missing)} (frames = evaluate(results))")
    folder = Path(folder)
    figures = {path.stem: path for path in write_figures(results, frames, folder / "figures")}
    name = results.attrs["campaign"] or folder.resolve().name
    target = folder / "report.html"
    with atomic_write(target) as part:
        part.write_text(whole_page(Content(results, frames, figures), name), "utf-8")
    return target


def whole_page(content: Content, name: str) -> str:
    """The page of a campaign of that name as HTML."""
    head = first_screen.first_screen(content.results, content.frames, name)
    return page.page(f"Campaign {name}", head, sections(content))


def sections(content: Content) -> list[Section]:
    """The page's sections below the first screen, in order; sections without content are left out."""
    results, frames, _ = content
    names = results.density_names()
    differences = conditions.paper_differences(results)
    ours, along, loading = not differences, "mu_s" in results.points.names, results.loading
    usual = loading == DRAINED
    fabric = "Void ratios, coordination numbers and fabric"
    stiffness = "Stiffness and dilatancy"
    if loading.is_undrained:
        fabric, stiffness = "Mechanical void ratio, coordination numbers and fabric", "Stiffness"
    listed = [
        Section(PICTURES, "Stress ratio", _pictures(content, ours, "fig05", "fig06", "fig07")),
        Section(PICTURES, "Stress paths and pore pressure", _pictures(content, ours, "fig17", "fig18")),
        Section(PICTURES, fabric,
                _pictures(content, ours, "fig08", "fig09", "fig10", "fig11", "fig12")),
        Section(PICTURES, "Critical state line", _pictures(content, ours, "fig19")),
        Section(PICTURES, stiffness, _pictures(content, ours, "fig13")),
        Section(PICTURES, "Joint PDFs", _pictures(content, ours, "fig14", "fig15")),
        Section(PICTURES, "Effect of interparticle friction", _pictures(content, ours, "fig16") * along),
        Section(PICTURES, input_words.pictures_heading(results), _pictures(content, ours, "fig02", "fig03", "fig04")),
        Section(TABLED, "Tests that ended early", numbers.ended_tests(frames, names)),
        Section(TABLED, "Ranges", numbers.ranges(frames, names, ours, loading)),
        Section(TABLED, "Strength in extension", numbers.extension_strength(frames, names)),
        Section(TABLED, "Critical state line", numbers.critical_lines(frames)),
        Section(TABLED, "Critical state at single frictions", friction.friction(frames, names, loading) * along),
        Section(TABLED, "States after consolidation", numbers.initial(frames, names, ours)),
        Section(TABLED, "Grains that carry stress", numbers.gradings(results, frames, names, ours)),
        Section(TABLED, input_words.inputs_heading(results), numbers.inputs(results, frames, ours)),
        Section(TABLED, "Runs", numbers.runs(results, frames)),
        Section(TRUST, "Standing of the states", reliability.standings(frames, names)),
        Section(TRUST, "What limits the accuracy", reliability.accuracy(results, frames, names)),
        Section(TRUST, "Sources of the variance", reliability.sources(results, frames, names)),
        Section(TRUST, "Peaks", reliability.peaks(frames, names, loading)),
        Section(TRUST, "Checks of the runs", reliability.checks(frames, names)),
        Section(TRUST, "Points against Monte Carlo", reliability.against_monte_carlo(frames, names, loading)),
        Section(TRUST, "How many runs would have been enough", reliability.replay(frames, names, loading)),
        Section(TRUST, "Other sizes, rates and grains", reliability.other_runs(frames)),
        Section(PAPER, "Statements of the paper", reference.claims(frames["claims"], differences) * usual),
        Section(REFERENCE, "Glossary", reference.glossary(loading)),
        Section(REFERENCE, "How to cite, licence", reference.citation(results)),
        Section(REFERENCE, "Versions and settings", reference.settings(results)),
    ]  # fmt: skip
    return [section for section in listed if section.html]


def _pictures(content: Content, is_papers_test: bool, *starts: str) -> str:
    return "".join(
        page.figure(path, start, caption(content.results, start, is_papers_test))
        for start in starts
        for name, path in content.figures.items()
        if name.startswith(start)
    )
