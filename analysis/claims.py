"""Each claim of the paper as a number of this campaign with a 95 % interval, and whether it holds at this size.

Intervals come from resampling the representative points, all densities together, with their probabilities; a point's
packing noise is resampled with it.  A claim is held if the whole interval meets its criterion, not held if none of it
does, and cannot be told otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from scipy import special

from analysis import paper, pdem, weighted
from analysis.results import read_results

HELD, NOT_HELD, OPEN = "held", "not held", "can't be told at this size"


@dataclass(frozen=True)
class Claim:
    """What the paper says, the number that tests it, and the criterion the number has to meet ("<=" or ">=")."""

    statement: str
    measure: str
    number: Callable
    sense: str
    limit: float


@dataclass(frozen=True)
class Sample:
    """One family's points, drawn once: states and curves of D densities at Q points, with weights (D, Q)."""

    results: object
    family: str
    densities: tuple[float, ...]
    index: np.ndarray
    store: dict

    @property
    def weight(self):
        """Weights (D, Q) of the drawn points, each density's summing to 1."""
        drawn = self._load("weight", self.results.weights)[:, self.index]
        total = drawn.sum(axis=1, keepdims=True)
        return drawn / np.where(total > 0, total, np.nan)

    def state(self, state, symbol):
        """Values (D, Q) of a quantity at a state."""
        read = partial(self.results.state, state, symbol)
        return self._load((state, symbol), read)[:, self.index]

    def curve(self, symbol):
        """Values (D, T, Q) of a response along strain."""
        read = self.results.response
        return self._load(symbol, lambda *where: read(symbol, *where).values)[:, :, self.index]

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


def claims_table(results, n_boot=200, seed=1) -> pd.DataFrame:
    """One row per claim: statement, measure, value, 95 % interval, criterion and verdict.

    results: a path or open results; n_boot resamplings of the points.  A claim whose quantities the campaign does not
    have, or whose number is not finite, cannot be told.
    """
    results = read_results(results)
    rng = np.random.default_rng(seed)
    draws = {family: rng.integers(n, size=(n_boot, n)) for family, n in _sizes(results).items()}
    base = {family: _sample(results, family) for family in draws}
    rows = []
    for claim in claims(results):
        value = _evaluate(claim, base)
        spread = [_evaluate(claim, {f: _drawn(s, draws[f][k]) for f, s in base.items()}) for k in range(n_boot)]
        low, high = np.quantile(spread, [0.025, 0.975]) if np.isfinite(spread).all() else (np.nan, np.nan)
        rows.append({"claim": claim.statement, "number": claim.measure, "value": value, "from": low, "to": high,
                     "criterion": f"{claim.sense} {claim.limit:g}",
                     "verdict": verdict(low, high, claim.sense, claim.limit)})  # fmt: skip
    return pd.DataFrame(rows)


