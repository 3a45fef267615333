"""The section [variables] of a campaign file: every property as a constant or as a distribution with stated figures."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..errors_and_files import shown
from .family import MarginalError
from .family_figures import from_figures
from .figures_stated import PARENT, STATED, is_number, is_pure
from .marginal_families import family_of
from .marginals import Marginal
from .variables import VARIABLES, InputVariable

_UNITS = {
    "G_p": {"Pa": 1.0, "MPa": 1e6, "GPa": 1e9},
    "E_p": {"Pa": 1.0, "MPa": 1e6, "GPa": 1e9},
    "sigma_3": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6},
    "d50": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
}
#: Probability of values that a property cannot have: what is mentioned, and what is refused.
MENTIONED, LARGEST_OUTSIDE = 1e-6, 0.01


@dataclass(frozen=True)
class StatedColumn:
    """What a key such as `G_p_GPa` stands for: symbol, unit ("" for SI), factor to SI units, whether it is E."""

    symbol: str
    unit: str
    factor: float
    youngs: bool = False


def stated_column(key: str) -> StatedColumn | None:
    """The variable of a key: its symbol alone (SI units) or with a unit, as in `G_p_MPa`; None for another key."""
    for quantity, units in _UNITS.items():
        symbol, youngs = ("G_p", True) if quantity == "E_p" else (quantity, False)
        if key == quantity:
            return StatedColumn(symbol, "", 1.0, youngs)
        unit = key.removeprefix(f"{quantity}_")
        if unit != key and unit in units:
            return StatedColumn(symbol, unit, units[unit], youngs)
    return StatedColumn(key, "", 1.0) if key in VARIABLES else None


def read_variable(key: str, section: Any, column: StatedColumn, nu: float | None) -> tuple[Marginal | float, list[str]]:
    """The distribution of a variable in SI units, or its value if it is a constant; and sentences on doubtful values.

    nu: Poisson's ratio, with which Young's modulus E_p becomes G_p = E_p / (2 (1 + nu)).  Raises MarginalError, in one
    line with key, value and limit.
    """
    try:
        return _read(section, column, nu)
    except MarginalError as error:
        raise MarginalError(f"variables.{key}: {error}") from None


def _read(section: Any, column: StatedColumn, nu: float | None) -> tuple[Marginal | float, list[str]]:
    if not isinstance(section, Mapping):
        raise MarginalError(
            f"{shown(repr(section))} must be a section with a family and its figures, or with value = ..."
        )
    variable = VARIABLES[column.symbol]
    factor = column.factor
    if column.youngs:
        if nu is None:
            raise MarginalError("E_p needs a constant nu, and nu is random; state G_p")
        factor /= 2.0 * (1.0 + nu)
    limits = (variable.low * variable.factor / factor, variable.high * variable.factor / factor)
    figures = {name: value for name, value in section.items() if name != "family"}
    family = section.get("family", "constant" if "value" in section else None)
    if family == "constant" or "value" in section:
        return _constant(family, figures, limits, column) * factor, []
    if family not in STATED:
        raise MarginalError(_unknown_family(family))
    if family in PARENT:
        figures = dict(zip(("low", "high"), limits, strict=True)) | figures
    found = from_figures(family, figures)
    return _scaled(found, factor), _outside(found, limits, column, variable)


def _constant(family: Any, figures: dict[str, Any], limits: tuple[float, float], column: StatedColumn) -> float:
    if family != "constant":
        raise MarginalError(f"value = {figures['value']!r} is for a constant, not for the family {family!r}")
    if unknown := [name for name in figures if name != "value"]:
        raise MarginalError(f"a constant has no {unknown[0]}; it has the key value only")
    value = figures.get("value")
    if value is None:
        raise MarginalError("a constant needs the key value")
    if not is_number(value):
        raise MarginalError(f"value = {shown(repr(value))} must be a number")
    if not limits[0] <= value <= limits[1]:
        raise MarginalError(f"value = {value:g} is outside [{limits[0]:g}, {limits[1]:g}]{_unit(column)}")
    return float(value)


def _unknown_family(family: Any) -> str:
    known = (*STATED, "constant")
    if family is None:
        return f"the key family is missing; known: {', '.join(known)}"
    near = difflib.get_close_matches(str(family).lower()[:60], known, 1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"unknown family {str(family)[:60]!r}; known: {', '.join(known)}{hint}"


def _scaled(marginal: Marginal, factor: float) -> Marginal:
    params = {name: value if is_pure(name) else value * factor for name, value in marginal.params.items()}
    return Marginal(marginal.family, {name: params[name] for name in family_of(marginal.family).names})


def _outside(
    marginal: Marginal, limits: tuple[float, float], column: StatedColumn, variable: InputVariable
) -> list[str]:
    """Sentences on the probability of values that no grain has; raises MarginalError if it is large."""
    texts = []
    if not limits[0] <= (median := float(marginal.ppf(0.5))) <= limits[1]:
        raise MarginalError(
            f"the median {median:.4g}{_unit(column)} is outside [{limits[0]:g}, {limits[1]:g}], the limits of "
            f"{variable.symbol}; is the unit right?"
        )
    sides = ((float(marginal.cdf(limits[0])), "below", limits[0]), (float(marginal.sf(limits[1])), "above", limits[1]))
    for share, side, limit in sides:
        text = f"{share:.2g} of the probability lies {side} {limit:g}{_unit(column)}, the limit of {variable.symbol}"
        if share > LARGEST_OUTSIDE:
            raise MarginalError(f"{text}; allowed: {LARGEST_OUTSIDE:g}")
        if share > MENTIONED:
            truncated = "; a truncated family has no such values" if marginal.family not in PARENT else ""
            texts.append(f"{column.symbol}: {text}{truncated}")
    return texts


def _unit(column: StatedColumn) -> str:
    return f" {column.unit}" if column.unit else ""
