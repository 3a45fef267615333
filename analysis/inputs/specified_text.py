"""Stated inputs in words: one line per variable and per pair of variables, and what stands behind the figures."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from ..copulas import Copula, CopulaError
from ..copulas.model import family_of
from ..copulas.multivariate import GaussianCopula, StudentCopula
from ..quantities import QUANTITIES, parameter
from .association import association
from .figures_stated import PARENT, figure
from .joint import Joint
from .marginals import Marginal
from .stated_variables import stated_column
from .variables import VARIABLES


def describe(
    names: Sequence[str],
    joint: Joint,
    constants: Mapping[str, float],
    variables: Mapping[str, Any],
    dependence: Mapping[str, Any],
) -> list[str]:
    """Lines on every variable, with the moments and quantiles of its distribution, and on the dependence.

    names: the random variables, in the order of `joint`; variables, dependence: the sections as stated.
    """
    keys = {column.symbol: key for key in variables if (column := stated_column(key))}
    lines = []
    for symbol in VARIABLES:
        if symbol in names:
            key, one = keys[symbol], joint.marginals[list(names).index(symbol)]
            lines.append(_distribution_line(symbol, one, key, variables[key]))
        elif symbol in constants:
            lines.append(f"{symbol}: constant, {_value(symbol, constants[symbol])}")
    return lines + _dependence_lines(names, joint, dependence)


def band_text(pairs_behind: int) -> str:
    """One sentence on what stands behind stated figures."""
    if pairs_behind:
        return (
            f"stated figures: {pairs_behind} measurements stand behind them (inputs.pairs_behind); the bands of the "
            "inputs follow from that; families and bounds are taken as known"
        )
    return (
        "stated figures: the number of measurements behind them is not known (inputs.pairs_behind), so results have no "
        "bands for the uncertainty of the inputs"
    )


def _value(symbol: str, value: float) -> str:
    quantity = QUANTITIES[symbol]
    unit = f" {quantity.shown_unit}" if quantity.shown_unit else ""
    return f"{value * quantity.shown_factor:.4g}{unit}"


def _distribution_line(symbol: str, one: Marginal, key: str, section: Mapping[str, Any]) -> str:
    figures = {name: value for name, value in section.items() if name != "family"}
    given = ", ".join(f"{name} = {value:g}" for name, value in figures.items())
    parameters = ", ".join(parameter(symbol, name, value) for name, value in one.params.items())
    assumed = [name for name in ("low", "high") if one.family in PARENT and name not in figures]
    limits = f"; {' and '.join(assumed)}: the limit of all values" if assumed else ""
    return (
        f"{symbol}: {one.family} ({parameters}); stated for {key}: {given}{limits}; mean {_value(symbol, one.mean)}, "
        f"sd {_value(symbol, one.std)}, cov {figure(one, 'cov'):.3g}, 5 and 95 % quantiles "
        f"{_value(symbol, figure(one, 'q05'))} and {_value(symbol, figure(one, 'q95'))}"
    )


def _dependence_lines(names: Sequence[str], joint: Joint, dependence: Mapping[str, Any]) -> list[str]:
    """One line per pair of random variables with the copula's parameter and three measures of the dependence."""
    if len(names) < 2:
        return []
    if not dependence:
        return [f"dependence: none is stated, so {', '.join(names)} are independent"]
    lines = []
    for i, j in itertools.combinations(range(len(names)), 2):
        copula = _pair_of(joint.copula, i, j)
        pair = (joint.marginals[i], joint.marginals[j])
        known = [f"{measure} {_measured(measure, copula, pair)}" for measure in ("pearson", "kendall", "spearman")]
        named = zip(family_of(copula.family).names, copula.parameters, strict=True)
        parameters = ", ".join(f"{name} = {value:.4g}" for name, value in named)
        text = f"{names[i]} and {names[j]}: {copula.family} copula{f' ({parameters})' if parameters else ''}, "
        if len(names) > 2 and not _is_stated(dependence, names[i], names[j]):
            text += "no value is stated, so they are uncorrelated; "
        lines.append(text + ", ".join(known))
    return lines


def _pair_of(copula: Copula | GaussianCopula | StudentCopula, i: int, j: int) -> Copula:
    if isinstance(copula, Copula):
        return copula
    rho = copula.correlation[i][j]
    if isinstance(copula, StudentCopula):
        return Copula("student", (rho, copula.degrees_of_freedom))
    return Copula("gaussian", (rho,))


def _measured(measure: str, copula: Copula, pair: tuple[Marginal, Marginal]) -> str:
    try:
        return f"{association(measure, copula, *pair):.3f}"
    except CopulaError:
        return "not known"


def _is_stated(dependence: Mapping[str, Any], first: str, second: str) -> bool:
    for key, partners in dependence.items():
        if isinstance(partners, Mapping) and (column := stated_column(key)):
            others = {other.symbol for partner in partners if (other := stated_column(partner))}
            if any(column.symbol == a and b in others for a, b in ((first, second), (second, first))):
                return True
    return False
