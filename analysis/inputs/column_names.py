"""The columns of a table of measurements: the names and units that are known, and what other names may mean."""

from __future__ import annotations

import difflib
import json
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..errors_and_files import shown
from .checks import InputError
from .variables import NEEDED, VARIABLES, InputVariable

#: Quantity of a column -> its units with their factors to SI units.  E_p is Young's modulus; it stands for G_p.
UNITS: dict[str, dict[str, float]] = {
    "mu_s": {"": 1.0},
    "G_p": {"GPa": 1e9, "MPa": 1e6, "Pa": 1.0},
    "E_p": {"GPa": 1e9, "MPa": 1e6, "Pa": 1.0},
    "nu": {"": 1.0},
    "sigma_ln": {"": 1.0},
    "sigma_3": {"kPa": 1e3, "MPa": 1e6, "Pa": 1.0},
    "d50": {"mm": 1e-3, "um": 1e-6, "m": 1.0},
}
#: Names of the project for the columns of a table, and keys of the section [inputs.columns] of a campaign file.
COLUMN_NAMES = tuple(f"{base}_{unit}" if unit else base for base, units in UNITS.items() for unit in units)
#: Other spellings of units.
_SPELLINGS = {
    "Pa": ("N/m2", "N/m^2"), "kPa": ("kN/m2", "kN/m^2", "KPa"), "MPa": ("N/mm2", "N/mm^2", "MN/m2", "Mpa", "MPA"),
    "GPa": ("kN/mm2", "kN/mm^2", "GN/m2", "Gpa", "GPA", "gpa"), "um": ("μm", "micron", "microns"), "mm": (), "m": (),
    "%": ("percent", "per cent", "Prozent"), "degrees": ("°", "deg", "degree", "grad", "Grad"), "rad": (),
    "psi": (), "ksi": (), "bar": (), "TPa": (), "hPa": (), "mPa": ("mpa",), "cm": (), "nm": (),
    "": ("-", "–", "—", "1", "none", "dimensionless", "dimensionslos"),
}  # fmt: skip
_STANDARD = {spelling: unit for unit, others in _SPELLINGS.items() for spelling in (unit, *others)}
#: Units that a name such as "G / MPa" may contain without brackets, for a modulus or a stress, a length, a pure number.
_STRESSES = ("Pa", "hPa", "kPa", "MPa", "GPa", "TPa", "mPa", "psi", "ksi")
_KINDS = {"": ("%", "degrees"), "GPa": _STRESSES, "kPa": _STRESSES, "mm": ("um", "mm", "cm", "nm")}
_BRACKETS = re.compile(r"(.*?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]")
#: Words in the name of a column -> what it may be; the first that fits.
_MEANINGS = (
    (r"(?i:friction|reibung|frott|fricci|attrito|^(mu|μ)([ _.\[(-]|s|$))", "mu_s"),
    (r"(?i:young|elasti[cz]|e-?modul)|^E([ _.,/\[(-]|p|$)", "E_p"),
    (r"(?i:shear mod|schubmod|cisaillement)|^G([ _.,/\[(-]|p|$)", "G_p"),
    (r"(?i:modul|stiff|steif|rigid)", "modulus"),
)
_ANGLE = re.compile(r"(?i:angle|winkel|°|\bdeg)")


