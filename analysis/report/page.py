"""Small pieces of a self-contained page: numbered tables and figures that fit a phone, and the page itself.

A caption defines its number by a key, and any text may refer to it: "@table:quote@" becomes "Table 1" and
"@figure:fig05@" becomes "Figure 1" on the page.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import NamedTuple

import numpy as np
import pandas as pd

from .headings import HEADINGS
from .symbols import marked, plain

TEMPLATE = Path(__file__).with_name("report_template.html")
#: Width of a picture (pixels) from which it has several panels, so that a phone shows it in a strip that scrolls.
WIDE = 900
HINT = "Swipe or scroll sideways to see all of it."
_DEFINED, _REFERENCE = re.compile(r"@@(figure|table):(\w+)@@"), re.compile(r"@(figure|table):(\w+)@")
_NUMERIC = re.compile(r"[-+−–±]?\d|–$|withheld$|not reached$|$")


class Section(NamedTuple):
    """A part of the page: the group that it belongs to, its heading ("" for none) and its HTML."""

    group: str
    heading: str
    html: str


def page(title: str, head: str, sections: Sequence[Section]) -> str:
    """The whole page: the first screen, the contents by group, then the sections; figures and tables are numbered."""
    parts, group = [head, _contents(sections)], ""
    for k, section in enumerate(sections):
        if section.group != group:
            group = section.group
            parts.append(f"<h2>{marked(group)}</h2>")
        parts.append(f'<h3 id="s{k}">{marked(section.heading)}</h3>\n{section.html}')
    template = Template(TEMPLATE.read_text(encoding="utf-8"))
    return template.substitute(title=plain(title), body=numbered("\n".join(parts)))


def numbered(html: str) -> str:
    """HTML with the numbers of its figures and tables, from 1 in the order of the page.

    Raises ValueError for a key that is defined twice.  A reference to what the page does not have stays as it is.
    """
    numbers: dict[tuple[str, str], str] = {}
    counts = {"figure": 0, "table": 0}
    for kind, key in _DEFINED.findall(html):
        if (kind, key) in numbers:
            raise ValueError(f"the page has two captions for the {kind} {key!r}")
        counts[kind] += 1
        numbers[kind, key] = f"{kind.capitalize()} {counts[kind]}"

    def number(match: re.Match[str]) -> str:
        kind, key = match.groups()
        return numbers.get((kind, key), match[0])

    return _REFERENCE.sub(number, _DEFINED.sub(number, html))


def table(
    frame: pd.DataFrame,
    key: str,
    caption: str,
    stack: bool = False,
    digits: int = 3,
    headings: Mapping[str, str] | None = None,
) -> str:
    """A frame as a table; with `stack` every row becomes a card on a narrow screen.

    headings: column -> words, for columns that `HEADINGS` does not have.  Raises KeyError for a column without words.
    """
    words = {name: {**HEADINGS, **(headings or {})}[name] for name in frame.columns}
    text = {name: _is_text(frame[name]) for name in frame.columns}
    head = "".join(f"<th{' class=text' * text[name]}>{marked(words[name])}</th>" for name in frame.columns)
    rows = []
    for values in frame.itertuples(index=False):
        cells = []
        for k, (name, value) in enumerate(zip(frame.columns, values, strict=True)):
            kinds = " ".join(["text"] * text[name] + ["first"] * (k == 0) + ["verdict"] * (name == "verdict"))
            cells.append(f'<td class="{kinds}" data-name="{plain(words[name])}">{marked(_shown(value, digits))}</td>')
        rows.append(f"<tr>{''.join(cells)}</tr>")
    look = ' class="stack"' if stack else ""
    inner = f"{table_caption(key, caption)}<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody>"
    return f'<div class="scroll"><table{look}>{inner}</table></div>'


def table_caption(key: str, caption: str) -> str:
    """The caption of a table, which begins with its number."""
    return f"<caption><b>@@table:{key}@@.</b> {marked(caption)}</caption>"


def figure(path: str | Path, key: str, caption: str) -> str:
    """An embedded PNG with its caption, which is also the alternative text; a wide one scrolls on a narrow screen."""
    content = Path(path).read_bytes()
    data = base64.b64encode(content).decode()
    picture = f'<img alt="@figure:{key}@. {plain(caption)}" src="data:image/png;base64,{data}">'
    if int.from_bytes(content[16:20], "big") >= WIDE:
        picture = f'<div class="scroll wide">{picture}</div><p class="hint">{HINT}</p>'
    return f"<figure>{picture}<figcaption><b>@@figure:{key}@@.</b> {marked(caption)}</figcaption></figure>"


def cards(items: Iterable[tuple[str, str]]) -> str:
    """Key numbers side by side: items are (number, words)."""
    inner = "".join(f"<li><b>{marked(number)}</b>{marked(words)}</li>" for number, words in items)
    return f'<ul class="cards">{inner}</ul>'


def paragraph(text: str, kind: str = "") -> str:
    """One paragraph of plain text, of a class of the template if `kind` is given."""
    return f"<p{f' class={kind}' if kind else ''}>{marked(text)}</p>"


def paragraphs(texts: Iterable[str]) -> str:
    """Paragraphs of plain text."""
    return "".join(map(paragraph, texts))


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


def intervals(frame: pd.DataFrame, name: str) -> list[str]:
    """Every value of a column with its interval, from the columns <name>, <name>_low and <name>_high."""
    columns = (frame[name], frame[f"{name}_low"], frame[f"{name}_high"])
    return [f"{number(v)} ({number(a)} … {number(b)})" if np.isfinite(v) else "–"
            for v, a, b in zip(*columns, strict=True)]  # fmt: skip


def plural(count: int, one: str, many: str) -> str:
    """A number with its noun, such as "1 density" and "3 densities"."""
    return f"{count:,} {one if count == 1 else many}"


def listed(words: Sequence[str]) -> str:
    """Words as a list in a sentence: "dense, medium and loose"."""
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def _contents(sections: Sequence[Section]) -> str:
    """Links to all sections, one line per group."""
    lines = []
    for group in dict.fromkeys(section.group for section in sections):
        links = "".join(f'<a href="#s{k}">{marked(s.heading)}</a>' for k, s in enumerate(sections) if s.group == group)
        lines.append(f"<div><b>{marked(group)}</b> {links}</div>")
    return f"<nav>{''.join(lines)}</nav>"


def _is_text(column: pd.Series) -> bool:
    """Whether a column is set to the left: words, not numbers or texts of numbers."""
    return column.dtype.kind in "OSUb" and not all(_NUMERIC.match(str(value)) for value in column)


def _shown(value: object, digits: int) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return number(float(value), digits)
    return "–" if value is None else f"{value:,}" if isinstance(value, (int, np.integer)) else str(value)
