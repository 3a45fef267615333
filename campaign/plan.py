"""The plan: one row per run, made from the points and the settings, and the predicted cost of all runs.

A run id ends in the hash of everything that the run uses, the id of the run it starts from included. A changed setting
therefore gives new ids to the runs that use it, leaves all other ids as they are, and a product can never be taken for
that of another setting.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.errors_and_files import digest
from analysis.quantities import effective_inertial_number
from campaign.config import ROOT, Config, assembly_file, grains_file
from campaign.files import read_json, write_json, write_text
from campaign.folder import folder_lock

if TYPE_CHECKING:
    from analysis.points import RepresentativePoints
    from analysis.points.representative_points import Point

#: Version of each stage. Raised whenever the script of a stage computes something else from the same parameters.
PROTOCOL = {"consolidate": 4, "probe": 4, "shear": 5}
#: The same of `campaign/lammps`.
LAMMPS_PROTOCOL = {"consolidate": 2, "probe": 2, "shear": 2}
STAGES = ("consolidate", "probe", "shear")

#: Constants of the cost model, fitted to the sums over the laptop campaign's 780 runs (data/laptop/tables/runs.csv):
#: 1,000 spheres, two runs at once on two cores. The rates are without the start of YADE, which is SECONDS_PER_START.
PARTICLE_STEPS_PER_CPU_SECOND = {"consolidate": 1.40e6, "probe": 0.70e6, "shear": 1.01e6}
SECONDS_PER_START = 1.5
#: Steps of a run over (G_p / sigma_3)^(1/3), at the time-step factor STEP_FACTOR and without density scaling. Means of
#: the same runs: 1,351 per consolidation (2,205 at mu_iso = 0.001, 962 at 0.04, 886 at 0.1), 133 per probe, and per
#: shear run 7.8 times strain over inertial number.
CONSOLIDATION_STEPS, PROBE_STEPS, SHEAR_STEPS = 1350.0, 150.0, 8.0
STEP_FACTOR = 0.8
#: How much larger the time step is with `dem.density_scaling` (shear runs at N = 1,000: 1.80 to 1.85).
BALANCED_STEP = 1.85
#: The same of LAMMPS, from chains of 400 spheres (data/benchmarks/engines.csv), one run at a time on a busy machine.
#: Its moments of inertia cannot be balanced.
LAMMPS_RATE = {"consolidate": 4.5e6, "probe": 5.0e6, "shear": 4.4e6}
LAMMPS_SECONDS_PER_START, LAMMPS_STEPS, LAMMPS_BALANCED_STEP = 0.6, (846.0, 219.0, 8.15), 1.5
#: Steps of a test that holds p', and of a drained extension, over those of drained compression (tests/benchmarks/
#: bench_paths.py: 1.10 to 1.11, and 1.17 to 1.18).
CONSTANT_P_STEPS, EXTENSION_STEPS = 1.1, 1.17
#: Strain of a drained test with as many steps as an undrained one has on average, by mu_iso: it ends early, and its
#: rate and its time step follow p' (24 runs of 400 spheres at mu_iso = 0.001, 0.04 and 0.1: 0.023, 0.063 and 0.057).
UNDRAINED_STRAIN = ((0.001, 0.023), (0.04, 0.06))

#: Random variables that give each point grains of its own, and those with which it consolidates by itself.
OWN_GRAINS = {"sigma_ln", "d50"}
OWN_CONSOLIDATION = {*OWN_GRAINS, "sigma_3"}

PLAN_COLUMNS = ("run_id", "stage", "family", "point", "packing", "mu_iso", "mu_s", "G_p", "product", "start", "steps",
                "particle_steps", "cpu_seconds")  # fmt: skip


@dataclass(frozen=True)
class PlannedRun:
    """One run of the plan, a row of its tables.

    `values` are the parameters that the stage's script reads (SI units), `start` is the id of the run that this run
    starts from ("" for a consolidation), G_p is in Pa. `steps` and `particle_steps` are predictions. `further` has the
    values (SI units) of the point's random variables beside mu_s and G_p, none for a consolidation that points share.
    """

    run_id: str
    stage: str
    family: str
    point: int
    packing: int
    mu_iso: float
    mu_s: float
    G_p: float
    start: str
    steps: float
    particle_steps: float
    values: dict[str, Any]
    further: Mapping[str, float] = field(default_factory=dict)

    @property
    def product(self) -> str:
        """Path of the run's product, relative to the campaign's folder."""
        return f"products/{self.run_id}.h5"

    @property
    def cpu_seconds(self) -> float:
        """Predicted CPU time, s."""
        return predicted_seconds(self.stage, self.particle_steps, self.values.get("code", "yade"))


def make_rows(config: Config, points: RepresentativePoints) -> list[PlannedRun]:
    """Return all runs of a campaign, stage by stage, within a stage the costliest first.

    A run that several points or families use occurs once; a consolidation has the family "shared".  A point has the
    same packing at every density and in every family.
    """
    rows: dict[str, PlannedRun] = {}
    all_points = list(points)
    packing = packing_of_points(config, points)
    for mu_iso in config.consolidation.mu_iso:
        for family, mu_s_fixed, family_points in _families(config, all_points):
            for point in family_points:
                _add_chain(rows, config, family, packing[point.id], mu_iso, point, mu_s_fixed)
    order = {stage: k for k, stage in enumerate(STAGES)}
    return sorted(rows.values(), key=lambda row: (order[row.stage], -row.particle_steps, row.run_id))


def packing_of_points(config: Config, points: RepresentativePoints) -> dict[int, int]:
    """Return the packing (its random seed) that each point takes, by the point's id."""
    seeds = config.assembly.packings
    if len(seeds) == 1:
        return dict.fromkeys(points.id.tolist(), seeds[0])
    from analysis.surrogates.rotation import deal

    return {k: seeds[r] for k, r in zip(points.id.tolist(), deal(points.x, len(seeds)).tolist(), strict=True)}


