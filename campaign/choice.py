"""The choice of the representative points: from measured pairs and their fits, or from the distributions of a file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from analysis.errors_and_files import GrainScatterError
from campaign.config import Config

if TYPE_CHECKING:
    import numpy as np

    from analysis.inputs.joint import Joint
    from analysis.points import RepresentativePoints


class PlanError(GrainScatterError):
    """A campaign's folder cannot be planned or used as it is; the text is one line that names the file."""


@dataclass(frozen=True)
class Inputs:
    """The random variables `names` with their joint distribution, the constants (SI units), and parts of inputs.json.

    `notes` are those parts, without the points and without the warnings.
    """

    names: tuple[str, ...]
    joint: Joint
    constants: dict[str, float]
    notes: dict[str, Any]
    warnings: list[str]


def choose(config: Config) -> tuple[RepresentativePoints, dict[str, Any]]:
    """Return the points of the campaign's inputs, and the contents of inputs.json.

    Raises PlanError for inputs that cannot be run, and the errors of the analysis.
    """
    import numpy as np

    from analysis.inputs.variables import NEEDED
    from analysis.points.selection import select_points

    inputs = _stated(config) if config.variables else _measured(config)
    _refuse_settings(config, inputs)
    wanted = config.points
    points = select_points(inputs.joint, wanted.n, method=wanted.method, seed=wanted.seed, nested=wanted.nested,
                           names=inputs.names, constants=inputs.constants)  # fmt: skip
    refuse_impossible(points.x, points.names, inputs.joint, f"the {wanted.n} points", config)
    contents = {
        **inputs.notes,
        "warnings": inputs.warnings + points.moment_warnings(),
        "point_attrs": {
            "method": points.method,
            "seed": wanted.seed,
            "discrepancy": points.discrepancy,
            "moment_errors": points.moment_errors,
        },
    }
    if points.names != NEEDED or points.constants:
        contents |= {"names": points.names, "constants": points.constants}
    return points, json.loads(json.dumps(contents, default=lambda value: np.asarray(value).tolist()))


def _measured(config: Config) -> Inputs:
    """Fit marginals and copulas to the measured table, and join the best of them."""
    from analysis.inputs.joint import fit_joint
    from analysis.inputs.plausibility import input_warnings
    from analysis.inputs.table import read_input_table

    table = read_input_table(config.pairs_path, config.material.nu, dict(config.inputs.columns))
    names, values = table.names, table.values
    families: dict[str, Any] = {"copula_families": config.inputs.copulas or None}
    if config.inputs.marginals:
        families["marginal_families"] = config.inputs.marginals
    fit = fit_joint(values, n_boot=config.inputs.bootstrap, seed=config.inputs.seed, names=names, **families)
    fits = fit.to_dict()
    fits["marginals"] = dict(zip(names, fits["marginals"], strict=True))
    warnings = input_warnings(values, dict(zip(names, fit.marginals, strict=True)), fit.copulas, table.lines)
    if len(names) > 2:
        warnings.append(f"copula: {fit.note}")
    notes = {"source": config.inputs.pairs, "understood": table.understood, "pairs": values.tolist(), **fits}
    return Inputs(names, fit.joint, {}, notes, warnings)


def _stated(config: Config) -> Inputs:
    """Join the distributions of [variables] by [dependence]."""
    from analysis.inputs.specified import joint_from_distributions
    from analysis.inputs.variables import NEEDED

    specified = joint_from_distributions(config.variables, config.dependence or None, config.material.nu)
    joint, names = specified.joint, specified.names
    notes = {
        "source": "[variables]",
        "pairs": [],
        "marginals": {name: [m.to_dict()] for name, m in zip(names, joint.marginals, strict=True)},
        "copulas": [_copula_note(joint, names)] if len(names) > 1 else [],
        "joint": joint.to_dict(),
        "specified": specified.to_dict(),
        "pairs_behind": config.inputs.pairs_behind,
    }
    constants = {symbol: value for symbol, value in specified.constants.items() if symbol in NEEDED}
    return Inputs(names, joint, constants, notes, list(specified.warnings))


def _copula_note(joint: Joint, names: Sequence[str]) -> dict[str, Any]:
    """Family, parameters and their names of a copula that was given, as the fit of a copula is noted."""
    from analysis.copulas.model import Copula, family_of
    from analysis.copulas.multivariate_fits import copula_parameters, parameter_names

    copula = joint.copula
    if isinstance(copula, Copula):
        named = {"parameters": copula.parameters, "names": family_of(copula.family).names, "tau": copula.tau}
        return {"family": copula.family, **named}
    family = copula.to_dict()["family"]
    return {"family": family, "parameters": copula_parameters(copula), "names": parameter_names(names, family)}


def _refuse_settings(config: Config, inputs: Inputs) -> None:
    """Raise PlanError for random variables that do not go with a setting of the file."""
    from analysis.inputs.variables import NEEDED, VARIABLES

    file = config.source.name
    others = [VARIABLES[symbol].column for symbol in inputs.names if symbol not in NEEDED]
    if config.material.heterogeneity == "grain" and others:
        raise PlanError(
            f'{file}: material.heterogeneity = "grain" draws mu_s and G_p for every grain, but {others[0]} is random, '
            "too, and a specimen has one value of it"
        )
    sizes = [VARIABLES[symbol].column for symbol in ("sigma_ln", "d50")
             if symbol in inputs.names or {symbol, VARIABLES[symbol].column} & {*config.variables}]  # fmt: skip
    if config.curve and sizes:
        raise PlanError(f"{file}: assembly.sieve gives the sizes of the grains, but the inputs state {sizes[0]}, too")
    if config.families.G_p_only and inputs.names != NEEDED:
        raise PlanError(
            f"{file}: families.G_p_only = true needs mu_s and G_p as the two random variables; random are "
            f"{', '.join(inputs.names)}"
        )


def refuse_impossible(x: np.ndarray, names: Sequence[str], joint: Joint, what: str, config: Config) -> None:
    """Raise PlanError for values x (n, d) that no grain has: at or below zero, or beyond the limits of the variable."""
    from analysis.inputs.marginal_families import FAMILIES
    from analysis.inputs.variables import VARIABLES

    source = config.source.name if config.variables else config.pairs_path
    for name, column, marginal in zip(names, x.T, joint.marginals, strict=True):
        variable = VARIABLES[name]
        low, high, value = variable.low, variable.high, column / variable.factor
        distribution = (
            f"{source}: the {marginal.family} distribution {'of' if config.variables else 'fitted to'} {name}"
        )
        if count := int((column <= 0.0).sum()):
            advice = ""
            if not config.variables:
                positive = ", ".join(f'"{family}"' for family, kind in FAMILIES.items() if kind.positive)
                advice = f"; choose inputs.marginals from {positive}"
            raise PlanError(
                f"{distribution} puts {count} of {what} at or below zero (least {column.min():.3g}){advice}"
            )
        if count := int(((value < low) | (value > high)).sum()):
            worst = value.max() if value.max() > high else value.min()
            raise PlanError(
                f"{distribution} puts {count} of {what} outside {variable.column} = {low:g} to {high:g} "
                f"(such as {worst:.3g})"
            )
