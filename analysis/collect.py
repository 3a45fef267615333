"""Collects a campaign's products into arrays on one strain grid, and says what became of every run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from analysis import runfile, stopping, weighted
from analysis.archive import NOTHING, STAGE_STATES, contribution
from analysis.packings import average
from analysis.run_states import RunStates

PROPERTIES = ("mu_s", "G_p")
COLUMNS = ("run_id", "stage", "family", "point", "packing", "mu_iso", "mu_s", "G_p", "product")
CHECKED = {"consolidate": ("G_p", "mu_iso"), "shear": ("mu_s", "G_p", "mu_iso"), "probe": ("mu_s", "G_p", "mu_iso")}
SURFACE = 5  # runs below which there is no response surface


class ResponsesError(ValueError):
    """A plan that cannot be turned into results; one line names the run or the density and the number that failed."""


@dataclass(frozen=True)
class FamilyDensity:
    """All runs of one family at one density on the common strain grid of T strains: Q points, R packings.

    `values` and `states` are averages over the packings brought to one level (`analysis.packings`), `replicates` the
    packings one by one as they ran; NaN where a run failed.  `weight` (Q,) sums to 1 and is zero for a point without
    a run, whose probability the point `bearer` (Q,) has, the nearest with one; `lost_probability` is how much that is.
    `filled` marks points (Q,) that were not run, by stage: their values and states are those of the response surface
    through the others.
    """

    family: str
    mu_iso: float
    points: pd.DataFrame
    packings: tuple
    weight: np.ndarray
    bearer: np.ndarray
    lost_probability: float
    filled: dict[str, np.ndarray]
    extended: np.ndarray
    values: dict[str, np.ndarray]
    replicates: dict[str, np.ndarray]
    states: dict[str, dict[str, np.ndarray]]
    errors: dict[str, dict[str, np.ndarray]]
    state_sets: dict[str, dict[str, np.ndarray]]
    counts: dict[str, int]


def collect(plan, points, archive=()):
    """Read every product of a plan; returns (list of FamilyDensity, strain (T,), runs frame, grains).

    archive: an `analysis.archive.Archive`, whose runs need no product.

    grains is (diameter (N,) m, grading dict) of the first run that has a snapshot.  Raises ResponsesError for a
    missing product, other parameters than the plan's, a plan without needed columns, or points it does not know.
    Rows with the plan's status "spared" need no product (optional column); their points are filled by regression.
    """
    missing = [name for name in COLUMNS if name not in plan.columns]
    if missing or len(plan) == 0:
        raise ResponsesError(f"plan of {len(plan)} runs lacks the columns {missing}" if missing else "plan has no runs")
    found = [_read(row, archive) for row in plan.itertuples(index=False)]
    runs = pd.DataFrame([line for line, _ in found])
    kept = [(row, states) for row, (_, states) in zip(plan.itertuples(index=False), found, strict=True)]
    spared = {line["run_id"] for line, _ in found if line["status"] == "spared"}
    strain = _strain_grid([states for row, states in kept if states and row.stage == "shear"])
    groups = []
    for (family, mu_iso), index in plan.groupby(["family", "mu_iso"], sort=True).indices.items():
        rows = [kept[i] for i in index if kept[i][0].stage in STAGE_STATES]
        if rows:
            own = _family_points(family, plan[plan["family"] == family], points)
            groups.append(_group(family, float(mu_iso), rows, own, strain, spared))
    grains = next((states.grains for _, states in kept if states and states.grains), (np.empty(0), {}))
    return groups, strain, runs, grains


def _read(row, archive):
    """One line of the runs table, and the run's states (None if it failed or was spared)."""
    path = Path(row.product)
    line = {name: getattr(row, name) for name in ("run_id", "stage", "family", "mu_iso", "point", "packing")}
    failed = path.with_name(f"{row.run_id}.failed.json")
    if path.exists():
        run = runfile.read_run(path)
        _check(run, row)
        given = contribution(run)
        return line | {"status": "done"} | given.facts, given.states
    if row.run_id in archive:
        given = archive[row.run_id]
        return line | {"status": "done"} | given.facts, given.states
    if failed.exists():
        note = json.loads(failed.read_text())
        told = {"status": "failed", "reason": str(note.get("reason", "no reason given"))}
        told["cpu_seconds"] = float(note.get("cpu_seconds", np.nan))
    elif getattr(row, "status", "") == "spared":
        told = {"status": "spared", "reason": "the answer does not need it"}
    else:
        raise ResponsesError(f"run {row.run_id}: there is no product {path}")
    return line | NOTHING | told, None


def _check(run, row):
    if run.stage != row.stage:
        raise ResponsesError(f"{run.path}: is a {run.stage} run, the plan wants {row.stage}")
    for name in CHECKED.get(row.stage, ()):
        planned, used = float(getattr(row, name)), float(run.parameters.get(name, np.nan))
        if not np.isclose(planned, used, rtol=1e-6, atol=0):
            raise ResponsesError(f"run {row.run_id}: {name} = {used:g} in {run.path.name}, the plan has {planned:g}")


def _strain_grid(shears: list[RunStates]):
    """The strains of the fullest run: the longest of those that have the most windows."""
    if not shears:
        raise ResponsesError("no shear run has a product: there is no response to collect")
    best = max(shears, key=lambda states: (len(states.eps_a), states.eps_a[-1]))
    end = max(float(states.eps_a[-1]) for states in shears)
    if best.eps_a[-1] < end:
        best = max((s for s in shears if s.eps_a[-1] == end), key=lambda states: len(states.eps_a))
    return np.asarray(best.eps_a, float)


