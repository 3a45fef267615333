"""Run time against error of the DEM protocol: one setting at a time, over common packings, points and densities.

    python3 tests/benchmarks/bench_dem.py            all runs that are missing (hours; resumable)
    python3 tests/benchmarks/bench_dem.py --short    one case, three settings (minutes); the tables stay as they are
    python3 tests/benchmarks/bench_dem.py --full     every density with every point and packing (a day)
    python3 tests/benchmarks/bench_dem.py --table    only the tables and the figure from the rows there are
    python3 tests/benchmarks/bench_dem.py --again --settings base    these rows once more: same numbers, new times

Five packings, three points, three densities in fifteen cases: each point meets each density, each packing each point.
All settings of a case start from the same packing at rest, those of another N from their own.  `rate` is a share of the
rate that a campaign would shear the point at.
Rows go to data/benchmarks/dem_runs.csv as they finish.  Beside it dem_errors.csv holds bias and scatter of every
response of every setting against the reference, dem_limit.csv the bias of the laptop campaign and of the presets of
campaign/accuracy.toml against an infinitely slow shear by one regression over all rows, dem_errors.png shows error
against cost, and dem_cost.csv has what the paper's campaign costs at these presets.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
from bench_rows import append, finished, written
from dem_cost import costs
from dem_errors import MAIN, summarise
from dem_regression import biases
from dem_runs import ROOT, RunCrashed, RunFailed, chain, row_digest

from analysis.micromechanics.stiffness import StiffnessError
from analysis.quantities import effective_inertial_number
from analysis.runs.run_file import RunFileError
from analysis.runs.states import run_states

ROWS = ROOT / "data" / "benchmarks" / "dem_runs.csv"
POINTS = {"low": (0.09, 45.0e9), "middle": (0.214, 25.7e9), "high": (0.50, 14.0e9)}
MU_ISO = (0.001, 0.04, 0.1)
PACKINGS = (1, 2, 3, 4, 5)
BASE = {
    "N": 1000,
    "inertial_number": 2.4e-3,
    "strain_end": 0.40,
    "rate": 1.0,
    "timestep_factor": 1.0,
    "damping": 0.0,
    "stiffness_scale": 1.0,
    "density_scaling": 1,
}
#: What may differ where a run repeats another to the last digit: times, and an energy balance over another strain.
NOT_REPEATED = ("cpu_seconds", "probe_cpu_seconds", "energy_error")
#: What a campaign uses, the reference (grains with their own inertia, a smaller step, a lower rate), and one change at
#: a time to the first; the most wanted first.
SETTINGS = {
    "base": {},
    "reference": {"density_scaling": 0, "timestep_factor": 0.8, "rate": 0.4},
    "N = 500": {"N": 500},
    "N = 400": {"N": 400},
    "damping 0.1": {"damping": 0.1},
    "stiffness 0.3": {"stiffness_scale": 0.3},
    "stiffness 0.1": {"stiffness_scale": 0.1},
    "half the step": {"timestep_factor": 0.5},
    "no density scaling": {"density_scaling": 0},
    "rate / 2": {"rate": 1 / 2},
    "N = 2000": {"N": 2000},
    "rate / 5": {"rate": 1 / 5},
    "N = 500, rate / 10": {"N": 500, "rate": 1 / 10},
}
RESPONSES = {
    "peak": ("eta", "eps_peak", "D_p"),
    "critical": ("eta", "e", "e_m", "Z", "Z_m", "Phi_dev"),
    "initial": ("e", "Z"),
}
#: The responses that the presets are named after.
NAMED = (*MAIN, "Z_m_critical")
COLUMNS = (
    "setting",
    "scripts",
    "packing",
    "mu_iso",
    "point",
    "N",
    "inertial_number",
    "steps",
    "particle_steps",
    "cpu_seconds",
    "probe_steps",
    "probe_cpu_seconds",
    "failure",
    "energy_error",
    "servo_mean_error",
    "servo_max_error",
    "G_0",
    *(f"{symbol}_{state}" for state, symbols in RESPONSES.items() for symbol in symbols),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="one case, three settings")
    parser.add_argument("--full", action="store_true", help="all 45 cases")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="runs at once")
    parser.add_argument("--table", action="store_true", help="only summarise the rows there are")
    parser.add_argument("--settings", nargs="*", default=list(SETTINGS), help="only these settings")
    parser.add_argument("--again", action="store_true", help="run the settings' rows once more and compare")
    args = parser.parse_args()
    if args.again:
        again(args.settings, args.jobs)
    elif not args.table:
        settings = list(SETTINGS)[:3] if args.short else args.settings
        for some in [settings[:2], *([s] for s in settings[2:])]:
            with ThreadPoolExecutor(args.jobs) as pool:
                list(pool.map(lambda case: fill(case, some), cases(args)))  # noqa: B023  the pool ends with its turn
    rows = pd.read_csv(ROWS)
    rows = rows[rows.scripts == row_digest()]
    if not len(rows):
        sys.exit(f"{ROWS}: no row of this code ({row_digest()})")
    folder = None if args.short else ROWS.parent
    settings = {name: BASE | values for name, values in SETTINGS.items()}
    summarise(rows, folder)
    limit = against_the_limit(rows, settings)
    cost = costs(rows, settings, presets(), POINTS)
    if folder:
        limit.to_csv(folder / "dem_limit.csv", index=False, float_format="%.4g")
        cost.to_csv(folder / "dem_cost.csv", index=False, float_format="%.4g")
    print(cost.to_string(index=False, float_format=lambda v: f"{v:.4g}"))


def against_the_limit(rows: pd.DataFrame, settings: dict[str, dict]) -> pd.DataFrame:
    """Bias of the laptop campaign and of each preset against an infinitely slow shear; printed, too.

    `within` says whether the whole 95 % interval is within the limit that the preset is named after ("yes"), beyond it
    ("no"), or neither ("open").  The rate is taken linearly (exponent 1) and by its root.
    """
    asked = presets()
    table = pd.concat([biases(rows, settings | asked, asked, exponent) for exponent in (1.0, 0.5)])
    limit = table.setting.map(lambda name: float(name.rstrip("%")) / 100 if name.endswith("%") else np.nan)
    table["limit"] = limit
    sure, beyond = (abs(table.bias) + sign * table.bias_half_width for sign in (1, -1))
    table["within"] = np.select([limit.isna(), sure <= limit, beyond > limit], ["", "yes", "no"], "open")
    words = [f"{100 * b:+.1f} ± {100 * h:.1f} {w}" for b, h, w in
             zip(table.bias, table.bias_half_width, table.within, strict=True)]  # fmt: skip
    shown = table.assign(words=words)[table.response.isin(NAMED)]
    print("bias in % against an infinitely slow shear, linear in the rate (exponent 1) or in its root")
    print(shown.pivot(index=["exponent", "setting", "of"], columns="response", values="words").to_string())
    print(
        shown.pivot_table(index="exponent", columns="response", values="aic").to_string(
            float_format="AIC {:.1f}".format
        )
    )
    return table


def presets() -> dict[str, dict]:
    """The laptop campaign and the presets of campaign/accuracy.toml as settings; `rate` is the share at each point."""
    out = {"laptop": BASE}
    for name, sections in tomllib.loads((ROOT / "campaign" / "accuracy.toml").read_text()).items():
        values = BASE | {key: value for section in sections.values() for key, value in section.items()}
        asked, usual = values["inertial_number"], BASE["inertial_number"]
        rate = {point: effective_inertial_number(asked, mu_s) / effective_inertial_number(usual, mu_s)
                for point, (mu_s, _) in POINTS.items()}  # fmt: skip
        out[name] = values | {"rate": rate}
    return out


def cases(args) -> list[tuple]:
    """(packing, mu_iso, point): fifteen (every point in every packing and at every density), all 45, or one."""
    if args.short:
        return [(1, 0.04, "middle")]
    if args.full:
        return list(itertools.product(PACKINGS, MU_ISO, POINTS))
    return [(q, MU_ISO[(q + k) % 3], point) for q in PACKINGS for k, point in enumerate(POINTS)]


def fill(case: tuple, settings: list[str]) -> None:
    """The rows of one case that today's scripts have not written yet, one setting after the other."""
    packing, mu_iso, point = case
    done = finished(ROWS, ("scripts", "setting", "packing", "mu_iso", "point"))
    for setting in settings:
        if (row_digest(), setting, str(packing), f"{mu_iso:g}", point) not in done:
            add_row(setting, packing, mu_iso, point)


