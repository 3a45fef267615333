"""Moments and quantiles of a response over the inputs, with intervals: denoised and as simulated, and variance shares.

Denoised is the distribution of f(X), what the inputs do.  As simulated is that of f(X) + packing + own noise, what one
specimen of the simulated size does.  An interval contains the error of f, of the packings and of the noise (draws of
the model), and that of the inputs where refits of their distribution are given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special, stats

from ..pdem import weighted
from .surrogate import LEVEL, Draws, Surrogate

QUANTILE_LEVELS = (0.05, 0.5, 0.95)
#: Most that `error_of_inputs` scales a deviation by: a refit may have next to no scatter.
MOST_SCALED = 10.0
#: Values of the noise per sample, one from each of as many equally probable parts of its distribution.
_STRATA = 4


@dataclass(frozen=True)
class Estimate:
    """Values (T, S) with the bounds low and high (T, S) of their 95 % intervals."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True)
class Distribution:
    """Columns of `denoised` and `as_simulated`: mean, standard deviation, then the quantiles at `levels`.

    shares: columns inputs, packing, own noise, as shares of the variance as simulated; NaN where packing and own noise
    are not separated.  runs_share (T,): share of the squared width of the interval of the denoised mean that the error
    of the model has, which more or larger runs could remove; the rest is that of the inputs.
    """

    levels: tuple[float, ...]
    denoised: Estimate
    as_simulated: Estimate
    shares: Estimate
    runs_share: np.ndarray


def moments_and_quantiles(
    model: Surrogate,
    samples: ArrayLike,
    probability: ArrayLike | None = None,
    levels: Sequence[float] = QUANTILE_LEVELS,
    refits: ArrayLike | None = None,
    pairs: int | None = None,
    n: int = 400,
    rng: np.random.Generator | None = None,
) -> Distribution:
    """Distribution of every row of the model over samples (m, d) of the inputs, or points with probability (m,).

    refits: for the error of the inputs, either samples (B, m, d) of refitted distributions (common random numbers
    reduce the scatter) or probabilities (B, m) of the same points; pairs: the number of measured pairs behind them.
    `error_of_inputs` says how they are used.
    An interval of a mean or quantile is symmetric about the estimate, that of a standard deviation in its logarithm;
    its half width is the larger distance of the two quantiles of the draws.  The reason is that draws of f on a plateau
    scatter to one side of the estimate only.
    Raises ValueError for refits of another shape, or refits without pairs.
    """
    found = sampled(model, samples, probability, levels, refits, pairs, n, rng)
    centre, of_model = found.centre, _half_width(found.of_model)
    half = of_model if found.of_inputs is None else _half_width(found.of_model + found.of_inputs)
    denoised, simulated = (Estimate(*(_shown(part) for part in (c, c - h, c + h)))
                           for c, h in zip(centre, half, strict=True))  # fmt: skip
    whole = np.where(half[0, :, 0] > 0, half[0, :, 0], np.nan)
    runs_share = np.minimum((of_model[0, :, 0] / whole) ** 2, 1.0)
    shares = _shares(model, found.drawn, centre + found.of_model)
    return Distribution(tuple(levels), denoised, simulated, shares, runs_share)


@dataclass(frozen=True)
class Sampled:
    """Statistics of a model, denoised and as simulated, with their errors.

    centre (2, T, S): mean, logarithm of the standard deviation, quantiles; of_model and of_inputs (n, 2, T, S): their
    deviations in n draws of the model, and by n refits of the inputs (None: the inputs are taken as known); drawn: the
    draws of the model.
    """

    centre: np.ndarray
    of_model: np.ndarray
    of_inputs: np.ndarray | None
    drawn: Draws


def sampled(
    model: Surrogate,
    samples: ArrayLike,
    probability: ArrayLike | None = None,
    levels: Sequence[float] = QUANTILE_LEVELS,
    refits: ArrayLike | None = None,
    pairs: int | None = None,
    n: int = 400,
    rng: np.random.Generator | None = None,
) -> Sampled:
    """The numbers behind `moments_and_quantiles`; arguments and errors as there."""
    rng = np.random.default_rng(0) if rng is None else rng
    samples = np.asarray(samples, float)
    equal = np.full(len(samples), 1.0 / len(samples))
    weight = equal if probability is None else weighted.normalised(probability)
    inside = (rng.permutation(len(samples)) + 0.5) / len(samples)
    noise = special.ndtri((np.arange(_STRATA)[:, None] + inside) / _STRATA)
    basis = model.basis(samples)
    centre = _statistics(model, basis, noise, weight, levels)
    drawn = model.draws(n, rng)
    found = np.stack([_statistics(drawn[k], basis, noise, weight, levels) for k in range(n)])
    of_inputs = None
    if refits is not None:
        refits = np.asarray(refits, float)
        if pairs is None or pairs < 2 or refits.shape[1] != len(samples) or refits.ndim > 3:
            raise ValueError(f"refits {refits.shape} of {pairs} pairs do not fit {len(samples)} samples")
        parts = []
        for k, refit in enumerate(refits):
            at, weights = (basis, weighted.normalised(refit)) if refit.ndim == 1 else (model.basis(refit), equal)
            parts.append(_statistics(drawn[k % n], at, noise, weights, levels))
        same = np.arange(len(parts))
        of_inputs = error_of_inputs(np.stack(parts), found[same % n], pairs)[np.arange(n) % len(parts)]
    return Sampled(centre, found - centre, of_inputs, drawn)


