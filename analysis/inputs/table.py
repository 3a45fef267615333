"""Tables of measured grain properties, read as people have them: what was understood is said, doubts are refused."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors_and_files import shown
from . import table_spreadsheet
from .cell_numbers import Marks, find_marks, looks_numeric, to_number, why_no_number
from .checks import InputError, check_set
from .column_names import (
    UNITS,
    FoundColumn,
    check_columns,
    check_mapping,
    check_unit,
    match,
    missing_symbols,
    plain,
    suggestions,
    unit_of,
)
from .table_text import COMMA, Grid, text_grids

POISSON_RATIO = 0.2
#: The header is sought in so many lines.
_HEAD = 10
#: Labels of lines that summarize the pairs above them.
_SUMMARIES = {"mean", "average", "avg", "median", "std", "std dev", "stdev", "sd", "standard deviation", "variance",
              "cov", "min", "max", "minimum", "maximum", "sum", "total", "count", "mittelwert", "mittel",
              "standardabweichung", "summe", "anzahl", "moyenne", "écart type", "ecart type", "media"}  # fmt: skip


@dataclass(frozen=True)
class InputTable:
    """Measured values of the grains' random properties.

    `names` are the symbols of the properties (d) in the order of `VARIABLES`, `values` (n, d) are in SI units, `lines`
    (n) are line or row numbers in the file, and `understood` is one line on how the file was read.
    """

    names: tuple[str, ...]
    values: np.ndarray
    lines: list[int]
    understood: str


def read_input_table(
    path: str | Path, nu: float = POISSON_RATIO, columns: Mapping[str, str] | None = None
) -> InputTable:
    """Read a table of measurements: text with `,`, `;` or tabs between cells, or a spreadsheet in `.xlsx`.

    A table has the columns mu_s and G_p_GPa or E_p_GPa (other units: MPa, Pa), with these names or with the names that
    `columns` gives, such as {"mu_s": "Friction coefficient", "G_p_MPa": "G (MPa)"}. Young's modulus E_p becomes
    G_p = E_p / (2 (1 + nu)) with `nu`, or with the value of the same line if the table has a column nu. Columns nu,
    sigma_ln, sigma_3_kPa and d50_mm are random properties, too; all others are ignored.

    Raises InputError with file, line and value for what cannot be read, for what can be read in two ways, for values
    that no grain can have, and for fewer than 10 lines or 5 distinct values of a property.
    """
    path, columns = Path(path), dict(columns or {})
    try:
        check_mapping(columns)
    except InputError as error:
        raise InputError(f"{path}: inputs.columns: {error}") from None
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    grids = table_spreadsheet.sheets(data, path) or text_grids(data, path)
    grid, top = _choose(grids, columns)
    header = [plain(_text(cell)) for cell in grid.cells(top)]
    found = match(header, columns)
    check_columns(grid.where(grid.lines[top][0]), found)
    below = ((grid.lines[k][0], grid.cells(k)) for k in range(top + 1, len(grid.lines)))
    rows = [(number, cells) for number, cells in below if any(cell != "" for cell in cells)]
    found, units_line = _with_units(grid, found, rows)
    rows = rows[1:] if units_line else rows
    _check_rows(grid, header, found, rows)
    used = [(number, [_cell(cells, column) for column in found]) for number, cells in rows]
    marks = find_marks(grid, [column.label for column in found], used)
    limits = [column.limits for column in found]
    values = np.empty((len(used), len(found)))
    for row, (number, cells) in enumerate(used):
        for k, (cell, (low, high)) in enumerate(zip(cells, limits, strict=True)):
            value = to_number(cell, marks)
            if value is None or not low <= value <= high:
                raise InputError(_refusal(grid, number, found[k], cell, value))
            values[row, k] = value
    _check_values(path, values, found)
    names = tuple(column.variable.symbol for column in found)
    if found[1].base == "E_p":
        values[:, 1] *= found[1].factor / (2.0 * (1.0 + (values[:, names.index("nu")] if "nu" in names else nu)))
    values *= [1.0 if column.base == "E_p" else column.factor for column in found]
    details = [
        str(marks),
        f"units {', '.join(column.unit for column in found if column.unit)}",
        f"header in {'row' if grid.sheet else 'line'} {grid.lines[top][0]}" if top else "",
        f"units in {'row' if grid.sheet else 'line'} {units_line}" if units_line else "",
        *grid.notes,
        *(f"{column.name} from {shown(column.header)!r}" for column in found if column.header != column.name),
        _conversion(found, nu),
    ]
    return InputTable(
        names, values, [number for number, _ in rows], _understood(grid, header, found, len(rows), details)
    )


def _choose(grids: Sequence[Grid], columns: Mapping[str, str]) -> tuple[Grid, int]:
    """The reading of a file whose header has all columns, and the index of the header's line.

    Raises InputError if there is none, or more than one.
    """
    fitting, others = [], []
    for grid in grids:
        for k in range(min(_HEAD, len(grid.lines))):
            try:
                cells = [_text(cell) for cell in grid.cells(k)]
            except InputError:
                continue  # raised again below if no other reading fits
            found = match(cells, columns)
            if not missing_symbols(found):
                fitting.append((grid, k))
                break
            others.append(((len(found), k == 0, sum(map(bool, cells))), grid, k))
    if len(fitting) > 1:
        said = " and ".join(grid.between or f"sheet {grid.sheet!r}" for grid, _ in fitting)
        raise InputError(f"{grids[0].path}: can be read in {len(fitting)} ways, with {said}; keep one of them")
    if fitting:
        grid, top = fitting[0]
        for k in range(top):
            if sum(map(looks_numeric, grid.cells(k))) > 1:
                header = grid.place(grid.lines[top][0])
                raise InputError(f"{grid.where(grid.lines[k][0])}: has numbers above the header in {header}")
        return grid, top
    if not others:
        grids[0].cells(0)  # raises the error
    _, grid, k = max(others, key=lambda entry: entry[0])
    raise InputError(_header_refusal(grid, k, columns))


def _header_refusal(grid: Grid, k: int, columns: Mapping[str, str]) -> str:
    """Why the line with index k is no header, with the columns found and what they may be."""
    cells = grid.cells(k)
    names = [name for name in (plain(_text(cell)) for cell in cells) if name]
    where, listed = grid.where(grid.lines[k][0]), shown(", ".join(names), 200)
    for key, wanted in columns.items():
        if plain(wanted) not in names:
            return f"{where}: has no column {shown(repr(wanted))}, which inputs.columns names for {key}; found {listed}"
    missing = missing_symbols(match(names, columns))
    hint = suggestions(names, missing)
    if names and all(looks_numeric(cell) for cell in cells if cell != ""):
        hint = "this line has numbers; the first line must have the names of the columns, without a # before them"
    elif len(names) == 1:
        hint = "put ',' or ';' or a tab between the cells"
    elif not hint:
        hint = 'say which columns they are in the section [inputs.columns], such as mu_s = "NAME"'
    if grid.notes:
        hint += f" (read as {', '.join(grid.notes)})"
    return f"{where}: needs the columns mu_s and G_p_GPa (or E_p_GPa); found {listed}; {hint}"


def _with_units(
    grid: Grid, found: list[FoundColumn], rows: list[tuple[int, list[str | float]]]
) -> tuple[list[FoundColumn], int]:
    """The columns with their units, and the number of the line below the header that has units, 0 if there is none."""
    line = 0
    if rows:
        number, cells = rows[0]
        units = [unit_of(_cell(cells, column)) for column in found]
        if None not in units and any(units):
            line = number
            for k, (column, unit) in enumerate(zip(found, units, strict=True)):
                if unit:
                    check_unit(grid.where(number), column, unit, "this line")
                    found[k] = replace(column, unit=unit)
        elif not any(looks_numeric(_cell(cells, column)) for column in found):
            for column, unit in zip(found, units, strict=True):
                text = _text(_cell(cells, column))
                if unit is None and to_number(text, Marks()) is None and not why_no_number(text):
                    known = ", ".join(unit for unit in UNITS[column.base] if unit) or "-"
                    raise InputError(
                        f"{grid.where(number)}: {column.label} = {shown(repr(text))} is not a number, nor a unit that "
                        f"is known ({known})"
                    )
    for column in found:
        if column.unit is None:
            names = " or ".join(f"{column.base}_{unit}" for unit in UNITS[column.base])
            raise InputError(f"{grid.path}: column {shown(column.header)} has no unit; call it {names}")
    return found, line


def _check_rows(
    grid: Grid, header: Sequence[str], found: Sequence[FoundColumn], rows: Sequence[tuple[int, list[str | float]]]
) -> None:
    """Refuse lines with more numbers than the header has names, and lines that summarize others."""
    width = max((k + 1 for k, name in enumerate(header) if name), default=0)
    used = {column.index for column in found}
    for number, cells in rows:
        if any(looks_numeric(cell) for cell in cells[width:]):
            raise InputError(f"{grid.where(number)}: {_too_many(grid, cells, width)}")
        for k, cell in enumerate(cells):
            if k not in used and plain(_text(cell)).casefold().strip(" .:") in _SUMMARIES:
                raise InputError(
                    f"{grid.where(number)}: {shown(repr(cell))} labels a line that summarizes pairs; delete it"
                )


def _too_many(grid: Grid, cells: Sequence[str | float], width: int) -> str:
    texts = [_text(cell) for cell in cells if cell != ""]
    count = f"{len(texts)} cells ({shown(' | '.join(texts))})"
    line = ",".join(texts)
    if grid.between == COMMA and ";" in line:
        return f"{shown(repr(line))} seems to have ';' between cells, and the header has ','; use one of them"
    if grid.between == COMMA:
        digits = len(texts) % 2 == 0 and all(text.isdigit() for text in texts)
        other = " | ".join(map(",".join, zip(texts[::2], texts[1::2], strict=True))) if digits else ""
        return (
            f"{shown(repr(line))} can be read in two ways: as {count}, of which the header names {width}, or as "
            f"numbers with a decimal comma{shown(f' ({other})') if other else ''}; put ';' between cells, or write "
            "decimal points"
        )
    return f"has {count}, but the header names {width} columns; give every column a name"


def _refusal(grid: Grid, number: int, column: FoundColumn, cell: str | float, value: float | None) -> str:
    """Why a cell holds no value within the limits of its variable."""
    text, what, (low, high) = _text(cell), f"{grid.where(number)}: {column.label}", column.limits
    if value is None:
        return f"{what} = {shown(repr(text))} is not a number{why_no_number(text)}"
    said, unit = shown(text), f" {column.unit}" if column.unit else ""
    if not math.isfinite(value):
        return f"{what} = {said} is not finite"
    if value <= 0.0 < low:
        comma = grid.between == COMMA and text == "0"
        ask = "; if a comma is the decimal mark, put ';' between the cells" if comma else ""
        return f"{what} = {said} must be positive{ask}"
    if value > high:
        return f"{what} = {said} exceeds {high:g}{unit}{_ask(column, 1.0)}"
    return f"{what} = {said} is below {low:g}{unit}{_ask(column, -1.0)}"


def _ask(column: FoundColumn, sign: float) -> str:
    """The smaller (sign 1) or larger (sign -1) units that a value beyond the limits may have."""
    own = sign * column.factor
    units = sorted((unit for unit, factor in UNITS[column.base].items() if sign * factor < own), key=len)
    return f" (is it in {' or '.join(units)}?)" if units else ""


def _check_values(path: Path, values: np.ndarray, found: Sequence[FoundColumn]) -> None:
    for column, name in zip(values.T, found, strict=True):
        if len(column) and name.base not in ("mu_s", "G_p", "E_p") and np.ptp(column) == 0.0:
            raise InputError(
                f"{path}: every {name.name} is {column[0]:g}, so it is not random; give it in the campaign file and "
                "take the column out, or give it another name"
            )
    check_set(path, values, [column.name for column in found])


def _understood(grid: Grid, header: Sequence[str], found: Sequence[FoundColumn], n: int, details: list[str]) -> str:
    """One line on how a file was read."""
    symbols = [column.variable.symbol for column in found]
    what = f"{n} pairs" if len(found) == 2 else f"{n} lines of {len(found)} properties ({', '.join(symbols)})"
    how = f"sheet {grid.sheet!r}" if grid.sheet else f"{grid.between} between cells"
    used = {column.index for column in found}
    others = [name for k, name in enumerate(header) if name and k not in used]
    parts = [part for part in (what, how, *details, *([f"not used: {'; '.join(others)}"] if others else [])) if part]
    return shown(f"{grid.path.name}: {', '.join(parts)}", 400)


def _conversion(found: Sequence[FoundColumn], nu: float) -> str:
    if found[1].base != "E_p":
        return ""
    own = any(column.base == "nu" for column in found)
    return f"G_p from E_p with {'nu of the same line' if own else f'nu = {nu:g}'}"


def _cell(cells: Sequence[str | float], column: FoundColumn) -> str | float:
    return cells[column.index] if column.index < len(cells) else ""


def _text(cell: str | float) -> str:
    return cell if isinstance(cell, str) else f"{cell:.15g}"
