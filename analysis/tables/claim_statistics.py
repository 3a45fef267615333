"""The statistics behind the claims: numbers of one family's points, denoised or as one draw of the model.

Each statistic takes {family: Sample} and returns one number, NaN where the campaign cannot give it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy import special, stats

from ..inputs.variables import NEEDED
from ..pdem import weighted
from ..quantities import CONSOLIDATED
from ..runs import peak_critical
from . import published
from .claim_samples import SMOOTHER, Sample, Samples

#: States and quantities of the grading indices that the paper states.
GRADING = [(state, symbol) for state in ("peak", "critical") for symbol in ("I_G_active", "I_G_stress")]


def _largest(values: Iterable[float]) -> float:
    """The largest value; NaN if one is not known or there is none (Python's `max` depends on the order then)."""
    listed = list(values)
    return float(np.max(listed)) if listed else np.nan


def _least(values: Iterable[float]) -> float:
    """The least value; NaN if one is not known or there is none."""
    return -_largest(-value for value in values)


def _distances(sample: Sample, state: str, symbol: str, pairs: Sequence[tuple[int, int]]) -> list[np.ndarray]:
    """Wasserstein distances of pairs of densities over the mean of their two spreads; one per draw."""
    values, probability = sample.state(state, symbol), sample.probability
    spread = sample.spread(state, symbol)
    return [
        weighted.wasserstein(values[a], values[b], probability[a], probability[b])
        / np.where(spread[a] + spread[b] > 0, 0.5 * (spread[a] + spread[b]), np.nan)
        for a, b in pairs
    ]


def largest_distance(samples: Samples, states: Sequence[str], symbol: str) -> np.ndarray | float:
    """Largest Wasserstein distance of two densities, at any of the states, over the mean of their two spreads."""
    sample, count = samples["coupled"], len(samples["coupled"].densities)
    pairs = [(a, b) for a in range(count) for b in range(a)]
    found = [distance for state in states for distance in _distances(sample, state, symbol, pairs)]
    return np.max(found, axis=0) if found else np.nan


def packing_noise_is_known(samples: Samples, states: Sequence[str], symbol: str) -> bool:
    """Whether there are enough packings to know how much of a difference between densities is due to them."""
    models = [model for state in states for model in samples["coupled"].models(state, symbol)]
    return all(model is not None and model.knows_packings for model in models)


def end_distance(samples: Samples, state: str, symbol: str) -> np.ndarray | float:
    """Wasserstein distance of the densest and the loosest over the mean standard deviation of the two."""
    sample = samples["coupled"]
    return _distances(sample, state, symbol, [(0, -1)])[0] if len(sample.densities) > 1 else np.nan


def share_within(samples: Samples, state: str, symbol: str, mu_iso: float, low: float, high: float) -> float:
    """Probability of a range for a specimen of the paper's size: the denoised points with the noise of such a run.

    That is the noise of a run here, which falls with the root of the number of spheres.
    """
    sample = samples["coupled"]
    k = sample.densities.index(mu_iso)
    values, probability, noise = sample.state(state, symbol)[k], sample.probability[k], sample.noise(state, symbol)[k]
    spheres = float(sample.results.runs.loc[sample.results.runs["N"] > 0, "N"].min())
    width = max(noise * min(np.sqrt(spheres / published.PARTICLES), 1.0), 1e-9 * abs(high))
    return float(probability @ (special.ndtr((high - values) / width) - special.ndtr((low - values) / width)))


def effect_of_G_p(samples: Samples, alone: bool) -> float:
    """Change of critical eta by one standard deviation of ln G_p, over the spread of eta with both varying; signed.

    alone: by regression on ln G_p in the family with mu_s fixed; otherwise on ln mu_s (quadratic), ln G_p and the
    logarithms of further inputs.  The mean
    of the densities, whose slopes scatter by more than they can differ.
    """
    both, sample = samples["coupled"], samples["G_p" if alone else "coupled"]
    effects = [slope * spread for slope, spread in _slopes_on_G_p(sample, sample.values("critical", "eta"), alone)]
    spread = _largest(weighted.std(both.values("critical", "eta"), both.probability))
    return float(np.mean(effects)) / spread if spread > 0 else math.nan


def _slopes_on_G_p(sample: Sample, values: np.ndarray, alone: bool) -> Iterator[tuple[float, float]]:
    """Per density: slope of values (D, Q) on ln G_p, unless alone beside the other inputs, and ln G_p's spread."""
    log_G, log_mu = np.log(sample.inputs("G_p")), np.log(sample.inputs("mu_s"))
    further = [np.log(sample.inputs(name)) for name in sample.results.points.names if name not in NEEDED]
    for of_density, probability in zip(values, sample.probability, strict=True):
        known = np.isfinite(of_density) & (probability > 0)
        if not known.any():
            yield np.nan, np.nan
            continue
        columns = [np.ones(known.sum()), log_G[known]] + (
            [] if alone else [log_mu[known], log_mu[known] ** 2, *(log[known] for log in further)]
        )
        root = np.sqrt(probability[known])
        slope = np.linalg.lstsq(np.stack(columns, 1) * root[:, None], of_density[known] * root, rcond=None)[0][1]
        yield slope, float(weighted.std(log_G, probability))


def stiffness_exponent(samples: Samples) -> float:
    """Least exponent of G_0 in G_p over the densities: slope of ln G_0 on ln G_p beside ln mu_s (quadratic)."""
    sample = samples["coupled"]
    with np.errstate(invalid="ignore"):  # a draw of a wide model may be negative, and then is not known
        logs = np.log(sample.values("probe", "G_0"))
    return _least(slope for slope, _ in _slopes_on_G_p(sample, logs, alone=False))


def stiffness_gain(samples: Samples) -> float:
    """Mean of G_0 of the densest over G_0 of the loosest at the same point, minus one."""
    values = samples["coupled"].state("probe", "G_0")
    if len(values) < 2:
        return np.nan
    return float(weighted.mean(values[0] / values[-1] - 1, samples["coupled"].probability[0]))


def least_correlation(samples: Samples, symbol: str, sign: int) -> float:
    """Least correlation over the densities of critical eta with a quantity (sign 1) or with its negative (sign -1)."""
    sample = samples["coupled"]
    pairs = zip(sample.values("critical", "eta"), sample.values("critical", symbol), sample.probability, strict=True)
    return _least(sign * weighted.correlation(eta, other, probability) for eta, other, probability in pairs)


def steady_strain(samples: Samples, symbol: str, tolerance: float) -> float:
    """Strain beyond which the smoothed mean of every density stays within a relative tolerance of its final average.

    Judged where the smoothing has rows on both sides: at the end of the record it follows the last few.
    """
    sample = samples["coupled"]
    strain = sample.results.strain
    if strain[-1] < published.STEADY_STRAIN + 2 * peak_critical.CORRELATION_STRAIN:
        return np.nan
    last = strain >= max(published.STEADY_STRAIN, 0.75 * strain[-1])
    starts = []
    for curve in sample.curve(symbol):
        mean = sample.smoother() @ curve
        if not np.isfinite(mean).all():
            return np.nan
        final = mean[last].mean()
        outside = np.flatnonzero((np.abs(mean / final - 1) > tolerance) & (strain <= strain[-1] - SMOOTHER))
        starts.append(strain[min(outside[-1] + 1, len(strain) - 1)] if len(outside) else strain[0])
    return _largest(starts)


def grading_distance(samples: Samples) -> float:
    """Largest distance of a mean of I_G_active or I_G_stress from the paper's index, at peak and critical state."""
    sample = samples["coupled"]
    means = [weighted.mean(sample.state(state, symbol), sample.probability) for state, symbol in GRADING]
    return _largest(float(np.max(np.abs(mean - published.GRADING_INDEX))) for mean in means)


def grading_cov(samples: Samples) -> float:
    """Largest coefficient of variation of I_G_active and I_G_stress with the inputs, at peak and critical state."""
    sample = samples["coupled"]
    return _largest(np.ravel([weighted.cov(sample.values(*of), sample.probability) for of in GRADING]))


def has_full_size(samples: Samples) -> bool:
    """Whether the runs have at least as many spheres as the paper's."""
    return bool(samples["coupled"].results.runs["N"].min() >= published.PARTICLES)


def never(samples: Samples) -> bool:
    """For a number that noise alone can take past any limit, such as the last of many values that may leave a range."""
    return False


def _initial(samples: Samples, symbol: str) -> np.ndarray:
    """Means (D,) after consolidation; a resample adds their error, from the scatter of consolidations.

    The relative scatter is pooled over the densities and widened by Student's t for its degrees of freedom.  With one
    consolidation per density the error is not known, and a resample is NaN.
    """
    sample = samples["coupled"]
    sets = sample.consolidated(symbol)
    freedom = sum(len(values) - 1 for values, _ in sets)
    means = np.array([values @ probability if len(values) else np.nan for values, probability in sets])
    if sample.draw is None:
        return means
    if freedom < 1:
        return np.full(len(means), np.nan)
    squares = sum(np.sum((values / mean - 1) ** 2) for (values, _), mean in zip(sets, means, strict=True))
    error = np.sqrt(squares / freedom) * stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)
    shift = np.random.default_rng([sample.draw, *symbol.encode()]).normal(size=len(means))
    return means * (1 + shift * error / np.sqrt([len(values) for values, _ in sets]))