def error_of_inputs(refitted: np.ndarray, fitted: np.ndarray, pairs: int) -> np.ndarray:
    """Deviations (B, ..., S) that stand for the error of statistics whose inputs are fitted to n measured pairs.

    refitted (B, ..., S): mean, logarithm of the standard deviation, then quantiles, with B refits to resamples of the
    pairs; fitted: the same with the fit itself (broadcast).  The bootstrap of few pairs is too narrow: deviations are
    multiplied by Student's t over the normal quantile, and by sqrt(n / (n - 1)).  A sample whose 95 % quantile is too
    low mostly has too little scatter as well, and its own bootstrap then shows too little error of that quantile: the
    deviation of a quantile is therefore divided by the refit's root mean square distance from this quantile and
    multiplied by that of the fit (a Studentised bootstrap).
    """
    off = refitted - fitted
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = _distance(fitted) / _distance(refitted)
    off[..., 2:] *= np.clip(np.nan_to_num(scale, nan=1.0), 1 / MOST_SCALED, MOST_SCALED)
    wide = stats.t.ppf(0.5 + LEVEL / 2, pairs - 1) / stats.norm.ppf(0.5 + LEVEL / 2) * np.sqrt(pairs / (pairs - 1))
    return wide * (off - off.mean(axis=0))


def _distance(statistics: np.ndarray) -> np.ndarray:
    """Root mean square distance of a distribution from each of its quantiles, from statistics (..., S)."""
    return np.hypot(statistics[..., 2:] - statistics[..., :1], np.exp(statistics[..., 1:2]))


def difference(first: Sampled, second: Sampled, same_inputs: bool) -> tuple[Estimate, Estimate]:
    """Second minus first, denoised and as simulated: mean, standard deviation, quantiles, with 95 % intervals.

    The errors of the two models are independent: the draws must come from different seeds. same_inputs: both are
    refitted to the same resamples of the same pairs, so that their errors from the inputs cancel as far as the
    responses to the inputs agree; otherwise these errors are independent, too.
    """
    centre = _shown(second.centre) - _shown(first.centre)
    parts = []
    for found, shuffled in ((first, False), (second, not same_inputs)):
        off = found.of_model
        if found.of_inputs is not None:
            order = np.random.default_rng(2).permutation(len(off)) if shuffled else slice(None)
            off = off + found.of_inputs[order]
        parts.append(_shown(found.centre + off))
    half = _half_width(parts[1] - parts[0] - centre)
    denoised, simulated = (Estimate(c, c - h, c + h) for c, h in zip(centre, half, strict=True))
    return denoised, simulated


def _half_width(off: np.ndarray) -> np.ndarray:
    """Half width of the interval of deviations (n, ...): the larger distance of their two quantiles from zero."""
    return np.abs(np.quantile(off, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2], axis=0)).max(axis=0)


def _statistics(model, basis, noise, weight, levels):
    """Mean, log of the standard deviation and quantiles (2, T, S), denoised and as simulated.

    model: the fitted one or a draw; basis (m, M) at the samples; noise (strata, m): standard normals.
    """
    f = model.coefficients @ basis.T
    packing = np.nan_to_num(model.noise_packing)[:, None]
    own = np.sqrt(model.noise[:, None] ** 2 - packing**2) * model.basis.growth(basis[:, 1], model.growth)
    scatter = np.hypot(own, packing)
    noisy = (f[:, None, :] + scatter[:, None, :] * noise).reshape(len(f), -1)
    mean, sd = weighted.moments(f, weight)
    with np.errstate(divide="ignore"):
        moments = [[mean, np.log(sd)], [mean, 0.5 * np.log(sd**2 + scatter**2 @ weight)]]
    quantiles = [_quantiles(f, weight, levels), _quantiles(noisy, np.tile(weight, len(noise)) / len(noise), levels)]
    return np.stack([np.column_stack([*m, q]) for m, q in zip(moments, quantiles, strict=True)])


def _quantiles(values, weight, levels):
    """`weighted.quantiles`, faster for equal weights."""
    if np.ptp(weight) > 0:
        return weighted.quantiles(values, weight, levels)
    return np.quantile(values, levels, axis=1, method="hazen").T


def _shown(statistics: np.ndarray) -> np.ndarray:
    """Statistics (..., S) with the standard deviation in place of its logarithm."""
    shown = statistics.copy()
    shown[..., 1] = np.exp(shown[..., 1])
    return shown


def _shares(model, drawn, found):
    """Shares of the variance of inputs, packing and own noise, with intervals from draws (n, 2, T, S)."""
    of_inputs = np.exp(2 * (found[:, 0, :, 1] - found[:, 1, :, 1]))
    total = np.maximum(np.exp(2 * found[:, 1, :, 1]), 1e-300)
    packing = drawn.noise_packing**2 / total
    own = 1.0 - of_inputs - packing
    separated = np.isfinite(model.noise_packing)
    parts = np.stack([of_inputs, packing, np.where(separated, own, np.nan)], axis=-1)
    return Estimate(*np.quantile(parts, [0.5, 0.5 - LEVEL / 2, 0.5 + LEVEL / 2], axis=0))
