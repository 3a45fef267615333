"""Reads results.h5, the file that holds a campaign's results. It needs nothing else of the campaign.

    results = read_results("runs/demo/results.h5")
    results.points                                    # RepresentativePoints: mu_s, G_p (Pa), probability
    eta = results.response("eta", mu_iso=0.04)        # eta.values (T, Q), eta.mean, eta.std, eta.pdf
    peak = results.state("peak", "eta", mu_iso=0.04)  # one value per point, NaN where the run is missing
    results.probability(0.04)                         # the probabilities of these values, of sum 1
    results.state("peak", "eta", "dense")             # a density has a name, too: results.density_names
    results.quote()                                   # the numbers to quote, with their uncertainties

Everything is in SI units; names and displayed units are in analysis/quantities.py.
"""

from __future__ import annotations

import numbers
import warnings
from collections.abc import Callable, Hashable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd

from ..errors_and_files import one_line, open_hdf5
from ..pdem import weighted
from ..pdem.pdf import PDF
from ..points.representative_points import RepresentativePoints
from ..quantities import CONSOLIDATED, DRAINED, QUANTITIES, STAGE_STATES, Loading
from .densities import density_names
from .derived import DerivedQuantities
from .ends import EndsOfTests
from .standing import PROVEN, Standing, curves_standing
from .tables_of_file import plain_attributes, points_of_table, read_fields
from .values import NotReachedError, PeakEstimate, Response, ResultsError, Runs

__all__ = ["JUDGED_STATES", "PROVEN_STATE", "STATES", "UNDRAINED_STATES", "NotReachedError", "PeakEstimate", "Response",
           "Results", "ResultsError", "Runs", "read_results"]  # fmt: skip

STATES = ("initial", "transformation", "peak", "strength", "critical", "probe")
UNDRAINED_STATES = ("transformation", "strength")
#: States that a test may not reach.
JUDGED_STATES = ("peak", "critical")
PROVEN_STATE = Standing(PROVEN, "")


