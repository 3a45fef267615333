"""A report page as its tables and texts, and the quantities that it gives more than one value."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser

import pandas as pd

from analysis.quantities import rounded
from analysis.report.headings import HEADINGS, STATES, quantity_words
from analysis.report.symbols import marked

#: Headings of moments and quantiles, and their columns in the numbers to quote.
STATISTICS = {HEADINGS[name]: name for name in ("mean", "sd", "q05", "q95")}
#: Words of captions of the tables in which a number with ± is no quoted quantity.
OTHER_QUANTITIES = ("Standing of", "Marginal distributions", "Copulas", "Critical stress ratio", "Bias of")
NUMBER = re.compile(r"\d ± \d")


@dataclass
class Table:
    """A table of the page: caption, headings and the texts of its cells."""

    caption: str = ""
    heads: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)


class ReportPage(HTMLParser):
    """Tables, paragraphs, quoted cells (data-quote -> texts) of a page, and all text outside of <pre> and <style>."""

    def __init__(self, source: str):
        super().__init__()
        self.tables: list[Table] = []
        self.paragraphs: list[str] = []
        self.quoted: dict[str, list[str]] = {}
        self.text: list[str] = []
        self._open: list[tuple[str, dict[str, str | None]]] = []
        self._cell = ""
        self.feed(source)

    def handle_starttag(self, tag, attrs):
        if tag in ("meta", "img", "br"):
            return
        self._open.append((tag, dict(attrs)))
        if tag == "table":
            self.tables.append(Table())
        elif tag == "tr":
            self.tables[-1].rows.append([])
        if tag in ("td", "th", "caption", "p", "figcaption", "li"):
            self._cell = ""

    def handle_startendtag(self, tag, attrs):
        """A tag that closes itself holds nothing."""

    def handle_data(self, data):
        if not any(tag in ("pre", "style", "title") for tag, _ in self._open):
            self.text.append(data)
            self._cell += data

    def handle_endtag(self, tag):
        opened, attrs = self._open.pop()
        assert opened == tag, f"<{opened}> is closed by </{tag}>"
        if tag == "caption":
            self.tables[-1].caption = self._cell
        elif tag in ("td", "th"):
            in_head = any(opened == "thead" for opened, _ in self._open)
            (self.tables[-1].heads if in_head else self.tables[-1].rows[-1]).append(self._cell)
            if attrs.get("data-quote"):
                self.quoted.setdefault(attrs["data-quote"], []).append(self._cell)
        elif tag in ("p", "figcaption", "li"):
            self.paragraphs.append(self._cell)


def as_text(words: str) -> str:
    """Words as the page's text has them, without tags."""
    return re.sub("<[^>]*>", "", marked(words))


def problems(source: str, quote: pd.DataFrame) -> list[str]:
    """What a page of these numbers to quote gives another value, names raw, or leaves empty."""
    page = ReportPage(source)
    found, expected = [], {}
    for row in quote.to_dict("records"):
        for name in STATISTICS.values():
            value, half = rounded(row[name], row[f"{name}_pm"])
            with_half = f"{value} ± {half}" if half and name in ("mean", "sd") else value
            of_row = (as_text(quantity_words(row["quantity"])), STATES[row["state"]], row["density"])
            expected[(*of_row, name)] = "withheld" if row["basis"] == "withheld" else with_half
            key = f"{row['mu_iso']:g}/{row['state']}/{row['quantity']}/{name}"
            if page.quoted.get(key) != [expected[(*of_row, name)]]:
                found.append(f"{key}: {page.quoted.get(key)}, not {expected[(*of_row, name)]}")
    for table in page.tables:
        rows = [cells for cells in table.rows if cells]
        if not rows:
            found.append(f"empty table: {table.caption}")
        found += [f"raw heading {head!r} in {table.caption}" for head in table.heads if is_raw(head)]
        if not re.match(r"Table \d+\. \S", table.caption):
            found.append(f"no caption: {table.heads}")
        if {"Quantity", "State", "Density"} <= set(table.heads):
            found += _doubles(table, rows, expected)
        if "after consolidation" not in table.caption and not any(w in table.caption for w in OTHER_QUANTITIES):
            found += [f"± in {table.caption}: {cell}" for cells in rows for cell in cells if NUMBER.search(cell)]
    found += [f"± in a paragraph: {text}" for text in page.paragraphs if NUMBER.search(text)]
    found += [f"raw name {word!r}" for word in RAW.findall(" ".join(page.text))]
    return found


#: Names of the code, and phrases that the page must not have.
RAW = re.compile(
    r"(?<![\w.])(?:eta|mu_s|mu_iso|G_p|G_0|e_m|Z_m|D_p|Phi_dev|sigma_\w+|eps_\w+|I_G\w*|nan|inf|1 densities|1 points)"
    r"(?!\w)|@\w+:"
)


def is_raw(head: str) -> bool:
    """Whether a heading is the name of a column: an underscore, or a small letter first that is no word's."""
    return "_" in head or (head != "" and head[0].islower())


def _doubles(table: Table, rows: list[list[str]], expected: dict[tuple[str, ...], str]) -> list[str]:
    """Cells that give a quoted number another text."""
    at = {head: k for k, head in enumerate(table.heads)}
    found = []
    for cells in rows:
        of_row = tuple(cells[at[head]] for head in ("Quantity", "State", "Density"))
        for head in set(STATISTICS) & set(table.heads):
            kept = expected.get((*of_row, STATISTICS[head]))
            if kept is not None and cells[at[head]] != kept:
                found.append(f"{table.caption}: {of_row}, {head}: {cells[at[head]]}, not {kept}")
    return found
