"""Reads results.h5, the one file that holds a campaign's answers; needs nothing else of the project's runs.

    results = read_results("runs/demo/results.h5")
    results.points                                   # mu_s, G_p (Pa), probability of every representative point
    eta = results.response("eta", mu_iso=0.04)       # eta.values (T, Q), eta.mean, eta.std, eta.density.p on .x
    peak = results.state("peak", "eta", mu_iso=0.04) # one value per point, NaN where the run is missing
    results.weights(0.04)                            # the probabilities that go with them, summing to 1

Everything is in SI units; names and shown units are in analysis/quantities.py.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pandas as pd

from analysis import weighted
from analysis.archive import CONSOLIDATED, STAGE_STATES
from analysis.density import Density
from analysis.quantities import QUANTITIES, Quantity

FORMAT, FORMAT_VERSION = "campaign-results", 3
STATES = ("initial", "peak", "critical", "probe")


class ResultsError(ValueError):
    """A results file that cannot be used, or a name that is not in it; one line says which and why."""


@dataclass(frozen=True)
class Response:
    """One response of one density: `values` (T, Q) over `strain` (T,) and the points, with weights and densities.

    `extended` (T, Q) marks values continued past the end of a run that stopped early in the steady state.
    `replicates` (R, T, Q) are the single packings behind the averages, or None.  `density` holds the PDF on its grid
    (density.p, density.x) and what widens it; `mean` and `std` (T,) are sums over the points, never integrals of it.
    """

    quantity: Quantity
    strain: np.ndarray
    values: np.ndarray
    probability: np.ndarray
    extended: np.ndarray
    replicates: np.ndarray | None
    density: Density

    @property
    def mean(self):
        """Probability-weighted mean of the points at every strain, (T,)."""
        return weighted.mean(self.values, self.probability)

    @property
    def std(self):
        """Probability-weighted standard deviation of the points at every strain, (T,)."""
        return weighted.std(self.values, self.probability)

    def quantile(self, q):
        """Quantile of the points at every strain, (T,)."""
        return np.array([weighted.quantile(row, self.probability, q) for row in self.values])


@dataclass(frozen=True)
class Results:
    """A campaign's results: tables in memory, responses and states read from the file when asked for."""

    path: Path
    attrs: dict
    strain: np.ndarray
    densities: tuple[float, ...]
    families: tuple[str, ...]
    points: pd.DataFrame
    runs: pd.DataFrame
    pairs: np.ndarray
    inputs: dict
    diameters: np.ndarray
    grading: dict

    def family_densities(self, family="coupled"):
        """The consolidation frictions mu_iso that a family has, ascending."""
        with h5py.File(self.path) as file:
            return self._densities(file, family)

    def _densities(self, file, family):
        if family not in self.families:
            raise ResultsError(f"{self.path}: there is no family {family!r}, only {', '.join(self.families)}")
        return tuple(sorted(float(name) for name in file[f"families/{family}"] if name != "points"))

    def _group(self, file, mu_iso, family, *names):
        """A family's density, or what it has below; ResultsError says what there is in place of what is missing."""
        densities = [f"{m:g}" for m in self._densities(file, family)]
        if f"{mu_iso:g}" not in densities:
            raise ResultsError(f"{self.path}: {family} has no density mu_iso = {mu_iso:g}, only {', '.join(densities)}")
        group = file[f"families/{family}/{mu_iso:g}"]
        for name in names:
            if name not in group:
                raise ResultsError(f"{self.path}: there is no {name!r} in {group.name}, only {', '.join(group)}")
            group = group[name]
        return group

    def family_points(self, family="coupled"):
        """The points of a family as a frame id, mu_s, G_p (Pa), probability."""
        with h5py.File(self.path) as file:
            self._densities(file, family)
            return _frame(file[f"families/{family}/points"])

    def weights(self, mu_iso, family="coupled"):
        """Probabilities (Q,) of a density's points, zero where no run is left, summing to 1."""
        with h5py.File(self.path) as file:
            return self._group(file, mu_iso, family, "weight")[()]

    def bootstrap_weights(self, mu_iso, family="coupled"):
        """Probabilities (B, Q) of a density's points under inputs refitted to resampled pairs, or None if not made.

        Like `weights`, zero where no run is left (the nearest point has its share), every row summing to 1.
        """
        with h5py.File(self.path) as file:
            if "inputs/bootstrap_probability" not in file:
                return None
            drawn = file["inputs/bootstrap_probability"][()]
            bearer = self._group(file, mu_iso, family, "bearer")[()][file[f"nearest/{family}"][()]]
        shares = np.zeros((len(drawn), len(self.weights(mu_iso, family))))
        np.add.at(shares.T, bearer, drawn.T)
        return shares / shares.sum(axis=1, keepdims=True)

    def filled(self, mu_iso, family="coupled", state="critical"):
        """Points (Q,) of a density that were not run for a state, but filled by regression over the inputs."""
        stage = next((stage for stage, states in STAGE_STATES.items() if state in states), None)
        if stage is None:
            raise ResultsError(f"{self.path}: there is no state {state!r}, only {', '.join(STATES)}")
        with h5py.File(self.path) as file:
            return self._group(file, mu_iso, family, "filled", stage)[()]

    def measured(self, state, symbol, mu_iso, family="coupled"):
        """Values (Q,) of a quantity at a state from runs only: NaN where a run is missing or filled."""
        values = self.state(state, symbol, mu_iso, family)
        return np.where(self.filled(mu_iso, family, state), np.nan, values)

    def counts(self, mu_iso, family="coupled"):
        """What became of a density's runs: dict of lost_probability, planned, done, failed, spared, extended."""
        with h5py.File(self.path) as file:
            return _plain(self._group(file, mu_iso, family).attrs)

    def response(self, symbol, mu_iso, family="coupled") -> Response:
        """One response along strain at one density; ResultsError if the file has none of that name."""
        with h5py.File(self.path) as file:
            base = self._group(file, mu_iso, family)
            group = self._group(file, mu_iso, family, "responses", symbol)
            replicates = base.get(f"replicates/{symbol}")
            return Response(
                quantity=QUANTITIES[symbol], strain=self.strain, values=group["values"][()],
                probability=base["weight"][()], extended=group["extended"][()],
                replicates=None if replicates is None else replicates[()], density=Density.from_hdf5(group),
            )  # fmt: skip

    def symbols(self, mu_iso, family="coupled"):
        """The responses that a density has, as symbols."""
        with h5py.File(self.path) as file:
            return tuple(self._group(file, mu_iso, family, "responses"))

    def state(self, state, symbol, mu_iso, family="coupled"):
        """Values (Q,) of a quantity at a state ("initial", "peak", "critical", "probe"), NaN where a run is missing."""
        with h5py.File(self.path) as file:
            return self._group(file, mu_iso, family, "states", state, symbol)[()]

    def consolidated(self, symbol, mu_iso, family="coupled"):
        """Values (R,) of e, e_m, Z or Z_m after R consolidations at a density, and their weights (R,), of sum 1.

        One a packing, all alike; with `per_point` one a point and packing, and the consolidations of a point share its
        probability in the family.
        """
        if symbol not in CONSOLIDATED:
            raise ResultsError(f"{self.path}: consolidations have no {symbol!r}, only {', '.join(CONSOLIDATED)}")
        with h5py.File(self.path) as file:
            self._group(file, mu_iso, family)
        runs = self.runs[(self.runs["stage"] == "consolidate") & (self.runs["mu_iso"] == mu_iso)]
        runs = runs[runs["family"].isin(["shared", family]) & np.isfinite(runs[symbol].astype(float))]
        weights = np.ones(len(runs))
        if (runs["point"] >= 0).any():
            probability = self.family_points(family).set_index("id")["probability"]
            runs = runs[runs["point"].isin(probability.index)]
            point = runs["point"]
            weights = (point.map(probability) / point.map(point.value_counts())).to_numpy(float)
        return runs[symbol].to_numpy(float), weights / weights.sum() if len(weights) else weights

    def state_error(self, state, symbol, mu_iso, family="coupled"):
        """Standard errors (Q,) of a state's values from the fluctuation within the runs, or None if not estimated."""
        with h5py.File(self.path) as file:
            self._group(file, mu_iso, family, "states", state, symbol)
            dataset = file.get(f"families/{family}/{mu_iso:g}/errors/{state}/{symbol}")
            return None if dataset is None else dataset[()]

    def state_replicates(self, state, symbol, mu_iso, family="coupled"):
        """Values (R, Q) of the single packings behind a state's averages, or None with one packing."""
        with h5py.File(self.path) as file:
            self._group(file, mu_iso, family, "states", state, symbol)
            dataset = file.get(f"families/{family}/{mu_iso:g}/state_replicates/{state}/{symbol}")
            return None if dataset is None else dataset[()]

    def state_symbols(self, state, mu_iso, family="coupled"):
        """The quantities recorded at a state; empty if the campaign has no such stage."""
        with h5py.File(self.path) as file:
            return tuple(self._group(file, mu_iso, family).get(f"states/{state}", ()))


