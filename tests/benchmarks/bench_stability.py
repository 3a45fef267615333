"""The stability map: what the protocol does far from where it is used; each cell ends right, or refused with a reason.

    python3 tests/benchmarks/bench_stability.py            all cells that are missing (an hour; resumable)
    python3 tests/benchmarks/bench_stability.py --table    only the counts

A cell is one chain consolidate -> shear to 4 % strain with one or two parameters changed.  It is held against the same
physical case at half the step, a third of the rate, with the grains' own inertia and the standard servo: e and Z of
the consolidated packing, and then, sheared from the cell's own packing (so that two packings' difference is not taken
for an error), eta over 0.5-4 % strain, e and Z at its end.  All within TOLERANCE: *right*.  A stage that ended with a
stated reason: *refused*.  Everything else is *wrong*, and the script exits with 1.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
from bench_rows import append, finished
from dem_runs import BUILD, ROOT, RunFailed, assembly, digest, run

from analysis.assembly import Assembly, make_assembly, write_assembly
from analysis.runfile import read_run
from analysis.triaxial import stress_ratio

ROWS = ROOT / "data" / "benchmarks" / "stability.csv"
MEASURED = ("e_0", "Z_0", "eta", "e", "Z")
COLUMNS = ("scripts", "axis", "value", "second", "outcome", "reason", *MEASURED, *(f"{k}_reference" for k in MEASURED),
           "energy_error", "servo_mean_error", "steps", "cpu_seconds")  # fmt: skip
BASE = {
    "N": 200,
    "seed": 1,
    "mu_iso": 0.04,
    "mu_s": 0.25,
    "G_p": 25.7e9,
    "sigma_3": 100e3,
    "inertial_number": 2.4e-3,
    "timestep_factor": 1.0,
    "density_scaling": 1,
    "stiffness_scale": 1.0,
    "sigma_ln": 0.174,
    "distribution": "lognormal",
}
#: Relative: three standard deviations of what packings of 200 spheres (e_0, Z_0), or 4 % of strain of one, differ by;
#: fewer spheres differ by more, as N^-1/2.
TOLERANCE = {"e_0": 0.03, "Z_0": 0.06, "eta": 0.15, "e": 0.02, "Z": 0.06}


STEP = (0.2, 0.3, 0.4, 0.6, 0.8, 0.9, 1.0, 1.05, 1.1, 1.15, 1.2, 1.3, 1.5, 1.75, 2.0, 2.5, 3.0)
STEP_OWN = (0.2, 0.5, 0.8, 1.0, 1.1, 1.2, 1.5, 2.0, 3.0)
STIFFNESS = (1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0)
FRICTION = (0.001, 0.003, 0.01, 0.03, 0.06, 0.1, 0.15, 0.25, 0.4, 0.65, 0.9, 1.2)
STRESS = (1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 1e6, 3e6, 1e7)
RATE = (1e-3, 1.5e-3, 2e-3, 2.4e-3, 3e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1)
SIZE = (64, 80, 100, 150, 200, 300, 500)
WIDTH = (0.0, 0.1, 0.174, 0.25, 0.35, 0.5)
GAIN, DAMPING = (1e-4, 1e-3, 5e-3, 0.02, 0.05, 0.1, 0.5, 2.0), (0.0, 0.4, 0.8, 0.99)
SQUEEZE = (1.0, 1.02, 1.05, 1.1, 1.2, 1.5)


def cells():
    """(axis, value, second, changes): one parameter at a time, then pairs of them."""
    for axis, values, name in (
        ("stiffness", STIFFNESS, "stiffness_scale"),
        ("friction", FRICTION, "mu_s"),
        ("stress", STRESS, "sigma_3"),
        ("size", SIZE, "N"),
        ("width", WIDTH, "sigma_ln"),
        ("step", STEP, "timestep_factor"),
        ("rate", RATE, "inertial_number"),
    ):
        for value in values:
            yield axis, value, "", {name: value}
    for value in STEP_OWN:
        yield "step, own inertia", value, "", {"timestep_factor": value, "density_scaling": 0}
    for name in ("loguniform", "well_graded", "gap_graded"):
        yield "grading", name, "", {"distribution": name}
    for squeeze in SQUEEZE:
        yield "overlapping start", squeeze, "", {"squeeze": squeeze}
    for gain in GAIN:
        for damping in DAMPING:
            yield "servo", gain, damping, {"servo_mass": gain, "servo_damping": damping}
    for step in (0.8, 1.0, 1.1, 1.3, 2.0):
        for mu_s in (0.01, 0.1, 0.65):
            yield "step x friction", step, mu_s, {"timestep_factor": step, "mu_s": mu_s}
        for sigma_3 in (1e4, 1e6, 1e7):
            yield "step x stress", step, sigma_3, {"timestep_factor": step, "sigma_3": sigma_3}
    for rate in (1e-3, 2.4e-3, 1e-2):
        for stiffness in (0.01, 0.1, 3.0):
            yield "rate x stiffness", rate, stiffness, {"inertial_number": rate, "stiffness_scale": stiffness}
        for mu_s in (0.03, 0.9):
            yield "rate x friction", rate, mu_s, {"inertial_number": rate, "mu_s": mu_s}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="store_true", help="only count the rows there are")
    parser.add_argument("--axis", help="only this axis")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="runs at once")
    args = parser.parse_args()
    done = finished(ROWS, ("scripts", "axis", "value", "second"))

    def fill(cell) -> None:
        axis, *values, changes = cell
        texts = (f"{v:.6g}" if isinstance(v, float) else str(v) for v in values)
        if (digest(), axis, *texts) not in done:
            append(ROWS, COLUMNS, judged(BASE | changes) | {"axis": axis, "value": values[0], "second": values[1]})

    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(fill, [c for c in cells() if not args.table and args.axis in (None, c[0])]))
    rows = pd.read_csv(ROWS, keep_default_na=False)
    rows = rows[rows.scripts == rows.scripts.iloc[-1]]
    print(rows.groupby(["axis", "outcome"]).size().unstack(fill_value=0).to_string())
    print(f"{len(rows)} cells, {np.sum(rows.outcome == 'wrong')} wrong without a word")
    sys.exit(int(np.any(rows.outcome == "wrong")))


def judged(case: dict) -> dict:
    """The row of one cell: its outcome against its own reference."""
    row = {"scripts": digest()}
    fine = {k: v for k, v in case.items() if not k.startswith("servo_") and k != "squeeze"}
    fine |= {"timestep_factor": 0.5, "inertial_number": 8e-4, "density_scaling": 0}
    try:
        start = consolidated(case)
        mine, told = sheared(start, case)
    except RunFailed as error:
        return row | {"outcome": "refused", "reason": str(error)}
    mine |= initial(start)
    try:
        reference = sheared(start, fine)[0] | initial(consolidated(fine))
    except RunFailed as error:
        return row | {"outcome": "wrong", "reason": f"its reference failed: {error}"} | mine | told
    grown = max(1.0, (200 / case["N"]) ** 0.5)
    off = [k for k, limit in TOLERANCE.items() if not abs(mine[k] / reference[k] - 1.0) <= grown * limit]
    return (
        row
        | {"outcome": "wrong" if off else "right", "reason": " ".join(off), **mine, **told}
        | {f"{k}_reference": v for k, v in reference.items()}
    )


def consolidated(case: dict, yade: str = "yade"):
    """The product of a cell's consolidation."""
    start = squeezed(case["N"], case["seed"], case["sigma_ln"], case["distribution"], case.get("squeeze"))
    values = {k: case[k] for k in ("mu_iso", "G_p", "sigma_3", "seed", "timestep_factor", "density_scaling")}
    servo = {k: v for k, v in case.items() if k.startswith("servo_")}
    return run("consolidate", yade, assembly=start, **values, **servo)


