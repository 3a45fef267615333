"""Run time against error of the DEM protocol: one setting at a time, over common packings, points and densities.

    python3 tests/benchmarks/bench_dem.py            all runs that are missing, packing by packing (hours; resumable)
    python3 tests/benchmarks/bench_dem.py --short    one packing, one point, one density (minutes)
    python3 tests/benchmarks/bench_dem.py --table    only the tables and the figure from the rows there are

Rows go to data/benchmarks/dem_runs.csv as they finish; data/benchmarks/dem_errors.csv holds bias and scatter of every
response of every setting against the reference, and data/benchmarks/dem_errors.png shows error against cost.
"""

from __future__ import annotations

import argparse
import itertools

from bench_rows import append, finished
from dem_runs import ROOT, RunFailed, chain, digest

from analysis.run_states import run_states

ROWS = ROOT / "data" / "benchmarks" / "dem_runs.csv"
POINTS = {"low": (0.09, 45.0e9), "middle": (0.214, 25.7e9), "high": (0.50, 14.0e9)}
MU_ISO = (0.001, 0.04, 0.1)
PACKINGS = (1, 2, 3, 4, 5)
BASE = {
    "N": 1000,
    "inertial_number": 1e-3,
    "timestep_factor": 0.8,
    "damping": 0.0,
    "stiffness_scale": 1.0,
    "density_scaling": 0,
}
#: One change at a time to the reference, then the settings that a campaign would use; the most wanted first.
SETTINGS = {
    "reference": {},
    "I = 2.4e-3": {"inertial_number": 2.4e-3},
    "step 1.0": {"inertial_number": 2.4e-3, "timestep_factor": 1.0},
    "N = 500": {"N": 500, "inertial_number": 2.4e-3, "timestep_factor": 1.0},
    "stiffness 0.3": {"inertial_number": 2.4e-3, "timestep_factor": 1.0, "stiffness_scale": 0.3},
    "stiffness 0.1": {"inertial_number": 2.4e-3, "timestep_factor": 1.0, "stiffness_scale": 0.1},
    "damping 0.2": {"inertial_number": 2.4e-3, "timestep_factor": 1.0, "damping": 0.2},
    "N = 2000": {"N": 2000, "inertial_number": 2.4e-3, "timestep_factor": 1.0},
    "I = 5e-4": {"inertial_number": 5e-4},
}
RESPONSES = {
    "peak": ("eta", "eps_peak", "D_p"),
    "critical": ("eta", "e", "e_m", "Z", "Z_m", "Phi_dev"),
    "initial": ("e", "Z"),
}
COLUMNS = (
    "setting",
    "scripts",
    "packing",
    "mu_iso",
    "point",
    "N",
    "steps",
    "particle_steps",
    "cpu_seconds",
    "failure",
    "energy_error",
    "servo_mean_error",
    "servo_max_error",
    "G_0",
    *(f"{symbol}_{state}" for state, symbols in RESPONSES.items() for symbol in symbols),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="one packing, one point, one density")
    parser.add_argument("--table", action="store_true", help="only summarise the rows there are")
    parser.add_argument("--settings", nargs="*", default=list(SETTINGS), help="only these settings")
    args = parser.parse_args()
    if not args.table:
        for setting, packing, mu_iso, point in wanted(args):
            add_row(setting, packing, mu_iso, point)
    from dem_errors import summarise

    summarise(ROWS)


def wanted(args):
    """Runs without a row of today's scripts: packing by packing, so that every setting soon has some."""
    done = finished(ROWS, ("scripts", "setting", "packing", "mu_iso", "point"))
    packings, densities, points = (PACKINGS[:1], (0.04,), ("middle",)) if args.short else (PACKINGS, MU_ISO, POINTS)
    for packing, setting, point, mu_iso in itertools.product(packings, args.settings, points, densities):
        if (digest(), setting, str(packing), f"{mu_iso:g}", point) not in done:
            yield setting, packing, mu_iso, point


def add_row(setting: str, packing: int, mu_iso: float, point: str) -> None:
    """Run one case and append its row, failed or not."""
    values = BASE | SETTINGS[setting]
    mu_s, G_p = POINTS[point]
    row = {
        "setting": setting,
        "scripts": digest(),
        "packing": packing,
        "mu_iso": mu_iso,
        "point": point,
        "N": values["N"],
        "failure": "",
    }
    try:
        probe, shear = chain(seed=packing, mu_iso=mu_iso, mu_s=mu_s, G_p=G_p, strain_end=0.40, snapshots="", **values)
        states = run_states(shear).states
        row |= {k: int(shear.timing[k]) for k in ("steps",)} | {"cpu_seconds": float(shear.timing["cpu_seconds"])}
        row["particle_steps"] = row["steps"] * values["N"]
        row |= {k: float(shear.proofs[k]) for k in ("energy_error", "servo_mean_error", "servo_max_error")}
        row["G_0"] = float(probe.probe["G_0"])
        row |= {f"{s}_{state}": float(states[state][s]) for state, names in RESPONSES.items() for s in names}
    except RunFailed as error:
        row["failure"] = str(error)
    append(ROWS, COLUMNS, row)


if __name__ == "__main__":
    main()
