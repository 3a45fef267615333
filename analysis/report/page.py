"""Small pieces of a self-contained page: tables that fit a phone, embedded figures, the page itself."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import Template

import numpy as np
import pandas as pd

from ..quantities import INPUTS

#: Columns whose values were set, not measured, and are shown as set.
AS_GIVEN = ("mu_iso",)
#: Column of a frame -> heading on the page.
HEADINGS = {
    "value_interval": "value (interval)", "here_cov": "here (COV)", "paper_cov": "paper (COV)",
    "before_shear_cov": "before shear (COV)", "difference_pct": "difference (%)", "G_p_GPa": "G_p (GPa)",
    **{f"only_{symbol}": f"only {symbol}" for symbol in INPUTS},
    **{f"shapley_{symbol}": f"Shapley effect of {symbol}" for symbol in INPUTS},
    "sigma_3_kPa": "sigma_3 (kPa)", "d50_mm": "d50 (mm)",
    "q05": "5%", "q50": "50%", "q95": "95%", "W1_average": "W1, average", "mean_deg": "mean",
    "sd_deg": "sd", "q05_deg": "5%", "q95_deg": "95%", "run_of_the_largest": "run of the largest",
    "steady_early": "steady early", "core_hours": "core-hours", "mean_steps": "steps, mean",
    "sd_of_points": "spread of points", "run_error": "error of one run",
    "packing": "noise of packings", "own": "noise of single runs", "noise": "noise, both",
    "kernel_width": "kernel width", "spacing_of_points": "spacing of points", "runs_share": "from runs",
    "off_diagonal_pct": "off-diagonal / sigma_1", "eta_windows_pct": "eta, by windows",
    "eta_mean_pct": "eta, of the mean tensor",
    "mean_bias": "mean bias subtracted", "no_interior_peak": "points without interior peak",
    "lost_probability": "lost probability", "share_of_runs": "share of runs", "shear_runs": "shear runs",
    "target": "error asked for", "claimed_for": "claimed for", "error_all_runs": "against all runs",
    "worst_in": "worst in", "error_surface": "against the surface of all",
}  # fmt: skip
TEMPLATE = Path(__file__).with_name("report_template.html")


def page(title: str, sections: Sequence[tuple[str, str]]) -> str:
    """The whole page: sections is a list of (heading, HTML); headings with a text get an entry in the contents."""
    links = "".join(f'<a href="#s{k}">{escape(name)}</a>' for k, (name, _) in enumerate(sections) if name)
    body = []
    for k, (name, content) in enumerate(sections):
        body.append((f'<h2 id="s{k}">{escape(name)}</h2>\n' if name else "") + content)
        if k == 0:
            body.append(f"<nav>{links}</nav>")
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(title=escape(title), body="\n".join(body))


def table(frame: pd.DataFrame, caption: str = "", stack: bool = False, digits: int = 3) -> str:
    """A frame as a table; with `stack` every row becomes a card on a narrow screen."""
    text = [frame[name].dtype.kind in "OSU" for name in frame.columns]
    head = "".join(
        f"<th{_class(t)}>{escape(HEADINGS.get(name, name))}</th>" for name, t in zip(frame.columns, text, strict=True)
    )
    rows = []
    for values in frame.itertuples(index=False):
        cells = [_cell(name, value, t, k == 0, digits)
                 for k, (name, value, t) in enumerate(zip(frame.columns, values, text, strict=True))]  # fmt: skip
        rows.append(f"<tr>{''.join(cells)}</tr>")
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    look = ' class="stack"' if stack else ""
    inner = f"<table{look}>{title}<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    return f'<div class="scroll">{inner}</div>'


def headings(frame: pd.DataFrame) -> list[str]:
    """Symbol and unit of every row of a frame with the columns `quantity` and `unit`, such as "G_0 (MPa)"."""
    pairs = zip(frame["quantity"], frame["unit"], strict=True)
    return [symbol if unit == "1" else f"{symbol} ({unit})" for symbol, unit in pairs]


def intervals(frame: pd.DataFrame, name: str, dash: str) -> list[str]:
    """Every value of a column with its interval, from the columns <name>, <name>_low and <name>_high."""
    columns = (frame[name], frame[f"{name}_low"], frame[f"{name}_high"])
    return [f"{number(v)} ({number(a)}{dash}{number(b)})" for v, a, b in zip(*columns, strict=True)]


def figure(path: str | Path, caption: str) -> str:
    """An embedded PNG with its caption, which is also the alternative text."""
    data = base64.b64encode(Path(path).read_bytes()).decode()
    plain = escape(caption)
    return f'<figure><img alt="{plain}" src="data:image/png;base64,{data}"><figcaption>{plain}</figcaption></figure>'


def cards(items: Iterable[tuple[str, str]]) -> str:
    """Key numbers side by side: items are (number, words)."""
    inner = "".join(f"<li><b>{escape(number)}</b>{escape(words)}</li>" for number, words in items)
    return f'<ul class="cards">{inner}</ul>'


def paragraph(text: str) -> str:
    """One paragraph of plain text."""
    return f"<p>{escape(text)}</p>"


def number(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, without an exponent where that reads well; a dash for NaN."""
    value = float(value)
    if not np.isfinite(value):
        return "–"
    if abs(value) < 1e-12:
        return "0"
    size = np.floor(np.log10(abs(value)))
    if -4 <= size < 6:
        return f"{value:.{max(0, int(digits - 1 - size))}f}"
    return f"{value:.{digits - 1}e}"


def escape(text: object) -> str:
    """Text made safe for HTML."""
    return html.escape(str(text), quote=True)


def _class(is_text):
    return ' class="text"' if is_text else ""


def _cell(name, value, is_text, first, digits):
    kinds = ["text"] if is_text else []
    kinds += ["first"] * first + ["verdict"] * (name == "verdict")
    if isinstance(value, (bool, np.bool_)):
        shown = "yes" if value else "no"
    elif name in AS_GIVEN:
        shown = f"{value:g}"
    elif isinstance(value, (int, np.integer)) or is_text:
        shown = "–" if value is None else str(value)
    else:
        shown = number(value, digits)
    return f'<td class="{" ".join(kinds)}" data-name="{escape(HEADINGS.get(name, name))}">{escape(shown)}</td>'
