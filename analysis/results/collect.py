"""Collects a campaign's products into arrays on one strain grid, and states what became of every run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from ..pdem import weighted
from ..points.representative_points import RepresentativePoints
from ..quantities import STAGE_STATES, Loading
from ..runs import run_file
from ..runs.archive import NOTHING, RunSummary, run_summary
from ..surrogates.basis import fewest_fitted
from ..surrogates.surrogate import fill
from .common_grid import ResponsesError, loading_of_runs, on_grid_of, strain_grid
from .ends import PointEnds
from .peaks import PooledPeaks, peak_states, pool_peaks

COLUMNS = ("run_id", "stage", "family", "point", "packing", "mu_iso", "mu_s", "G_p", "product")
#: Parameters of a product that must be those of the plan, by stage.
CHECKED = {"consolidate": ("G_p", "mu_iso"), "shear": ("mu_s", "G_p", "mu_iso"), "probe": ("mu_s", "G_p", "mu_iso")}
#: Further variables, of all stages, that must be those of the plan if it has their column; a product has the width of
#: its grains as they are for sigma_ln, not the one that was asked for.
ALSO_CHECKED = ("nu", "sigma_3", "d50")


@dataclass(frozen=True)
class FamilyDensity:
    """All runs of one family at one density on the common strain grid of T strains: Q points.

    `packing` (Q,) is the random seed of the packing that each point has.  `values` and `states` are NaN where a run
    failed.  `probability` (Q,) sums to 1; a point without a run has zero, and the nearest point with a run, `bearer`
    (Q,), has its probability; `lost_probability` is the sum that moved.  A test that liquefied or became stiff is a
    run: its point keeps its probability, and its values are NaN beyond that strain (`ends`).  `filled` marks points
    (Q,) that were not run, by stage: their values and states are those of the model through the others.  `peaks` states
    where the peaks of the points are; None if each run has the peak of its own curve.
    """

    mu_iso: float
    family: PlannedFamily
    packing: np.ndarray
    probability: np.ndarray
    bearer: np.ndarray
    lost_probability: float
    filled: dict[str, np.ndarray]
    extended: np.ndarray
    values: dict[str, np.ndarray]
    states: dict[str, dict[str, np.ndarray]]
    errors: dict[str, dict[str, np.ndarray]]
    counts: dict[str, int]
    peaks: PooledPeaks | None
    ends: PointEnds


@dataclass(frozen=True)
class PlannedFamily:
    """A family's points (Q,) with the properties that its runs have.

    A campaign's point that the family does not plan gives its probability to the planned one that is nearest in the
    logarithms of those properties in which the planned ones differ: `nearest` (n,) has that one's place for each of the
    campaign's n points.  `planned_share` is the probability of the planned points before that.
    """

    name: str
    points: RepresentativePoints
    nearest: np.ndarray
    planned_share: float


@dataclass(frozen=True)
class Collected:
    """What a campaign's products hold: densities by family, strains (T,), one row per run, the grains, and the test.

    `diameters` (N,) in m and `grading` are those of the first run that has a snapshot.
    """

    densities: list[FamilyDensity]
    strain: np.ndarray
    runs: pd.DataFrame
    diameters: np.ndarray
    grading: dict[str, Any]
    loading: Loading


def collect(
    plan: pd.DataFrame, points: RepresentativePoints, archive: Mapping[str, RunSummary] | None = None
) -> Collected:
    """Read every product of a plan and return what they hold as `Collected`.

    archive: an `analysis.runs.archive.Archive`; its runs need no product.  Raises ResponsesError for a missing product,
    parameters that are not the plan's, a plan without needed columns, or points that are unknown.  Rows whose status in
    the plan (an optional column) is "spared" need no product; a regression fills their points.
    """
    missing = [name for name in dict.fromkeys((*COLUMNS, *points.names)) if name not in plan.columns]
    if missing or len(plan) == 0:
        raise ResponsesError(f"plan of {len(plan)} runs lacks the columns {missing}" if missing else "plan has no runs")
    planned = list(plan.itertuples(index=False))
    read = [_read(row, archive or {}) for row in planned]
    runs = pd.DataFrame([line for line, _ in read])
    runs = runs.fillna({name: "" for name in Loading._fields if name in runs})
    by_run = [(row, states) for row, (_, states) in zip(planned, read, strict=True)]
    spared = {line["run_id"] for line, _ in read if line["status"] == "spared"}
    strain = strain_grid([states for row, states in by_run if states and row.stage == "shear"], runs)
    loading = loading_of_runs(by_run)
    densities = []
    for (family, mu_iso), index in plan.groupby(["family", "mu_iso"], sort=True).indices.items():
        rows = [by_run[i] for i in index if by_run[i][0].stage in STAGE_STATES]
        if rows:
            family_points = _family_points(family, plan[plan["family"] == family], points)
            densities.append(_density(family_points, float(mu_iso), rows, strain, spared))
    none: tuple[np.ndarray, dict[str, Any]] = (np.empty(0), {})
    grains = next((states.grains for _, states in by_run if states and states.grains), none)
    return Collected(densities, strain, runs, grains[0], grains[1], loading)


def _read(row, archive):
    """One line of the table of runs, and the run's states (None if it failed or was spared)."""
    path = Path(row.product)
    line = {name: getattr(row, name) for name in ("run_id", "stage", "family", "mu_iso", "point", "packing")}
    failure_file = path.with_name(f"{row.run_id}.failed.json")
    if path.exists():
        run = run_file.read_run(path)
        _check(run, row)
        summary = run_summary(run)
        return line | {"status": "done"} | summary.facts, summary.states
    if row.run_id in archive:
        summary = archive[row.run_id]
        return line | {"status": "done"} | summary.facts, summary.states
    if failure_file.exists():
        failure = _read_failure(failure_file)
        outcome: dict[str, Any] = {"status": "failed", "reason": str(failure.get("reason", "no reason given"))}
        spent = failure.get("cpu_seconds")
        outcome["cpu_seconds"] = float(spent) if isinstance(spent, (int, float)) else np.nan
    elif getattr(row, "status", "") == "spared":
        outcome = {"status": "spared", "reason": "target error reached without it"}
    else:
        raise ResponsesError(f"run {row.run_id}: there is no product {path}")
    return line | NOTHING | outcome, None


