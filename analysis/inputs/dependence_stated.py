"""The copula of stated dependence: the section [dependence] of a campaign file.

[dependence]
copula = "gaussian"
measure = "pearson"            # kendall, spearman, or parameter: the copula's own
degrees_of_freedom = 5         # of the copula "student" only
mu_s.G_p_GPa = -0.5            # one line per pair of random variables
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..copulas import FAMILIES, Copula, CopulaError
from ..copulas.elliptical import LARGEST_NU, SMALLEST_NU
from ..copulas.multivariate import GaussianCopula, StudentCopula
from ..errors_and_files import shown
from .association import MEASURES, association, with_association
from .figures_stated import is_number
from .marginals import Marginal
from .stated_variables import stated_column

_KEYS = ("copula", "measure", "degrees_of_freedom")
#: Copulas of any number of variables.
ELLIPTICAL = ("gaussian", "student")


@dataclass(frozen=True)
class StatedDependence:
    """A checked section [dependence]: `values` holds the measure of pairs (i, j), i < j, of the random variables.

    `keys` holds the pairs as they are written in the file, such as `mu_s.G_p_GPa`.
    """

    copula: str
    measure: str
    values: dict[tuple[int, int], float]
    keys: dict[tuple[int, int], str]
    degrees_of_freedom: float | None = None


def read_dependence(section: Mapping[str, Any], names: Sequence[str], constants: Sequence[str]) -> StatedDependence:
    """Check the section for random variables `names`; raises CopulaError with the key, its value and the limit."""
    options = {key: section[key] for key in _KEYS if key in section}
    copula = _choice("copula", options.get("copula", "gaussian"), tuple(FAMILIES))
    values: dict[tuple[int, int], float] = {}
    keys: dict[tuple[int, int], str] = {}
    for key, partners in section.items():
        if key in _KEYS:
            continue
        first = stated_column(key)
        if first is None:
            raise CopulaError(
                f"dependence: unknown key {key[:60]!r}; known: {', '.join(_KEYS)} and the random variables"
            )
        if not isinstance(partners, Mapping):
            raise CopulaError(
                f"dependence.{key} = {shown(repr(partners))} must name a second variable, {key}.{_other(names, key)}"
            )
        for other, value in partners.items():
            pair = _pair(names, constants, key, other)
            full = f"{key}.{other}"
            if not is_number(value):
                raise CopulaError(f"dependence.{full} = {shown(repr(value))} must be a finite number")
            if values.get(pair, value) != value:
                raise CopulaError(
                    f"dependence.{full} = {value:g} contradicts dependence.{keys[pair]} = {values[pair]:g}"
                )
            values[pair], keys[pair] = float(value), full
    nu = options.get("degrees_of_freedom")
    if copula != "independence" and values and "measure" not in options:
        raise CopulaError(f"dependence.measure is missing; it is one of {', '.join(MEASURES)}")
    measure = _choice("measure", options.get("measure", "parameter"), MEASURES)
    if (nu is not None) != (copula == "student"):
        raise CopulaError(
            f"dependence.degrees_of_freedom = {shown(repr(nu))} is for the copula student only, not for {copula}"
            if nu is not None
            else "dependence.degrees_of_freedom is missing; the copula student needs it"
        )
    if nu is not None and not (is_number(nu) and SMALLEST_NU <= nu <= LARGEST_NU):
        raise CopulaError(
            f"dependence.degrees_of_freedom = {shown(repr(nu))} is outside [{SMALLEST_NU:g}, {LARGEST_NU:g}]"
        )
    if copula == "independence" and any(values.values()):
        raise CopulaError("dependence: the copula independence has no values; leave them out")
    if copula not in (*ELLIPTICAL, "independence") and len(names) > 2:
        raise CopulaError(
            f"dependence.copula = {copula!r} joins two variables only, and {len(names)} are random: "
            f"{', '.join(names)}; choose {' or '.join(ELLIPTICAL)}"
        )
    if len(names) < 2:
        raise CopulaError(f"dependence: only {names[0]} is random, so there is none; leave the section out")
    if copula != "independence" and not values:
        raise CopulaError(f"dependence: the copula {copula} needs a value of a pair, {names[0]}.{names[1]} = ...")
    return StatedDependence(copula, measure, values, keys, None if nu is None else float(nu))


def _pair(names: Sequence[str], constants: Sequence[str], *keys: str) -> tuple[int, int]:
    """The places (i, j), i < j, of two keys among the random variables."""
    full = f"dependence.{'.'.join(key[:60] for key in keys)}"
    symbols = []
    for key in keys:
        column = stated_column(key)
        if column is None or column.symbol not in names:
            constant = column is not None and column.symbol in constants
            why = f"{key} is a constant" if constant else f"{key[:60]} is no random variable"
            raise CopulaError(f"{full}: {why}; the random variables are {', '.join(names)}")
        symbols.append(column.symbol)
    if symbols[0] == symbols[1]:
        raise CopulaError(f"{full} joins {symbols[0]} with itself")
    i, j = sorted(names.index(symbol) for symbol in symbols)
    return i, j


def stated_copula(
    stated: StatedDependence, names: Sequence[str], marginals: Sequence[Marginal]
) -> Copula | GaussianCopula | StudentCopula:
    """The copula with the stated measures, pairs without a value being uncorrelated.

    Raises CopulaError, in one line with the pair, its value and the range, for a value that the two marginals or the
    family cannot have, and for values of several pairs that contradict each other.
    """
    d = len(names)
    found = {pair: _pair_copula(stated, pair, marginals) for pair in stated.values}
    if d == 2:
        return found.get((0, 1)) or Copula("independence")
    matrix = np.eye(d)
    for (i, j), copula in found.items():
        matrix[i, j] = matrix[j, i] = copula.parameters[0] if copula.parameters else 0.0
    if np.linalg.eigvalsh(matrix)[0] <= 1e-9:
        raise CopulaError(_not_positive(stated, matrix, marginals))
    rows = tuple(tuple(row) for row in matrix.tolist())
    return GaussianCopula(rows) if stated.degrees_of_freedom is None else StudentCopula(rows, stated.degrees_of_freedom)


def _pair_family(stated: StatedDependence, parameter: float) -> Copula:
    """The copula of a pair with a first parameter."""
    if stated.copula == "independence":
        return Copula("independence")
    rest = () if stated.degrees_of_freedom is None else (stated.degrees_of_freedom,)
    return Copula(stated.copula, (parameter, *rest))


def _pair_copula(stated: StatedDependence, pair: tuple[int, int], marginals: Sequence[Marginal]) -> Copula:
    if stated.copula == "independence":
        return Copula("independence")
    first, second = (marginals[k] for k in pair)
    try:
        return with_association(
            stated.measure,
            stated.values[pair],
            lambda parameter: _pair_family(stated, parameter),
            stated.copula,
            first,
            second,
        )
    except CopulaError as error:
        joint = " " if str(error).startswith("is ") else ": "
        raise CopulaError(f"{_shown(stated, pair)}{joint}{error}") from None


def _shown(stated: StatedDependence, pair: tuple[int, int]) -> str:
    """The key, value and measure of a pair."""
    what = "" if stated.measure == "parameter" else f" ({stated.measure})"
    return f"dependence.{stated.keys[pair]} = {stated.values[pair]:g}{what}"


def _not_positive(stated: StatedDependence, matrix: np.ndarray, marginals: Sequence[Marginal]) -> str:
    """One line on correlations that no variables can have: the pair that needs the smallest change, and its range."""
    best: tuple[float, tuple[int, int], tuple[float, float]] | None = None
    for i, j in stated.values:
        room = partial_range(matrix, i, j)
        if room is not None:
            excess = max(room[0] - matrix[i, j], matrix[i, j] - room[1])
            if best is None or excess < best[0]:
                best = (excess, (i, j), room)
    if best is None:
        return (
            f"dependence: these {len(stated.values)} correlations contradict each other in several pairs (smallest "
            f"eigenvalue of their matrix {np.linalg.eigvalsh(matrix)[0]:.3g}, limit 0)"
        )
    _, (i, j), room = best
    limits = [
        association(
            stated.measure, _pair_family(stated, float(np.clip(rho, -0.9999, 0.9999))), marginals[i], marginals[j]
        )
        for rho in room
    ]
    return (
        f"{_shown(stated, (i, j))} contradicts the values of the other pairs, with which it lies between "
        f"{limits[0]:.4f} and {limits[1]:.4f}"
    )


def partial_range(matrix: np.ndarray, i: int, j: int) -> tuple[float, float] | None:
    """The open interval of entry (i, j) in which a correlation matrix is positive definite, the others unchanged.

    None if the other entries alone are not positive definite.
    """
    rest = [k for k in range(len(matrix)) if k not in (i, j)]
    for k in (i, j):
        if np.linalg.eigvalsh(matrix[np.ix_([k, *rest], [k, *rest])])[0] <= 0.0:
            return None
    a, b = matrix[i, rest], matrix[j, rest]
    inverse = np.linalg.inv(matrix[np.ix_(rest, rest)])
    middle = float(a @ inverse @ b)
    half = math.sqrt((1.0 - float(a @ inverse @ a)) * (1.0 - float(b @ inverse @ b)))
    return middle - half, middle + half


def _choice(key: str, value: Any, known: tuple[str, ...]) -> str:
    if value in known:
        return str(value)
    near = difflib.get_close_matches(str(value)[:60], known, 1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise CopulaError(f"dependence.{key} = {str(value)[:60]!r} must be one of {', '.join(known)}{hint}")


def _other(names: Sequence[str], key: str) -> str:
    column = stated_column(key)
    return next((name for name in names if column is None or name != column.symbol), "G_p")
