"""The numbers behind the claims: statistics of one family's points, as they are or drawn anew.

Each function takes {family: Sample} and returns one number, NaN where the campaign cannot give it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import special, stats

from analysis import paper, pdem, triaxial, weighted
from analysis.packing_noise import common_curves, common_error, own_error
from analysis.unrun import values_drawn

#: Half-width, in strain, over which mean curves are smoothed.
SMOOTHER = 0.04
#: Response surfaces drawn for points that were not run.
SURFACES = 100


@dataclass(frozen=True)
class Sample:
    """One family's points, drawn once: states and curves of D densities at Q points, with weights (D, Q).

    shift (D,) is the error that all points of a density share, in units of `packing_noise.common_error`; zeros: none.
    surface: which of the response surfaces that the runs would also allow gives points that were not run; -1: theirs.
    luck: seed of what else is drawn, errors along strain and of what packings add; -1: nothing is.
    """

    results: object
    family: str
    densities: tuple[float, ...]
    index: np.ndarray
    shift: np.ndarray
    store: dict
    surface: int = -1
    luck: int = -1

    @property
    def weight(self):
        """Weights (D, Q) of the drawn points, each density's summing to 1."""
        drawn = self._load("weight", self.results.weights)[:, self.index]
        total = drawn.sum(axis=1, keepdims=True)
        return drawn / np.where(total > 0, total, np.nan)

    def state(self, state, symbol):
        """Values (D, Q) of a quantity at a state, with the densities' common errors; NaN if drawn and these unknown."""
        values = self.values(state, symbol)
        if not self.shift.any():
            return values
        if (state, symbol, "common") not in self.store:
            self.store[state, symbol, "common"] = common_error(self.results, state, symbol, self.family)[0]
        return values + (self.shift * self.store[state, symbol, "common"])[:, None]

    def values(self, state, symbol):
        """Values (D, Q) without common errors, for numbers that these leave as they are."""
        if self.surface < 0:
            return self._load((state, symbol), partial(self.results.state, state, symbol))[:, self.index]
        read = partial(values_drawn, self.results, state, symbol, n=SURFACES)
        return self._load((state, symbol, "drawn"), read)[:, self.surface][:, self.index]

    def noise(self, state, symbol, k):
        """Variance that packings add to single points (`packing_noise.own_error`) of density k; 0 if nothing tells it.

        If drawn, what it may as well be: times the estimate's degrees of freedom over a chi-squared number of so many.
        """
        key = (state, symbol, k, "own")
        if key not in self.store:
            self.store[key] = own_error(self.results, state, symbol, self.densities[k], self.family)
        variance, freedom = self.store[key]
        if self.luck >= 0 and freedom:
            rng = np.random.default_rng([self.luck, k, *f"{state}/{symbol}".encode()])
            variance *= freedom / rng.chisquare(freedom)
        return np.nan_to_num(variance)

    def spread(self, state, symbol):
        """Standard deviation (D,) of a quantity at a state over all points, not those drawn."""
        values = self._load((state, symbol), partial(self.results.state, state, symbol))
        return weighted.std(values, self._load("weight", self.results.weights))

    def curve(self, symbol):
        """Values (D, T, Q) along strain, with an error common to all points if drawn; NaN then where none is known."""
        read = self.results.response
        values = self._load(symbol, lambda *where: read(symbol, *where).values)[:, :, self.index]
        return values if self.luck < 0 else values + self._common(symbol)[:, :, None]

    def _common(self, symbol):
        """A drawn error (D, T) along strain that all points of a density share; NaN where there are no replicates."""
        if (symbol, "common") not in self.store:
            self.store[symbol, "common"] = [common_curves(self.results, symbol, mu_iso, self.family)
                                            for mu_iso in self.densities]  # fmt: skip
        unknown = np.full(len(self.results.strain), np.nan)
        return np.array([unknown if curves is None
                         else np.random.default_rng([self.luck, k]).normal(size=len(curves)) @ curves
                         for k, curves in enumerate(self.store[symbol, "common"])])  # fmt: skip

    @property
    def smoother(self):
        """Matrix (T, T) that smooths a curve along strain, over 4 % to either side."""
        strain = self.results.strain
        if "smoother" not in self.store:
            self.store["smoother"] = triaxial.smooth(strain, np.eye(len(strain)), width=SMOOTHER)
        return self.store["smoother"]

    def consolidated(self, symbol):
        """Values and weights after consolidation, one pair a density."""
        key = ("consolidated", symbol)
        if key not in self.store:
            self.store[key] = [self.results.consolidated(symbol, mu_iso) for mu_iso in self.densities]
        return self.store[key]

    def driver(self, symbol):
        """Values (Q,) of an input at the points."""
        return self._load(("points", symbol), None)[self.index]

    def _load(self, key, read):
        if key not in self.store:
            if read is None:
                self.store[key] = self.results.family_points(self.family)[key[1]].to_numpy()
            else:
                self.store[key] = np.array([read(mu_iso, self.family) for mu_iso in self.densities])
        return self.store[key]


