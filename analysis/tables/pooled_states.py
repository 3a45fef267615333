"""The states and quantities that tables compare with their model, each with samples of the inputs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..results.models import has_model, joint_samples, runs_needed, state_model
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
    if not results.inputs["joint"]:
        return
    samples, fewest = joint_samples(results, power), fewest or runs_needed(results)
    for mu_iso in results.family_densities():
        for state, symbol in POOLED:
            if has_model(results, state, symbol, mu_iso, fewest):
                model = state_model(results, state, symbol, mu_iso)
                if model is not None:
                    yield PooledState(mu_iso, state, symbol, model, samples)
