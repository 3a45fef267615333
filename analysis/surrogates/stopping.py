"""Sequential stopping of a campaign: nested order of the points and the claimed error of the PDFs after each batch.

The error of a PDF is its Wasserstein-1 distance to the true PDF, divided by the standard deviation of the response.  It
is estimated from response surfaces drawn from their distribution given the runs so far: their PDFs scatter about the
fitted one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import qmc

from . import surrogate
from .surrogate import FEWEST_RUNS, SAFETY, Surrogate

#: (state, quantity) of the responses by which a campaign is judged, at every density of the soil.
JUDGED = (("peak", "eta"), ("critical", "eta"), ("critical", "e"))


class InputDistribution(Protocol):
    """What the rule needs of the joint distribution of the inputs; `inputs.Joint` has it."""

    def inverse_rosenblatt(self, w: np.ndarray) -> np.ndarray:
        """Independent uniforms (n, 2) to points (n, 2) of the distribution."""


@dataclass(frozen=True)
class Assessment:
    """State of a campaign after a batch: runs (points) so far, target error, and whether every response reaches it.

    claimed and loo: error of the PDF and leave-one-out error of each response, divided by its standard deviation.
    """

    runs: int
    target: float
    claimed: dict[str, float]
    loo: dict[str, float]
    reached: bool

    def sentence(self) -> str:
        """One line with the number of points, the worst response and the target."""
        worst = max(self.claimed, key=lambda name: self.claimed[name])
        verdict = "reached" if self.reached else "not yet reached"
        return f"{self.runs} points: {worst} within {self.claimed[worst]:.1%}, {self.target:.1%} asked, {verdict}"


def assess(
    inputs: ArrayLike,
    responses: Mapping[str, ArrayLike],
    samples: ArrayLike,
    stop_when: str | float = "2%",
    rng: np.random.Generator | None = None,
    confidence: float = 0.95,
    kind: str = "polynomial",
) -> Assessment:
    """Assess the runs so far: inputs (Q, 2), responses {name: (Q,) or (T, Q)}, NaN where a run failed.

    All responses have the same terms.  samples (n, 2) from the joint inputs, n >= 200 (best: `judged_samples`);
    stop_when: target error, "2%" or 0.02.  The claimed error of a response is 1.1 times the `confidence` quantile over
    200 surfaces at its worst strain.  With fewer than 12 usable runs the claimed error is infinite.
    Raises ValueError for another stop_when.
    """
    target = parse_target(stop_when)
    rng = np.random.default_rng(0) if rng is None else rng
    rows = {name: np.atleast_2d(np.asarray(values, float)) for name, values in responses.items()}
    usable = {k: v for k, v in rows.items() if np.isfinite(v).sum(axis=1).min() >= FEWEST_RUNS}
    claimed, loo = dict.fromkeys(rows, float("inf")), dict.fromkeys(rows, float("inf"))
    if usable:
        surface = surrogate.fit(inputs, np.concatenate(list(usable.values())), kind=kind)
        errors, residuals = _claims(surface, samples, confidence, rng)
        ends = np.cumsum([0, *(len(v) for v in usable.values())])
        for name, begin, end in zip(usable, ends[:-1], ends[1:], strict=True):
            claimed[name], loo[name] = float(errors[begin:end].max()), float(residuals[begin:end].max())
    reached = max(claimed.values()) <= target
    return Assessment(runs=len(np.asarray(inputs)), target=target, claimed=claimed, loo=loo, reached=reached)


def parse_target(stop_when: str | float | None) -> float:
    """The target error as a number: 0.02 from "2%" or 0.02; raises ValueError unless it is within 0 ... 1."""
    try:
        text = str(stop_when).strip()
        value = float(text[:-1]) / 100 if text.endswith("%") else float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value < 1:
        raise ValueError(f"stop_when = {stop_when!r}: expected a share such as '2%' or 0.02")
    return value


def nested_order(inputs: ArrayLike, first: ArrayLike | None = None) -> np.ndarray:
    """Order (Q,) of points (Q, 2) in which every first part covers their range.

    The order begins at the middle; each next point is the one farthest from those before it, in the standardised
    logarithms of the inputs.  first (Q,): mask of points that come before all others, e.g. those with replicate
    packings.
    """
    if first is not None and np.any(first):
        is_first = np.asarray(first, bool)
        all_points = nested_order(inputs)
        return np.concatenate([all_points[is_first[all_points]], all_points[~is_first[all_points]]])
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
    """Number of points in the first batch of a campaign with this number of points."""
    return min(points, max(FEWEST_RUNS, math.ceil(points / 8)))


def next_batch(used: int, points: int) -> int:
    """Number of points used after one more batch, of a campaign with this number of points."""
    return min(points, used + max(2, round(points / 12)))


def judged_samples(joint: InputDistribution, n: int = 1024) -> np.ndarray:
    """Samples (n, 2) of the joint inputs for `assess`, n a power of 2: Sobol' points mapped to the distribution."""
    return joint.inverse_rosenblatt(qmc.Sobol(2, seed=1).random(n))


def judged_name(state: str, symbol: str, mu_iso: float) -> str:
    """Name of one of `JUDGED` at the density of the soil that mu_iso gives."""
    return f"{symbol} at {state}, mu_iso = {mu_iso:g}"


def _claims(
    surface: Surrogate, samples: ArrayLike, confidence: float, rng: np.random.Generator, draws: int = 200
) -> np.ndarray:
    """Claimed and leave-one-out errors (2, T) of the rows of the surface, divided by the row's standard deviation."""
    basis = surface.basis(samples)
    drawn = surface.draws(draws, rng)
    errors = np.zeros((2, len(surface.coefficients)))
    for k, coefficients in enumerate(surface.coefficients):
        fitted = np.sort(basis @ coefficients)
        std = fitted.std()
        if std > 0:
            other = np.sort(drawn[:, k] @ basis.T, axis=1)
            distance = np.mean(np.abs(other - fitted), axis=1)
            errors[:, k] = SAFETY * np.quantile(distance, confidence) / std, surface.loo_error[k] / std
    return errors
