"""The statistics behind the claims: numbers of one family's points, as simulated or resampled.

Each statistic takes {family: Sample} and returns one number, NaN where the campaign cannot give it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import special, stats

from ..pdem import evolution, weighted
from ..quantities import CONSOLIDATED
from ..results.reader import Results
from ..runs import peak_critical
from . import published
from .packing_noise import common_curves, common_error, own_error, values_drawn

#: Half-width, in strain, over which mean curves are smoothed.
SMOOTHER = 0.04
#: Response surfaces drawn for points that were not run.
SURFACES = 100
#: States and quantities of the grading indices that the paper states.
GRADING = [(state, symbol) for state in ("peak", "critical") for symbol in ("I_G_active", "I_G_stress")]


@dataclass(frozen=True, eq=False)
class PointSet:
    """One family's Q points at D densities; every array is read from the results once.

    Arrays have the densities first: probability (D, Q), values (D, Q), curves (D, T, Q).
    """

    results: Results
    family: str
    densities: tuple[float, ...]
    _read: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def probability(self) -> np.ndarray:
        """Probabilities (D, Q) of the points at every density."""
        return self._once("probability", lambda: self._stack(self.results.probability))

    def inputs(self, name: str) -> np.ndarray:
        """Values (Q,) of mu_s or G_p at the points."""
        return self._once(("inputs", name), lambda: self.results.family_points(self.family)[name])

    def values(self, state: str, symbol: str) -> np.ndarray:
        """Values (D, Q) of a quantity at a state."""
        return self._once(
            ("values", state, symbol), lambda: self._stack(lambda *at: self.results.shown_state(state, symbol, *at))
        )

    def drawn_values(self, state: str, symbol: str) -> np.ndarray:
        """Values (D, SURFACES, Q) in which points that were not run are drawn (`packing_noise.values_drawn`)."""
        return self._once(
            ("drawn", state, symbol),
            lambda: self._stack(lambda m, family: values_drawn(self.results, state, symbol, m, family, SURFACES)),
        )

    def curves(self, symbol: str) -> np.ndarray:
        """Values (D, T, Q) of a response along strain."""
        return self._once(
            ("curves", symbol), lambda: self._stack(lambda *at: self.results.response(symbol, *at).values)
        )

    def common_error(self, state: str, symbol: str) -> tuple[np.ndarray, float]:
        """`packing_noise.common_error`: error (D,) that all points of a density may share, and degrees of freedom."""
        return self._once(
            ("common error", state, symbol), lambda: common_error(self.results, state, symbol, self.family)
        )

    def common_curves(self, symbol: str) -> list[np.ndarray | None]:
        """`packing_noise.common_curves` of every density."""
        return self._once(
            ("common curves", symbol),
            lambda: [common_curves(self.results, symbol, mu_iso, self.family) for mu_iso in self.densities],
        )

    def own_error(self, state: str, symbol: str, k: int) -> tuple[float, int]:
        """`packing_noise.own_error` of density k: variance that packings add to single points, degrees of freedom."""
        return self._once(
            ("own error", state, symbol, k),
            lambda: own_error(self.results, state, symbol, self.densities[k], self.family),
        )

    def consolidated(self, symbol: str) -> list[tuple[np.ndarray, np.ndarray]]:
        """Values and probabilities after consolidation, one pair per density."""
        return self._once(
            ("consolidated", symbol), lambda: [self.results.consolidated(symbol, mu_iso) for mu_iso in self.densities]
        )

    def smoother(self) -> np.ndarray:
        """Matrix (T, T) that smooths a curve along strain, over 4 % to either side."""
        strain = self.results.strain
        return self._once("smoother", lambda: peak_critical.smooth(strain, np.eye(len(strain)), width=SMOOTHER))

    def spread(self, state: str, symbol: str) -> np.ndarray:
        """Standard deviation (D,) of a quantity at a state over all points."""
        return weighted.std(self.values(state, symbol), self.probability())

    def _stack(self, read: Callable[..., np.ndarray]) -> np.ndarray:
        return np.array([read(mu_iso, self.family) for mu_iso in self.densities])

    def _once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        if key not in self._read:
            self._read[key] = make()
        return self._read[key]


@dataclass(frozen=True)
class Resample:
    """One bootstrap draw: which points, the shared error of each density, and what else is random.

    index (Q,): the points drawn with replacement.  shift (D,): the error that all points of a density share, in units
    of `packing_noise.common_error`.  surface: the response surface that gives the points that were not run.
    noise_seed: seed of the errors along strain and of the noise of packings.
    """

    index: np.ndarray
    shift: np.ndarray
    surface: int
    noise_seed: int


@dataclass(frozen=True)
class Sample:
    """The points of one family as simulated (`resample` None), or one bootstrap draw of them."""

    points: PointSet
    resample: Resample | None = None

    @property
    def densities(self) -> tuple[float, ...]:
        """The densities mu_iso, ascending."""
        return self.points.densities

    @property
    def probability(self) -> np.ndarray:
        """Probabilities (D, Q) of the drawn points; those of each density sum to 1."""
        return weighted.normalised(self._drawn(self.points.probability()))

    def inputs(self, name: str) -> np.ndarray:
        """Values (Q,) of mu_s or G_p at the drawn points."""
        return self._drawn(self.points.inputs(name))

    def state(self, state: str, symbol: str) -> np.ndarray:
        """Values (D, Q) of a quantity at a state, with the densities' shared errors; NaN where these are unknown."""
        values = self.values(state, symbol)
        if self.resample is None:
            return values
        return values + (self.resample.shift * self.points.common_error(state, symbol)[0])[:, None]

    def values(self, state: str, symbol: str) -> np.ndarray:
        """Values (D, Q) without shared errors, for numbers that these do not change."""
        if self.resample is None:
            return self._drawn(self.points.values(state, symbol))
        return self._drawn(self.points.drawn_values(state, symbol)[:, self.resample.surface])

    def noise(self, state: str, symbol: str, k: int) -> float:
        """Variance that packings add to single points of density k (`packing_noise.own_error`); 0 if not known.

        In a resample: that estimate times its degrees of freedom over a chi-squared number of as many.
        """
        variance, freedom = self.points.own_error(state, symbol, k)
        if self.resample is not None and freedom:
            rng = np.random.default_rng([self.resample.noise_seed, k, *f"{state}/{symbol}".encode()])
            variance *= freedom / rng.chisquare(freedom)
        return float(np.nan_to_num(variance))

    def curve(self, symbol: str) -> np.ndarray:
        """Values (D, T, Q) along strain; a resample adds an error common to all points, NaN where it is not known."""
        values = self._drawn(self.points.curves(symbol))
        return values if self.resample is None else values + self._common_curve(symbol)[:, :, None]

    def _drawn(self, values: np.ndarray) -> np.ndarray:
        return values if self.resample is None else values[..., self.resample.index]

    def _common_curve(self, symbol: str) -> np.ndarray:
        """A drawn error (D, T) along strain that all points of a density share; NaN where there are no replicates."""
        assert self.resample is not None
        unknown = np.full(len(self.points.results.strain), np.nan)
        return np.array([unknown if curves is None
                         else np.random.default_rng([self.resample.noise_seed, k]).normal(size=len(curves)) @ curves
                         for k, curves in enumerate(self.points.common_curves(symbol))])  # fmt: skip


