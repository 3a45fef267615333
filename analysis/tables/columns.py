"""Column names of the tables: one symbol and one unit per quantity, `_low` and `_high` for the ends of intervals.

`quantity` always holds a symbol of analysis/quantities.py and `unit` the unit of the row's numbers, so that any two
tables can be joined on them.
"""

from __future__ import annotations

from ..quantities import QUANTITIES

#: Quantiles that the tables give, and their columns.
QUANTILES = {"q05": 0.05, "q50": 0.5, "q95": 0.95}


def unit(symbol: str) -> str:
    """The displayed unit of a quantity, "1" for a number."""
    quantity = QUANTITIES[symbol]
    return quantity.shown_unit or quantity.unit


def named(symbol: str) -> dict[str, str]:
    """The columns `quantity` and `unit` of one row."""
    return {"quantity": symbol, "unit": unit(symbol)}


def with_interval(name: str) -> tuple[str, str, str]:
    """The columns of a number and of the ends of its interval."""
    return name, f"{name}_low", f"{name}_high"
