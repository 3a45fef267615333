"""The statistics behind the claims: numbers of one family's points, denoised or as one draw of the model.

Each statistic takes {family: Sample} and returns one number, NaN where the campaign cannot give it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import special, stats

from ..inputs.variables import NEEDED
from ..pdem import weighted
from ..quantities import CONSOLIDATED
from ..results.reader import Results
from ..runs import peak_critical
from ..surrogates.surrogate import Surrogate
from . import published
from .pooled_states import curve_model, state_model

#: Half-width, in strain, over which mean curves are smoothed.
SMOOTHER = 0.04
#: Draws of the model.
DRAWS = 200
#: States and quantities of the grading indices that the paper states.
GRADING = [(state, symbol) for state in ("peak", "critical") for symbol in ("I_G_active", "I_G_stress")]


@dataclass(frozen=True, eq=False)
class Sample:
    """One family's Q points at D densities, with the denoised values (`draw` None) or those of one draw of the model.

    Arrays have the densities first.  `scale` multiplies the differences of the densities from their mean
    (`claims.inverted`).  With one packing, the model does not know what the points share through it: a draw then also
    shifts each density by a normal error, the standard error of one run, as if all of it were shared.
    """

    results: Results
    family: str
    densities: tuple[float, ...]
    draw: int | None = None
    scale: float = 1.0

    @property
    def probability(self) -> np.ndarray:
        """Probabilities (D, Q) of the points; those of each density sum to 1."""
        return self._once("probability", lambda: self._stack(self.results.probability))

    def inputs(self, name: str) -> np.ndarray:
        """Values (Q,) of an input at the points."""
        return self._once(("inputs", name), lambda: self.results.family_points(self.family)[name])

    def state(self, state: str, symbol: str) -> np.ndarray:
        """Values (D, Q) of a quantity at a state; NaN where there are too few runs for a model."""
        if self.draw is None:
            return self.values(state, symbol)
        return self.values(state, symbol) + self._once(("state", state, symbol), lambda: None)[2][:, self.draw, None]

    def values(self, state: str, symbol: str) -> np.ndarray:
        """Values (D, Q) for numbers that an error which all points of a density share does not change."""
        fitted, drawn, _ = self._once(("state", state, symbol), lambda: self._state(state, symbol))
        values = fitted if self.draw is None else drawn[:, self.draw]
        return values + (self.scale - 1.0) * (fitted - fitted.mean(axis=0))

    def curve(self, symbol: str) -> np.ndarray:
        """Mean (D, T) of a response along strain."""
        fitted, drawn = self._once(("curve", symbol), lambda: self._curve(symbol))
        return fitted if self.draw is None else drawn[:, self.draw]

    def noise(self, state: str, symbol: str) -> np.ndarray:
        """Standard deviations (D,) of a single run about the denoised values."""
        models = self.models(state, symbol)
        return np.array([np.nan if model is None else model.noise[0] for model in models])

    def models(self, state: str, symbol: str) -> list[Surrogate | None]:
        """The model of a quantity at a state, per density."""
        return [state_model(self.results, state, symbol, mu_iso, self.family) for mu_iso in self.densities]

    def consolidated(self, symbol: str) -> list[tuple[np.ndarray, np.ndarray]]:
        """Values and probabilities after consolidation, one pair per density."""
        return self._once(
            ("consolidated", symbol), lambda: [self.results.consolidated(symbol, mu_iso) for mu_iso in self.densities]
        )

    def smoother(self) -> np.ndarray:
        """Matrix (T, T) that smooths a curve along strain, over 4 % to either side."""
        strain = self.results.strain
        return self._once("smoother", lambda: peak_critical.smooth(strain, np.eye(len(strain)), width=SMOOTHER))

    def _state(self, state: str, symbol: str) -> tuple[np.ndarray, ...]:
        """Denoised values (D, Q), draws (D, DRAWS, Q), and shifts (D, DRAWS) where there is one packing."""
        parts, points = [], self.results.family_points(self.family).x
        for k, model in enumerate(self.models(state, symbol)):
            if model is None:
                unknown = np.full(len(points), np.nan)
                parts.append((unknown, np.tile(unknown, (DRAWS, 1)), np.zeros(DRAWS)))
                continue
            rng, shift = np.random.default_rng([k, *f"{state}/{symbol}".encode()]), np.zeros(DRAWS)
            if model.packings == 1:
                error = self.results.state_error(state, symbol, self.densities[k], self.family)
                scale = np.nan if error is None else np.sqrt(np.nanmean(error**2))
                shift = scale * rng.normal(size=DRAWS)
            parts.append((model.predict(points)[0], model.draws(DRAWS, rng).predict(points)[:, 0], shift))
        return tuple(np.array(part) for part in zip(*parts, strict=True))

    def _curve(self, symbol: str) -> tuple[np.ndarray, np.ndarray]:
        """Denoised means (D, T) and draws (D, DRAWS, T); draws are NaN where packings are not known."""
        parts, points = [], self.results.family_points(self.family).x
        for mu_iso, probability in zip(self.densities, self.probability, strict=True):
            model = curve_model(self.results, symbol, mu_iso, self.family)
            if model is None:
                unknown = np.full(len(self.results.strain), np.nan)
                parts.append((unknown, np.tile(unknown, (DRAWS, 1))))
                continue
            mean = model.basis(points).T @ probability
            drawn = model.draws(DRAWS, np.random.default_rng(1)).coefficients @ mean
            parts.append((model.coefficients @ mean, drawn if model.knows_packings else np.full_like(drawn, np.nan)))
        fitted, drawn = (np.array(part) for part in zip(*parts, strict=True))
        return fitted, drawn

    def _stack(self, read: Callable[..., np.ndarray]) -> np.ndarray:
        return np.array([read(mu_iso, self.family) for mu_iso in self.densities])

    def _once(self, key: Any, make: Callable[[], Any]) -> Any:
        return self.results.cached(("claims", self.family, key), make)


Samples = dict[str, Sample]


def sample(results: Results, family: str, draw: int | None = None) -> Sample:
    """The points of a family, denoised or as one draw of the model."""
    return Sample(results, family, results.family_densities(family), draw)


def _largest(values: Iterable[float]) -> float:
    """The largest value; NaN if one is not known or there is none (Python's `max` depends on the order then)."""
    listed = list(values)
    return float(np.max(listed)) if listed else np.nan


def _least(values: Iterable[float]) -> float:
    """The least value; NaN if one is not known or there is none."""
    return -_largest(-value for value in values)


def _distance(sample: Sample, state: str, symbol: str, a: int, b: int) -> float:
    """Wasserstein distance of two densities over the mean standard deviation of their denoised values."""
    values, probability = sample.state(state, symbol)[[a, b]], sample.probability[[a, b]]
    denoised = replace(sample, draw=None, scale=1.0).state(state, symbol)[[a, b]]
    spread = float(np.mean(weighted.std(denoised, probability)))
    return weighted.wasserstein(*values, *probability) / spread if spread > 0 else np.nan


def largest_distance(samples: Samples, states: Sequence[str], symbol: str) -> float:
    """Largest Wasserstein distance of two densities, at any of the states, over the mean of their two spreads."""
    sample, count = samples["coupled"], len(samples["coupled"].densities)
    pairs = [(a, b) for a in range(count) for b in range(a)]
    return _largest(_distance(sample, state, symbol, a, b) for state in states for a, b in pairs)


def packing_noise_is_known(samples: Samples, states: Sequence[str], symbol: str) -> bool:
    """Whether there are enough packings to know how much of a difference between densities is due to them."""
    models = [model for state in states for model in samples["coupled"].models(state, symbol)]
    return all(model is not None and model.knows_packings for model in models)


def end_distance(samples: Samples, state: str, symbol: str) -> float:
    """Wasserstein distance of the densest and the loosest over the mean standard deviation of the two."""
    sample = samples["coupled"]
    return _distance(sample, state, symbol, 0, -1) if len(sample.densities) > 1 else np.nan


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
