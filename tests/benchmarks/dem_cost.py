"""What the paper's campaign costs at a setting of `bench_dem.py`, beside the paper's own protocol at LAMMPS' speed."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
from dem_runs import ROOT

from analysis.points import RepresentativePoints
from campaign.config import Config, read_config
from campaign.plan import STAGES, make_rows, predicted_seconds, predicted_steps

LAMMPS = ROOT / "data" / "benchmarks" / "lammps.csv"
#: Campaign that is costed -> setting of the benchmark whose runs correct its plan (those of equal size); and the
#: setting whose steps tell how far the model of steps is off the paper's.
COSTED, OWN_INERTIA = {"laptop": "base", "5%": "N = 400", "3%": "N = 500", "2%": "N = 500"}, "reference"


def costs(
    rows: pd.DataFrame, settings: dict[str, dict], presets: dict[str, dict], points: dict[str, tuple]
) -> pd.DataFrame:
    """Core-hours of the paper's 600 shear runs, 600 probes and consolidations: a row a setting, and the paper's own.

    The plan of that campaign has the rate, step and size of every run; what the benchmark's runs took over what the
    plan says of them corrects it, for shear and probe apart (consolidation, three runs, as shear).  The paper's
    protocol has 23,312 spheres with their own inertia at I = 1e-4 and a consolidation a point; its particle-steps, all
    corrected as the reference's shear runs, are taken at the rate of LAMMPS' bare loop over 27,000 spheres, without
    servo and record, while ours are whole runs, as many at once as the benchmark had.  `ratio`: how many times dearer
    it is.

    settings: name -> what the rows of this name were run with; presets: campaign -> what it would be given; points:
    name -> (mu_s, G_p in Pa).
    """
    good = rows[rows.failure.isna()]
    paper = read_config(ROOT / "campaign" / "paper.toml")
    all_points = RepresentativePoints.from_csv((ROOT / "data" / "laptop" / "points.csv").read_text())

    def over_plan(some, stage: str, taken: pd.Series, seconds: bool) -> float:
        """What these rows took together over the steps, or CPU seconds, that the plan has for them."""
        planned = (_planned(row, stage, settings[row.setting], points[row.point], seconds) for row in some.itertuples())
        return taken.sum() / sum(planned)

    out = []
    for name in (name for name, setting in COSTED.items() if (good.setting == setting).any()):
        some, plan = good[good.setting == COSTED[name]], make_rows(_config(paper, presets[name]), all_points)
        over = {"shear": over_plan(some, "shear", some.cpu_seconds, True),
                "probe": over_plan(some, "probe", some.probe_cpu_seconds, True)}  # fmt: skip
        steps = {"shear": over_plan(some, "shear", some.steps, False),
                 "probe": over_plan(some, "probe", some.probe_steps, False)}  # fmt: skip
        hours = {s: over.get(s, over["shear"]) * sum(r.cpu_seconds for r in plan if r.stage == s) / 3600
                 for s in STAGES}  # fmt: skip
        particle_steps = sum(steps.get(r.stage, steps["shear"]) * r.particle_steps for r in plan)
        out.append({"campaign": name, "runs": len(plan), "particle_steps": particle_steps, **hours,
                    "core_hours": sum(hours.values())})  # fmt: skip
    slow = good[good.setting == OWN_INERTIA]
    if len(slow) and LAMMPS.exists():
        loops = pd.read_csv(LAMMPS).query("run == 'bare loop'").sort_values("N")
        plan = make_rows(paper, all_points)
        steps = over_plan(slow, "shear", slow.steps, False) * sum(r.particle_steps for r in plan)
        hours = steps / loops.particle_steps_per_cpu_second.iloc[-1] / 3600
        out.append({"campaign": "the paper's protocol, LAMMPS", "runs": len(plan), "particle_steps": steps,
                    "core_hours": hours})  # fmt: skip
        for row in out:
            row["ratio"] = hours / row["core_hours"]
    return pd.DataFrame(out)


def _config(paper: Config, values: dict) -> Config:
    """The paper's campaign at a setting of the benchmark, consolidated once a density."""
    return replace(
        paper,
        assembly=replace(paper.assembly, N=values["N"]),
        consolidation=replace(paper.consolidation, per_point=False),
        shear=replace(paper.shear, inertial_number=values["inertial_number"]),
        dem=replace(paper.dem, timestep_factor=values["timestep_factor"],
                    density_scaling=bool(values["density_scaling"]), stiffness_scale=values["stiffness_scale"]),
    )  # fmt: skip


def _planned(row, stage: str, values: dict, point: tuple, seconds: bool) -> float:
    mu_s, G_p = point
    asked = values | {"inertial_number": row.inertial_number, "mu_s": mu_s, "G_p": G_p, "sigma_3": 100e3}
    steps = predicted_steps(stage, asked)
    return predicted_seconds(stage, steps * row.N) if seconds else steps
