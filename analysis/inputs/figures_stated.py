"""What figures may be stated of a distribution, and what each of them is for given parameters.

The figures of a distribution are its own parameters and `mean`, `sd`, `cov` = sd / mean, `median`, `q05`, `q95` or
another quantile q01 to q99, `sigma_ln` = the standard deviation of ln x (positive families), `low` and `high` (families
with bounds). For the truncated families they are those of the truncated distribution; the same names with `parent_` in
front are those of the normal or lognormal distribution before the truncation.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import special

from ..errors_and_files import shown
from .bounded_families import BOUNDED
from .family import MarginalError
from .marginal_families import FAMILIES, family_of
from .marginals import Marginal
from .truncated_normal import weighted_nodes

#: All families that can be stated.
STATED = (*FAMILIES, *BOUNDED)
#: The distribution before the truncation.
PARENT = {"truncated_normal": "normal", "truncated_lognormal": "lognormal"}
_COMMON = ("mean", "sd", "cov", "median", "q05", "q95")
#: Figures that are no multiple of the unit of x; all others are.
_PURE = ("cov", "sigma_ln", "shape")
_POSITIVE = ("sd", "cov", "sigma_ln", "shape", "scale")


def is_number(value: Any) -> bool:
    """Whether a value of a TOML file is a finite number of the usual size."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300


def probability_of(name: str) -> float | None:
    """0.05 for q05, 0.5 for median; None for the name of another figure."""
    if name == "median":
        return 0.5
    return float(name[1:]) / 100.0 if re.fullmatch(r"q(0[1-9]|[1-9]\d)", name) else None


def is_pure(name: str) -> bool:
    """Whether a figure has no unit."""
    return name.removeprefix("parent_") in _PURE


def known_figures(family: str) -> tuple[str, ...]:
    """The names of the figures that may be stated of a family; other quantiles than q05 and q95 are known, too."""
    names = dict.fromkeys((*family_of(family).names, *_COMMON))
    if family_of(family).positive:
        names["sigma_ln"] = None
    if family in PARENT:
        names |= dict.fromkeys(f"parent_{name}" for name in known_figures(PARENT[family]))
    return tuple(names)


def figure(marginal: Marginal, name: str) -> float:
    """The value of a figure of a distribution, in the unit of x."""
    params = marginal.params
    if name in params:
        return params[name]
    if name.startswith("parent_"):
        return figure(parent(marginal), name.removeprefix("parent_"))
    if (probability := probability_of(name)) is not None:
        return float(marginal.ppf(probability))
    if name == "sigma_ln":
        return _sigma_ln(marginal)
    mean, sd = marginal.mean, marginal.std
    return {"mean": mean, "sd": sd, "cov": sd / mean if mean else math.inf}[name]


def parent(marginal: Marginal) -> Marginal:
    """The distribution before the truncation."""
    family = PARENT[marginal.family]
    values = list(marginal.params.values())[:2]
    return Marginal(family, dict(zip(family_of(family).names, values, strict=True)))


def _sigma_ln(marginal: Marginal) -> float:
    params = marginal.params
    if marginal.family == "gamma":
        return math.sqrt(special.polygamma(1, params["shape"]))
    if marginal.family == "weibull":
        return math.pi / (math.sqrt(6.0) * params["shape"])
    low = math.log(params["low"]) if params["low"] > 0.0 else -math.inf
    y, weight = weighted_nodes(math.log(params["parent_median"]), params["parent_sigma_ln"], low,
                               math.log(params["high"]))  # fmt: skip
    return float(np.sqrt(weight @ (y - weight @ y) ** 2))


def check_figures(family: str, figures: Mapping[str, Any], positive: bool = True) -> None:
    """Raise MarginalError for a figure that is unknown, no finite number, of the wrong sign or out of order.

    `positive`: the mean must be positive, also of a family that has negative values.
    """
    known = known_figures(family)
    for name, value in figures.items():
        if name not in known and probability_of(name.removeprefix("parent_" if family in PARENT else "")) is None:
            raise MarginalError(_unknown(family, name, known))
        if not is_number(value):
            raise MarginalError(f"{name} = {shown(repr(value))} must be a finite number")
        bare = name.removeprefix("parent_")
        if bare in ("sd", "cov", "sigma_ln") and value == 0.0:
            raise MarginalError(f'{name} = 0 is no scatter; use family = "constant" with the key value')
        if bare in _POSITIVE and value <= 0.0:
            raise MarginalError(f"{name} = {value:g} must be positive")
        if family_of(family).positive and bare != "low" and value <= 0.0:
            raise MarginalError(f"{name} = {value:g} must be positive, as all values of a {family} distribution are")
    if positive and figures.get("mean", 1.0) <= 0.0:
        raise MarginalError(f"mean = {figures['mean']:g} must be positive, as the property is")
    own = {name: value for name, value in figures.items() if not name.startswith("parent_")}
    _check_order(own)
    _check_order({name: value for name, value in figures.items() if name not in own})


def _unknown(family: str, name: str, known: tuple[str, ...]) -> str:
    everywhere = {n for other in STATED for n in known_figures(other)}
    if name in everywhere:
        instead = ""
        if name in ("low", "high"):
            instead = f"; the family truncated_{'lognormal' if family_of(family).positive else 'normal'} has"
        return f"a {family} distribution has no {name}{instead}; its figures are {', '.join(known)}"
    near = difflib.get_close_matches(name[:60], known, 1, 0.5)
    return f"unknown key {name[:60]!r}; " + (f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}")


def _check_order(figures: Mapping[str, float]) -> None:
    """Bounds and quantiles must increase with their probability, and mean and mode must lie between the bounds."""
    at = {name: {"low": 0.0, "high": 1.0}.get(name.removeprefix("parent_")) for name in figures}
    at = {name: probability_of(name.removeprefix("parent_")) if p is None else p for name, p in at.items()}
    ordered = sorted((p, name) for name, p in at.items() if p is not None)
    for (p, lower), (q, upper) in zip(ordered, ordered[1:], strict=False):
        if p < q and figures[lower] >= figures[upper]:
            raise MarginalError(f"{lower} = {figures[lower]:g} must be below {upper} = {figures[upper]:g}")
    low, high = figures.get("low", -math.inf), figures.get("high", math.inf)
    for name in ("mean", "mode"):
        value = figures.get(name, math.nan)
        if value < low or value > high or (name == "mean" and value in (low, high)):
            raise MarginalError(f"{name} = {value:g} is outside [low, high] = [{low:g}, {high:g}]")
