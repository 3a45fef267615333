"""Points and settings become rows: one row, one run, one product; and what it will cost.

A run's id ends in the hash of everything that run uses, the run it starts from included.  So a changed setting makes
new rows where it matters, leaves the others as they are, and can never be mistaken for the old one.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path

from campaign.config import ROOT, Config
from campaign.files import read_json, write_json, write_text
from campaign.prepare import grains_file

#: Raised for a stage whenever its script computes something else from the same parameters.
PROTOCOL = {"consolidate": 4, "probe": 4, "shear": 5}
STAGES = ("consolidate", "probe", "shear")
#: Of the laptop campaign's 855 runs together (data/laptop/tables/runs.csv), starts apart; two at once on two cores.
PARTICLE_STEPS_PER_CPU_SECOND = {"consolidate": 0.86e6, "probe": 0.445e6, "shear": 0.524e6}
SECONDS_PER_START = 1.5
#: How much larger the step is with `dem.density_scaling` (shear runs at N = 1,000: 1.80 to 1.85).
BALANCED_STEP = 1.85
#: Friction above which the inertial number of shear has a limit, and that at the threshold (yade_scripts/rve.py).
FULL_RATE_FRICTION, FULL_RATE = 0.3, 2.4e-3
RETRY_STEP = 0.5


@dataclass(frozen=True)
class Row:
    """One run: `values` are the parameters its script reads (SI), `start` the run it starts from ("" if none)."""

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
    values: dict

    @property
    def product(self) -> str:
        return f"products/{self.run_id}.h5"

    @property
    def cpu_seconds(self) -> float:
        return predicted_seconds(self.stage, self.particle_steps)


def make_rows(config: Config, points: list[dict]) -> list[Row]:
    """All runs of a campaign, stage by stage, the costliest first within a stage.

    points: dicts with id, mu_s and G_p (Pa).  Rows that two families share stand once, under family "shared".
    """
    rows: dict[str, Row] = {}
    for packing in config.assembly.packings:
        first = packing == config.assembly.packings[0]
        for mu_iso in config.consolidation.mu_iso:
            for family, fixed, own in _families(config, points, first):
                for point in own if first else _spread(own, "mu_s", config.assembly.replicate_points):
                    _chain(rows, config, family, packing, mu_iso, point, fixed)
    order = {stage: k for k, stage in enumerate(STAGES)}
    return sorted(rows.values(), key=lambda r: (order[r.stage], -r.particle_steps, r.run_id))


def _families(config: Config, points: list[dict], first: bool):
    """Family, its fixed mu_s (None: each point has its own), and its points; a second family has one packing."""
    yield "coupled", None, points
    if config.families.G_p_only and first:
        yield "G_p", config.families.mu_s_fixed, _spread(points, "G_p", config.families.G_p_points)


def _spread(points: list[dict], symbol: str, wanted: int) -> list[dict]:
    """So many of the points, evenly spread in the order of a property; all for -1."""
    if wanted < 0 or wanted >= len(points):
        return points
    ranked = sorted(points, key=lambda p: p[symbol])
    return [ranked[int((k + 0.5) * len(points) / wanted)] for k in range(wanted)]


def _chain(rows, config: Config, family: str, packing: int, mu_iso: float, point: dict, mu_s_fixed) -> None:
    """Add consolidate -> probe -> shear of one point, one density, one packing."""
    mu_s = point["mu_s"] if mu_s_fixed is None else mu_s_fixed
    dem, per_point = config.dem, config.consolidation.per_point
    common = {
        "assembly": f"assembly_{packing}.h5", "mu_iso": mu_iso, "sigma_3": config.consolidation.sigma_3_kPa * 1e3,
        "nu": config.material.nu, "rho": config.material.rho, "d50": config.assembly.d50_mm * 1e-3, "seed": packing,
        "timestep_factor": dem.timestep_factor, "stiffness_scale": 1.0, "density_scaling": int(dem.density_scaling),
    }  # fmt: skip
    where = {"packing": packing, "mu_iso": mu_iso}
    G_first = point["G_p"] if per_point else config.consolidation.G_ref_GPa * 1e9
    first = _row(
        config, "consolidate", "shared", point["id"] if per_point else -1, where, math.nan, G_first, "", common
    )
    rows.setdefault(first.run_id, first)
    swapped = common | {"mu_s": mu_s, "damping": dem.damping, "heterogeneity": config.material.heterogeneity}
    if config.material.heterogeneity == "grain":
        swapped["grains"] = grains_file(config, point["id"])
    probe_only = {"probe_strain": config.probe.strain}
    probe = _row(config, "probe", family, point["id"], where, mu_s, point["G_p"], first.run_id, swapped | probe_only)
    rows.setdefault(probe.run_id, probe)
    shear_only = {
        "inertial_number": config.shear.inertial_number, "strain_end": config.shear.strain_end,
        "windows": config.shear.windows or "default", "stop_when_steady": int(config.shear.stop_when_steady),
        "snapshots": ",".join(f"{s:g}" for s in config.shear.snapshots), "stiffness_scale": dem.stiffness_scale,
    }  # fmt: skip
    if config.shear.energy_strain:
        shear_only["energy_strain"] = config.shear.energy_strain
    shear = _row(config, "shear", family, point["id"], where, mu_s, point["G_p"], probe.run_id, swapped | shear_only)
    rows.setdefault(shear.run_id, shear)


def _row(config, stage, family, point, where, mu_s, G_p, start, values) -> Row:
    values = values | {"G_p": G_p, "start": f"products/{start}.h5" if start else ""}
    grains = config.assembly
    used = {"stage": stage, "protocol": PROTOCOL[stage], "N": grains.N, "sigma_ln": grains.sigma_ln,
            "distribution": grains.distribution, **values}  # fmt: skip
    digest = hashlib.sha256(json.dumps(used, sort_keys=True).encode()).hexdigest()[:8]
    names = [stage]
    if not math.isnan(mu_s):
        names.append(f"mu{mu_s:.3f}")
    names += [f"G{G_p / 1e9:.1f}", f"iso{where['mu_iso']:.3f}", f"s{where['packing']}", digest]
    steps = predicted_steps(stage, values)
    return Row("_".join(names), stage, family, point, where["packing"], where["mu_iso"], mu_s, G_p, start, steps,
               steps * grains.N, values)  # fmt: skip


def predicted_steps(stage: str, values: dict) -> float:
    """Steps of a run: 8 (strain / I) (G_p / sigma_3)^(1/3) at 0.8 of the contact time step, and its like."""
    stiff = (values["G_p"] * values["stiffness_scale"] / values["sigma_3"]) ** (1.0 / 3.0)
    step = values["timestep_factor"] / 0.8 * (BALANCED_STEP if values["density_scaling"] else 1.0)
    if stage == "shear":
        rate = effective_rate(values["inertial_number"], values["mu_s"])
        return 8.0 * values["strain_end"] / rate * stiff / step
    return {"consolidate": 1350.0, "probe": 150.0}[stage] * stiff / step


def predicted_seconds(stage: str, particle_steps: float) -> float:
    """CPU time (s) of a run, YADE's start included."""
    return SECONDS_PER_START + particle_steps / PARTICLE_STEPS_PER_CPU_SECOND[stage]


