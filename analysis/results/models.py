"""The model of every response and state of a density: inputs, packing and own noise, fitted to all its runs at once.

`state_moments` gives what the tables, the report and `Results.quote` show of a state: mean, standard deviation and
quantiles with intervals.  Every place that shows one of these numbers takes it from there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from ..inputs.joint import Joint
from ..inputs.measurements import measurements_behind, refitted_joints
from ..surrogates import surrogate
from ..surrogates.basis import fewest_fitted, fewest_runs
from ..surrogates.distribution import QUANTILE_LEVELS, Distribution, moments_and_quantiles
from ..surrogates.surrogate import Surrogate
from .friction_angle import friction_angle
from .reader import Results, Runs

#: Fewest runs of a density whose moments have intervals, with up to three inputs (`runs_with_moments`).
FEWEST = 8
#: log2 of the samples of the inputs, and the number of refits of the inputs (`inputs.measurements`).
POWER, REFITS = 9, 200
#: Stresses whose values in undrained tests may span decades, and the largest ratio of two values that have a model.
STRESSES, SPAN = ("p", "q", "u", "r_u", "s_u"), 5.0
#: Symbol of the friction angle, which is computed from the stress ratio of every run.
ANGLE = "phi"


class StateMoments(NamedTuple):
    """Moments and quantiles of a quantity at a state, in SI units (friction angles in degrees).

    `runs_share`: share of the squared width of the interval of the mean that more or larger runs could remove; the rest
    is due to the number of measurements behind the inputs.  `packings`: their number; with one or two the intervals
    lack what all points share through them.
    """

    distribution: Distribution
    runs_share: float
    packings: int


def state_runs(results: Results, state: str, symbol: str, mu_iso: float, family: str = "coupled") -> Runs:
    """Values of a quantity at a state in the single runs, in SI units; friction angles (`ANGLE`) in degrees."""
    if symbol != ANGLE:
        return results.runs_at(state, symbol, mu_iso, family)
    runs = results.runs_at(state, "eta", mu_iso, family)
    return runs._replace(values=friction_angle(runs.values, results.loading.direction))


def state_model(results: Results, state: str, symbol: str, mu_iso: float, family: str = "coupled") -> Surrogate | None:
    """Model (one row) of a quantity at a state, in SI units; None with too few runs.  It is fitted once."""
    key = ("state model", state, symbol, f"{mu_iso:g}", family)
    return results.cached(key, lambda: model_of(results, state_runs(results, state, symbol, mu_iso, family), family))


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


def joint_samples(results: Results, power: int) -> np.ndarray:
    """2^power samples (m, d) of the joint inputs, from Sobol' points."""
    joint = Joint.from_dict(results.inputs["joint"])
    return joint.inverse_rosenblatt(qmc.Sobol(joint.dimension, seed=1).random_base2(power))


def has_model(results: Results, state: str, symbol: str, mu_iso: float, fewest: int = 0) -> bool:
    """Whether a quantity at a state is in the file, varies, and has so many runs; False without a joint distribution.

    fewest: by default `runs_with_moments`.  False for a stress of undrained tests that varies by more than SPAN: no
    polynomial follows it.
    """
    fewest = fewest or runs_with_moments(results)
    of_file = "eta" if symbol == ANGLE else symbol
    if not results.inputs["joint"] or of_file not in results.state_symbols(state, mu_iso):
        return False
    values = results.measured(state, of_file, mu_iso)
    known = values[np.isfinite(values)]
    if len(known) < fewest or not np.nanstd(values) > 0:
        return False
    if not results.loading.is_undrained:
        return True
    if symbol in STRESSES:
        return bool(known.min() * known.max() > 0 and 1 / SPAN <= known.min() / known.max() <= SPAN)
    return symbol != "e" or bool(np.ptp(known) > 1e-9)


def state_moments(results: Results, state: str, symbol: str, mu_iso: float) -> StateMoments | None:
    """Moments and quantiles of a quantity at a state of a density; None with too few runs (`runs_with_moments`).

    The intervals contain the error of the model and that of the inputs, if the number of measurements behind them is
    known.  Of a state that not all tests reached, they are those of the points that did.  Computed once.
    """
    key = ("state moments", state, symbol, f"{mu_iso:g}")
    return results.cached(key, lambda: _state_moments(results, state, symbol, mu_iso))


def _state_moments(results: Results, state: str, symbol: str, mu_iso: float) -> StateMoments | None:
    model = state_model(results, state, symbol, mu_iso) if has_model(results, state, symbol, mu_iso) else None
    if model is None:
        return None
    behind: int | None = measurements_behind(results.inputs, results.pairs)
    if results.holds_for(state, "eta" if symbol == ANGLE else symbol, mu_iso) < 1.0:
        samples, probability, refits = _reached(results, state, symbol, mu_iso)
        behind = None if refits is None else behind
    else:
        samples = results.cached(("samples of the inputs", POWER), lambda: joint_samples(results, POWER))
        probability, refits = None, input_refits(results)
    found = moments_and_quantiles(model, samples, probability, levels=QUANTILE_LEVELS, refits=refits, pairs=behind)
    return StateMoments(found, float(found.runs_share[0]), model.packings)


def _reached(
    results: Results, state: str, symbol: str, mu_iso: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Inputs (m, d) and probabilities (m,) of the points that reached a state, and those under refits (B, m)."""
    reached = np.isfinite(state_runs(results, state, symbol, mu_iso).values)
    refitted = results.bootstrap_probability(mu_iso)
    of_points = results.family_points().x[reached], results.probability(mu_iso)[reached]
    return *of_points, None if refitted is None else refitted[:, reached]


def input_refits(results: Results) -> np.ndarray | None:
    """Samples (B, m, d) of the refitted inputs; None if they are not refitted.  Computed once."""
    return results.cached("refits of the inputs", lambda: _refits(results))


def _refits(results: Results) -> np.ndarray | None:
    """Samples (B, m, d) of the refitted inputs, with common random numbers; None if they are not refitted."""
    joints = refitted_joints(results.inputs, results.pairs, REFITS)
    if not joints:
        return None
    uniforms = qmc.Sobol(joints[0].dimension, seed=1).random_base2(POWER)
    return np.stack([joint.inverse_rosenblatt(uniforms) for joint in joints])
