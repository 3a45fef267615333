"""Undrained tests that ended before their strain: which points they are, and the probability of such an end.

A point whose test liquefied or became stiff keeps its probability.  Beyond that strain it has no response, and the
numbers of the other points hold for the tests that go on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np

from ..pdem.proportion import Proportion, proportion
from ..quantities import EARLY_ENDS

if TYPE_CHECKING:
    from .collect import FamilyDensity
    from .reader import Results

#: How the intervals were made, as results.h5 states it.
INTERVAL = "95 %, Clopper-Pearson with the effective number of points (Korn and Graubard 1998; pdem/proportion.py)"


@dataclass(frozen=True)
class PointEnds:
    """Ends of the tests of Q points: `kind` (Q,), "" where the test did not end early, and strain (Q,), NaN there."""

    kind: np.ndarray
    strain: np.ndarray

    @property
    def any(self) -> bool:
        """Whether a test ended early."""
        return bool((self.kind != "").any())


class Ended(NamedTuple):
    """Probability (T,) that a test has ended in one way, along strain (T,), with the ends of its 95 % interval.

    `point` and `at`: numbers of the points that did, and the strains at which.
    """

    strain: np.ndarray
    probability: np.ndarray
    low: np.ndarray
    high: np.ndarray
    point: np.ndarray
    at: np.ndarray


def write_ends(out: h5py.Group, density: FamilyDensity, over: np.ndarray) -> None:
    """Write the ends of a density of undrained tests: probabilities along strain, their intervals, and which points.

    over (Q, T): whether the test of a point has ended at a strain.
    """
    for kind in EARLY_ENDS:
        those = (density.ends.kind == kind) & (density.probability > 0)
        found = proportion((those[:, None] & over).T, density.probability, density.packing)
        group = out.create_group(kind)
        for name, values in zip(("probability", "low", "high"), found, strict=True):
            group[name] = values
        group["point"], group["at"] = density.family.points.id[those], density.ends.strain[those]
    out.attrs["interval"] = INTERVAL


class EndsOfTests:
    """Methods of `Results` on tests that ended before their strain.  A density is given as mu_iso or by its name."""

    def ended(self, kind: str, mu_iso: float | str, family: str = "coupled") -> Ended:
        """Probability that a test has "liquefied" or become "stiff", along strain, with its 95 % interval.

        Zero with an interval of zero width in campaigns of other paths, where tests cannot end so.
        Raises ResultsError for another kind, density or family.
        """
        from .reader import ResultsError

        results: Results = self  # type: ignore[assignment]
        if kind not in EARLY_ENDS:
            raise ResultsError(f"{results.path}: no test ends as {kind!r}, only as {' or '.join(EARLY_ENDS)}")
        with results._open() as file:
            base = results._group(file, mu_iso, family)
            if "ends" not in base:
                zero = np.zeros(len(results.strain))
                return Ended(results.strain, zero, zero, zero, np.empty(0, int), np.empty(0))
            group: dict[str, Any] = base["ends"][kind]
            numbers = (group[name][()] for name in ("probability", "low", "high", "point", "at"))
            return Ended(results.strain, *numbers)

    def going_on(self, mu_iso: float | str, family: str = "coupled") -> Proportion:
        """Probability that a test goes on to the last strain, with its 95 % interval."""
        results: Results = self  # type: ignore[assignment]
        probability, packing = results.probability(mu_iso, family), results.packing(mu_iso, family)
        points = results.family_points(family).id
        gone = np.concatenate([self.ended(kind, mu_iso, family).point for kind in EARLY_ENDS])
        return proportion(~np.isin(points, gone), probability, packing)

    def has_early_ends(self, mu_iso: float | str, family: str = "coupled") -> bool:
        """Whether a test of a density liquefied or became stiff."""
        return any(len(self.ended(kind, mu_iso, family).point) for kind in EARLY_ENDS)

    def holds_for(self, state: str, symbol: str, mu_iso: float | str, family: str = "coupled") -> float:
        """Probability of the points that reached a state: numbers of the state are conditional on it.

        1 where every test reached it, 0 where none did.  Points without a run do not count.
        """
        results: Results = self  # type: ignore[assignment]
        values = results.state(state, symbol, mu_iso, family, withheld="show")
        probability = results.probability(mu_iso, family)
        if state == "transformation":  # which a regression cannot give
            probability = np.where(results.filled(mu_iso, family, state), 0.0, probability)
        reached = np.isfinite(values)
        return 1.0 if reached[probability > 0].all() else float(probability[reached].sum() / probability.sum())
