"""The sheets of a workbook in .xlsx, read with openpyxl where it is installed; other formats are named and refused."""

from __future__ import annotations

import datetime
import io
import warnings
import zipfile
from pathlib import Path
from typing import Any

from ..errors_and_files import one_line, shown
from .checks import InputError
from .table_text import Grid, is_comment

#: Unpacked, a table of measurements has fewer bytes.
_LARGEST = 200_000_000
#: First bytes of files that hold a table, or seem to, and cannot be read -> what they are.
_OTHERS = (
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "a workbook in .xls, or one with a password"),
    (b"%PDF", "a PDF file"),
    (b"\x1f\x8b", "a compressed file (gzip)"),
    (b"{\\rtf", "a text document (RTF)"),
    (b"<", "HTML or XML, perhaps with the name of a spreadsheet"),
)
_INSTEAD = "save the table as CSV in UTF-8 or as .xlsx"


def sheets(data: bytes, path: Path) -> list[Grid]:
    """The sheets of a workbook that are not empty; an empty list for a file that is no workbook.

    Raises InputError for a workbook that cannot be read, for one in .xlsx without openpyxl, and for another format.
    """
    head = data[:512].removeprefix(b"\xef\xbb\xbf").lstrip()
    for start, what in _OTHERS:
        if head.startswith(start):
            raise InputError(f"{path}: is {what}; {_INSTEAD}")
    if not data.startswith(b"PK\x03\x04"):
        return []
    _check_archive(data, path)
    try:
        import openpyxl
    except ImportError:
        raise InputError(
            f"{path}: is a workbook; to read it, install openpyxl (in Debian python3-openpyxl), or save the sheet as "
            "CSV in UTF-8"
        ) from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of drawings, styles and rules of input that play no part here
            values = openpyxl.load_workbook(io.BytesIO(data), data_only=True)
            formulas = openpyxl.load_workbook(io.BytesIO(data))
            grids = [_grid(sheet, formulas[sheet.title], path) for sheet in values.worksheets]
    except Exception as error:  # openpyxl raises errors of many types for a damaged workbook
        raise InputError(f"{path}: cannot be read as a workbook ({shown(one_line(error), 120)})") from None
    grids = [grid for grid in grids if grid.lines]
    if not grids:
        raise InputError(f"{path}: is empty; expected a header with mu_s and G_p_GPa (or E_p_GPa)")
    return grids


def _check_archive(data: bytes, path: Path) -> None:
    """Raise InputError if an archive is not a workbook in .xlsx, or is far larger unpacked than a table can be."""
    try:
        members = {member.filename: member.file_size for member in zipfile.ZipFile(io.BytesIO(data)).infolist()}
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise InputError(f"{path}: cannot be read as a workbook ({shown(one_line(error), 120)})") from None
    if sum(members.values()) > _LARGEST:
        size = sum(members.values())
        raise InputError(f"{path}: has {size:,} bytes unpacked, at most {_LARGEST:,}; {_INSTEAD}")
    if "xl/workbook.xml" not in members:
        what = "a workbook in .xlsb" if "xl/workbook.bin" in members else "an archive"
        what = "a document in .ods or another OpenDocument format" if "mimetype" in members else what
        raise InputError(f"{path}: is {what}; {_INSTEAD}")


def _grid(sheet: Any, formulas: Any, path: Path) -> Grid:
    """The cells of a sheet; a formula without a stored value stands as its text."""
    lines = []
    for row, origin in zip(sheet.iter_rows(), formulas.iter_rows(), strict=True):
        cells = [_cell(value.value, formula) for value, formula in zip(row, origin, strict=True)]
        if any(cell != "" for cell in cells) and not is_comment(str(cells[0])):
            lines.append((row[0].row, cells))
    hidden = sum(bool(sheet.row_dimensions[number].hidden) for number, _ in lines)
    notes = (f"hidden rows included: {hidden}",) if hidden else ()
    return Grid(path, lines, lambda _, cells: cells, sheet=sheet.title, notes=notes)


def _cell(value: Any, formula: Any) -> str | float:
    if value is None:
        return str(formula.value) if formula.data_type == "f" else ""
    if isinstance(value, bool):
        return str(value).upper()
    if isinstance(value, (int, float)):
        return float(value)
    return value.isoformat() if isinstance(value, (datetime.date, datetime.time)) else str(value).strip()
