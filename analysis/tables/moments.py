"""Mean, standard deviation and quantiles of the states with 95 % intervals, denoised and as simulated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
from scipy.stats import qmc

from ..inputs.measurements import measurements_behind, refitted_joints
from ..quantities import QUANTITIES
from ..results.models import runs_with_moments
from ..results.reader import Results
from ..surrogates.distribution import QUANTILE_LEVELS, Distribution, moments_and_quantiles
from ..surrogates.surrogate import Surrogate
from .columns import QUANTILES, unit, with_interval
from .pooled_states import pooled_states

#: log2 of the samples of the inputs, and of those through each refit of the inputs.
POWER, REFITS = 9, 200
DENOISED, AS_SIMULATED = "denoised", "as simulated"
NUMBERS = ("mean", "sd", *QUANTILES)


def moments(results: Results) -> pd.DataFrame:
    """Moments and quantiles of every state per density with 95 % intervals, twice, in displayed units.

    `kind`: "denoised", what the inputs do, from the model without the noise of packings and runs; "as simulated", what
    one specimen of the simulated number of spheres does.  The intervals contain the error of the model and that of the
    inputs (`inputs.measurements`), if the number of measurements behind them is known.  `runs_share`: share of the
    squared width of the interval of the mean that more or larger runs could remove; the rest is due to the number of
    measurements.  `packings`: their number; with one or two the intervals lack what all points share through them.
    """
    rows = []
    for mu_iso, state, symbol, model, samples in pooled_states(results, POWER, runs_with_moments(results)):
        factor = QUANTITIES[symbol].shown_factor
        found, runs_share = with_refits(results, model, samples)
        for kind, numbers in kinds(found):
            rows.append((mu_iso, state, symbol, unit(symbol), kind, *(factor * numbers), runs_share, model.packings))
    columns = ["mu_iso", "state", "quantity", "unit", "kind", *(c for n in NUMBERS for c in with_interval(n))]
    return pd.DataFrame(rows, columns=[*columns, "runs_share", "packings"])


def with_refits(results: Results, model: Surrogate, samples: np.ndarray) -> tuple[Distribution, float]:
    """Distribution of a model over the inputs with the error of their refits, and the share of the runs in that."""
    plain = moments_and_quantiles(model, samples, levels=QUANTILE_LEVELS)
    refits = input_refits(results)
    if refits is None:
        return plain, 1.0
    found = moments_and_quantiles(model, samples, levels=QUANTILE_LEVELS, refits=refits,
                                  pairs=measurements_behind(results.inputs, results.pairs))  # fmt: skip
    wide, narrow = (float(d.denoised.high[0, 0] - d.denoised.low[0, 0]) for d in (found, plain))
    return found, min((narrow / wide) ** 2, 1.0) if wide > 0 else np.nan


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


def kinds(found: Distribution) -> Iterator[tuple[str, np.ndarray]]:
    """Kind and its numbers, each followed by low and high."""
    for kind, estimate in ((DENOISED, found.denoised), (AS_SIMULATED, found.as_simulated)):
        yield kind, np.stack([estimate.value[0], estimate.low[0], estimate.high[0]], axis=1).ravel()