def _family_points(family, plan, points):
    """The points of a family with the properties its runs have.

    A point that is not planned gives its probability to the planned one that is nearest in the logarithms of those
    properties in which the planned ones differ; attrs["nearest"] has that one's place for each point of the family.
    """
    own = points[points["family"] == family] if "family" in points.columns else points
    used = plan.drop_duplicates("point").set_index("point")
    unknown = sorted(set(used.index) - set(own["id"]))
    if unknown:
        raise ResponsesError(f"{family}: the plan's points {unknown} are not among the {len(own)} points")
    everyone = own
    own = own[own["id"].isin(used.index)].reset_index(drop=True)
    properties = {name: used.loc[own["id"], name].to_numpy(float) for name in PROPERTIES}
    nearest = _nearest(everyone, properties)
    shares = np.bincount(nearest, weights=everyone["probability"], minlength=len(own))
    planned = float(own["probability"].sum())
    own = own.assign(probability=shares / shares.sum(), **properties)
    own.attrs.update(planned_share=planned, nearest=nearest)
    return own


def _nearest(points, planned):
    """Place (n,) of the planned point that is nearest to each point; `planned`: property -> (Q,)."""
    names = [name for name in PROPERTIES if np.ptp(planned[name]) > 0] or list(PROPERTIES)
    given, kept = np.log(points[names].to_numpy(float)), np.log(np.column_stack([planned[name] for name in names]))
    scale = np.where(given.std(axis=0) > 0, given.std(axis=0), 1.0)
    return cKDTree(kept / scale).query(given / scale)[1]


def _group(family, mu_iso, rows, own, strain, spared):
    packings = tuple(sorted({row.packing for row, _ in rows}))
    place = {point: q for q, point in enumerate(own["id"])}
    where = {packing: r for r, packing in enumerate(packings)}
    shape = (len(packings), len(strain), len(own))
    replicates, extended, state_sets, error_sets = {}, np.zeros(shape, bool), {}, {}
    for row, states in rows:
        if states is None:
            continue
        r, q = where[row.packing], place[row.point]
        for symbol in states.responses:
            values, extended[r, :, q] = _on_grid(states, symbol, strain, row.run_id)
            replicates.setdefault(symbol, np.full(shape, np.nan))[r, :, q] = values
        for target, source in ((state_sets, states.states), (error_sets, states.errors)):
            for state, table in source.items():
                for symbol, value in table.items():
                    target.setdefault(state, {}).setdefault(symbol, np.full(shape[::2], np.nan))[r, q] = value
    values = {symbol: average(sets) for symbol, sets in replicates.items()}
    averages = {state: {s: average(v) for s, v in table.items()} for state, table in state_sets.items()}
    filled = {stage: _unrun(stage, rows, own, spared) for stage in STAGE_STATES}
    for stage, states in STAGE_STATES.items():
        for table in (averages.get(state, {}) for state in states):
            table |= {symbol: _fill(own, value[None], filled[stage])[0] for symbol, value in table.items()}
    values = {symbol: _fill(own, value, filled["shear"]) for symbol, value in values.items()}
    probability = own["probability"].to_numpy()
    alive = np.isfinite(values["eta"]).all(axis=0) if values else np.ones(len(own), bool)
    lost = float(probability[~alive].sum())
    bearer = np.arange(len(own))
    if alive.any() and not alive.all():
        left = own[alive]
        bearer = np.flatnonzero(alive)[_nearest(own, {name: left[name].to_numpy(float) for name in PROPERTIES})]
    shear = [(row, states) for row, states in rows if row.stage == "shear"]
    return FamilyDensity(
        family=family, mu_iso=mu_iso, points=own, packings=packings,
        weight=np.bincount(bearer, weights=probability, minlength=len(own)), bearer=bearer,
        lost_probability=lost, extended=extended.any(axis=0),
        values=values, replicates=replicates, states=averages, filled=filled,
        errors={state: {s: _packing_error(v) for s, v in table.items()} for state, table in error_sets.items()},
        state_sets=state_sets if len(packings) > 1 else {},
        counts={"planned": len(shear), "done": sum(s is not None for _, s in shear),
                "failed": sum(s is None and row.run_id not in spared for row, s in shear),
                "spared": sum(row.run_id in spared for row, _ in shear),
                "extended": sum(s is not None and s.steady_end for _, s in shear)},
    )  # fmt: skip


def _unrun(stage, rows, own, spared):
    """Points (Q,) all of whose runs of a stage were spared."""
    at = [(row.point, row.run_id in spared) for row, _ in rows if row.stage == stage]
    return own["id"].isin({p for p, _ in at} - {p for p, unneeded in at if not unneeded}).to_numpy()


def _fill(own, values, filled):
    """Values (T, Q) with those of the filled points from the response surface through the others, if it has any."""
    if not filled.any() or np.isfinite(values).sum(axis=1).min() < SURFACE:
        return values
    surface, _ = stopping.fill(own[["mu_s", "G_p"]].to_numpy(), values)
    return np.where(filled, surface, values)


def _on_grid(states, symbol, strain, run_id):
    """A run's response on the common grid, and where it is continued by its critical-state average."""
    end = states.eps_a[-1]
    beyond = strain > end + 0.5 * np.median(np.diff(states.eps_a))
    values = np.interp(strain, states.eps_a, states.responses[symbol])
    if beyond.any():
        if not states.steady_end:
            raise ResponsesError(
                f"run {run_id}: ends at eps_a = {end:.4g} before the campaign's {strain[-1]:.4g} and is not steady"
            )
        values[beyond] = states.states["critical"][symbol]
    return values, beyond


def _packing_error(sets):
    count = np.maximum(np.isfinite(sets).sum(axis=0), 1)
    return np.sqrt(weighted.mean(np.moveaxis(sets**2, 0, -1), np.ones(len(sets))) / count)
