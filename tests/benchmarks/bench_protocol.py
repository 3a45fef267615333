"""What the DEM protocol claims of its runs, measured: cost over a bare loop, the servo, energy balance, round-off.

    python3 tests/benchmarks/bench_protocol.py overhead     CPU time of a shear run over a bare loop's (2 minutes)
    python3 tests/benchmarks/bench_protocol.py servo        sigma_3 held, for N from 500 to 8,000 (15 minutes)
    python3 tests/benchmarks/bench_protocol.py energy       energy balance against step and friction (5 minutes)
    python3 tests/benchmarks/bench_protocol.py roundoff     the same runs in double and in long double (15 minutes)

Times are CPU times of one core; runs that are there are not repeated.  Each writes data/benchmarks/protocol_<word>.csv.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
from bench_stability import BASE, consolidated, initial, sheared
from dem_runs import ROOT, RunCrashed, RunFailed, assembly, chain, run
from scipy.stats import t

from analysis.runs.peak_critical import stress_ratio
from analysis.runs.run_file import read_run
from campaign.run_one import run_environment

G_P = 25.7e9
BARE_LOOP = ROOT / "tests" / "yade" / "scenes" / "bare_loop.py"
CAMPAIGN = {"inertial_number": 2.4e-3, "timestep_factor": 1.0, "density_scaling": 1, "snapshots": ""}


def overhead(jobs: int) -> pd.DataFrame:
    """A whole shear run to 4 % strain and a bare loop of as many steps over the same packing, ten times in turns.

    Windows are as wide as most of a campaign's, so that samples are as rare as there, and energies are summed over the
    first eighth of the strain, as there.
    """
    probe, _ = chain(N=1000, seed=1, mu_iso=0.04, mu_s=0.25, G_p=G_P, strain_end=0.01, **CAMPAIGN)
    rows = []
    for turn in range(10):
        # The rate differs in the ninth digit, so that each turn is a run of its own.
        rate = {"inertial_number": CAMPAIGN["inertial_number"] * (1.0 - 1e-9 * turn)}
        values = CAMPAIGN | rate | {"mu_s": 0.25, "G_p": G_P, "strain_end": 0.04, "windows": 8,
                                    "energy_strain": 0.005}  # fmt: skip
        shear = read_run(run("shear", start=probe.path, **values))
        steps, dt = int(shear.timing["steps"]), float(shear.timing["dt_mean"])
        command = ["yade", "-n", "-x", "-j1", str(BARE_LOOP), str(probe.path)]
        command += [str(steps), repr(dt), repr(0.04 / steps / dt)]
        out = subprocess.run(
            command, env=run_environment(), text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, check=True
        ).stdout
        bare = float(out.split("cpu_seconds")[1].split()[0])
        whole = float(shear.timing["cpu_seconds"])
        rows.append({"turn": turn, "steps": steps, "shear_cpu_seconds": whole, "bare_cpu_seconds": bare,
                     "ratio": whole / bare})  # fmt: skip
    return pd.DataFrame(rows)


def servo(jobs: int) -> pd.DataFrame:
    """Errors of sigma_3 in shear to 5 % strain and the overshoot of consolidation, low and high friction, five N."""
    cases = [(N, mu_s) for N in (8000, 4000, 2000, 1000, 500) for mu_s in (0.10, 0.25, 0.50)]

    def one(case):
        N, mu_s = case
        first = run("consolidate", assembly=assembly(N, 1), mu_iso=0.04, G_p=G_P, seed=1)
        shear = read_run(run("shear", start=first, mu_s=mu_s, G_p=G_P, strain_end=0.05, **CAMPAIGN))
        late = shear.record["eps_a"] > 0.01
        return {"N": N, "mu_s": mu_s, "overshoot": float(read_run(first).proofs["overshoot"]),
                "window_mean_worst": float(np.abs(shear.record["servo_mean"][late]).max()),
                "window_mean_rms": float(np.sqrt(np.mean(shear.record["servo_mean"][late] ** 2))),
                "sample_worst": float(shear.record["servo_max"][late].max()),
                "energy_error": float(shear.proofs["energy_error"])}  # fmt: skip

    return _all(one, cases, jobs)


def energy(jobs: int) -> pd.DataFrame:
    """The error of the energy balance of shear to 5 % strain, over the work put in, at shares of a campaign's step."""
    cases = [(mu_s, step) for step in (0.25, 0.35, 0.5, 0.7, 1.0) for mu_s in (0.10, 0.25, 0.50, 0.70)]

    def one(case):
        mu_s, step = case
        first = run("consolidate", assembly=assembly(500, 1), mu_iso=0.04, G_p=G_P, seed=1)
        values = CAMPAIGN | {"timestep_factor": step, "mu_s": mu_s, "G_p": G_P, "strain_end": 0.05}
        shear = read_run(run("shear", start=first, **values))
        eta = stress_ratio(shear.record["sigma"])
        return {"mu_s": mu_s, "timestep_factor": step, "steps": int(shear.timing["steps"]),
                "energy_error": float(shear.proofs["energy_error"]), "eta": float(eta[1:].mean()),
                "Z": float(shear.record["Z"][1:].mean())}  # fmt: skip

    return _all(one, cases, jobs)