@dataclass(frozen=True)
class Results(DerivedQuantities, EndsOfTests):
    """A campaign's results: tables in memory; responses and states are read from the file on demand.

    Methods take a density as mu_iso or by its name (`density_names`), such as 0.001 or "dense".
    `strain` (T,); `densities` are the mu_iso of all families; `points` the representative points; `runs` one row per
    run; `pairs` (n, d) of the random variables (SI units); `inputs` the distributions; `diameters` (N,) m.
    """

    path: Path
    attrs: dict[str, Any]
    strain: np.ndarray
    densities: tuple[float, ...]
    families: tuple[str, ...]
    points: RepresentativePoints
    runs: pd.DataFrame
    pairs: np.ndarray
    inputs: dict[str, Any]
    diameters: np.ndarray
    grading: dict[str, Any]
    _cache: dict[Hashable, Any] = field(default_factory=dict, repr=False, compare=False)

    def cached(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What `make` returned when it was first asked for under this key."""
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]

    @property
    def loading(self) -> Loading:
        """The test: what is held, and the direction."""
        return Loading(*(str(self.attrs.get(name, usual)) for name, usual in DRAINED._asdict().items()))

    @property
    def states(self) -> tuple[str, ...]:
        """The states that the test has."""
        return STATES if self.loading.is_undrained else tuple(s for s in STATES if s not in UNDRAINED_STATES)

    def family_densities(self, family: str = "coupled") -> tuple[float, ...]:
        """The densities of a family as consolidation frictions mu_iso, ascending: the densest first."""
        with self._open() as file:
            return self._densities(file, family)

    def density_names(self, family: str = "coupled") -> dict[float, str]:
        """Name of each density mu_iso of a family, such as dense, medium and loose for three."""
        return density_names(self.family_densities(family))

    def family_points(self, family: str = "coupled") -> RepresentativePoints:
        """The points of a family, with the properties that its runs have."""
        with self._open() as file:
            self._densities(file, family)
            return points_of_table(file[f"families/{family}/points"], self.points.names, self.points.constants)

    def probability(self, mu_iso: float | str, family: str = "coupled") -> np.ndarray:
        """Probabilities (Q,) of the points at a density, of sum 1; zero where a point has no run."""
        with self._open() as file:
            return self._group(file, mu_iso, family, "weight")[()]

    def packing(self, mu_iso: float | str, family: str = "coupled") -> np.ndarray:
        """Packing (Q,) of each point at a density: the random seed of its assembly.  All equal: one packing for all."""
        with self._open() as file:
            return self._packing(self._group(file, mu_iso, family))

    def weights(self, mu_iso: float | str, family: str = "coupled") -> np.ndarray:
        """Former name of `probability`; will be removed in the next version."""
        warnings.warn("Results.weights is now Results.probability", DeprecationWarning, stacklevel=2)
        return self.probability(mu_iso, family)

    def bootstrap_weights(self, mu_iso: float | str, family: str = "coupled") -> np.ndarray | None:
        """Former name of `bootstrap_probability`; will be removed in the next version."""
        warnings.warn("Results.bootstrap_weights is now bootstrap_probability", DeprecationWarning, stacklevel=2)
        return self.bootstrap_probability(mu_iso, family)

    def bootstrap_probability(self, mu_iso: float | str, family: str = "coupled") -> np.ndarray | None:
        """Probabilities (B, Q) of the points at a density under inputs refitted to B resamples of the pairs, or None.

        As in `probability`, a point without a run has zero (the nearest point with a run has its probability); every
        row sums to 1.
        """
        with self._open() as file:
            if "inputs/bootstrap_probability" not in file:
                return None
            drawn = file["inputs/bootstrap_probability"][()]
            bearer = self._group(file, mu_iso, family, "bearer")[()][file[f"nearest/{family}"][()]]
            count = len(self._group(file, mu_iso, family, "weight"))
        probability = np.zeros((len(drawn), count))
        np.add.at(probability.T, bearer, drawn.T)
        return weighted.normalised(probability)

    def filled(self, mu_iso: float | str, family: str = "coupled", state: str = "critical") -> np.ndarray:
        """Which points (Q,) of a density were not run for a state; a regression over the inputs gives their values."""
        stage = next((stage for stage, states in STAGE_STATES.items() if state in states), None)
        if stage is None or state not in self.states:
            raise ResultsError(f"{self.path}: there is no state {state!r}, only {', '.join(self.states)}")
        with self._open() as file:
            return self._group(file, mu_iso, family, "filled", stage)[()]

    def measured(self, state: str, symbol: str, mu_iso: float | str, family: str = "coupled") -> np.ndarray:
        """Values (Q,) of a quantity at a state from runs only, in SI units; NaN where missing, filled or withheld."""
        values = self.state(state, symbol, mu_iso, family, withheld="nan")
        return np.where(self.filled(mu_iso, family, state), np.nan, values)

    def runs_at(self, state: str, symbol: str, mu_iso: float | str, family: str = "coupled") -> Runs:
        """Values of a quantity at a state in the single runs, in SI units; NaN where missing or withheld."""
        values = self.measured(state, symbol, mu_iso, family)
        with self._open() as file:
            return self._single(file, mu_iso, family, values, f"state_replicates/{state}/{symbol}")

    def runs_along(self, symbol: str, mu_iso: float | str, family: str = "coupled") -> Runs:
        """Values (T, n) of a response along strain in the single runs, in SI units; NaN where missing."""
        filled = self.filled(mu_iso, family)
        with self._open() as file:
            values = self._group(file, mu_iso, family, "responses", symbol)["values"][()]
            values = np.where(filled, np.nan, values)
            return self._single(file, mu_iso, family, values, f"replicates/{symbol}")

    def counts(self, mu_iso: float | str, family: str = "coupled") -> dict[str, Any]:
        """Numbers of shear runs planned, done, failed, spared and extended at a density, and the lost probability."""
        with self._open() as file:
            return plain_attributes(self._group(file, mu_iso, family).attrs)

    def response(self, symbol: str, mu_iso: float | str, family: str = "coupled") -> Response:
        """One response along strain at one density.  Raises ResultsError if the file has none of that name."""
        with self._open() as file:
            base = self._group(file, mu_iso, family)
            group = self._group(file, mu_iso, family, "responses", symbol)
            values, probability = group["values"][()], base["weight"][()]
            return Response(
                quantity=QUANTITIES[symbol],
                strain=self.strain,
                values=values,
                probability=probability,
                extended=group["extended"][()],
                packing=self._packing(base),
                loading=self.loading,
                pdf=PDF.from_hdf5(group).with_points(values, probability),
            )

    def symbols(self, mu_iso: float | str, family: str = "coupled") -> tuple[str, ...]:
        """Symbols of the responses along strain at a density."""
        with self._open() as file:
            return tuple(self._group(file, mu_iso, family, "responses"))

    def state(
        self, state: str, symbol: str, mu_iso: float | str, family: str = "coupled", withheld: str = "raise"
    ) -> np.ndarray:
        """Values (Q,) of a quantity at a state ("initial", "peak", "critical", "probe"), in SI units.

        Undrained tests have "transformation" and "strength", too.  NaN where a run is missing or did not reach the
        state (`holds_for`).  Values of a state that the tests did not reach (`standing`) are withheld:
        `withheld` is "raise" for a NotReachedError, "nan" for NaN, "show" for the values all the same.  Raises
        ResultsError for an unknown state, quantity, density or family.
        """
        with self._open() as file:
            values = self._group(file, mu_iso, family, "states", state, symbol)[()]
        standing = PROVEN_STATE if withheld == "show" else self.standing(state, mu_iso, family)
        if standing.shown:
            return values
        if withheld == "raise":
            raise NotReachedError(
                f"{self.path}: {symbol} at the {state} state of {family}, {_density(mu_iso)}: {standing.status}, "
                f'{standing.reason}; withheld="show" gives the values all the same'
            )
        return np.full(len(values), np.nan)

    def shown_state(self, state: str, symbol: str, mu_iso: float | str, family: str = "coupled") -> np.ndarray:
        """Values (Q,) of a quantity at a state as tables and figures show them: NaN where missing or withheld."""
        return self.state(state, symbol, mu_iso, family, withheld="nan")

    def standing(self, state: str, mu_iso: float | str, family: str = "coupled") -> Standing:
        """Standing of a state at a density: proven, not proven at this size, or not reached, with the reason.

        As stored in the file; for files of earlier versions it is computed from the curves.  The initial state and the
        probe need no strain and count as proven.
        """
        if state not in self.states:
            raise ResultsError(f"{self.path}: there is no state {state!r}, only {', '.join(self.states)}")
        if state not in JUDGED_STATES:
            return PROVEN_STATE
        with self._open() as file:
            value = self._mu_iso(file, mu_iso, family)
        return self.cached(("standing", state, value, family), lambda: self._standing(state, value, family))

    def _standing(self, state: str, mu_iso: float, family: str) -> Standing:
        with self._open() as file:
            attrs = plain_attributes(self._group(file, mu_iso, family, "states", state).attrs)
        if "standing" in attrs:
            return Standing(str(attrs["standing"]), str(attrs["standing_reason"]))
        curves = {symbol: self.response(symbol, mu_iso, family) for symbol in self.loading.steady}
        return curves_standing(state, self.strain, curves, self.loading)

    def consolidated(self, symbol: str, mu_iso: float | str, family: str = "coupled") -> tuple[np.ndarray, np.ndarray]:
        """Values (R,) of e, e_m, Z or Z_m after the R consolidations of a density, and probabilities (R,) of sum 1.

        One consolidation per packing: all have the same probability.  With `per_point` one per point and packing: those
        of a point share its probability.
        """
        if symbol not in CONSOLIDATED:
            raise ResultsError(f"{self.path}: consolidations have no {symbol!r}, only {', '.join(CONSOLIDATED)}")
        with self._open() as file:
            value = self._mu_iso(file, mu_iso, family)
        runs = self.runs[(self.runs["stage"] == "consolidate") & (self.runs["mu_iso"] == value)]
        runs = runs[runs["family"].isin(["shared", family]) & np.isfinite(runs[symbol].astype(float))]
        probability = np.ones(len(runs))
        if (runs["point"] >= 0).any():
            points = self.family_points(family)
            of_point = pd.Series(points.probability, index=points.id)
            runs = runs[runs["point"].isin(of_point.index)]
            point = runs["point"]
            probability = (point.map(of_point) / point.map(point.value_counts())).to_numpy(float)
        values = runs[symbol].to_numpy(float)
        return values, weighted.normalised(probability) if len(probability) else probability

    def state_error(self, state: str, symbol: str, mu_iso: float | str, family: str = "coupled") -> np.ndarray | None:
        """Standard errors (Q,) of a state's values from the fluctuation within the runs, or None if not estimated."""
        with self._open() as file:
            self._group(file, mu_iso, family, "states", state, symbol)
            dataset = self._group(file, mu_iso, family).get(f"errors/{state}/{symbol}")
            return None if dataset is None else dataset[()]

    def peak_estimate(self, mu_iso: float | str, family: str = "coupled") -> PeakEstimate | None:
        """How the peaks of a density were estimated; None if each point has the peak of its own run."""
        with self._open() as file:
            group = self._group(file, mu_iso, family).get("peak_estimate")
            return None if group is None else PeakEstimate(group["bias"][()], group["interior"][()])

    def state_symbols(self, state: str, mu_iso: float | str, family: str = "coupled") -> tuple[str, ...]:
        """Symbols of the quantities at a state; empty if the campaign has no such stage."""
        with self._open() as file:
            return tuple(self._group(file, mu_iso, family).get(f"states/{state}", ()))

    def _open(self) -> AbstractContextManager[h5py.File]:
        return open_hdf5(self.path, ResultsError, "results file")

    def _densities(self, file: h5py.File, family: str) -> tuple[float, ...]:
        if family not in self.families:
            raise ResultsError(f"{self.path}: there is no family {family!r}, only {', '.join(self.families)}")
        return tuple(sorted(float(name) for name in file[f"families/{family}"] if name != "points"))

    def _mu_iso(self, file: h5py.File, density: float | str, family: str) -> float:
        """The density of a family that a number mu_iso or a name means; the error names what there is instead."""
        names = density_names(self._densities(file, family))
        for mu_iso, name in names.items():
            if density == name or (isinstance(density, numbers.Real) and f"{density:g}" == f"{mu_iso:g}"):
                return mu_iso
        there = ", ".join(f"{mu_iso:g} ({name})" for mu_iso, name in names.items())
        raise ResultsError(f"{self.path}: {family} has no density {_density(density)}, only {there}")

    def _group(self, file: h5py.File, density: float | str, family: str, *names: str) -> Any:
        """The group of a family at a density, or what is below it; the error names what there is instead."""
        group = file[f"families/{family}/{self._mu_iso(file, density, family):g}"]
        for name in names:
            if name not in group:
                raise ResultsError(f"{self.path}: there is no {name!r} in {group.name}, only {', '.join(group)}")
            group = group[name]
        return group

    def _single(self, file: h5py.File, mu_iso: float | str, family: str, values: np.ndarray, replicates: str) -> Runs:
        """The points' values as single runs; in files of version 3 the replicates are single runs, too."""
        group = self._group(file, mu_iso, family)
        if replicates not in group or not np.isfinite(values).any():
            return Runs(values, self._packing(group), np.arange(values.shape[-1]))
        sets = np.moveaxis(group[replicates][()], 0, -2)  # (..., R, Q)
        packing, place = np.nonzero(np.isfinite(sets).any(axis=tuple(range(sets.ndim - 2))))
        return Runs(sets[..., packing, place], packing, place)

    def _packing(self, group: h5py.Group) -> np.ndarray:
        """Packing (Q,) of the points of a density; the campaign's first one in files of version 3."""
        if "packing" in group:
            return group["packing"][()]
        return np.full(len(group["weight"]), int(self.runs["packing"].iloc[0]) if "packing" in self.runs else 1)


def _density(density: object) -> str:
    """How a message names a density: mu_iso = 0.04, or the text that was given."""
    return f"mu_iso = {density:g}" if isinstance(density, numbers.Real) else one_line(repr(density))


def read_results(path: str | Path | Results) -> Results:
    """Open results.h5.

    Parameters
    ----------
    path : str, Path or Results
        The file; results that are already open are returned as they are.

    Returns
    -------
    Results
        Tables in memory; responses and states are read on demand.

    Raises
    ------
    ResultsError
        If the file is missing, is no results file or has another format version.

    Examples
    --------
    >>> results = read_results("data/laptop/results.h5")
    >>> results.densities
    (0.001, 0.04, 0.1)
    >>> eta = results.response("eta", mu_iso=0.04)
    >>> eta.values.shape == (len(eta.strain), len(results.points))
    True
    >>> round(float(eta.mean[-1]), 2)
    0.63
    """
    if isinstance(path, Results):
        return path
    path = Path(path)
    with open_hdf5(path, ResultsError, "results file") as file:
        return Results(**read_fields(path, file))