Samples = dict[str, Sample]


def full_sample(results: Results, family: str) -> Sample:
    """All points of a family as they were simulated."""
    return Sample(PointSet(results, family, results.family_densities(family)))


def drawn_sample(sample: Sample, rng: np.random.Generator) -> Sample:
    """The same points drawn with replacement, with errors that all points of a density share."""
    count = len(sample.points.inputs("mu_s"))
    index, shift = rng.integers(count, size=count), rng.normal(size=len(sample.densities))
    surface, noise_seed = int(rng.integers(SURFACES)), int(rng.integers(2**31))
    return Sample(sample.points, Resample(index, shift, surface, noise_seed))


def _largest(values: Iterable[float]) -> float:
    """The largest value; NaN if one is not known or there is none (Python's `max` depends on the order then)."""
    listed = list(values)
    return float(np.max(listed)) if listed else np.nan


def _least(values: Iterable[float]) -> float:
    """The least value; NaN if one is not known or there is none."""
    return -_largest(-value for value in values)


def _distance(sample: Sample, state: str, symbol: str, a: int, b: int) -> float:
    """Wasserstein distance of two densities over the mean standard deviation of all their points."""
    values, probability = sample.state(state, symbol)[[a, b]], sample.probability[[a, b]]
    spread = sample.points.spread(state, symbol)[[a, b]].mean()
    return weighted.wasserstein(*values, *probability) / spread if spread > 0 else np.nan


def largest_distance(samples: Samples, states: Sequence[str], symbol: str) -> float:
    """Largest Wasserstein distance of two densities, at any of the states, over the mean of their two spreads."""
    sample, count = samples["coupled"], len(samples["coupled"].densities)
    pairs = [(a, b) for a in range(count) for b in range(a)]
    return _largest(_distance(sample, state, symbol, a, b) for state in states for a, b in pairs)


def packing_noise_is_known(samples: Samples, states: Sequence[str], symbol: str) -> bool:
    """Whether replicate packings measure the difference between packings of a quantity at the states."""
    return all(0 < samples["coupled"].points.common_error(state, symbol)[1] < np.inf for state in states)


def end_distance(samples: Samples, state: str, symbol: str) -> float:
    """Wasserstein distance of the densest and the loosest over the mean standard deviation of the two."""
    sample = samples["coupled"]
    return _distance(sample, state, symbol, 0, -1) if len(sample.densities) > 1 else np.nan


def share_within(samples: Samples, state: str, symbol: str, mu_iso: float, low: float, high: float) -> float:
    """Probability of a range under the points with kernels of the width of the shown PDF."""
    sample = samples["coupled"]
    k = sample.densities.index(mu_iso)
    values, probability = sample.state(state, symbol)[k], sample.probability[k]
    known = np.isfinite(values)
    if not known.any():
        return np.nan
    values, probability = values[known], weighted.normalised(probability[known])
    width = max(evolution.kernel_width(values[None], probability[None])[0], 1e-9 * abs(high))
    return probability @ (special.ndtr((high - values) / width) - special.ndtr((low - values) / width))