@dataclass(frozen=True)
class FoundColumn:
    """One column that is used: its place in a line, its header, the quantity, and the unit, None if not known yet."""

    index: int
    header: str
    base: str
    unit: str | None

    @property
    def variable(self) -> InputVariable:
        """The variable that the column is, or stands for."""
        return VARIABLES["G_p" if self.base == "E_p" else self.base]

    @property
    def name(self) -> str:
        """The project's name of the column, with the unit."""
        return f"{self.base}_{self.unit}" if self.unit else self.base

    @property
    def label(self) -> str:
        """How messages name the column."""
        same = self.header in (self.name, self.base)
        return self.name if same else f"{self.name} (column {shown(self.header)!r})"

    @property
    def factor(self) -> float:
        """Factor to SI units."""
        return UNITS[self.base][self.unit or ""]

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of one value in the unit of the column."""
        ratio = self.variable.factor / self.factor
        return self.variable.low * ratio, self.variable.high * ratio


def check_mapping(columns: Mapping[str, str]) -> None:
    """Raise InputError if a mapping from project's names to the names in a table cannot be meant."""
    seen: dict[str, str] = {}
    for key, header in columns.items():
        if key not in COLUMN_NAMES:
            near = difflib.get_close_matches(key[:60], COLUMN_NAMES, 3, 0.6)
            hint = f"; did you mean {' or '.join(near)}?" if near else f"; known: {', '.join(COLUMN_NAMES)}"
            raise InputError(f"unknown key {shown(key)}{hint}")
        if not isinstance(header, str) or not plain(header):
            raise InputError(f"{key} = {shown(repr(header))} must be the name of a column of the table, in quotes")
        symbol = _symbol(_split_name(key)[0])
        if symbol in seen:
            raise InputError(f"{seen[symbol]} and {key} both name a column for {symbol}; keep one")
        seen[symbol] = key
        if twin := next((k for k, name in columns.items() if k != key and plain(str(name)) == plain(header)), None):
            raise InputError(f"{key} and {twin} name the same column, {shown(repr(header))}")


def match(header: Sequence[str], columns: Mapping[str, str]) -> list[FoundColumn]:
    """The columns of a header that have names of the project or are named in `columns`; several may be one variable.

    A variable that is named in `columns` has no other column.
    """
    names = [plain(name) for name in header]
    mapped = [
        FoundColumn(index, name, base, unit)
        for key, wanted in columns.items()
        for base, unit in [_split_name(key)]
        for index, name in enumerate(names)
        if name == plain(wanted)
    ]
    named = {_symbol(_split_name(key)[0]) for key in columns}
    found = [(index, name, _own_name(name)) for index, name in enumerate(names)]
    own = [FoundColumn(index, name, *parts) for index, name, parts in found if parts and _symbol(parts[0]) not in named]
    return sorted(mapped + own, key=lambda column: list(VARIABLES).index(column.variable.symbol))


def check_columns(where: str, found: Sequence[FoundColumn]) -> None:
    """Raise InputError if a variable has two columns, or if the unit in a header contradicts the name of the column."""
    for symbol in VARIABLES:
        same = [column for column in found if column.variable.symbol == symbol]
        if len({column.header for column in same}) < len(same):
            raise InputError(f"{where}: column {shown(same[0].header)} appears more than once")
        if len(same) > 1:
            raise InputError(
                f"{where}: has both {shown(same[0].header)} and {shown(same[1].header)}; keep one, or name the one "
                f"that is meant in [inputs.columns], so that {_kind(symbol)} is unambiguous"
            )
    for column in found:
        units = units_in(column.header, column.base)
        if units and column.unit not in units:
            check_unit(where, column, units[0], "its header")


def check_unit(where: str, column: FoundColumn, unit: str, source: str) -> None:
    """Raise InputError if a unit of a column is not the one of its name, or is none that its quantity can have."""
    if column.unit is None and unit not in UNITS[column.base]:
        raise InputError(
            f"{where}: {column.label} has the unit {shown(repr(unit))} in {source}; "
            f"use one of {', '.join(UNITS[column.base])}"
        )
    if column.unit is not None and unit != column.unit:
        own = f"says {column.unit}" if column.unit else "has no unit"
        ask = ": mu_s is a coefficient, the tangent of the angle of friction" if unit in ("degrees", "rad") else ""
        raise InputError(f"{where}: {column.label} {own}, but {source} says {unit or 'that it has no unit'}{ask}")


def unit_of(cell: str | float) -> str | None:
    """The standard name of the unit that a cell consists of, "" for none; None if it is no unit."""
    text = plain(str(cell)) if isinstance(cell, str) else ""
    return _STANDARD.get(text.removeprefix("[").removeprefix("(").removesuffix("]").removesuffix(")").strip())


