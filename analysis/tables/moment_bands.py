"""95 % bands of the means and standard deviations of the states: from the runs' noise and from the pairs."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import stats
from scipy.stats import qmc

from ..inputs.joint import Joint, bootstrap_joints
from ..inputs.pairs import FEWEST_PAIRS
from ..pdem import bands, weighted
from ..quantities import QUANTITIES
from ..results.reader import Results
from .columns import unit, with_interval
from .packing_noise import common_error
from .pooled_states import POOLED, pooled_states

#: log2 of the samples behind the means and standard deviations in the middle of the bands.
CENTRE_POWER = 12
COLUMNS = ["mu_iso", "state", "quantity", "unit", *with_interval("mean"), *with_interval("sd")]


def moment_bands(results: Results, n_boot: int = 200, power: int = 9, seed: int = 1) -> pd.DataFrame:
    """95 % bands of mean and standard deviation of every state, from the runs' noise and from the finite set of pairs.

    Both are those of the response surface, so the standard deviation contains no packing noise.  The inputs are
    refitted to n_boot resamples of the pairs.  The error that all points of a density share
    (`packing_noise.common_error`) is added to that of the mean where it is known (`packings`).  `runs_share` is the
    share of the mean's squared error that more or larger runs could remove; the rest comes from the pairs.  In
    displayed units.  The bands use 2^power samples per refitted input, their centre 2^12, because a steep surface needs
    as many.
    """
    columns = [*COLUMNS, "runs_share", "packings"]
    if not results.inputs["joint"] or len(results.pairs) < FEWEST_PAIRS:
        return pd.DataFrame(columns=columns)
    rng = np.random.default_rng(seed)
    uniforms = qmc.Sobol(2, seed=1).random_base2(power)
    fitted = Joint.from_dict(results.inputs["joint"])
    others = bootstrap_joints(results.pairs, n_boot, rng, fitted)
    drawn = np.stack([joint.inverse_rosenblatt(uniforms) for joint in others])
    densities, rows = results.family_densities(), []
    for mu_iso, state, symbol, surface, samples, _ in pooled_states(results, CENTRE_POWER):
        moments, factor = bands.surface_moment_bands(surface, samples, drawn, rng), QUANTITIES[symbol].shown_factor
        shared = common_error(results, state, symbol)[0][densities.index(mu_iso)]
        error = float(np.hypot(moments.mean_error[0], np.nan_to_num(shared)))
        of_pairs = moments.mean_error[0] ** 2 * (1 - moments.noise_part[0])
        mean, half = factor * moments.mean[0], factor * stats.norm.ppf(0.975) * error
        spread = [float(factor * part[0]) for part in (moments.std, moments.std_low, moments.std_high)]
        share, known = 1 - of_pairs / error**2, "in" if np.isfinite(shared) else "not known"
        rows.append((mu_iso, state, symbol, unit(symbol), mean, mean - half, mean + half, *spread, share, known))
    return pd.DataFrame(rows, columns=columns)


def input_bands(results: Results) -> pd.DataFrame:
    """Mean and standard deviation of every state per density with their 95 % bands from the pairs, in displayed units.

    The points keep their values; the inputs refitted to resampled pairs give them other probabilities.  No rows for
    results without refitted inputs.
    """
    rows = []
    for mu_iso in results.family_densities():
        refitted = results.bootstrap_probability(mu_iso)
        if refitted is None:
            continue
        for state, symbol in POOLED:
            if symbol not in results.state_symbols(state, mu_iso):
                continue
            values = QUANTITIES[symbol].shown_factor * results.shown_state(state, symbol, mu_iso)
            if np.isfinite(values).any():
                probability = weighted.normalised(results.probability(mu_iso), np.isfinite(values))
                mean, sd = (float(m) for m in weighted.moments(values, probability))
                of_mean, of_sd = bands.reweighted_moment_bands(values, refitted)
                numbers = (mean, float(of_mean[0]), float(of_mean[1]), sd, float(of_sd[0]), float(of_sd[1]))
                rows.append((mu_iso, state, symbol, unit(symbol), *numbers))
    return pd.DataFrame(rows, columns=COLUMNS)
