"""What few measured pairs leave open: the inputs refitted to resampled pairs, carried to moments and PDFs as a band.

No run is repeated: the points stay, and every refitted joint distribution gives them other probabilities.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from analysis import pdem
from analysis.density import Density
from analysis.joint import Joint, bootstrap_joints
from analysis.points import reweighted
from analysis.pooling import POOLED
from analysis.quantities import QUANTITIES
from analysis.results import read_results

LEVEL = 0.95


def bootstrap_probabilities(pairs, joint: Joint, x, n_boot: int, seed: int = 1) -> np.ndarray:
    """Probabilities (n_boot, Q) of the points x (Q, 2) under the inputs refitted to resampled pairs (n, 2).

    Families stay those of `joint`; every row is positive and sums to 1.  Raises InputError for bad pairs.
    """
    refitted = bootstrap_joints(pairs, n_boot, np.random.default_rng(seed), joint)
    return np.array([reweighted(np.asarray(x, float), other) for other in refitted])


def moment_bands(values, probabilities, level: float = LEVEL) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest mean and standard deviation, two arrays (2, ...) each (low, high), of values (..., Q).

    probabilities (B, Q) as from `bootstrap_probabilities`; points whose value is NaN drop out.
    """
    values = np.asarray(values, float)
    share = np.isfinite(values)[..., None, :] * np.asarray(probabilities, float)
    share = share / share.sum(axis=-1, keepdims=True)
    known = np.where(np.isfinite(values), values, 0.0)[..., None, :]
    mean = np.sum(share * known, axis=-1)
    std = np.sqrt(np.sum(share * (known - mean[..., None]) ** 2, axis=-1))
    tails = [0.5 - 0.5 * level, 0.5 + 0.5 * level]
    return np.quantile(mean, tails, axis=-1), np.quantile(std, tails, axis=-1)


def with_input_band(density: Density, values, probabilities, level: float = LEVEL) -> Density:
    """The density of points with values (T, Q) with a pointwise band low, high (T, X) from probabilities (B, Q).

    The band is seen through the density's own kernel; points without a value (NaN) drop out.
    """
    values = np.asarray(values, float)
    tails = [0.5 - 0.5 * level, 0.5 + 0.5 * level]
    low, high = np.empty_like(density.p), np.empty_like(density.p)
    for k, (dx, edge) in enumerate(zip(density.dx, density.edges[:, 0], strict=True)):
        known = np.isfinite(values[k])
        share = probabilities[:, known] / probabilities[:, known].sum(axis=1, keepdims=True)
        path = ((values[k, known] - edge) / dx)[:, None]
        width = np.full(len(path), density.shown_width[k] / dx)
        kernels = pdem.translate(path, np.ones_like(path), width, density.p.shape[1]) / dx
        low[k], high[k] = np.quantile(share @ kernels, tails, axis=0)
    return replace(density, low=low, high=high)


def input_bands(results) -> pd.DataFrame:
    """Mean and standard deviation of every state per density with their 95 % bands from the pairs, in shown units.

    No rows for results without refitted inputs.
    """
    results = read_results(results)
    rows = []
    for mu_iso in results.family_densities():
        probabilities = results.bootstrap_weights(mu_iso)
        for state, symbol in POOLED if probabilities is not None else ():
            if symbol not in results.state_symbols(state, mu_iso):
                continue
            values = QUANTITIES[symbol].shown_factor * results.state(state, symbol, mu_iso)
            if np.isfinite(values).any():
                weight = np.where(np.isfinite(values), results.weights(mu_iso), 0.0)
                centre = [float(m) for m in pdem.moments(values, weight / weight.sum())]
                bands = [(float(low), float(high)) for low, high in moment_bands(values, probabilities)]
                rows.append((mu_iso, state, QUANTITIES[symbol].heading, centre[0], *bands[0], centre[1], *bands[1]))
    names = [f"{name}{end}" for name in ("mean", "sd") for end in ("", ", from", ", to")]
    return pd.DataFrame(rows, columns=["mu_iso", "state", "quantity", *names])