def again(settings: list[str], jobs: int) -> None:
    """Run rows once more with the scripts as they are: all must repeat; NOT_REPEATED is taken anew."""
    table = pd.read_csv(ROWS, dtype=str, keep_default_na=False)
    mine = table[(table.scripts == row_digest()) & table.setting.isin(settings)]
    cases = list(zip(mine.setting, mine.packing.astype(int), mine.mu_iso.astype(float), mine.point, strict=True))
    if not cases:
        sys.exit(f"{ROWS}: no row of {', '.join(settings)} to repeat")
    with ThreadPoolExecutor(jobs) as pool:
        rows = list(pool.map(lambda case: measured(*case), cases))
    other = []
    for index, case, row in zip(mine.index, cases, rows, strict=True):
        new = {key: written(value) for key, value in (row or {}).items()}
        differing = [key for key in new if key not in NOT_REPEATED and new[key] != table.loc[index, key]]
        if differing or not new:
            other.append(" ".join(map(str, (*case, *differing))))
        else:
            table.loc[index, list(new)] = list(new.values())
    table.to_csv(ROWS, index=False, lineterminator="\n")
    print(f"{len(cases) - len(other)} of {len(cases)} rows repeat every number but {', '.join(NOT_REPEATED)}")
    if other:
        sys.exit("not repeated, left as they were: " + "; ".join(other))


