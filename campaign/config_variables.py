"""The sections [variables] and [dependence] of a campaign file: stated distributions in place of measured pairs.

    [variables.mu_s]           # every property as a distribution (family and figures) or a constant (value)
    family = "lognormal"
    mean = 0.25
    cov = 0.30
    [dependence]               # copula, measure, and one value per pair; without the section: independent
    measure = "pearson"
    mu_s.G_p_GPa = -0.5

`analysis/inputs/figures_stated.py` lists the families and their figures, `dependence_stated.py` the keys of the
dependence.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from analysis.errors_and_files import GrainScatterError, shown

#: The sections that this module reads.
SECTIONS_STATED = ("variables", "dependence")
#: Keys of [inputs] that concern measured pairs.
OF_PAIRS = ("pairs", "marginals", "copulas", "bootstrap")
#: Variables with a key of their own, which is left out where [variables] states them.
OWN_KEYS = {
    "nu": ("material", "nu"),
    "sigma_ln": ("assembly", "sigma_ln"),
    "d50": ("assembly", "d50_mm"),
    "sigma_3": ("consolidation", "sigma_3_kPa"),
}
#: Fewest measurements behind stated figures.
FEWEST_BEHIND = 10


class VariablesError(GrainScatterError):
    """The sections [variables] and [dependence] cannot be used; the text is one line with key, value and limit."""


def read_variables(
    table: Mapping[str, Any], nu: float, pairs_behind: int
) -> tuple[dict[str, Any], dict[str, Any], dict[str, dict[str, float]]]:
    """Check and return the two sections of a campaign file, {} where they are absent, and the keys that they settle.

    A constant with a key of its own, such as material.nu, settles this key: {section: {key: value}}.  nu: the file's
    Poisson's ratio, for E_p. Raises VariablesError, also for keys of other sections that contradict
    [variables].
    """
    variables, dependence = (table.get(name, {}) for name in SECTIONS_STATED)
    if "variables" not in table:
        if "dependence" in table:
            raise VariablesError("[dependence] needs the section [variables]; that of measured pairs is fitted")
        if pairs_behind:
            raise VariablesError(f"inputs.pairs_behind = {pairs_behind} is for [variables]; measured pairs are counted")
        return {}, {}, {}
    for name, section in (("variables", variables), ("dependence", dependence)):
        if not isinstance(section, dict):
            raise VariablesError(f"{name} = {shown(repr(section))} must be a section, [{name}]")
    for key in OF_PAIRS:
        if key in table.get("inputs", {}):
            raise VariablesError(f"inputs.{key} is for measured pairs, and [variables] takes their place; keep one")
    if 0 < pairs_behind < FEWEST_BEHIND:
        raise VariablesError(f"inputs.pairs_behind = {pairs_behind} must be 0 (not known) or at least {FEWEST_BEHIND}")
    from analysis.inputs.specified import joint_from_distributions
    from analysis.inputs.variables import VARIABLES

    try:
        specified = joint_from_distributions(variables, dependence, nu)
    except GrainScatterError as error:
        raise VariablesError(str(error)) from None
    for symbol in (*specified.names, *specified.constants):
        section, key = OWN_KEYS.get(symbol, ("", ""))
        if key and key in table.get(section, {}):
            raise VariablesError(f"{section}.{key} and [variables] both state {symbol}; keep one")
    settled: dict[str, dict[str, float]] = {}
    for symbol in (symbol for symbol in specified.constants if symbol in OWN_KEYS):
        section, key = OWN_KEYS[symbol]
        settled.setdefault(section, {})[key] = specified.constants[symbol] / VARIABLES[symbol].factor
    return variables, dependence, settled
