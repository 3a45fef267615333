"""One distribution of every family that can be stated, and the figures of it that determine the family."""

from __future__ import annotations

import itertools

from analysis.inputs.figures_stated import PARENT, STATED, figure, known_figures
from analysis.inputs.marginals import Marginal

#: Distributions of a friction coefficient; their means and standard deviations are near 0.25 and 0.07.
EXAMPLES = {
    one.family: one
    for one in (
        Marginal("lognormal", {"median": 0.24, "sigma_ln": 0.29}),
        Marginal("normal", {"mean": 0.25, "sd": 0.06}),
        Marginal("gamma", {"shape": 11.0, "scale": 0.0225}),
        Marginal("weibull", {"shape": 3.0, "scale": 0.28}),
        Marginal("gumbel", {"location": 0.22, "scale": 0.05}),
        Marginal("uniform", {"low": 0.1, "high": 0.4}),
        Marginal("triangular", {"low": 0.1, "mode": 0.2, "high": 0.45}),
        Marginal("truncated_normal", {"parent_mean": 0.22, "parent_sd": 0.1, "low": 0.05, "high": 0.5}),
        Marginal("truncated_lognormal", {"parent_median": 0.23, "parent_sigma_ln": 0.4, "low": 0.1, "high": 0.5}),
    )
}
assert set(EXAMPLES) == set(STATED)


def stated_sets(family: str) -> list[dict[str, float]]:
    """All sets of two figures of the example (three of a triangular one), with the bounds of truncated families."""
    one = EXAMPLES[family]
    bounds = {name: one.params[name] for name in ("low", "high") if family in PARENT}
    names = [name for name in known_figures(family) if name not in bounds]
    sets = itertools.combinations(names, 3 if family == "triangular" else 2)
    return [
        {name: figure(one, name) for name in chosen} | bounds
        for chosen in sets
        if len({name.startswith("parent_") for name in chosen}) == 1
    ]
