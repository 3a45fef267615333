"""How sure a PDF and its moments are: bands from packing noise, from the response surface and from the measured pairs.

A draw is one campaign that could have happened as well: a response surface drawn from what the runs allow (regression,
or the scatter of replicate packings), under inputs refitted to a bootstrap sample of the pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from analysis import pdem
from analysis.density import Density


@dataclass(frozen=True)
class MomentBands:
    """Mean and standard deviation (T,) of a response with their bands at `level`; *_error are standard errors.

    noise_part (T,) is the share of the mean's squared error that comes from the runs, the rest from the pairs.
    """

    level: float
    mean: np.ndarray
    mean_low: np.ndarray
    mean_high: np.ndarray
    std: np.ndarray
    std_low: np.ndarray
    std_high: np.ndarray
    mean_error: np.ndarray
    std_error: np.ndarray
    noise_part: np.ndarray


def moment_bands(surface, samples, bootstrap, rng, level: float = 0.95, noise=None) -> MomentBands:
    """Bands of mean and standard deviation from a Surrogate, the fitted inputs and their bootstrap.

    samples (m, 2) from the fitted joint distribution; bootstrap (B, n, 2), one sample from each refitted one, B >= 50
    (common random numbers reduce scatter); noise (T,): standard deviation of a run from replicates, used in place of
    the regression's.  The standard deviation's band is symmetric in its logarithm.
    """
    bootstrap = np.asarray(bootstrap, float)
    if bootstrap.ndim != 3 or len(bootstrap) < 50:
        raise ValueError(f"bands: bootstrap samples have the shape {bootstrap.shape}, expected (B >= 50, n, 2)")
    surface = surface if noise is None else replace(surface, noise=np.asarray(noise, float), dof=surface.dof * 0 + 1e9)
    draws = surface.draws(len(bootstrap), rng)
    mean, std = _moments(surface, samples, surface.coefficients)
    both = np.array([_moments(surface, x, c) for x, c in zip(bootstrap, draws, strict=True)])
    runs = draws @ surface.basis(samples).mean(axis=0)
    mean_error = both[:, 0].std(axis=0, ddof=1)
    log_error = np.log(np.maximum(both[:, 1], 1e-300)).std(axis=0, ddof=1)
    wide = stats.norm.ppf(0.5 + 0.5 * level)
    total = np.where(mean_error > 0, mean_error, 1.0) ** 2
    return MomentBands(
        level=level,
        mean=mean,
        mean_low=mean - wide * mean_error,
        mean_high=mean + wide * mean_error,
        std=std,
        std_low=std * np.exp(-wide * log_error),
        std_high=std * np.exp(wide * log_error),
        mean_error=mean_error,
        std_error=std * log_error,
        noise_part=np.minimum(runs.var(axis=0, ddof=1) / total, 1.0),
    )


def with_bands(density: Density, surface, bootstrap, rng, level: float = 0.95) -> Density:
    """The density with a pointwise band low, high (T, X) on p, from the same draws and the density's own kernel.

    The kernel's bias is not in the band: it covers the true density seen through the same kernel.
    """
    bootstrap = np.asarray(bootstrap, float)
    draws = surface.draws(len(bootstrap), rng)
    basis = [surface.basis(x) for x in bootstrap]
    tails = [0.5 - 0.5 * level, 0.5 + 0.5 * level]
    low, high = np.empty_like(density.p), np.empty_like(density.p)
    weight = np.full(bootstrap.shape[:2], 1.0 / bootstrap.shape[1])
    cells = density.p.shape[1]
    for k, (dx, edge) in enumerate(zip(density.dx, density.edges[:, 0], strict=True)):
        path = np.stack([b @ c[k] for b, c in zip(basis, draws, strict=True)])
        path = np.clip((path - edge) / dx, 0.0, cells - 1e-9)
        p = pdem.translate(path, weight, np.full(len(path), density.bandwidth[k] / dx), cells) / dx
        low[k], high[k] = np.quantile(p, tails, axis=0)
    return replace(density, low=low, high=high)


def _moments(surface, samples, coefficients):
    basis = surface.basis(samples)
    middle = basis.mean(axis=0)
    off = basis - middle
    spread = off.T @ off / len(off)
    variance = np.einsum("tm,mk,tk->t", coefficients, spread, coefficients)
    return coefficients @ middle, np.sqrt(np.maximum(variance, 0.0))
