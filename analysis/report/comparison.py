"""compare.html: several campaigns side by side, with tables and figures in the same folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pandas as pd

from ..errors_and_files import atomic_write
from ..figures import comparison as figures
from ..figures import style
from ..figures.critical_line import critical_line
from ..quantities import QUANTITIES, Loading
from ..results.reader import read_results
from ..tables.comparison import Comparison, comparison, comparison_tables, predicted_extension, shared_packings
from ..tables.registry import without_formulas
from ..tables.strength import EXTENSION
from . import page
from .headings import STATES, quantity_words
from .numbers import critical_line_table

PAGE = "compare.html"
TITLE = "Comparison of campaigns"
#: Tables that are written only if they have rows.
OPTIONAL = ("critical_points", "critical_lines", "critical_offsets", "directions")
#: Heading of each column on the page.
WORDS = {
    "campaign": "campaign", "mu_iso": "mu_iso", "kind": "kind", "packings": "packings",
    "state": "state", "number": "number", "reference": "reference",
    "value": "this campaign", "interval": "difference (95 % interval)", "excludes_zero": "interval excludes zero",
    "q05": "5 % quantile", "q50": "median", "q95": "95 % quantile", "mean": "mean", "sd": "standard deviation",
    "offset": "mean distance in e", "points": "points", "fitted_to": "line through", "scatter": "scatter of the points",
    "scatter_of_line": "scatter about the line", "direction": "test", "compression": "compression",
    "extension": "extension", "eta_compression": "eta in compression", "eta_extension": "eta in extension",
    "what": "what", "reason": "reason", "setting": "setting", "quantity": "quantity",
}  # fmt: skip


def write_comparison(paths: Sequence[str | Path], folder: str | Path) -> Path:
    """Write compare.html, tables/*.csv and figures/*.png of several results files into a folder; returns the page.

    Raises analysis.results.ResultsError for a file that cannot be used.
    """
    of, folder = comparison([read_results(path) for path in paths]), Path(folder)
    tables = comparison_tables(of)
    for name in ("tables", "figures"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for name, frame in tables.items():
        if name in OPTIONAL and not len(frame):
            continue
        with atomic_write(folder / "tables" / f"{name}.csv") as part:
            without_formulas(frame).to_csv(part, index=False, float_format="%.6g")
    pictures = {}
    for symbol in of.symbols:
        figure = figures.responses(tables["responses"], symbol, of.names, of.strain_label)
        pictures[symbol] = style.save(figure, folder / "figures" / f"compare_{symbol}.png", ", ".join(of.names))
    if len(tables["differences"]):
        figure = figures.differences(tables["differences"], of.names)
        pictures["differences"] = style.save(figure, folder / "figures" / "compare_differences.png")
    points, lines = tables["critical_points"], tables["critical_lines"]
    if len(points):
        figure = critical_line(points, lines, predicted_extension(tables["directions"]))
        pictures["critical_line"] = style.save(figure, folder / "figures" / "compare_critical_line.png")
    path = folder / PAGE
    with atomic_write(path) as part:
        part.write_text(page.page(TITLE, _head(of, tables), list(_sections(of, tables, pictures))), encoding="utf-8")
    return path


def _head(of: Comparison, tables: Mapping[str, pd.DataFrame]) -> str:
    return f"<h1>{TITLE}</h1>" + page.paragraphs(_summary(of, tables["differences"]))


def _sections(
    of: Comparison, tables: Mapping[str, pd.DataFrame], pictures: Mapping[str, Path]
) -> Iterator[page.Section]:
    for heading, html in _parts(of, tables, pictures):
        yield page.Section("", heading, html)


def _parts(
    of: Comparison, tables: Mapping[str, pd.DataFrame], pictures: Mapping[str, Path]
) -> Iterator[tuple[str, str]]:
    """Heading and HTML of each section."""
    yield "Settings that differ", _settings(tables["settings"])
    if "differences" in pictures:
        caption = (
            f"Differences of the denoised means from those of {of.names[0]}, in standard deviations of {of.names[0]}, "
            "with 95 % intervals."
        )
        yield (
            "Differences",
            page.figure(pictures["differences"], "differences", caption) + _differences(tables["differences"]),
        )
    else:
        yield "Differences", page.paragraph("No state of two campaigns can be compared; the last section says why.")
    yield from _critical(tables, pictures)
    shown = [symbol for symbol in of.symbols if symbol in pictures]
    caption = "{} along axial strain: mean of the points (line) and one standard deviation to either side (band)."
    yield (
        "Responses along strain",
        "".join(page.figure(pictures[symbol], symbol, caption.format(QUANTITIES[symbol].name)) for symbol in shown)
        or page.paragraph("The campaigns have no density and response in common."),
    )
    yield "Moments of each campaign", _table(_moments(tables["moments"]), "moments", "Moments of each campaign")
    left_out = tables["not_compared"]
    nothing = page.paragraph("Everything that one campaign contains is compared with the others.")
    yield (
        "What is not compared",
        _table(left_out, "left_out", "What is not compared, and why") if len(left_out) else nothing,
    )


def _critical(tables: Mapping[str, pd.DataFrame], pictures: Mapping[str, Path]) -> Iterator[tuple[str, str]]:
    """Critical state line and directions, if the campaigns have them."""
    if "critical_line" not in pictures:
        return
    caption = (
        "Critical states of all points: void ratio against mean effective stress, with fitted lines and their scatter, "
        "and stress ratio by direction. Open symbols: compression; full ones: extension."
    )
    parts = [page.figure(pictures["critical_line"], "critical_line", caption)]
    if len(tables["critical_lines"]):
        parts.append(critical_line_table(tables["critical_lines"]))
    offsets = tables["critical_offsets"]
    if len(offsets):
        signs = [f"{v:+.4f}" for v in offsets["offset"]]
        shown = offsets.drop(columns="path").assign(offset=signs, direction=[
            Loading(*test).words for test in zip(offsets["path"], offsets["direction"], strict=True)
        ])  # fmt: skip
        words = "Mean distance in e from the line, and its scatter over the points, beside the scatter about the line"
        parts.append(_table(shown, "critical_offsets", words))
    yield "Critical state line", "".join(parts)
    frame = tables["directions"]
    if len(frame):
        surfaces = [name for name in EXTENSION if name in frame]
        text = (
            "Compression gives a stress ratio in extension by a surface of constant strength. Prediction and "
            "difference of the extension campaign from it, in magnitude; the Lode angle is 30° in compression, −30° in "
            "extension."
        )
        heads = {f"{name}_difference_pct": f"Difference from {name} (%)" for name in surfaces}
        heads |= {name: f"Extension by {name}" for name in surfaces}
        html = page.table(frame, "directions", "Extension beside compression.", stack=True, headings=WORDS | heads)
        yield "Compression and extension", page.paragraph(text) + html


def _summary(of: Comparison, differences: pd.DataFrame) -> Iterator[str]:
    files = "; ".join(f"{name}: {results.path.name}, {len(results.points)} points" for name, results in of.pairs)
    yield f"{files}. All differences are from {of.names[0]}."
    for name in of.names[1:]:
        rows = differences[differences["campaign"] == name]
        outside = int(rows["excludes_zero"].sum())
        if len(rows):
            yield (
                f"{name}: {outside} of {len(rows)} intervals of differences exclude zero. If the campaigns did not "
                f"differ, about {0.05 * len(rows):.0f} would be expected by chance; the numbers of one state depend on "
                "each other."
            )
    few = differences[(differences["packings"] < 3) | (differences["packings_reference"] < 3)]
    for name in dict.fromkeys(few["campaign"]):
        yield (
            f"{name}: one of the two campaigns has fewer than three packings. The intervals do not contain what all "
            "its points share through them, and are too narrow."
        )
    for name in shared_packings(of):
        yield (
            f"{name} has packings of {of.names[0]}. Their noise is partly the same in both, so that the intervals are "
            "rather too wide."
        )
    yield (
        "Denoised: what the grain properties do, without the noise of packings and runs. As simulated: what one "
        "specimen of the simulated size does. The intervals contain the errors of both models and of the inputs; "
        "campaigns with the same pairs share the error of the inputs."
    )


def _settings(frame: pd.DataFrame) -> str:
    if frame.empty:
        return page.paragraph("All settings agree.")
    return _table(frame, "settings", "Settings that differ")


def _table(frame: pd.DataFrame, key: str, caption: str) -> str:
    """A table of the page; a column without words of its own, such as the name of a campaign, keeps its name."""
    return page.table(frame, key, f"{caption}.", stack=True, headings={n: WORDS.get(n, str(n)) for n in frame.columns})


def _differences(frame: pd.DataFrame) -> str:
    """The differences of mean and standard deviation; the CSV file has the quantiles, too."""
    rows = frame[frame["number"].isin(["mean", "sd"])].reset_index(drop=True)
    shown = rows[["campaign", "mu_iso", "state"]].assign(
        state=rows["state"].map(STATES),
        quantity=rows["quantity"].map(quantity_words),
        kind=rows["kind"],
        number=rows["number"].map(WORDS),
        reference=rows["reference"],
        value=rows["value"],
        interval=page.intervals(rows, "difference"),
        excludes_zero=["yes" if flag else "no" for flag in rows["excludes_zero"]],
    )
    note = page.paragraph("tables/differences.csv has the differences of the quantiles, too.")
    return _table(shown, "differences", "Differences of means and standard deviations") + note


def _moments(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.drop(columns="unit").assign(
        state=frame["state"].map(STATES), quantity=frame["quantity"].map(quantity_words)
    )
