"""The text of a table of measurements as lines of cells: encodings, separators, quotation marks and comments."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors_and_files import decoded, shown
from .checks import InputError

#: Character between cells -> how it is named.
SEPARATORS = {",": "','", ";": "';'", "\t": "a tab"}
COMMA = SEPARATORS[","]
#: The encoding that is taken where the bytes are not UTF-8; Latin-1 differs from it in control characters only.
_WESTERN = "Windows-1252"
#: Errors that spreadsheet programs write into cells: no comments.
_ERRORS = re.compile(r'"?#(N/A|NV|DIV/0|REF|BEZUG|VALUE|WERT|NUM|ZAHL|NAME|NULL)[!?]?"?\s*([,;\t]|$)')


@dataclass(frozen=True)
class Grid:
    """One reading of a file: numbered lines that are neither empty nor comments, and how a line becomes cells.

    A cell is a text or, from a spreadsheet, a number.  `between` is how the character between cells is named, "" in a
    spreadsheet; `notes` is what the reader should be told, such as the encoding.
    """

    path: Path
    lines: Sequence[tuple[int, Any]]
    split: Callable[[int, Any], list[str | float]]
    between: str = ""
    sheet: str = ""
    notes: tuple[str, ...] = ()

    def cells(self, k: int) -> list[str | float]:
        """Cells of the line with index k; texts have no blanks at their ends. Raises InputError for a bad quotation."""
        number, line = self.lines[k]
        return [cell.strip() if isinstance(cell, str) else cell for cell in self.split(number, line)]

    def place(self, number: int) -> str:
        """Name of the line with this number in the file, such as "line 3"."""
        return f"row {number} of sheet {self.sheet!r}" if self.sheet else f"line {number}"

    def where(self, number: int) -> str:
        """The file and the line, to begin a message with."""
        return f"{self.path}, {self.place(number)}"


def text_grids(data: bytes, path: Path) -> list[Grid]:
    """The readings of a text file, one per character that can separate its cells.

    Raises InputError for an empty file and for bytes that are no text.
    """
    text, encoding = _decoded(data, path)
    lines = list(enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1))
    separators = list(SEPARATORS)
    if lines[0][1].strip().lower() in {f"sep={separator}".strip() for separator in SEPARATORS}:  # Excel's first line
        separators = [lines[0][1][4:5] or "\t"]
        del lines[0]
    kept = [(number, line) for number, line in lines if line.strip(" ,;\t\v\f\"'") and not is_comment(line)]
    if not kept:
        raise InputError(f"{path}: is empty; expected a header with mu_s and G_p_GPa (or E_p_GPa)")
    notes = (encoding,) if encoding else ()

    def reading(separator: str) -> Grid:
        return Grid(path, kept, lambda number, line: _cells(path, number, line, separator), SEPARATORS[separator],
                    notes=notes)  # fmt: skip

    return [reading(separator) for separator in separators]


def is_comment(line: str) -> bool:
    """Whether a line is a comment; a spreadsheet puts a comment that contains a separator between quotation marks."""
    return line.startswith(("#", '"#')) and not _ERRORS.match(line)


def _decoded(data: bytes, path: Path) -> tuple[str, str]:
    """The text, and the name of its encoding if it is not UTF-8."""
    encoding = _utf16(data)
    try:
        if encoding:
            text, name = data.decode(encoding).removeprefix("\ufeff"), "UTF-16"
        else:
            text, name = data.decode("utf-8-sig"), ""
    except UnicodeDecodeError as failure:
        if encoding:
            raise InputError(
                f"{path}: begins as a text in UTF-16, but its bytes from {failure.start + 1:,} on are none; "
                "save it as UTF-8"
            ) from None
        try:
            text, name = data.decode("cp1252"), _WESTERN
        except UnicodeDecodeError:
            text, name = decoded(data, path, InputError), ""  # raises the error that names the line and the byte
    if "\0" in text or (re.search("[^\\s,;\"']", text) and not re.search("[A-Za-z0-9]", text)):
        raise InputError(f"{path}: seems to be no text; save the table as CSV in UTF-8")
    return text, name


def _utf16(data: bytes) -> str:
    """The byte order of a text in UTF-16, by its mark or by the zeros of its ASCII characters; "" for another text."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16-le" if data[0] == 0xFF else "utf-16-be"
    even, odd = (data[k:4000:2].count(0) / max(1, len(data[k:4000:2])) for k in (0, 1))
    if max(even, odd) > 0.4 and min(even, odd) < 0.1:
        return "utf-16-le" if odd > even else "utf-16-be"
    return ""


def _cells(path: Path, number: int, line: str, separator: str) -> list[str | float]:
    """The cells of one line; a quoted cell must end in its line."""
    try:
        return list(next(csv.reader([line], delimiter=separator, strict=True)))
    except csv.Error as error:
        if "field limit" in str(error):
            raise InputError(
                f"{path}, line {number}: a cell has more than {csv.field_size_limit():,} characters"
            ) from None
        raise InputError(
            f"{path}, line {number}: a quoted cell does not end in this line ({shown(str(error))}); a cell must have "
            f"no line break, and text after a closing quote must start with {SEPARATORS[separator]}"
        ) from None
