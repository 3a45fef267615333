"""The states that are pooled over the points of a density by a response surface over (mu_s, G_p)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from ..inputs.joint import Joint
from ..pdem import weighted
from ..results.reader import Results
from ..surrogates import surrogate
from ..surrogates.surrogate import FEWEST_RUNS, Surrogate

#: States and quantities that are pooled.
POOLED = (("peak", "eta"), ("critical", "eta"), ("critical", "e"), ("critical", "Z"), ("critical", "Phi_dev"),
          ("peak", "D_p"), ("probe", "G_0"))  # fmt: skip


class PooledState(NamedTuple):
    """A quantity of a state at a density: its surface, samples (m, 2) of the inputs, sd of the points."""

    mu_iso: float
    state: str
    symbol: str
    surface: Surrogate
    samples: np.ndarray
    spread: float


def pooled_states(results: Results, power: int) -> Iterator[PooledState]:
    """Every pooled state of every density with at least 12 runs, with 2^power samples of the joint inputs."""
    if not results.inputs["joint"]:
        return
    samples = joint_samples(results, power)
    points = results.family_points()
    for mu_iso in results.family_densities():
        for state, symbol in POOLED:
            if symbol not in results.state_symbols(state, mu_iso):
                continue
            values = results.measured(state, symbol, mu_iso)
            spread = float(weighted.std(results.shown_state(state, symbol, mu_iso), results.probability(mu_iso)))
            if np.isfinite(values).sum() >= FEWEST_RUNS and spread > 0:
                yield PooledState(mu_iso, state, symbol, surrogate.fit(points.x, values), samples, spread)


def joint_samples(results: Results, power: int) -> np.ndarray:
    """2^power samples (m, 2) of the fitted joint inputs, from Sobol' points."""
    return Joint.from_dict(results.inputs["joint"]).inverse_rosenblatt(qmc.Sobol(2, seed=1).random_base2(power))
