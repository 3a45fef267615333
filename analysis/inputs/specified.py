"""The joint distribution of the inputs from stated distributions, where no measured values are at hand.

The sections [variables] and [dependence] of a campaign file give every property as a constant or as a distribution with
figures such as mean and cov, and the correlations of the random ones. `figures_stated` lists the figures,
`dependence_stated` the keys of the dependence. What stands behind the figures is not known from them: there are no
bands from the data, unless the number of measured pairs is stated (`bootstrap_specified`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import copulas
from ..copulas import Copula
from ..copulas.multivariate import GaussianCopula, StudentCopula, fit_gaussian, student_of_known_degrees
from . import marginals
from .bounded_families import BOUNDED, refit_rows
from .dependence_stated import read_dependence, stated_copula
from .family import MarginalError
from .joint import Joint
from .marginals import Marginal
from .pairs import FEWEST_PAIRS, POISSON_RATIO
from .specified_text import describe
from .stated_variables import read_variable, stated_column
from .variables import NEEDED, VARIABLES


@dataclass(frozen=True)
class SpecifiedInputs:
    """Stated inputs: the joint distribution of the random variables `names`, and the constant ones in SI units.

    `variables` and `dependence` are the sections as stated, `warnings` sentences on doubtful values.
    """

    joint: Joint
    names: tuple[str, ...]
    constants: dict[str, float]
    variables: dict[str, Any]
    dependence: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def text(self) -> list[str]:
        """Lines for the user: every distribution with its moments and quantiles, constants, and the dependence."""
        return describe(self.names, self.joint, self.constants, self.variables, self.dependence)

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary."""
        return {
            "names": list(self.names),
            "constants": self.constants,
            "joint": self.joint.to_dict(),
            "variables": self.variables,
            "dependence": self.dependence,
            "warnings": list(self.warnings),
            "text": self.text,
        }

    @staticmethod
    def from_dict(data: dict[str, Any]) -> SpecifiedInputs:
        """The inverse of to_dict."""
        return SpecifiedInputs(
            joint=Joint.from_dict(data["joint"]),
            names=tuple(data["names"]),
            constants=dict(data["constants"]),
            variables=dict(data["variables"]),
            dependence=dict(data["dependence"]),
            warnings=tuple(data["warnings"]),
        )


def joint_from_distributions(
    variables: Mapping[str, Any], dependence: Mapping[str, Any] | None = None, nu: float = POISSON_RATIO
) -> SpecifiedInputs:
    """The joint distribution that the sections [variables] and [dependence] state.

    variables: key such as `G_p_GPa` -> family and figures, or value.  nu: Poisson's ratio for `E_p_GPa`, unless it is a
    constant of the section.  Without dependence the variables are independent.  Raises MarginalError or CopulaError, in
    one line with the key, its value and the limit.
    """
    keys = _keys(variables)
    if any(symbol not in keys for symbol in NEEDED):
        missing = next(symbol for symbol in NEEDED if symbol not in keys)
        raise MarginalError(f"variables.{VARIABLES[missing].column} is missing; state a distribution or a value")
    poisson: float | None = nu
    found: dict[str, Marginal | float] = {}
    warnings: list[str] = []
    for symbol in sorted(keys, key=lambda name: (name != "nu", list(VARIABLES).index(name))):
        column = stated_column(keys[symbol])
        assert column is not None
        found[symbol], sentences = read_variable(keys[symbol], variables[keys[symbol]], column, poisson)
        warnings += sentences
        if symbol == "nu":
            poisson = value if isinstance(value := found["nu"], float) else None
    names = tuple(name for name in VARIABLES if isinstance(found.get(name), Marginal))
    constants = {name: constant for name in VARIABLES if isinstance(constant := found.get(name), float)}
    if not names:
        raise MarginalError("variables: every variable is a constant; at least one must have a distribution")
    of_names = tuple(one for name in names if isinstance(one := found[name], Marginal))
    copula: Copula | GaussianCopula | StudentCopula
    if dependence:
        copula = stated_copula(read_dependence(dependence, names, tuple(constants)), names, of_names)
    elif len(names) == 2:
        copula = Copula("independence")
    else:
        copula = GaussianCopula(tuple(tuple(row) for row in np.eye(len(names)).tolist()))
    joint = Joint(of_names, copula)
    return SpecifiedInputs(joint, names, constants, _plain(variables), _plain(dependence or {}), tuple(warnings))


def _keys(variables: Mapping[str, Any]) -> dict[str, str]:
    """Symbol -> key of the section; raises MarginalError for an unknown key, and for two keys of one variable."""
    keys: dict[str, str] = {}
    for key in variables:
        column = stated_column(key)
        if column is None:
            known = ", ".join(variable.column for variable in VARIABLES.values())
            raise MarginalError(
                f"unknown key variables.{key[:60]}; known: {known} (other units: G_p_MPa, E_p_GPa, ...)"
            )
        if column.symbol in keys:
            raise MarginalError(
                f"variables.{keys[column.symbol]} and variables.{key} both state {column.symbol}; keep one"
            )
        keys[column.symbol] = key
    return keys


def bootstrap_specified(
    specified: SpecifiedInputs, pairs_behind: int, n_boot: int, rng: np.random.Generator
) -> list[Joint]:
    """Joint distributions refitted to n_boot samples of `pairs_behind` points of the stated one: parametric bootstrap.

    Families, bounds, constants and degrees of freedom stay; so does independence where no dependence is stated. The
    bands assume that the figures were estimated about as well as by maximum likelihood.  Raises MarginalError for
    fewer than 10 pairs.
    """
    if pairs_behind < FEWEST_PAIRS:
        raise MarginalError(f"pairs_behind = {pairs_behind} is below {FEWEST_PAIRS}, the fewest that are fitted")
    joint = specified.joint
    d = joint.dimension
    samples = joint.inverse_rosenblatt(rng.random((n_boot, pairs_behind, d)))
    columns = [_refitted_marginals(one, samples[..., i]) for i, one in enumerate(joint.marginals)]
    dependences = _refitted_copulas(joint.copula, samples, bool(specified.dependence))
    return [Joint(tuple(column[k] for column in columns), dependences[k]) for k in range(n_boot)]


def _refitted_marginals(one: Marginal, rows: np.ndarray) -> list[Marginal]:
    bounded = one.family in BOUNDED
    params = refit_rows(one.family, one.params, rows) if bounded else marginals.fit_rows(rows, one.family)
    return [Marginal(one.family, dict(zip(one.params, values, strict=True))) for values in params.tolist()]


def _refitted_copulas(
    copula: Copula | GaussianCopula | StudentCopula, samples: np.ndarray, dependent: bool
) -> Sequence[Copula | GaussianCopula | StudentCopula]:
    if not dependent or copula.dimension == 1:
        return [copula] * len(samples)
    if isinstance(copula, GaussianCopula):
        return [fit_gaussian(rows) for rows in samples]
    if isinstance(copula, StudentCopula):
        return [student_of_known_degrees(rows, copula.degrees_of_freedom) for rows in samples]
    if copula.family == "student":
        nu = copula.parameters[1]
        rhos = [student_of_known_degrees(rows, nu).correlation[0][1] for rows in samples]
        return [Copula("student", (min(max(rho, -0.9999), 0.9999), nu)) for rho in rhos]
    u, v = copulas.pseudo_observations(samples[..., 0]), copulas.pseudo_observations(samples[..., 1])
    return [Copula(copula.family, tuple(row)) for row in copulas.fit_rows(u, v, copula.family).tolist()]


def _plain(section: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _plain(value) if isinstance(value, Mapping) else value for key, value in section.items()}