def full_sample(results, family):
    """All points of a family as they are, without common errors."""
    count = len(results.family_points(family))
    densities = results.family_densities(family)
    return Sample(results, family, densities, np.arange(count), np.zeros(len(densities)), {})


def drawn_sample(sample, rng):
    """The same points drawn with replacement, with errors that all points of a density share."""
    count = len(sample.index)
    index, shift = rng.integers(count, size=count), rng.normal(size=len(sample.densities))
    return replace(sample, index=index, shift=shift, surface=int(rng.integers(SURFACES)), luck=int(rng.integers(2**31)))


def _distance(sample, state, symbol, a, b):
    """Wasserstein distance of two densities over the mean standard deviation of all their points."""
    values, weight = sample.state(state, symbol)[[a, b]], sample.weight[[a, b]]
    spread = sample.spread(state, symbol)[[a, b]].mean()
    return weighted.wasserstein(*values, *weight) / spread if spread > 0 else np.nan


def largest_distance(samples, states, symbol):
    """Largest Wasserstein distance of two densities, at any of the states, over the mean of their two spreads."""
    sample, count = samples["coupled"], len(samples["coupled"].densities)
    pairs = [(a, b) for a in range(count) for b in range(a)]
    return max(_distance(sample, state, symbol, a, b) for state in states for a, b in pairs) if pairs else np.nan


def packings_tell(samples, states, symbol):
    """Whether replicate packings tell what a quantity at the states differs by between packings."""
    sample = samples["coupled"]
    freedom = [common_error(sample.results, state, symbol, sample.family)[1] for state in states]
    return all(0 < f < np.inf for f in freedom)


def end_distance(samples, state, symbol):
    """Wasserstein distance of the densest and the loosest over the mean standard deviation of the two."""
    sample = samples["coupled"]
    return _distance(sample, state, symbol, 0, -1) if len(sample.densities) > 1 else np.nan


def share_within(samples, state, symbol, mu_iso, low, high):
    """Probability of a range under the points with their kernel, as the shown density has it."""
    sample = samples["coupled"]
    k = sample.densities.index(mu_iso)
    values, weight = sample.state(state, symbol)[k], sample.weight[k]
    known = np.isfinite(values)
    if not known.any():
        return np.nan
    values, weight = values[known], weight[known] / weight[known].sum()
    width = max(pdem.kernel_width(values[None], weight[None])[0], 1e-9 * abs(high))
    return weight @ (special.ndtr((high - values) / width) - special.ndtr((low - values) / width))


def effect_of_G_p(samples, alone):
    """Change of critical eta by one standard deviation of ln G_p over the spread of eta with both varying, signed.

    alone: by regression on ln G_p in the family with mu_s fixed; otherwise on ln mu_s (quadratic) and ln G_p.  The mean
    of the densities, whose slopes scatter by more than they can differ.
    """
    both, sample = samples["coupled"], samples["G_p" if alone else "coupled"]
    effects = [slope * spread for slope, spread in _slopes_on_G_p(sample, sample.values("critical", "eta"), alone)]
    spread = max(weighted.std(both.values("critical", "eta"), both.weight))
    return np.mean(effects) / spread if spread > 0 else np.nan


def _slopes_on_G_p(sample, values, alone):
    """Per density: slope of values (D, Q) on ln G_p, unless alone beside ln mu_s (quadratic), and ln G_p's spread."""
    log_G, log_mu = np.log(sample.driver("G_p")), np.log(sample.driver("mu_s"))
    for found, weight in zip(values, sample.weight, strict=True):
        known = np.isfinite(found) & (weight > 0)
        columns = [np.ones(known.sum()), log_G[known]] + ([] if alone else [log_mu[known], log_mu[known] ** 2])
        root = np.sqrt(weight[known])
        slope = np.linalg.lstsq(np.stack(columns, 1) * root[:, None], found[known] * root, rcond=None)[0][1]
        yield slope, weighted.std(log_G, weight)


def stiffness_exponent(samples):
    """Least exponent of G_0 in G_p over the densities: slope of ln G_0 on ln G_p beside ln mu_s (quadratic)."""
    sample = samples["coupled"]
    return min(slope for slope, _ in _slopes_on_G_p(sample, np.log(sample.values("probe", "G_0")), alone=False))


def stiffness_gain(samples):
    """Mean of G_0 of the densest over G_0 of the loosest at the same point, minus one."""
    values = samples["coupled"].state("probe", "G_0")
    return weighted.mean(values[0] / values[-1] - 1, samples["coupled"].weight[0]) if len(values) > 1 else np.nan


def least_correlation(samples, symbol, sign):
    """Least correlation over the densities of critical eta with a quantity (sign 1) or with its negative (sign -1)."""
    sample = samples["coupled"]
    pairs = zip(sample.values("critical", "eta"), sample.values("critical", symbol), sample.weight, strict=True)
    return min(sign * weighted.correlation(eta, other, weight) for eta, other, weight in pairs)