def effective_rate(asked: float, mu_s: float) -> float:
    """Inertial number at which shear runs: the one asked for, above FULL_RATE_FRICTION under its limit."""
    return asked if mu_s <= FULL_RATE_FRICTION else min(asked, FULL_RATE * FULL_RATE_FRICTION / mu_s)


def predicted_cost(rows: list[Row]) -> dict[str, dict]:
    """Runs, particle-steps and core-hours by stage, and in all."""
    cost = {}
    for stage in (*STAGES, "total"):
        some = [r for r in rows if stage in (r.stage, "total")]
        cost[stage] = {
            "runs": len(some),
            "particle_steps": sum(r.particle_steps for r in some),
            "core_hours": sum(r.cpu_seconds for r in some) / 3600.0,
        }
    return cost


def collapsing(rows: list[Row]) -> dict[float, int]:
    """mu_iso -> how many points' packings collapse to a denser one when the grains take on their own friction."""
    lower = {(r.mu_iso, r.point) for r in rows if r.family == "coupled" and r.mu_s < r.mu_iso}
    return {mu_iso: sum(m == mu_iso for m, _ in lower) for mu_iso in sorted({m for m, _ in lower})}


PLAN_COLUMNS = ("run_id", "stage", "family", "point", "packing", "mu_iso", "mu_s", "G_p", "product", "start", "steps",
                "particle_steps", "cpu_seconds")  # fmt: skip


def write_plan(rows: list[Row], folder: Path) -> list[str]:
    """tables/plan.csv for people and batch/<stage>.table for yade-batch, from the same rows.

    Returns the files that somebody had edited since they were written; they are written anew.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(PLAN_COLUMNS)
    for row in rows:
        writer.writerow([_plain(getattr(row, name)) for name in PLAN_COLUMNS])
    files = {"tables/plan.csv": out.getvalue()}
    for stage in STAGES:
        some = [row for row in rows if row.stage == stage]
        files[f"batch/{stage}.table"] = yade_table(some, f"yade-batch batch/{stage}.table {script(folder, stage)}")
    written = read_json(folder / "tables" / "written.json", {})
    edited = [name for name, digest in written.items() if _file_digest(folder / name) not in ("", digest)]
    for name, text in files.items():
        write_text(folder / name, text)
    write_json(folder / "tables" / "written.json", {name: _file_digest(folder / name) for name in files})
    return edited


def _file_digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else ""


def _plain(value):
    return f"{value:.6g}" if isinstance(value, float) and value > 1e4 and value == round(value) else value


def table_path(folder: Path, stage: str) -> Path:
    return folder / "batch" / f"{stage}.table"


def script(folder: Path, stage: str) -> str:
    """The stage's script as seen from the campaign's folder."""
    return os.path.relpath(ROOT / "yade_scripts" / f"{stage}.py", folder)


def yade_table(rows: list[Row], note: str) -> str:
    """Rows as yade-batch reads them: text in quotes (not the description), numbers in full, a newline at the end."""
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
    """The line (as an editor counts) of a stage's row number `position`."""
    return position + 3