def initial_step(samples: Samples) -> float:
    """Least relative step of e, e_m (up) and Z, Z_m (down) between neighbouring densities after consolidation.

    NaN with one density.
    """
    steps: list[float] = []
    for symbol, sign in (("e", 1), ("e_m", 1), ("Z", -1), ("Z_m", -1)):
        mean = _initial(samples, symbol)
        steps.extend(sign * np.diff(mean) / mean[1:])
    return _least(steps)


def initial_difference(samples: Samples) -> float:
    """Largest relative difference of the initial means from Table 3; NaN without a density of the paper's."""
    places = {mu_iso: k for k, mu_iso in enumerate(samples["coupled"].densities)}
    differences = (abs(_initial(samples, symbol)[places[mu_iso]] / mean - 1)
                   for (symbol, mu_iso), (mean, _) in published.INITIAL_STATE.items() if mu_iso in places)  # fmt: skip
    return _largest(differences)


def initial_cov(samples: Samples) -> float:
    """Largest coefficient of variation of e, e_m, Z and Z_m after consolidation, over the consolidations of a density.

    A draw divides each by the root of a chi-squared number over its degrees of freedom.  NaN with one consolidation.
    """
    sample, covs = samples["coupled"], []
    for symbol in CONSOLIDATED:
        for k, (values, _) in enumerate(sample.consolidated(symbol)):
            if len(values) < 2:
                return np.nan
            cov = float(values.std(ddof=1) / values.mean())
            if sample.draw is not None:
                rng = np.random.default_rng([sample.draw, k, *symbol.encode()])
                cov *= np.sqrt((len(values) - 1) / rng.chisquare(len(values) - 1))
            covs.append(cov)
    return _largest(covs)
