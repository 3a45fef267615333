"""The model of every response and state of a density: inputs, packing and own noise, fitted to all its runs at once."""

from __future__ import annotations

import numpy as np

from ..surrogates import surrogate
from ..surrogates.basis import fewest_fitted, fewest_runs
from ..surrogates.surrogate import Surrogate
from .reader import Results, Runs

#: Fewest runs of a density whose moments have intervals, with up to three inputs (`runs_with_moments`).
FEWEST = 8


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


def runs_with_moments(results: Results) -> int:
    """Fewest runs of a density whose moments have intervals and whose denoised PDF is shown.

    With more than three inputs, twice as many as the plane of the model has coefficients.
    """
    return max(FEWEST, 2 * len(results.points.names) + 2)
