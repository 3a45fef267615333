"""Uncertainty of PDFs and their moments: bands from packing noise, from the response surface and from the pairs.

Each draw is one campaign that is as plausible as the real one: a response surface drawn from its distribution given the
runs (regression, or the scatter of replicate packings), with inputs refitted to a bootstrap sample of the pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from . import evolution
from .pdf import PDF
from .weighted import moments, normalised

LEVEL = 0.95
#: Fewer bootstrap samples than this give no useful standard error.
FEWEST_BOOTSTRAPS = 50


class ResponseSurface(Protocol):
    """What the bands need of a response surface; `surrogates.Surrogate` has it."""

    @property
    def coefficients(self) -> np.ndarray:
        """Coefficients (T, M) of the basis functions."""

    def basis(self, inputs: ArrayLike) -> np.ndarray:
        """Values (n, M) of the basis functions at the inputs (n, 2)."""

    def draws(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Coefficients (n, T, M) drawn from their distribution given the runs."""

    def with_known_noise(self, noise: ArrayLike) -> ResponseSurface:
        """The surface with a known standard deviation (T,) of a single run."""


@dataclass(frozen=True)
class MomentBands:
    """Mean and standard deviation (T,) of a response with their bands at `level`; *_error are standard errors.

    noise_part (T,) is the share of the squared error of the mean that comes from the runs; the rest comes from the
    pairs.
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


def surface_moment_bands(
    surface: ResponseSurface,
    samples: ArrayLike,
    bootstrap: ArrayLike,
    rng: np.random.Generator,
    level: float = LEVEL,
    noise: ArrayLike | None = None,
) -> MomentBands:
    """Bands of mean and standard deviation from a response surface, the fitted inputs and their bootstrap.

    samples (m, 2) from the fitted joint distribution; bootstrap (B, n, 2), one sample from each refitted distribution,
    B >= 50 (common random numbers reduce the scatter); noise (T,): standard deviation of a single run from replicates,
    instead of that of the regression.  The band of the standard deviation is symmetric in its logarithm.
    Raises ValueError for a bootstrap of another shape.
    """
    bootstrap = np.asarray(bootstrap, float)
    if bootstrap.ndim != 3 or len(bootstrap) < FEWEST_BOOTSTRAPS:
        raise ValueError(
            f"bands: bootstrap samples have the shape {bootstrap.shape}, expected (B >= {FEWEST_BOOTSTRAPS}, n, 2)"
        )
    surface = surface if noise is None else surface.with_known_noise(noise)
    draws = surface.draws(len(bootstrap), rng)
    mean, std = _surface_moments(surface, samples, surface.coefficients)
    both = np.array([_surface_moments(surface, x, c) for x, c in zip(bootstrap, draws, strict=True)])
    mean_by_runs = draws @ surface.basis(samples).mean(axis=0)
    mean_error = both[:, 0].std(axis=0, ddof=1)
    log_error = np.log(np.maximum(both[:, 1], 1e-300)).std(axis=0, ddof=1)
    half_width = stats.norm.ppf(0.5 + 0.5 * level)
    total = np.where(mean_error > 0, mean_error, 1.0) ** 2
    return MomentBands(
        level=level,
        mean=mean,
        mean_low=mean - half_width * mean_error,
        mean_high=mean + half_width * mean_error,
        std=std,
        std_low=std * np.exp(-half_width * log_error),
        std_high=std * np.exp(half_width * log_error),
        mean_error=mean_error,
        std_error=std * log_error,
        noise_part=np.minimum(mean_by_runs.var(axis=0, ddof=1) / total, 1.0),
    )


def _surface_moments(
    surface: ResponseSurface, samples: ArrayLike, coefficients: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (T,) over samples (m, 2) of a surface with these coefficients (T, M)."""
    basis = surface.basis(samples)
    middle = basis.mean(axis=0)
    off = basis - middle
    spread = off.T @ off / len(off)
    variance = np.einsum("tm,mk,tk->t", coefficients, spread, coefficients)
    return coefficients @ middle, np.sqrt(np.maximum(variance, 0.0))


def reweighted_moment_bands(
    values: ArrayLike, probabilities: ArrayLike, level: float = LEVEL
) -> tuple[np.ndarray, np.ndarray]:
    """Bands (2, ...), low and high, of the mean and of the standard deviation of values (..., Q).

    probabilities (B, Q), one row per refitted input, as from `points.bootstrap_probabilities`; points whose value is
    NaN drop out.
    """
    values = np.asarray(values, float)[..., None, :]
    probability = normalised(probabilities, np.isfinite(values))
    mean, std = moments(values, probability)
    tails = [0.5 - 0.5 * level, 0.5 + 0.5 * level]
    return np.quantile(mean, tails, axis=-1), np.quantile(std, tails, axis=-1)


def with_input_band(pdf: PDF, values: ArrayLike, probabilities: np.ndarray, level: float = LEVEL) -> PDF:
    """The PDF of points with values (T, Q), with a pointwise band low, high (T, X) from probabilities (B, Q).

    With kernels of the width of the PDF, the quantiles of the refitted PDFs over their mean are the band over p; points
    without a value (NaN) drop out.
    """
    values = np.asarray(values, float)
    tails = [0.5 - 0.5 * level, 0.5 + 0.5 * level]
    low, high = np.empty_like(pdf.p), np.empty_like(pdf.p)
    for k, (dx, edge) in enumerate(zip(pdf.dx, pdf.edges[:, 0], strict=True)):
        known = np.isfinite(values[k])
        probability = normalised(probabilities[:, known])
        path = ((values[k, known] - edge) / dx)[:, None]
        width = np.full(len(path), pdf.shown_width[k] / dx)
        kernels = evolution.translate(path, np.ones_like(path), width, pdf.p.shape[1]) / dx
        refitted = probability @ kernels
        middle = refitted.mean(axis=0)
        change = np.quantile(refitted, tails, axis=0) / np.where(middle > 0, middle, 1.0)
        low[k], high[k] = pdf.p[k] * np.where(middle > 0, change, 1.0)
    return replace(pdf, low=low, high=high)
