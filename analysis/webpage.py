"""Small pieces of a self-contained page: tables that fit a phone, embedded figures, the page itself."""

from __future__ import annotations

import base64
import html
from pathlib import Path
from string import Template

import numpy as np

#: Columns whose values were set, not measured, and are shown as set.
AS_GIVEN = ("mu_iso",)
TEMPLATE = Path(__file__).with_name("report_template.html")


def page(title, sections) -> str:
    """The whole page: sections is a list of (heading, HTML); headings with a text get an entry in the contents."""
    links = "".join(f'<a href="#s{k}">{escape(name)}</a>' for k, (name, _) in enumerate(sections) if name)
    body = []
    for k, (name, content) in enumerate(sections):
        body.append((f'<h2 id="s{k}">{escape(name)}</h2>\n' if name else "") + content)
        if k == 0:
            body.append(f"<nav>{links}</nav>")
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(title=escape(title), body="\n".join(body))


def table(frame, caption="", stack=False, digits=3) -> str:
    """A frame as a table; with `stack` every row becomes a card on a narrow screen."""
    text = [frame[name].dtype.kind in "OSU" for name in frame.columns]
    head = "".join(f"<th{_class(t)}>{escape(name)}</th>" for name, t in zip(frame.columns, text, strict=True))
    rows = []
    for values in frame.itertuples(index=False):
        cells = [_cell(name, value, t, k == 0, digits)
                 for k, (name, value, t) in enumerate(zip(frame.columns, values, text, strict=True))]  # fmt: skip
        rows.append(f"<tr>{''.join(cells)}</tr>")
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    look = ' class="stack"' if stack else ""
    inner = f"<table{look}>{title}<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    return f'<div class="scroll">{inner}</div>'


def figure(path, caption) -> str:
    """An embedded PNG with its caption, which is also the alternative text."""
    data = base64.b64encode(Path(path).read_bytes()).decode()
    plain = escape(caption)
    return f'<figure><img alt="{plain}" src="data:image/png;base64,{data}"><figcaption>{plain}</figcaption></figure>'


def cards(items) -> str:
    """Key numbers side by side: items are (number, words)."""
    inner = "".join(f"<li><b>{escape(number)}</b>{escape(words)}</li>" for number, words in items)
    return f'<ul class="cards">{inner}</ul>'


def paragraph(text) -> str:
    """One paragraph of plain text."""
    return f"<p>{escape(text)}</p>"


def number(value, digits=3) -> str:
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


def escape(text) -> str:
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
    return f'<td class="{" ".join(kinds)}" data-name="{escape(name)}">{escape(shown)}</td>'