def verdict(low, high, sense, limit) -> str:
    """Held, not held or open, for an interval low ... high against "<= limit" or ">= limit"."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return OPEN
    inside, outside = (high <= limit, low > limit) if sense == "<=" else (low >= limit, high < limit)
    return HELD if inside else NOT_HELD if outside else OPEN


def claims(results) -> list[Claim]:
    """The paper's claims as tests of this campaign; the criteria are this project's reading of its words."""
    out = []
    for symbol, name in (("eta", "stress ratio"), ("e", "void ratio"), ("e_m", "mechanical void ratio"),
                         ("Phi_dev", "fabric anisotropy")):  # fmt: skip
        out.append(Claim(f"At the critical state the PDFs of the {name} coincide for all densities",
                         "largest Wasserstein distance of two densities over the standard deviation, critical state",
                         partial(_largest_distance, state="critical", symbol=symbol), "<=", 0.25))  # fmt: skip
        out.append(Claim(f"At the peak the PDFs of the {name} differ between densities",
                         "Wasserstein distance of densest and loosest over the standard deviation, peak",
                         partial(_end_distance, state="peak", symbol=symbol), ">=", 0.5))  # fmt: skip
    out.append(Claim("The coordination number forgets the density",
                     "largest Wasserstein distance of two densities over the standard deviation, critical state",
                     partial(_largest_distance, state="critical", symbol="Z"), "<=", 0.25))  # fmt: skip
    for (state, symbol, mu_iso), (low, high) in paper.STATE_RANGE.items():
        if mu_iso in results.family_densities():
            share = partial(_share_within, state=state, symbol=symbol, mu_iso=mu_iso, low=low, high=high)
            out.append(Claim(f"{symbol} lies within {low:g}-{high:g} at the {state} state, mu_iso = {mu_iso:g}",
                             "probability of the shown density within the range", share, ">=", 0.9))  # fmt: skip
    alone = "G_p" in results.families
    out += [
        Claim("G_p alone hardly moves the stress ratio at large strain",
              "change of critical eta by one sd of ln G_p over the sd of eta with both varying, "
              + ("mu_s fixed" if alone else "by regression on ln mu_s and ln G_p"),
              partial(_effect_of_G_p, alone=alone), "<=", 0.2),
        Claim("G_p moves the small-strain stiffness", "least correlation of ln G_0 with ln G_p over the densities",
              _stiffness_follows_G_p, ">=", 0.8),
        Claim("Dense samples have the higher G_0", "mean of G_0 densest over G_0 loosest at the same point, minus 1",
              _stiffness_gain, ">=", 0.0),
        Claim("A higher critical eta goes with a larger void ratio", "least correlation of eta and e of any density",
              partial(_least_correlation, symbol="e", sign=1), ">=", 0.5),
        Claim("A higher critical eta goes with a smaller coordination number",
              "least correlation of eta and -Z of any density", partial(_least_correlation, symbol="Z", sign=-1),
              ">=", 0.5),
        Claim("The critical state is reached by 25 % strain", "strain beyond which every density's mean eta stays "
              "within 3 % of its final average", partial(_steady_strain, symbol="eta", tolerance=0.03), "<=",
              paper.STEADY_STRAIN),
        Claim("The void ratio is steady by 25 % strain", "strain beyond which every density's mean e stays within "
              "1 % of its final average", partial(_steady_strain, symbol="e", tolerance=0.01), "<=",
              paper.STEADY_STRAIN),
        Claim("I_G_active and I_G_stress are about 1.19 at peak and critical state",
              "largest distance of a mean from 1.19", _grading_distance, "<=", 0.01),
        Claim("I_G_active and I_G_stress hardly vary (COV about 0.001)", "largest COV", _grading_cov, "<=", 0.002),
        Claim("e and e_m grow and Z and Z_m fall with mu_iso", "least relative step between neighbouring densities, "
              "initial state", _initial_step, ">=", 0.0),
        Claim("The initial states are those of Table 3", "largest relative difference of means",
              _initial_difference, "<=", 0.05),
        Claim("Initial states of one density hardly vary (COV at most 0.011)", "largest COV of e, e_m, Z, Z_m",
              _initial_cov, "<=", 0.011),
    ]  # fmt: skip
    return out


def _evaluate(claim, samples):
    try:
        return float(claim.number(samples))
    except (ValueError, KeyError):
        return float("nan")


def _sizes(results):
    return {family: len(results.family_points(family)) for family in results.families if family in ("coupled", "G_p")}


def _sample(results, family):
    count = len(results.family_points(family))
    return Sample(results, family, results.family_densities(family), np.arange(count), {})


def _drawn(sample, index):
    return Sample(sample.results, sample.family, sample.densities, index, sample.store)


def _distance(values, weight, a, b):
    spread = np.mean(weighted.std(values[[a, b]], weight[[a, b]]))
    return weighted.wasserstein(values[a], values[b], weight[a], weight[b]) / spread if spread > 0 else np.nan


def _largest_distance(samples, state, symbol):
    values, weight = samples["coupled"].state(state, symbol), samples["coupled"].weight
    count = len(values)
    return max(_distance(values, weight, a, b) for a in range(count) for b in range(a)) if count > 1 else np.nan


def _end_distance(samples, state, symbol):
    values = samples["coupled"].state(state, symbol)
    return _distance(values, samples["coupled"].weight, 0, -1) if len(values) > 1 else np.nan


def _share_within(samples, state, symbol, mu_iso, low, high):
    sample = samples["coupled"]
    k = sample.densities.index(mu_iso)
    values, weight = sample.state(state, symbol)[k], sample.weight[k]
    known = np.isfinite(values)
    values, weight = values[known], weight[known] / weight[known].sum()
    width = max(pdem.kernel_width(values[None], weight[None])[0], 1e-9 * abs(high))
    return weight @ (special.ndtr((high - values) / width) - special.ndtr((low - values) / width))


def _effect_of_G_p(samples, alone):
    both, sample = samples["coupled"], samples["G_p" if alone else "coupled"]
    log_G, log_mu = np.log(sample.driver("G_p")), np.log(sample.driver("mu_s"))
    effects = []
    for k, eta in enumerate(sample.state("critical", "eta")):
        known = np.isfinite(eta) & (sample.weight[k] > 0)
        columns = [np.ones(known.sum()), log_G[known]] + ([] if alone else [log_mu[known], log_mu[known] ** 2])
        root = np.sqrt(sample.weight[k][known])
        slope = np.linalg.lstsq(np.stack(columns, 1) * root[:, None], eta[known] * root, rcond=None)[0][1]
        effects.append(abs(slope) * weighted.std(log_G, sample.weight[k]))
    return max(effects) / max(weighted.std(both.state("critical", "eta"), both.weight[0]))


def _stiffness_follows_G_p(samples):
    sample = samples["coupled"]
    log_G = np.log(sample.driver("G_p"))
    stiffness = np.log(sample.state("probe", "G_0"))
    return min(weighted.correlation(y, log_G, w) for y, w in zip(stiffness, sample.weight, strict=True))


def _stiffness_gain(samples):
    values = samples["coupled"].state("probe", "G_0")
    return weighted.mean(values[0] / values[-1] - 1, samples["coupled"].weight[0]) if len(values) > 1 else np.nan


def _least_correlation(samples, symbol, sign):
    sample = samples["coupled"]
    pairs = zip(sample.state("critical", "eta"), sample.state("critical", symbol), sample.weight, strict=True)
    return min(sign * weighted.correlation(eta, other, weight) for eta, other, weight in pairs)


def _steady_strain(samples, symbol, tolerance):
    sample = samples["coupled"]
    strain = sample.results.strain
    if strain[-1] < paper.STEADY_STRAIN + 0.04:
        return np.nan
    last = strain >= max(paper.STEADY_STRAIN, 0.75 * strain[-1])
    starts = []
    for values, weight in zip(sample.curve(symbol), sample.weight, strict=True):
        mean = weighted.mean(values, weight)
        final = mean[last].mean()
        off = np.flatnonzero(np.abs(mean / final - 1) > tolerance)
        starts.append(strain[min(off[-1] + 1, len(strain) - 1)] if len(off) else strain[0])
    return max(starts)


def _grading_values(samples):
    sample = samples["coupled"]
    return [(sample.state(state, symbol), sample.weight) for state in ("peak", "critical")
            for symbol in ("I_G_active", "I_G_stress")]  # fmt: skip


def _grading_distance(samples):
    return max(np.max(np.abs(weighted.mean(v, w) - paper.GRADING_INDEX)) for v, w in _grading_values(samples))


def _grading_cov(samples):
    return max(np.max(weighted.cov(v, w)) for v, w in _grading_values(samples))


def _initial(samples, symbol):
    return samples["coupled"].state("initial", symbol), samples["coupled"].weight


def _initial_step(samples):
    steps = []
    for symbol, sign in (("e", 1), ("e_m", 1), ("Z", -1), ("Z_m", -1)):
        mean = weighted.mean(*_initial(samples, symbol))
        steps.extend(sign * np.diff(mean) / mean[1:])
    return min(steps)


def _initial_difference(samples):
    places = {mu_iso: k for k, mu_iso in enumerate(samples["coupled"].densities)}
    return max(abs(weighted.mean(*_initial(samples, symbol))[places[mu_iso]] / mean - 1)
               for (symbol, mu_iso), (mean, _) in paper.INITIAL_STATE.items() if mu_iso in places)  # fmt: skip


def _initial_cov(samples):
    return max(np.max(weighted.cov(*_initial(samples, symbol))) for symbol in ("e", "e_m", "Z", "Z_m"))