def _families(config: Config, points: Sequence[Point]) -> Iterator[tuple[str, float | None, Sequence[Point]]]:
    """Name, fixed mu_s (None: that of each point) and points of each family."""
    yield "coupled", None, points
    if config.families.G_p_only:
        yield "G_p", config.families.mu_s_fixed, _spread(points, "G_p", config.families.G_p_points)


def _spread(points: Sequence[Point], symbol: str, count: int) -> Sequence[Point]:
    """`count` of the points, evenly spread in the order of the property `symbol`; all points for -1."""
    if count < 0 or count >= len(points):
        return points
    ranked = sorted(points, key=lambda point: getattr(point, symbol))
    return [ranked[int((k + 0.5) * len(points) / count)] for k in range(count)]


def _add_chain(
    rows: dict[str, PlannedRun],
    config: Config,
    family: str,
    packing: int,
    mu_iso: float,
    point: Point,
    mu_s_fixed: float | None,
) -> None:
    """Add consolidation, probe and shear of one point, one density and one packing; runs that are there stay."""
    mu_s = point.mu_s if mu_s_fixed is None else mu_s_fixed
    dem, given, per_point = config.dem, point.further, consolidates_alone(config, point.further)
    nu = given.get("nu", config.material.nu)
    common = {
        "assembly": assembly_file(packing, point.id if OWN_GRAINS & given.keys() else -1), "mu_iso": mu_iso,
        "sigma_3": given.get("sigma_3", config.consolidation.sigma_3_kPa * 1e3),
        "nu": nu if per_point else config.material.nu, "rho": config.material.rho,
        "d50": given.get("d50", config.assembly.d50_mm * 1e-3), "seed": packing,
        "timestep_factor": dem.timestep_factor, "stiffness_scale": 1.0, "density_scaling": int(dem.density_scaling),
    }  # fmt: skip
    if dem.code != "yade":  # runs in YADE keep the ids that they had before there was a choice
        common["code"] = dem.code
    if config.curve:
        common["sieve"] = config.curve.name
    planned = partial(_planned_run, config, packing=packing, mu_iso=mu_iso, further=given)
    if per_point:
        first = planned("consolidate", "shared", point.id, math.nan, point.G_p, "", common)
    else:
        G_ref = config.consolidation.G_ref_GPa * 1e9
        first = planned("consolidate", "shared", -1, math.nan, G_ref, "", common, further={})
    rows.setdefault(first.run_id, first)
    swapped = common | {"nu": nu, "mu_s": mu_s, "damping": dem.damping, "heterogeneity": config.material.heterogeneity}
    if config.material.heterogeneity == "grain":
        swapped["grains"] = grains_file(config, point.id)
    probe_only = {"probe_strain": config.probe.strain}
    probe = planned("probe", family, point.id, mu_s, point.G_p, first.run_id, swapped | probe_only)
    rows.setdefault(probe.run_id, probe)
    shear_only = {
        "inertial_number": config.shear.inertial_number, "strain_end": config.shear.strain_end,
        "windows": config.shear.windows or "default", "stop_when_steady": int(config.shear.stop_when_steady),
        "snapshots": ",".join(f"{s:g}" for s in config.shear.snapshots), "stiffness_scale": dem.stiffness_scale,
    }  # fmt: skip
    if config.shear.energy_strain:
        shear_only["energy_strain"] = config.shear.energy_strain
    shear_only |= path_parameters(config)
    shear = planned("shear", family, point.id, mu_s, point.G_p, probe.run_id, swapped | shear_only)
    rows.setdefault(shear.run_id, shear)


