"""The states whose models the tables show, and samples of the inputs for them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from ..inputs.joint import Joint
from ..results.models import runs_needed, state_model
from ..results.reader import Results
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
