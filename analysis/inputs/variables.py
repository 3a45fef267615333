"""The input variables of a specimen that can be random: names, units and limits, each stated once."""

from __future__ import annotations

from dataclasses import dataclass

from ..quantities import INPUTS, Quantity


@dataclass(frozen=True)
class InputVariable:
    """One input variable; `symbol` is its name in `quantities.INPUTS`, and values of the analysis are in SI units.

    `column` is its name in a table of measurements and in the section [variables] of a campaign file, with the unit;
    `factor` converts a value of this column to SI units.  `low` and `high` are the limits of one value in the unit of
    the column: a value outside is an error of typing or of the unit.
    """

    symbol: str
    column: str
    factor: float
    low: float
    high: float

    @property
    def quantity(self) -> Quantity:
        """Name, unit and sign of the variable."""
        return INPUTS[self.symbol]

    @property
    def unit(self) -> str:
        """The unit of the column, "" for a pure number."""
        return self.column.removeprefix(self.symbol).lstrip("_")


#: All input variables by symbol, in the order of the columns of a set of points.
VARIABLES: dict[str, InputVariable] = {
    variable.symbol: variable
    for variable in (
        InputVariable("mu_s", "mu_s", 1.0, 1e-4, 5.0),
        InputVariable("G_p", "G_p_GPa", 1e9, 1e-6, 1000.0),
        InputVariable("nu", "nu", 1.0, 0.0, 0.49),
        InputVariable("sigma_ln", "sigma_ln", 1.0, 0.0, 1.0),
        InputVariable("sigma_3", "sigma_3_kPa", 1e3, 1.0, 1e4),
        InputVariable("d50", "d50_mm", 1e-3, 1e-3, 100.0),
    )
}
#: The variables that every specimen needs; the others have a value in the campaign file.
NEEDED = ("mu_s", "G_p")