def _planned_run(
    config: Config,
    stage: str,
    family: str,
    point: int,
    mu_s: float,
    G_p: float,
    start: str,
    values: dict[str, Any],
    *,
    packing: int,
    mu_iso: float,
    further: Mapping[str, float],
) -> PlannedRun:
    """One run with its id. The keys and values that are hashed must stay as they are, for they make the ids."""
    values = values | {"G_p": G_p, "start": f"products/{start}.h5" if start else ""}
    grains = config.assembly
    protocol = PROTOCOL if config.dem.code == "yade" else LAMMPS_PROTOCOL
    hashed = {"stage": stage, "protocol": protocol[stage], "N": grains.N,
              "sigma_ln": further.get("sigma_ln", grains.sigma_ln), "distribution": grains.distribution,
              **values}  # fmt: skip
    names = [stage]
    if not math.isnan(mu_s):
        names.append(f"mu{mu_s:.3f}")
    names += [f"G{G_p / 1e9:.1f}", f"iso{mu_iso:.3f}", f"s{packing}"]
    run_id = "_".join([*names, digest(json.dumps(hashed, sort_keys=True).encode(), 8)])
    steps = predicted_steps(stage, values)
    return PlannedRun(
        run_id, stage, family, point, packing, mu_iso, mu_s, G_p, start, steps, steps * grains.N, values, further
    )


def path_parameters(config: Config) -> dict[str, Any]:
    """Return the parameters of a shear run that give its path; none for drained compression, so that its ids hold."""
    shear, given = config.shear, dict[str, Any]()
    if shear.path != "drained":
        given["path"] = shear.path
    if shear.direction != "compression":
        given["direction"] = shear.direction
    if shear.path == "undrained":
        given["stiff_cap"] = shear.stiff_cap_MPa * 1e6
    return given


def consolidates_alone(config: Config, further: Mapping[str, float]) -> bool:
    """Whether every point has a consolidation of its own, because of `per_point` or of its `further` variables."""
    return config.consolidation.per_point or bool(OWN_CONSOLIDATION & further.keys())


