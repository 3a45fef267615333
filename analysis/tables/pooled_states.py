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
#: Those of undrained tests.
POOLED_UNDRAINED = (("transformation", "eta"), ("peak", "eta"), ("strength", "s_u"), ("critical", "eta"),
                    ("critical", "p"), ("critical", "Z"), ("critical", "Phi_dev"), ("probe", "G_0"))  # fmt: skip


def pooled(results: Results) -> tuple[tuple[str, str], ...]:
    """States and quantities of a campaign that are pooled."""
    return POOLED_UNDRAINED if results.loading.is_undrained else POOLED


class PooledState(NamedTuple):
    """A quantity of a state at a density: its model and samples (m, d) of the inputs."""

    mu_iso: float
    state: str
    symbol: str
    model: Surrogate
    samples: np.ndarray


def pooled_states(results: Results, power: int, fewest: int = 0) -> Iterator[PooledState]:
    """Every pooled state of every density with so many runs, with 2^power samples of the joint inputs.

    fewest: by default `runs_needed`.  A state that not all tests of a density reached is left out, because its model is
    not that of all inputs.
    """
    if not results.inputs["joint"]:
        return
    samples, fewest = joint_samples(results, power), fewest or runs_needed(results)
    for mu_iso in results.family_densities():
        for state, symbol in pooled(results):
            if has_model(results, state, symbol, mu_iso, fewest) and results.holds_for(state, symbol, mu_iso) == 1.0:
                model = state_model(results, state, symbol, mu_iso)
                if model is not None:
                    yield PooledState(mu_iso, state, symbol, model, samples)