def _read_failure(path: Path) -> dict[str, Any]:
    """What a failure file states; a damaged one says that it is."""
    try:
        failure = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        failure = None
    return failure if isinstance(failure, dict) else {"reason": "its failure file is damaged"}


def _check(run, row):
    if run.stage != row.stage:
        raise ResponsesError(f"{run.path}: is a {run.stage} run, the plan wants {row.stage}")
    for name in (*CHECKED.get(row.stage, ()), *ALSO_CHECKED):
        planned, used = float(getattr(row, name, np.nan)), float(run.parameters.get(name, np.nan))
        if np.isnan(planned) and name in ALSO_CHECKED:
            continue
        if not np.isclose(planned, used, rtol=1e-6, atol=0):
            raise ResponsesError(f"run {row.run_id}: {name} = {used:g} in {run.path.name}, the plan has {planned:g}")


def _family_points(family: str, plan: pd.DataFrame, points: RepresentativePoints) -> PlannedFamily:
    """The points that a family plans, with the probability of those that it does not."""
    used = plan.drop_duplicates("point").set_index("point")
    unknown = sorted(set(used.index) - set(points.id))
    if unknown:
        raise ResponsesError(f"{family}: the plan's points {unknown} are not among the {len(points)} points")
    planned = np.isin(points.id, used.index)
    number = points.id[planned]
    x = np.column_stack([used.loc[number, name].to_numpy(float) for name in points.names])
    nearest = _nearest(points.x, x)
    probability = np.bincount(nearest, weights=points.probability, minlength=len(number))
    family_points = replace(
        points, x=x, probability=weighted.normalised(probability), id=number, discrepancy=(), moment_errors=()
    )
    return PlannedFamily(family, family_points, nearest, float(points.probability[planned].sum()))


def _nearest(x, planned):
    """Place (n,) of the planned point (Q, d) that is nearest to each point x (n, d)."""
    varying = np.ptp(planned, axis=0) > 0
    columns = varying if varying.any() else np.ones(x.shape[1], bool)
    logs, planned_logs = np.log(x[:, columns]), np.log(planned[:, columns])
    scale = np.where(logs.std(axis=0) > 0, logs.std(axis=0), 1.0)
    return cKDTree(planned_logs / scale).query(logs / scale)[1]


