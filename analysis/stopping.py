"""When a campaign has runs enough: nested points, a claimed error after each batch, and the rest filled by regression.

The error of a PDF is the Wasserstein-1 distance to the true one over the response's standard deviation.  It is
estimated from the surfaces that the runs made so far would also allow: their PDFs scatter about the fitted one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from analysis import surrogate

LEAST = 12  # runs a family before the rule may speak
#: (state, quantity) that a campaign is judged by, at every density.
JUDGED = (("peak", "eta"), ("critical", "eta"), ("critical", "e"))
SAFETY = 1.1  # for what the draws don't know: that the terms of the surface were themselves chosen from the data


@dataclass(frozen=True)
class Assessment:
    """What a batch says: runs (points) so far, the error asked for, and whether every response is good enough.

    claimed and loo: error of the PDF and leave-one-out error of every response, both over its standard deviation.
    """

    runs: int
    target: float
    claimed: dict[str, float]
    loo: dict[str, float]
    reached: bool

    def sentence(self) -> str:
        """One line for a person."""
        worst = max(self.claimed, key=self.claimed.get)
        verdict = "reached" if self.reached else "not yet reached"
        return f"{self.runs} points: {worst} within {self.claimed[worst]:.1%}, {self.target:.1%} asked, {verdict}"


def assess(
    inputs, responses: dict, samples, stop_when="2%", rng=None, confidence: float = 0.95, kind="polynomial"
) -> Assessment:
    """Judge the runs so far: inputs (Q, 2), responses {name: (Q,) or (T, Q)}, NaN where a run failed.

    One set of terms serves all responses.  samples (n, 2) from the joint inputs, n >= 200 (Sobol' mapped through the
    joint distribution is best); stop_when: "2%" or 0.02; the claimed error is 1.1 times the `confidence` quantile over
    200 surfaces, the worst strain of each response.  Below 12 usable runs nothing is claimed (infinity).
    """
    target = parse_target(stop_when)
    rng = np.random.default_rng(0) if rng is None else rng
    rows = {name: np.atleast_2d(np.asarray(values, float)) for name, values in responses.items()}
    usable = {k: v for k, v in rows.items() if np.isfinite(v).sum(axis=1).min() >= LEAST}
    claimed, loo = dict.fromkeys(rows, float("inf")), dict.fromkeys(rows, float("inf"))
    if usable:
        surface = surrogate.fit(inputs, np.concatenate(list(usable.values())), kind=kind)
        errors, residuals = _claims(surface, samples, confidence, rng)
        ends = np.cumsum([0, *(len(v) for v in usable.values())])
        for name, begin, end in zip(usable, ends[:-1], ends[1:], strict=True):
            claimed[name], loo[name] = float(errors[begin:end].max()), float(residuals[begin:end].max())
    return Assessment(len(inputs), target, claimed, loo, max(claimed.values()) <= target)


def parse_target(stop_when) -> float:
    """0.02 from "2%" or 0.02; ValueError otherwise."""
    try:
        text = str(stop_when).strip()
        value = float(text[:-1]) / 100 if text.endswith("%") else float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value < 1:
        raise ValueError(f"stop_when = {stop_when!r}: expected a share such as '2%' or 0.02")
    return value


def nested_order(inputs, first=None) -> np.ndarray:
    """Order (Q,) of given points (Q, 2) in which every beginning covers their range.

    The middle first, then always the point farthest from those before it, in the standardised logarithms of the inputs.
    first (Q,): points that come before all others, such as those that tell how packings differ.
    """
    if first is not None and np.any(first):
        first = np.asarray(first, bool)
        order = nested_order(inputs)
        return np.concatenate([order[first[order]], order[~first[order]]])
    logs = np.log(np.asarray(inputs, float))
    z = (logs - logs.mean(axis=0)) / np.maximum(logs.std(axis=0), 1e-12)
    order = [int(np.argmin(np.sum(z**2, axis=1)))]
    away = np.sum((z - z[order[0]]) ** 2, axis=1)
    while len(order) < len(z):
        order.append(int(np.argmax(away)))
        away = np.minimum(away, np.sum((z - z[order[-1]]) ** 2, axis=1))
        away[order] = -1.0
    return np.array(order)


def first_batch(points: int) -> int:
    """Points of a campaign's first batch, of so many."""
    return min(points, max(LEAST, math.ceil(points / 8)))


def next_batch(used: int, points: int) -> int:
    """Points used after one more batch, of so many."""
    return min(points, used + max(2, round(points / 12)))


def judged_samples(joint, n: int = 1024) -> np.ndarray:
    """Samples (n, 2) of the joint inputs that a campaign is judged on, Sobol' points, n a power of 2."""
    return joint.inverse_rosenblatt(qmc.Sobol(2, seed=1).random(n))


def judged_name(state: str, symbol: str, mu_iso: float) -> str:
    """How a judgement names one of `JUDGED` at a density."""
    return f"{symbol} at {state}, mu_iso = {mu_iso:g}"


def fill(inputs, values, **options) -> tuple[np.ndarray, np.ndarray]:
    """Values (T, Q) with the missing ones taken from the response surface through the others, and where (T, Q) so."""
    values = np.atleast_2d(np.asarray(values, float))
    missing = ~np.isfinite(values)
    surface = surrogate.fit(inputs, values, **options)
    return np.where(missing, surface.predict(inputs), values), missing


def _claims(surface, samples, confidence, rng, draws: int = 200):
    """Claimed error and leave-one-out error of every row of the surface, over the row's standard deviation."""
    basis = surface.basis(samples)
    allowed = surface.draws(draws, rng)
    errors = np.zeros((2, len(surface.coefficients)))
    for k, coefficients in enumerate(surface.coefficients):
        fitted = np.sort(basis @ coefficients)
        std = fitted.std()
        if std > 0:
            other = np.sort(allowed[:, k] @ basis.T, axis=1)
            distance = np.mean(np.abs(other - fitted), axis=1)
            errors[:, k] = SAFETY * np.quantile(distance, confidence) / std, surface.loo_error[k] / std
    return errors
