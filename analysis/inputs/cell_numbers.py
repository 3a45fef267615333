"""Numbers in the cells of a table: what point and comma mean, and why a cell is no number.

A mark is a decimal mark in `0,25`, `29,1` and `1.234,5`, and stands between thousands in `1.234.567` and `1.234,5`.  In
`1,234` it can be either.  Such a cell is read if other cells of the table show what the mark means, and refused if not.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors_and_files import shown
from .checks import InputError
from .table_text import COMMA, Grid

#: A number: ASCII digits, a decimal point, an exponent; and the words that are reported as not finite.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.ASCII | re.IGNORECASE)
#: Digits with points and commas, and an exponent.
_MARKED = re.compile(r"[+-]?([\d.,]*\d[\d.,]*)([eE][+-]?\d+)?", re.ASCII)
#: Digits in groups of three with a no-break, narrow or thin space or an apostrophe between them.
_SPACED = re.compile("[+-]?[0-9]{1,3}([\u00a0\u202f\u2009'\u2019][0-9]{3})+([.,][0-9]*)?")
_MARK_NAMES = {".": "point", ",": "comma"}
_SCOPE = "the tool uses single measured values, and no truncated, censored or interval values"
_SOME = r"[+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?"
_MONTH = r"(?:jan|feb|mar|mär|apr|ma[iy]|jun|jul|aug|sep|o[ck]t|nov|de[cz])[a-z]*\.?"
#: Form of a cell that is no number -> what it is.
_FORMS: tuple[tuple[str, str], ...] = tuple(
    (form, f"it is {what}; {_SCOPE}")
    for form, what in (
        (rf"(?:[<>≤≥]=?|less than|more than|under|over|max\.?|min\.?)\s*{_SOME}.*|{_SOME}\s*\+", "a limit"),
        (rf"(?:[~≈]|ca\.?|approx\.?|about)\s*{_SOME}.*", "an approximate value"),
        (rf"{_SOME}\s*[*†‡§#]+", "a value with a mark"),
        (rf"{_SOME}\s*(?:±|\+/-|\+-)\s*{_SOME}.*|{_SOME}\s*\(\s*±?{_SOME}\s*\)", "a value with its error"),
        (rf"[\[(]?\s*{_SOME}\s*(?:-|–|—|\.\.+|…|to|bis|and|/|;)\s*{_SOME}\s*[\])]?", "an interval"),
        (r"n\.?\s?[da]\.?|n/a|k\.?\s?a\.?|[-–—?./]+|none|null|missing|[<>]?\s?(?:LO[DQ]|BDL|DL)|#\S+[!?]?",
         "no measured value"),
    )
) + (
    (r"=.*", "it is a formula without a stored value; open the workbook in a spreadsheet program and save it"),
    (rf"\d{{4}}-\d\d-\d\d.*|\d\d?[./]\d\d?[./]\d{{2,4}}|\d\d?[. -]+{_MONTH}|{_MONTH}[. -]+\d\d?",
     "it is a date; a spreadsheet program may have changed the number that was typed"),
    (rf"{_SOME}\s*(?:[a-zA-Zµμ%°][^\d]*[\d²]?)", "a unit belongs in the header or in a row below it"),
)  # fmt: skip
_FORMS_COMPILED = tuple((re.compile(form, re.IGNORECASE), text) for form, text in _FORMS)


#: Uses of marks of which one file can have one only.
_CONTRADICTIONS = (
    ((",", "decimal"), (".", "decimal")),
    ((",", "decimal"), (",", "thousands")),
    ((".", "decimal"), (".", "thousands")),
    ((",", "thousands"), (".", "thousands")),
)


@dataclass(frozen=True)
class Marks:
    """What point and comma mean in a table; "" where no cell shows it."""

    decimal: str = ""
    thousands: str = ""

    def __str__(self) -> str:
        said = [f"decimal {_MARK_NAMES[self.decimal]}"] if self.decimal else []
        return ", ".join(said + ([f"a {_MARK_NAMES[self.thousands]} between thousands"] if self.thousands else []))


def find_marks(grid: Grid, labels: Sequence[str], rows: Sequence[tuple[int, Sequence[str | float]]]) -> Marks:
    """What point and comma mean in the cells of a table: rows with their numbers, whose columns have these labels.

    If commas separate the cells, a point is a decimal mark unless cells show something else. Raises InputError with
    both readings if the cells contradict each other, or if a cell has two.
    """
    source = grid.path
    texts = [(number, k, text) for number, cells in rows for k, cell in enumerate(cells) if isinstance(cell, str)
             if "." in (text := _without_spaces(cell)) or "," in text]  # fmt: skip
    seen: dict[tuple[str, str], tuple[str, str]] = {}
    for number, k, text in texts:
        for use in _uses(text) or []:
            if use not in seen:
                seen[use] = (f"{grid.place(number)}: {labels[k]}", text)
    for first, second in _CONTRADICTIONS:
        if first in seen and second in seen:
            (place, text), (other, another) = seen[first], seen[second]
            raise InputError(
                f"{source}, {place} = {shown(text)!r} has {_use(*first)}, but {other} = {shown(another)!r} has "
                f"{_use(*second)}; write all numbers in one way"
            )
    decimal = next((mark for mark in ".," if (mark, "decimal") in seen), "")
    thousands = next((mark for mark in ".," if (mark, "thousands") in seen), "")
    if not decimal and thousands:
        decimal = "," if thousands == "." else "."
    if not decimal and grid.between == COMMA and not any("," in text for _, _, text in texts):
        decimal = "."
    for number, k, text in texts:
        mark = _open(text)
        if mark and mark not in (decimal, thousands):
            place = f"{grid.place(number)}: {labels[k]}"
            whole, decimals = text.replace(mark, ""), text.replace(mark, ".")
            raise InputError(
                f"{source}, {place} = {shown(text)!r} can be read in two ways: as {whole} ({_use(mark, 'thousands')}) "
                f"or as {decimals} ({_use(mark, 'decimal')}); write the one that is meant"
            )
    return Marks(decimal if texts else "", thousands)


def to_number(cell: str | float, marks: Marks) -> float | None:
    """The value of a cell, which may be not finite; None if the cell is no number."""
    if isinstance(cell, float):
        return cell
    text = _without_spaces(cell)
    if "," in text or marks.thousands:
        if _uses(text) is None:
            return None
        text = text.replace(marks.thousands, "") if marks.thousands else text
        text = text.replace(",", ".") if marks.decimal == "," else text
    return float(text) if _NUMBER.fullmatch(text) else None


def why_no_number(cell: str) -> str:
    """What a cell that is no number seems to be, as the end of a sentence; "" if nothing can be said of it."""
    for form, text in _FORMS_COMPILED:
        if form.fullmatch(cell[:200]):
            return f": {text}"
    return ""


def looks_numeric(cell: str | float) -> bool:
    """Whether a cell is a number in one of the usual forms."""
    return isinstance(cell, float) or bool(_MARKED.fullmatch(_without_spaces(cell)))


def _uses(text: str) -> list[tuple[str, str]] | None:
    """Marks of a text with what they must be there, "decimal" or "thousands"; None if they fit no number."""
    found = _MARKED.fullmatch(text)
    if not found:
        return []
    body, exponent = found[1], found[2]
    marks = re.sub(r"\d", "", body)
    if not marks or _open(text):
        return []
    if len(marks) == 1:
        return [(marks, "decimal")]
    last, other = marks[-1], marks[0]
    whole, fraction = body.rsplit(last, 1) if last != other else (body, "")
    groups = rf"[1-9]\d{{0,2}}(?:{re.escape(other)}\d{{3}})+"
    if len(set(marks[:-1])) > 1 or not re.fullmatch(groups, whole) or (last == other and exponent):
        return None
    return [(other, "thousands"), *([(last, "decimal")] if last != other else [])]


def _open(text: str) -> str:
    """The only mark of a text such as "1,234", which can be a decimal mark or stand between thousands; "" if none."""
    found = re.fullmatch(r"[+-]?[1-9]\d{0,2}([.,])\d{3}", text, re.ASCII)
    return found[1] if found else ""


def _without_spaces(cell: str | float) -> str:
    """A text without the spaces or apostrophes between its thousands."""
    text = str(cell)
    return re.sub("[\u00a0\u202f\u2009'\u2019]", "", text) if _SPACED.fullmatch(text) else text


def _use(mark: str, use: str) -> str:
    name = _MARK_NAMES[mark]
    return f"a decimal {name}" if use == "decimal" else f"a {name} between thousands"