def predicted_steps(stage: str, values: dict[str, Any]) -> float:
    """Return the predicted number of time steps of a run with these parameters (SI units).

    The time step scales with (G_p / sigma_3)^(-1/3) in units of the inertial time d50 sqrt(rho / sigma_3). A shear run
    lasts strain over inertial number inertial times, a consolidation or a probe a fixed number of them, so that

        steps = C (G_p / sigma_3)^(1/3) / (timestep_factor / STEP_FACTOR)

    with C = CONSOLIDATION_STEPS, PROBE_STEPS, or SHEAR_STEPS times strain over inertial number, LAMMPS_STEPS in LAMMPS.
    The strain is that of a drained compression with as many steps (`equivalent_strain`).
    """
    yade = values.get("code", "yade") == "yade"
    consolidation, probe, shear = (CONSOLIDATION_STEPS, PROBE_STEPS, SHEAR_STEPS) if yade else LAMMPS_STEPS
    balanced = BALANCED_STEP if yade else LAMMPS_BALANCED_STEP
    stiff = (values["G_p"] * values["stiffness_scale"] / values["sigma_3"]) ** (1.0 / 3.0)
    step = values["timestep_factor"] / STEP_FACTOR * (balanced if values["density_scaling"] else 1.0)
    if stage == "shear":
        rate = effective_inertial_number(values["inertial_number"], values["mu_s"])
        return shear * equivalent_strain(values) / rate * stiff / step
    return {"consolidate": consolidation, "probe": probe}[stage] * stiff / step


def equivalent_strain(values: dict[str, Any]) -> float:
    """Return the strain of a drained compression that has as many steps as a shear run with these parameters."""
    strain, path, extends = values["strain_end"], values.get("path", "drained"), values.get("direction") == "extension"
    if path == "undrained":
        mu_iso = values.get("mu_iso", UNDRAINED_STRAIN[-1][0])
        (low, dense), (high, medium) = UNDRAINED_STRAIN
        part = min(max((mu_iso - low) / (high - low), 0.0), 1.0)
        return min(strain, dense + part * (medium - dense))
    return strain * (CONSTANT_P_STEPS if path == "constant_p" else EXTENSION_STEPS if extends else 1.0)


def predicted_seconds(stage: str, particle_steps: float, code: str = "yade") -> float:
    """Return the predicted CPU time (s) of a run, the start of its code ("yade" or "lammps") included."""
    if code == "lammps":
        return LAMMPS_SECONDS_PER_START + particle_steps / LAMMPS_RATE[stage]
    return SECONDS_PER_START + particle_steps / PARTICLE_STEPS_PER_CPU_SECOND[stage]


def cost_model() -> str:
    """Return a name of the constants from which steps and seconds are predicted; it changes when one of them does."""
    constants = (PARTICLE_STEPS_PER_CPU_SECOND, SECONDS_PER_START, CONSOLIDATION_STEPS, PROBE_STEPS, SHEAR_STEPS,
                 BALANCED_STEP, LAMMPS_RATE, LAMMPS_SECONDS_PER_START, LAMMPS_STEPS, LAMMPS_BALANCED_STEP,
                 CONSTANT_P_STEPS, EXTENSION_STEPS, UNDRAINED_STRAIN)  # fmt: skip
    return digest(repr(constants).encode(), 8)


def predicted_cost(rows: Sequence[PlannedRun]) -> dict[str, dict[str, float]]:
    """Return runs, particle_steps and core_hours by stage, and their sums under "total"."""
    cost = {}
    for stage in (*STAGES, "total"):
        rows_of_stage = [row for row in rows if stage in (row.stage, "total")]
        cost[stage] = {
            "runs": len(rows_of_stage),
            "particle_steps": sum(row.particle_steps for row in rows_of_stage),
            "core_hours": sum(row.cpu_seconds for row in rows_of_stage) / 3600.0,
        }
    return cost