def initial(product) -> dict:
    """e and Z of a consolidated packing."""
    record = read_run(product).record
    return {"e_0": float(record["e"][-1]), "Z_0": float(record["Z"][-1])}


def sheared(start, case: dict, yade: str = "yade") -> tuple[dict, dict]:
    """eta over 0.5-4 % strain, e and Z at its end, and the run's proofs.  Raises RunFailed where a stage refuses."""
    left_out = ("N", "sigma_ln", "distribution", "squeeze")
    values = {k: v for k, v in case.items() if k not in left_out}
    shear = read_run(run("shear", yade, start=start, strain_end=0.04, windows=16, snapshots="", **values))
    strain = shear.record["eps_a"]
    eta = float(stress_ratio(shear.record["sigma"])[strain > 0.005].mean())
    mine = {"eta": eta, "e": float(shear.record["e"][-1]), "Z": float(shear.record["Z"][strain > 0.02].mean())}
    told = {k: float(shear.proofs[k]) for k in ("energy_error", "servo_mean_error")}
    return mine, told | {k: shear.timing[k] for k in ("steps", "cpu_seconds")}


def squeezed(N: int, seed: int, width: float, kind: str, squeeze: float | None):
    """The usual assembly, or one whose grains are blown up by `squeeze` so that they overlap from the start."""
    if squeeze is None:
        return assembly(N, seed, width, kind)
    path = BUILD / f"assembly_squeezed_{squeeze:g}_{N}_{seed}.h5"
    if not path.exists():
        loose = make_assembly(N, 0.248e-3, width, seed, kind, solid_fraction=0.56)
        write_assembly(path, Assembly(loose.position / squeeze, loose.radius, loose.cell / squeeze))
    return path


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