def read_results(path) -> Results:
    """Open results.h5 (a path, or a Results already open, returned as it is).

    Raises ResultsError if the file is missing, is no results file or has another format version.
    """
    if isinstance(path, Results):
        return path
    path = Path(path)
    if not path.is_file():
        raise ResultsError(f"{path}: no such results file")
    try:
        with h5py.File(path) as file:
            attrs = _plain(file.attrs)
            if attrs.get("format") != FORMAT or attrs.get("format_version") != FORMAT_VERSION:
                raise ResultsError(
                    f"{path}: format {attrs.get('format')!r} version {attrs.get('format_version')!r}, "
                    f"want {FORMAT!r} version {FORMAT_VERSION}"
                )
            for name in ("versions", "settings"):
                attrs[name] = json.loads(attrs.get(name, "{}"))
            inputs = {k: json.loads(v) if k != "source" else v for k, v in _plain(file["inputs"].attrs).items()}
            return Results(
                path=path, attrs=attrs, strain=file["strain"][()], densities=tuple(file["densities"][()].tolist()),
                families=tuple(file["families"]), points=_frame(file["points"]), runs=_frame(file["runs"]),
                pairs=file["inputs/pairs"][()], inputs=inputs | {"points": _plain(file["points"].attrs)},
                diameters=file["grading/diameter"][()], grading=_plain(file["grading"].attrs),
            )  # fmt: skip
    except (OSError, KeyError) as error:
        raise ResultsError(f"{path}: not a readable results file ({str(error).splitlines()[0]})") from error


def _frame(group):
    columns = {name: dataset[()] for name, dataset in group.items()}
    order = group.attrs.get("columns")
    names = list(columns) if order is None else [str(name) for name in order]
    text = {n: [v.decode() for v in columns[n]] if columns[n].dtype.kind in "OS" else columns[n] for n in names}
    return pd.DataFrame(text)


def _plain(attrs):
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in attrs.items()}
