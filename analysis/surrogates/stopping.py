"""Sequential stopping of a campaign: the claimed error of the denoised PDFs after each batch of points.

The error of a PDF is its Wasserstein-1 distance to the true PDF, divided by the standard deviation of the response.  It
is at most the mean absolute error of f over the inputs, which the claim bounds with surfaces drawn from the model: they
contain the own noise, what the runs share through their packings, and the error of f itself.  The distance between the
drawn and the fitted PDF would be too small where f is flat, because the fit's own scatter then widens both.
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
from .basis import fewest_runs
from .surrogate import FEWEST_PACKINGS, Surrogate

#: (state, quantity) of the responses by which a campaign is judged, at every density of the soil.
JUDGED = (("peak", "eta"), ("critical", "eta"), ("critical", "e"))
#: Factor on claimed errors: the model cannot know kinks that lie between the runs.
SAFETY = 1.1


class InputDistribution(Protocol):
    """What the rule needs of the joint distribution of the inputs; `inputs.Joint` has it."""

    @property
    def dimension(self) -> int:
        """Number of variables d."""

    def inverse_rosenblatt(self, w: np.ndarray) -> np.ndarray:
        """Independent uniforms (n, d) to points (n, d) of the distribution."""


@dataclass(frozen=True)
class Assessment:
    """State of a campaign after a batch: runs (points) so far, target error, and whether every response reaches it.

    claimed and loo: error of the PDF and leave-one-out error of each response, divided by its standard deviation.
    unknown: why nothing is claimed; empty if the rule can judge.
    """

    runs: int
    target: float
    claimed: dict[str, float]
    loo: dict[str, float]
    reached: bool
    unknown: str = ""

    def sentence(self) -> str:
        """One line with the number of points, the worst response and the target."""
        if self.unknown:
            return f"{self.runs} points: the error cannot be judged, because {self.unknown}; {self.target:.1%} asked"
        worst = max(self.claimed, key=lambda name: self.claimed[name])
        verdict = "reached" if self.reached else "not yet reached"
        return f"{self.runs} points: {worst} within {self.claimed[worst]:.1%}, {self.target:.1%} asked, {verdict}"


def assess(
    inputs: ArrayLike,
    responses: Mapping[str, ArrayLike],
    samples: ArrayLike,
    stop_when: str | float = "2%",
    packing: ArrayLike | None = None,
    rng: np.random.Generator | None = None,
    confidence: float = 0.95,
) -> Assessment:
    """Assess the runs so far: inputs (Q, d), responses {name: (Q,) or (T, Q)}, NaN where a run failed, packing (Q,).

    samples (n, d) from the joint inputs, n >= 200 (best: `judged_samples`); stop_when: target error, "2%" or 0.02.  The
    claimed error of a response is 1.1 times the `confidence` quantile over 200 draws at its worst strain.  It is
    infinite with fewer usable runs than `fewest_runs(d)`, 12 for d = 2, and with fewer than 3 packings: what all runs
    share is then not known. Raises ValueError for another stop_when.
    """
    target = parse_target(stop_when)
    rng = np.random.default_rng(0) if rng is None else rng
    rows = {name: np.atleast_2d(np.asarray(values, float)) for name, values in responses.items()}
    runs = {name: int(np.isfinite(values).sum(axis=1).min()) for name, values in rows.items()}
    needed = fewest_runs(np.shape(inputs)[1])
    usable = {name: values for name, values in rows.items() if runs[name] >= needed}
    packings = 1 if packing is None else len(np.unique(packing))
    claimed, loo = dict.fromkeys(rows, float("inf")), dict.fromkeys(rows, float("inf"))
    if usable:
        model = surrogate.fit(inputs, np.concatenate(list(usable.values())), packing)
        errors, residuals = _claims(model, samples, confidence, rng)
        ends = np.cumsum([0, *(len(v) for v in usable.values())])
        for name, begin, end in zip(usable, ends[:-1], ends[1:], strict=True):
            claimed[name], loo[name] = float(errors[begin:end].max()), float(residuals[begin:end].max())
    unknown = ""
    if len(usable) < len(rows):
        unknown = f"{min(runs, key=lambda name: runs[name])} has {min(runs.values())} runs, and {needed} are needed"
    if packings < FEWEST_PACKINGS:
        claimed = dict.fromkeys(rows, float("inf"))
        unknown = f"the runs use {packings} packing{'s' * (packings > 1)}, and {FEWEST_PACKINGS} are needed"
    reached = max(claimed.values()) <= target
    return Assessment(len(np.asarray(inputs)), target, claimed, loo, reached, unknown)


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


def first_batch(points: int, d: int = 2) -> int:
    """Number of points in the first batch of a campaign with this number of points and d random inputs."""
    return min(points, max(fewest_runs(d), math.ceil(points / 8)))


def next_batch(used: int, points: int) -> int:
    """Number of points used after one more batch, of a campaign with this number of points."""
    return min(points, used + max(2, round(points / 12)))


def judged_samples(joint: InputDistribution, n: int = 1024) -> np.ndarray:
    """Samples (n, d) of the joint inputs for `assess`, n a power of 2: Sobol' points mapped to the distribution."""
    return joint.inverse_rosenblatt(qmc.Sobol(joint.dimension, seed=1).random(n))


def judged_name(state: str, symbol: str, mu_iso: float) -> str:
    """Name of one of `JUDGED` at the density of the soil that mu_iso gives."""
    return f"{symbol} at {state}, mu_iso = {mu_iso:g}"


def _claims(
    model: Surrogate, samples: ArrayLike, confidence: float, rng: np.random.Generator, draws: int = 200
) -> np.ndarray:
    """Claimed and leave-one-out errors (2, T) of the rows of the model, divided by the row's standard deviation."""
    basis = model.basis(samples)
    drawn = model.draws(draws, rng).coefficients - model.coefficients
    errors = np.zeros((2, len(model.coefficients)))
    for k, coefficients in enumerate(model.coefficients):
        std = (basis @ coefficients).std()
        if std > 0:
            distance = np.mean(np.abs(drawn[:, k] @ basis.T), axis=1)
            errors[:, k] = SAFETY * np.quantile(distance, confidence) / std, model.loo_error[k] / std
    return errors