def roundoff(jobs: int) -> pd.DataFrame:
    """Consolidation and 4 % of shear of the stability map's middle, in double and in long double, eight packings."""
    cases = [(seed, yade) for seed in range(1, 9) for yade in ("yade", "yade-longdouble")]

    def one(case):
        seed, yade = case
        start = consolidated(BASE | {"seed": seed}, yade)
        mine, told = sheared(start, BASE | {"seed": seed}, yade)
        return {"seed": seed, "digits": yade} | initial(start) | mine | {k: float(v) for k, v in told.items()}

    return _all(one, cases, jobs)


def _all(one, cases: list, jobs: int) -> pd.DataFrame:
    """The rows of all cases, several at once; a failed run keeps its row, with the reason."""

    def row(case):
        try:
            return one(case) | {"failure": ""}
        except (RunFailed, RunCrashed) as error:
            return {"case": " ".join(map(str, case)), "failure": str(error)}

    with ThreadPoolExecutor(jobs) as pool:
        return pd.DataFrame(list(pool.map(row, cases)))


def told_overhead(table: pd.DataFrame) -> str:
    shear, bare = table["shear_cpu_seconds"], table["bare_cpu_seconds"]
    return (f"over a bare loop: {shear.sum() / bare.sum():.2f} by the sums, {shear.min() / bare.min():.2f} by the "
            f"least of each, {table['ratio'].min():.2f} to {table['ratio'].max():.2f} in single turns")  # fmt: skip


def told_energy(table: pd.DataFrame) -> str:
    runs = table.groupby("mu_s")
    ranges = {name: ((runs[name].max() - runs[name].min()) / runs[name].mean()).max() for name in ("eta", "Z")}
    return f"the steps of a friction differ by up to {ranges['eta']:.1%} in eta and {ranges['Z']:.1%} in Z"


def told_roundoff(table: pd.DataFrame) -> str:
    pairs = table.pivot(index="seed", columns="digits", values=["e_0", "Z_0", "eta", "e", "Z"])
    off = pairs.xs("yade-longdouble", axis=1, level=1) / pairs.xs("yade", axis=1, level=1) - 1
    wide = t.ppf(0.975, len(off) - 1) * off.sem()
    words = ", ".join(f"{name} {100 * off[name].mean():+.1f} ± {100 * wide[name]:.1f}" for name in off)
    return f"long double against double, mean of {len(off)} packings and 95 %: {words} %"


#: What the README takes of a table, in words.
TOLD = {"overhead": told_overhead, "energy": told_energy, "roundoff": told_roundoff}


def main() -> None:
    words = {f.__name__: f for f in (overhead, servo, energy, roundoff)}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="+", choices=words)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="runs at once")
    parser.add_argument("--table", action="store_true", help="only print the table there is")
    args = parser.parse_args()
    for word in args.what:
        path = ROOT / "data" / "benchmarks" / f"protocol_{word}.csv"
        if not args.table:
            words[word](args.jobs).to_csv(path, index=False, float_format="%.6g")
        table = pd.read_csv(path)
        print(table.to_string(index=False, float_format="%.4g"))
        if word in TOLD:
            print(TOLD[word](table))


if __name__ == "__main__":
    main()