def _density(
    family: PlannedFamily, mu_iso: float, rows: list[Any], strain: np.ndarray, spared: set[str]
) -> FamilyDensity:
    points = family.points
    values, extended, states, errors, ends = _by_point(points, rows, strain)
    filled, packing = {stage: _not_run(stage, rows, points, spared) for stage in STAGE_STATES}, _packing(points, rows)
    peaks = _pool_peaks(points, rows, strain, packing, values, states, errors, ends) if values else None
    not_run = filled["shear"]
    if ends.any:  # whether a test that was not made would have ended early is not known
        filled["shear"] = np.zeros(len(points), bool)
    for stage, names in STAGE_STATES.items():
        for table in (states.get(state, {}) for state in names if state != "transformation"):
            table |= {symbol: _fill(points, value[None], filled[stage], packing)[0] for symbol, value in table.items()}
    values = {symbol: _fill(points, value, filled["shear"], packing) for symbol, value in values.items()}
    sheared = any(row.stage == "shear" and row.run_id not in spared for row, _ in rows)
    alive = np.isfinite(values["eta"][0]) if values else np.full(len(points), not sheared)
    bearer = np.arange(len(points))
    if alive.any() and not alive.all():
        bearer = np.flatnonzero(alive)[_nearest(points.x, points.x[alive])]
    return FamilyDensity(
        mu_iso=mu_iso,
        family=family,
        packing=packing,
        probability=np.bincount(bearer, weights=points.probability, minlength=len(points)),
        bearer=bearer,
        lost_probability=float(points.probability[~alive & ~(not_run & ends.any)].sum()),
        filled=filled,
        extended=extended,
        values=values,
        states=states,
        errors=errors,
        counts=_counts([(row, states) for row, states in rows if row.stage == "shear"], spared),
        peaks=peaks,
        ends=ends,
    )


def _pool_peaks(points, rows, strain, packing, values, states, errors, ends):
    """Peaks that are pooled over the points, if there are enough; they replace those in `states` and `errors`.

    A test that ended early keeps the peak of its own curve.
    """
    loading = next(run.loading for row, run in rows if run and row.stage == "shear")
    peaks = pool_peaks(strain, loading.sign * values["eta"], points.x, packing)
    if peaks:
        at_peak, error = peak_states(strain, values, peaks, states["peak"], loading)
        if ends.any:
            early, nothing = ends.kind != "", np.full(len(points), np.nan)
            at_peak = {s: np.where(early, states["peak"].get(s, nothing), value) for s, value in at_peak.items()}
            error = np.where(early, errors["peak"].get("eta", nothing), error)
        states["peak"] |= at_peak
        errors["peak"] |= {"eta": error}
    return peaks


def _by_point(points, rows, strain):
    """Responses (T, Q), where they are extended, states and their errors (Q,), and early ends of the runs."""
    place = {point: q for q, point in enumerate(points.id.tolist())}
    shape = (len(strain), len(points))
    values: dict[str, np.ndarray] = {}
    states: dict[str, dict[str, np.ndarray]] = {}
    errors: dict[str, dict[str, np.ndarray]] = {}
    extended = np.zeros(shape, bool)
    ends = PointEnds(np.full(len(points), "", dtype="U9"), np.full(len(points), np.nan))
    for row, run in rows:
        if run is None:
            continue
        q = place[row.point]
        if run.end:
            ends.kind[q], ends.strain[q] = run.end, run.end_strain
        for symbol in run.responses:
            on_grid, extended[:, q] = on_grid_of(run, symbol, strain, row.run_id)
            values.setdefault(symbol, np.full(shape, np.nan))[:, q] = on_grid
        for target, source in ((states, run.states), (errors, run.errors)):
            for state, table in source.items():
                for symbol, value in table.items():
                    target.setdefault(state, {}).setdefault(symbol, np.full(len(points), np.nan))[q] = value
    return values, extended, states, errors, ends


def _packing(points, rows):
    """Packing (Q,) of each point.  Raises ResponsesError for a point with two of them."""
    of_point: dict[int, int] = {}
    for row, _ in rows:
        if of_point.setdefault(row.point, row.packing) != row.packing:
            raise ResponsesError(
                f"run {row.run_id}: point {row.point} has packings {of_point[row.point]} and {row.packing}; a point "
                "can have one packing only"
            )
    return np.array([of_point[point] for point in points.id.tolist()])


def _counts(shear, spared):
    """What became of the shear runs of a density."""
    return {
        "planned": len(shear),
        "done": sum(states is not None for _, states in shear),
        "failed": sum(states is None and row.run_id not in spared for row, states in shear),
        "spared": sum(row.run_id in spared for row, _ in shear),
        "extended": sum(states is not None and states.steady_end for _, states in shear),
    }


def _not_run(stage, rows, points, spared):
    """Points (Q,) all of whose runs of a stage were spared."""
    of_stage = [(row.point, row.run_id in spared) for row, _ in rows if row.stage == stage]
    needed = {point for point, is_spared in of_stage if not is_spared}
    return np.isin(points.id, sorted({point for point, _ in of_stage} - needed))


def _fill(points, values, filled, packing):
    """Values (T, Q) with those of the filled points from the model through the others, if there is one."""
    if not filled.any() or np.isfinite(values).sum(axis=1).min() < fewest_fitted(points.x.shape[1]):
        return values
    return np.where(filled, fill(points.x, values, packing)[0], values)
