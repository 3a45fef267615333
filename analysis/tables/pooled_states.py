"""The model of every response and state of a density: inputs, packing and own noise, fitted to all its runs at once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from ..inputs.joint import Joint
from ..results.reader import Results, Runs
from ..surrogates import surrogate
from ..surrogates.basis import fewest_fitted, fewest_runs
from ..surrogates.surrogate import Surrogate

#: States and quantities that are pooled.
POOLED = (("peak", "eta"), ("critical", "eta"), ("critical", "e"), ("critical", "Z"), ("critical", "Phi_dev"),
          ("peak", "D_p"), ("probe", "G_0"))  # fmt: skip


class PooledState(NamedTuple):
    """A quantity of a state at a density: its model and samples (m, d) of the inputs."""

    mu_iso: float
    state: str
    symbol: str
    model: Surrogate
    samples: np.ndarray


def state_model(results: Results, state: str, symbol: str, mu_iso: float, family: str = "coupled") -> Surrogate | None:
    """Model (one row) of a quantity at a state, in SI units; None with too few runs.  It is fitted once."""
    key = ("state model", state, symbol, f"{mu_iso:g}", family)
    return results.cached(key, lambda: model_of(results, results.runs_at(state, symbol, mu_iso, family), family))


def curve_model(results: Results, symbol: str, mu_iso: float, family: str = "coupled") -> Surrogate | None:
    """Model (T rows) of a response along strain, in SI units; None with too few runs.  It is fitted once."""
    key = ("curve model", symbol, f"{mu_iso:g}", family)
    return results.cached(key, lambda: model_of(results, results.runs_along(symbol, mu_iso, family), family))


def model_of(results: Results, runs: Runs, family: str = "coupled") -> Surrogate | None:
    """Model of the values of single runs; None with fewer than `fewest_fitted` of them, 5 for two inputs."""
    inputs = results.family_points(family).x[runs.place]
    if np.isfinite(runs.values).sum(axis=-1).min() < fewest_fitted(inputs.shape[1]):
        return None
    return surrogate.fit(inputs, runs.values, runs.packing)


def runs_needed(results: Results) -> int:
    """Runs of a density from which on errors are claimed from its model: 12 for two inputs, more for more."""
    return fewest_runs(len(results.points.names))


def pooled_states(results: Results, power: int, fewest: int = 0) -> Iterator[PooledState]:
    """Every pooled state of every density with so many runs, with 2^power samples of the joint inputs.

    fewest: by default `runs_needed`.
    """
    fewest = fewest or runs_needed(results)
    if not results.inputs["joint"]:
        return
    samples = joint_samples(results, power)
    for mu_iso in results.family_densities():
        for state, symbol in POOLED:
            if symbol not in results.state_symbols(state, mu_iso):
                continue
            values = results.measured(state, symbol, mu_iso)
            if np.isfinite(values).sum() >= fewest and np.nanstd(values) > 0:
                model = state_model(results, state, symbol, mu_iso)
                if model is not None:
                    yield PooledState(mu_iso, state, symbol, model, samples)


def joint_samples(results: Results, power: int) -> np.ndarray:
    """2^power samples (m, d) of the joint inputs, from Sobol' points."""
    joint = Joint.from_dict(results.inputs["joint"])
    return joint.inverse_rosenblatt(qmc.Sobol(joint.dimension, seed=1).random_base2(power))