def add_row(setting: str, packing: int, mu_iso: float, point: str) -> None:
    """Run one case and append its row, failed or not."""
    row = measured(setting, packing, mu_iso, point)
    if row is not None:
        append(ROWS, COLUMNS, row)


def measured(setting: str, packing: int, mu_iso: float, point: str) -> dict | None:
    """The row of one case, failed or not; None where the run crashed."""
    values = BASE | SETTINGS[setting]
    mu_s, G_p = POINTS[point]
    values["inertial_number"] = values.pop("rate") * effective_inertial_number(values["inertial_number"], mu_s)
    row = {
        "setting": setting,
        "scripts": row_digest(),
        "packing": packing,
        "mu_iso": mu_iso,
        "point": point,
        "N": values["N"],
        "inertial_number": values["inertial_number"],
        "failure": "",
    }
    try:
        probe, shear = chain(seed=packing, mu_iso=mu_iso, mu_s=mu_s, G_p=G_p, snapshots="", **values)
        states = run_states(shear).states
        row |= {k: int(shear.timing[k]) for k in ("steps",)} | {"cpu_seconds": float(shear.timing["cpu_seconds"])}
        row |= {"probe_steps": int(probe.timing["steps"]), "probe_cpu_seconds": float(probe.timing["cpu_seconds"])}
        row["particle_steps"] = row["steps"] * values["N"]
        row |= {k: float(shear.proofs[k]) for k in ("energy_error", "servo_mean_error", "servo_max_error")}
        row["G_0"] = run_states(probe).states["probe"]["G_0"]
        row |= {f"{s}_{state}": float(states[state][s]) for state, names in RESPONSES.items() for s in names}
    except (RunFailed, RunFileError, StiffnessError) as error:
        row["failure"] = str(error)
    except RunCrashed as error:
        print(f"crashed, no row: {error}", flush=True)
        return None
    return row


if __name__ == "__main__":
    main()