def steady_strain(samples, symbol, tolerance):
    """Strain beyond which the smoothed mean of every density stays within a relative tolerance of its final average.

    Judged where the smoothing has rows on both sides: at the end of the record it follows the last few.
    """
    sample = samples["coupled"]
    strain = sample.results.strain
    if strain[-1] < paper.STEADY_STRAIN + 2 * triaxial.CORRELATION_STRAIN:
        return np.nan
    last = strain >= max(paper.STEADY_STRAIN, 0.75 * strain[-1])
    starts = []
    for values, weight in zip(sample.curve(symbol), sample.weight, strict=True):
        mean = sample.smoother @ weighted.mean(values, weight)
        if not np.isfinite(mean).all():
            return np.nan
        final = mean[last].mean()
        off = np.flatnonzero((np.abs(mean / final - 1) > tolerance) & (strain <= strain[-1] - SMOOTHER))
        starts.append(strain[min(off[-1] + 1, len(strain) - 1)] if len(off) else strain[0])
    return max(starts)


def _grading_values(samples):
    sample = samples["coupled"]
    return [(sample.state(state, symbol), sample.weight) for state in ("peak", "critical")
            for symbol in ("I_G_active", "I_G_stress")]  # fmt: skip


def grading_distance(samples):
    """Largest distance of a mean of I_G_active or I_G_stress from the paper's index, at peak and critical state."""
    return max(np.max(np.abs(weighted.mean(v, w) - paper.GRADING_INDEX)) for v, w in _grading_values(samples))


def grading_cov(samples):
    """Largest coefficient of variation of I_G_active and I_G_stress, at peak and critical state.

    What packings add to single points is no variation with the grains' properties: where replicates tell it, it is
    taken off, in the squares.
    """
    sample, found = samples["coupled"], []
    for state in ("peak", "critical"):
        for symbol in ("I_G_active", "I_G_stress"):
            values, weight = sample.values(state, symbol), sample.weight
            for k in range(len(sample.densities)):
                noise = sample.noise(state, symbol, k) / weighted.mean(values[k], weight[k]) ** 2
                found.append(np.sqrt(max(weighted.cov(values[k], weight[k]) ** 2 - noise, 0.0)))
    return max(found)


def grading_noise_is_known(samples):
    """Whether replicates tell what packings add to I_G_active and I_G_stress at all states and densities."""
    sample = samples["coupled"]
    return all(own_error(sample.results, state, symbol, mu_iso, sample.family)[1] > 0
               for state in ("peak", "critical") for symbol in ("I_G_active", "I_G_stress")
               for mu_iso in sample.densities)  # fmt: skip


def never(samples):
    """Of a number that noise alone can take past any limit, as the last of many values that may leave a range is."""
    return False


def _initial(samples, symbol):
    """Means (D,) after consolidation with their error: the relative scatter of consolidations, pooled over densities.

    Widened by Student's t for its degrees of freedom.  With one consolidation a density nothing tells the error, and a
    drawn sample is NaN.
    """
    sample = samples["coupled"]
    sets = sample.consolidated(symbol)
    freedom = sum(len(values) - 1 for values, _ in sets)
    means = np.array([values @ weight if len(values) else np.nan for values, weight in sets])
    if freedom < 1:
        return means if not sample.shift.any() else np.full(len(means), np.nan)
    squares = sum(np.sum((values / mean - 1) ** 2) for (values, _), mean in zip(sets, means, strict=True))
    error = np.sqrt(squares / freedom) * stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)
    return means * (1 + sample.shift * error / np.sqrt([len(values) for values, _ in sets]))


def initial_step(samples):
    """Least relative step of e, e_m (up) and Z, Z_m (down) between neighbouring densities after consolidation."""
    steps = []
    for symbol, sign in (("e", 1), ("e_m", 1), ("Z", -1), ("Z_m", -1)):
        mean = _initial(samples, symbol)
        steps.extend(sign * np.diff(mean) / mean[1:])
    return min(steps)


def initial_difference(samples):
    """Largest relative difference of the initial means from Table 3."""
    places = {mu_iso: k for k, mu_iso in enumerate(samples["coupled"].densities)}
    return max(abs(_initial(samples, symbol)[places[mu_iso]] / mean - 1)
               for (symbol, mu_iso), (mean, _) in paper.INITIAL_STATE.items() if mu_iso in places)  # fmt: skip


def initial_cov(samples):
    """Largest coefficient of variation of e, e_m, Z and Z_m after consolidation; NaN if points share it."""
    sample = samples["coupled"]
    sets = [one for symbol in ("e", "e_m", "Z", "Z_m") for one in sample.consolidated(symbol)]
    runs = sample.results.runs
    if ((runs["stage"] == "consolidate") & (runs["point"] < 0)).any() or not all(len(values) for values, _ in sets):
        return np.nan
    return max(weighted.cov(values, weight) for values, weight in sets)