def units_in(header: str, base: str) -> list[str]:
    """The units that the name of a column contains and that its quantity might have; "" is that of a pure number."""
    brackets = _BRACKETS.fullmatch(header)
    if brackets and brackets[2] in _STANDARD:
        return [_STANDARD[brackets[2]]]
    kinds = _KINDS[next(iter(UNITS[base]))]
    words = sorted((word for word, unit in _STANDARD.items() if unit in kinds), key=len, reverse=True)
    signs = rf"(?<![^\W_])({'|'.join(map(re.escape, words))})(?![^\W_])"
    return [_STANDARD[word] for word in re.findall(signs, header)]


def plain(name: str) -> str:
    """A name in one form of Unicode, with single blanks and without invisible characters."""
    text = unicodedata.normalize("NFKC", name)
    return " ".join("".join(c for c in text if unicodedata.category(c) != "Cf").split())


def suggestions(header: Sequence[str], missing: Sequence[str]) -> str:
    """Which columns may be those that are missing (symbols of variables), and how to say so."""
    said, names = [], [plain(name) for name in header]
    for symbol in missing:
        bases = ("G_p", "E_p", "modulus") if symbol == "G_p" else (symbol,)
        near = [(name, base) for name in names for base in [_meaning(name)] if base in bases]
        if near:
            said.append(_suggestion(symbol, *near[0], [name for name, _ in near[1:3]]))
        elif symbol == "mu_s" and (angles := [name for name in names if _ANGLE.search(name)]):
            said.append(f"{shown(repr(angles[0]))} seems to be an angle; mu_s is its tangent")
    return "; ".join(said)


def _suggestion(symbol: str, name: str, base: str, others: Sequence[str]) -> str:
    """What one column may be, and how to say so; `base` "modulus": a modulus of either kind."""
    unit = next((unit for unit in units_in(name, symbol) if unit in UNITS[symbol]), None)
    units = list(UNITS[symbol]) if unit is None else [unit]
    bases = ("G_p", "E_p") if base == "modulus" else (base,)
    keys = [f"{base}_{unit}" if unit else base for base in bases for unit in units]
    also = f" (or {' or '.join(shown(repr(other)) for other in others)})" if others else ""
    line = f"{keys[0]} = {json.dumps(name[:80], ensure_ascii=False)}"
    return f"{shown(repr(name))}{also} may be {' or '.join(keys)}: say so with [inputs.columns] {line}"


def _meaning(name: str) -> str:
    """What a column may be by its name; "" if nothing points to a variable."""
    if _ANGLE.search(name):
        return ""
    for words, base in _MEANINGS:
        if re.search(words, name):
            return base
    near = difflib.get_close_matches(name.casefold()[:60], [known.casefold() for known in COLUMN_NAMES], 1, 0.75)
    return next((_split_name(known)[0] for known in COLUMN_NAMES if near and known.casefold() == near[0]), "")


def _own_name(name: str) -> tuple[str, str | None] | None:
    """Quantity and unit of a column with a name of the project; the unit is None if the header does not state it."""
    if name in COLUMN_NAMES:
        return _split_name(name)
    brackets = _BRACKETS.fullmatch(name)
    base = brackets[1] if brackets else name
    if base in COLUMN_NAMES:  # as in "mu_s (-)"; check_columns compares the units
        return _split_name(base)
    if base not in UNITS:
        return None
    unit = _STANDARD.get(brackets[2]) if brackets else None
    return base, unit if unit in UNITS[base] else None


def _split_name(key: str) -> tuple[str, str]:
    """Quantity and unit of a name of the project."""
    return next((base, unit) for base, units in UNITS.items() for unit in units
                if key == (f"{base}_{unit}" if unit else base))  # fmt: skip


def _symbol(base: str) -> str:
    return "G_p" if base == "E_p" else base


def _kind(symbol: str) -> str:
    return "the modulus" if symbol == "G_p" else symbol


def missing_symbols(found: Sequence[FoundColumn]) -> list[str]:
    """The variables that every table must have and that have no column here."""
    present = {column.variable.symbol for column in found}
    return [symbol for symbol in NEEDED if symbol not in present]