def effect_of_G_p(samples: Samples, alone: bool) -> float:
    """Change of critical eta by one standard deviation of ln G_p, over the spread of eta with both varying; signed.

    alone: by regression on ln G_p in the family with mu_s fixed; otherwise on ln mu_s (quadratic) and ln G_p.  The mean
    of the densities, whose slopes scatter by more than they can differ.
    """
    both, sample = samples["coupled"], samples["G_p" if alone else "coupled"]
    effects = [slope * spread for slope, spread in _slopes_on_G_p(sample, sample.values("critical", "eta"), alone)]
    spread = _largest(weighted.std(both.values("critical", "eta"), both.probability))
    return float(np.mean(effects)) / spread if spread > 0 else math.nan


def _slopes_on_G_p(sample: Sample, values: np.ndarray, alone: bool) -> Iterator[tuple[float, float]]:
    """Per density: slope of values (D, Q) on ln G_p, unless alone beside ln mu_s (quadratic), and ln G_p's spread."""
    log_G, log_mu = np.log(sample.inputs("G_p")), np.log(sample.inputs("mu_s"))
    for of_density, probability in zip(values, sample.probability, strict=True):
        known = np.isfinite(of_density) & (probability > 0)
        columns = [np.ones(known.sum()), log_G[known]] + ([] if alone else [log_mu[known], log_mu[known] ** 2])
        root = np.sqrt(probability[known])
        slope = np.linalg.lstsq(np.stack(columns, 1) * root[:, None], of_density[known] * root, rcond=None)[0][1]
        yield slope, float(weighted.std(log_G, probability))


def stiffness_exponent(samples: Samples) -> float:
    """Least exponent of G_0 in G_p over the densities: slope of ln G_0 on ln G_p beside ln mu_s (quadratic)."""
    sample = samples["coupled"]
    return _least(slope for slope, _ in _slopes_on_G_p(sample, np.log(sample.values("probe", "G_0")), alone=False))


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
    strain = sample.points.results.strain
    if strain[-1] < published.STEADY_STRAIN + 2 * peak_critical.CORRELATION_STRAIN:
        return np.nan
    last = strain >= max(published.STEADY_STRAIN, 0.75 * strain[-1])
    starts = []
    for values, probability in zip(sample.curve(symbol), sample.probability, strict=True):
        mean = sample.points.smoother() @ weighted.mean(values, probability)
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
    """Largest coefficient of variation of I_G_active and I_G_stress, at peak and critical state.

    The noise of packings is no variation with the grains' properties: where replicates measure it, it is subtracted, in
    the squares.
    """
    sample, covs = samples["coupled"], []
    for state, symbol in GRADING:
        values, probability = sample.values(state, symbol), sample.probability
        for k in range(len(sample.densities)):
            noise = sample.noise(state, symbol, k) / float(weighted.mean(values[k], probability[k])) ** 2
            covs.append(np.sqrt(max(float(weighted.cov(values[k], probability[k])) ** 2 - noise, 0.0)))
    return _largest(covs)


def grading_noise_is_known(samples: Samples) -> bool:
    """Whether replicates measure the noise of packings in I_G_active and I_G_stress at all states and densities."""
    points = samples["coupled"].points
    return all(points.own_error(*of, k)[1] > 0 for of in GRADING for k in range(len(points.densities)))


def never(samples: Samples) -> bool:
    """For a number that noise alone can take past any limit, such as the last of many values that may leave a range."""
    return False


def _initial(samples: Samples, symbol: str) -> np.ndarray:
    """Means (D,) after consolidation; a resample adds their error, from the scatter of consolidations.

    The relative scatter is pooled over the densities and widened by Student's t for its degrees of freedom.  With one
    consolidation per density the error is not known, and a resample is NaN.
    """
    sample = samples["coupled"]
    sets = sample.points.consolidated(symbol)
    freedom = sum(len(values) - 1 for values, _ in sets)
    means = np.array([values @ probability if len(values) else np.nan for values, probability in sets])
    if sample.resample is None:
        return means
    if freedom < 1:
        return np.full(len(means), np.nan)
    squares = sum(np.sum((values / mean - 1) ** 2) for (values, _), mean in zip(sets, means, strict=True))
    error = np.sqrt(squares / freedom) * stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)
    return means * (1 + sample.resample.shift * error / np.sqrt([len(values) for values, _ in sets]))


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
    """Largest coefficient of variation of e, e_m, Z and Z_m after consolidation; NaN if points share it."""
    points = samples["coupled"].points
    sets = [of_density for symbol in CONSOLIDATED for of_density in points.consolidated(symbol)]
    runs = points.results.runs
    if ((runs["stage"] == "consolidate") & (runs["point"] < 0)).any() or not all(len(values) for values, _ in sets):
        return np.nan
    return _largest(float(weighted.cov(values, probability)) for values, probability in sets)
