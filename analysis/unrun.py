"""Points that were not run: their values are a response surface's, and no more certain than it."""

from __future__ import annotations

import numpy as np

from analysis import surrogate
from analysis.results import read_results


def values_drawn(results, state, symbol, mu_iso, family="coupled", n=100, seed=5) -> np.ndarray:
    """Values (n, Q) of a quantity at a state; points that were not run, anew each time.

    From n response surfaces that the runs would also allow (`surrogate.Surrogate.draws`), without single runs' scatter,
    as the filled values are.
    """
    results = read_results(results)
    values = np.tile(results.state(state, symbol, mu_iso, family), (n, 1))
    filled = results.filled(mu_iso, family, state) & np.isfinite(values[0])
    if filled.any():
        inputs = results.family_points(family)[["mu_s", "G_p"]].to_numpy()
        surface = surrogate.fit(inputs, np.where(filled, np.nan, values[0]))
        drawn = surface.draws(n, np.random.default_rng(seed))[:, 0] @ surface.basis(inputs).T
        values[:, filled] = drawn[:, filled]
    return values