def collapsing(rows: Sequence[PlannedRun]) -> dict[float, int]:
    """Return mu_iso -> number of points with mu_s < mu_iso; densities without such points are left out.

    A packing of such a point collapses to a denser one when the grains take on their own, lower friction.
    """
    lower = {(row.mu_iso, row.point) for row in rows if row.family == "coupled" and row.mu_s < row.mu_iso}
    return {mu_iso: sum(m == mu_iso for m, _ in lower) for mu_iso in sorted({m for m, _ in lower})}


def write_plan(rows: Sequence[PlannedRun], folder: Path) -> list[str]:
    """Write tables/plan.csv (for people) and batch/<stage>.table (for yade-batch) from the same rows.

    Returns the names of those files that were edited by hand since they were last written; they are written anew.
    Raises RunError if files would change and another process runs in the folder, OSError if a file cannot be written.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    further = list(dict.fromkeys(name for row in rows for name in row.further))
    place = PLAN_COLUMNS.index("G_p") + 1
    writer.writerow([*PLAN_COLUMNS[:place], *further, *PLAN_COLUMNS[place:]])
    for row in rows:
        cells = [_csv_cell(getattr(row, name)) for name in PLAN_COLUMNS]
        writer.writerow([*cells[:place], *(_csv_cell(row.further.get(name, "")) for name in further), *cells[place:]])
    files = {"tables/plan.csv": out.getvalue()}
    for stage in STAGES:
        stage_rows = [row for row in rows if row.stage == stage]
        command = f"yade-batch batch/{stage}.table {script(folder, stage)}"
        if any("code" in row.values for row in stage_rows):
            root = os.path.relpath(ROOT, folder)
            command = f"YADE_BATCH=batch/{stage}.table:LINE PYTHONPATH={root} python3 -m campaign.lammps {stage}"
        files[f"batch/{stage}.table"] = yade_table(stage_rows, command)
    note = folder / "tables" / "written.json"
    written, before = read_json(note, {}), {name: _digest(folder / name) for name in files}
    edited = [name for name in files if name in written and before[name] not in ("", written[name])]
    after = {name: digest(text.encode(), 16) for name, text in files.items()}
    if (before, written) != (after, after):
        with folder_lock(folder):
            for name, text in files.items():
                write_text(folder / name, text)
            write_json(note, after)
    return edited


def _digest(path: Path) -> str:
    return digest(path.read_bytes(), 16) if path.exists() else ""


def _csv_cell(value: Any) -> Any:
    """Large whole numbers in six digits, everything else as it is."""
    return f"{value:.6g}" if isinstance(value, float) and value > 1e4 and value == round(value) else value


def table_path(folder: Path, stage: str) -> Path:
    """Return the path of a stage's table for yade-batch."""
    return folder / "batch" / f"{stage}.table"


def script(folder: Path, stage: str) -> str:
    """Return the path of a stage's script, relative to the campaign's folder."""
    return os.path.relpath(ROOT / "yade_scripts" / f"{stage}.py", folder)


def yade_table(rows: Sequence[PlannedRun], note: str) -> str:
    """Return rows of one stage as a parameter table of YADE; its first line is a comment that ends in `note`.

    Text is in quotes (the description is not), numbers have all their digits, and the text ends with a newline.
    """
    if not rows:
        return f"# {note}\n"
    names = ["description", "product", *rows[0].values]
    cells = [names] + [[row.run_id, repr(row.product)] + [repr(row.values[name]) for name in names[2:]] for row in rows]
    widths = [max(len(line[k]) for line in cells) for k in range(len(names))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)) for line in cells]
    ends = [""] + [f" # {row.cpu_seconds:.0f} CPU-s predicted" for row in rows]
    body = "".join(f"{line.rstrip()}{end}\n" for line, end in zip(lines, ends, strict=True))
    return f"# By hand, from the campaign's folder: {note}\n{body}"


def table_line(position: int) -> int:
    """Return the line number (from 1, as in an editor) of the row at a position (from 0) in a stage's table."""
    return position + 3
