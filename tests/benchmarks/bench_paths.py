"""Drained, constant-p' and undrained tests in compression and extension, run for real: states, proofs, critical line.

    python3 tests/benchmarks/bench_paths.py --part states    6 tests x 3 densities x 3 mu_s, N = 500; 40 CPU-minutes
    python3 tests/benchmarks/bench_paths.py --part line      e against ln p', N = 2,000; 25 CPU-minutes
    python3 tests/benchmarks/bench_paths.py --table          what the rows say

Rows are appended to data/benchmarks/paths.csv; a case that has a row is not run again.  `line` has drained tests at
four sigma_3 and undrained ones from several void ratios, one that liquefies and one that becomes too stiff among them.
"""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path

import h5py
import pandas as pd
from bench_rows import append, finished
from dem_runs import ROOT, RunCrashed, RunFailed, assembly, digest, run
from scipy.optimize import brentq

from analysis.runs.peak_critical import TriaxialError, critical_state, mean_stress, peak_state, stress_ratio
from analysis.tables.strength import EXTENSION

ROWS = ROOT / "data" / "benchmarks" / "paths.csv"
KEYS = ("part", "path", "direction", "mu_iso", "mu_s", "sigma_3", "stiff_cap", "N", "seed")
COLUMNS = (*KEYS, "scripts", "failure", "end", "strain", "liquefied_from", "eta_peak", "eta_peak_error", "eta_critical",
           "eta_error", "e", "e_error", "p", "p_error", "Z", "drift_eta", "drift_e", "servo_mean", "servo_max",
           "energy_error", "inertial_number", "steps", "cpu_seconds")  # fmt: skip
G_P, RATE, STRAIN, CAP = 25.7e9, 2.4e-3, 0.40, 10e6
PATHS, DIRECTIONS = ("drained", "constant_p", "undrained"), ("compression", "extension")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", action="append", default=[], choices=("states", "line"))
    parser.add_argument("--table", action="store_true")
    args = parser.parse_args()
    for part in args.part:
        for case in {"states": states, "line": line}[part]():
            fill(dict(zip(KEYS, (part, *case), strict=True)))
    if args.table:
        table(pd.read_csv(ROWS))


def states():
    """Every test of one packing of 500 spheres at three densities, for three mu_s."""
    for mu_iso, mu_s, path, direction in itertools.product((0.04, 0.1, 0.001), (0.25, 0.5, 0.1), PATHS, DIRECTIONS):
        if (path, direction) != ("constant_p", "extension") or mu_s == 0.25:
            yield path, direction, mu_iso, mu_s, 100e3, CAP, 500, 1


def line():
    """Drained tests at four sigma_3; undrained ones of dense to loose packings, some with a cap beyond their state."""
    for sigma_3 in (100e3, 1e6, 4e6, 20e6):
        yield "drained", "compression", 0.04, 0.25, sigma_3, CAP, 2000, 1
    for mu_iso, cap in ((0.08, 100e6), (0.1, CAP), (0.07, 100e6), (0.04, CAP), (0.25, CAP)):
        yield "undrained", "compression", mu_iso, 0.25, 100e3, cap, 2000, 1


def fill(case: dict) -> None:
    """Run a case unless it has a row, and append the row; a failed run has one with the reason."""
    if tuple(f"{case[key]}" for key in KEYS) in finished(ROWS, KEYS):
        return
    row = case | {"scripts": digest(), "failure": ""}
    common = {"sigma_3": case["sigma_3"], "G_p": G_P}
    grains = assembly(case["N"], case["seed"])
    first = {"assembly": grains, "mu_iso": case["mu_iso"], "seed": case["seed"]}
    own = {"mu_s": case["mu_s"]}
    test = {"path": case["path"], "direction": case["direction"], "strain_end": STRAIN, "inertial_number": RATE}
    test |= {"stiff_cap": case["stiff_cap"]} if case["path"] == "undrained" else {}
    try:
        start = run("consolidate", **first, **common)
        start = run("probe", start=start, **own, **common)
        product = run("shear", start=start, **own, **common, **test)
        row |= measured(product)
    except (RunFailed, TriaxialError) as error:
        row |= {"failure": str(error)}
    except RunCrashed as error:
        print(f"crashed, no row: {error}", flush=True)
        return
    append(ROWS, COLUMNS, {key: str(value) if key in KEYS else value for key, value in row.items()})


def measured(product: Path) -> dict:
    """Peak and critical state of a product, its proofs and its cost; eta is negative in extension."""
    with h5py.File(product) as file:
        record = {name: file["record"][name][()] for name in ("eps_a", "sigma", "e", "Z")}
        proofs, timing, attrs = (dict(part.attrs) for part in (file["proofs"], file["timing"], file))
        sign = -1.0 if file["parameters"].attrs["direction"] == "extension" else 1.0
    strain, eta, p = sign * record["eps_a"], stress_ratio(record["sigma"]), mean_stress(record["sigma"])
    found = {"end": attrs["exit_reason"], "strain": float(strain[-1]), "servo_mean": proofs["servo_mean_error"],
             "servo_max": proofs["servo_max_error"], "energy_error": proofs["energy_error"],
             "inertial_number": proofs["max_inertial_number"], "steps": int(timing["steps"]),
             "cpu_seconds": float(timing["cpu_seconds"]),
             "liquefied_from": float(attrs.get("liquefied_from", math.nan))}  # fmt: skip
    if attrs["exit_reason"] == "liquefied":
        return found
    peak = peak_state(strain, sign * eta)
    found |= {"eta_peak": sign * peak.eta, "eta_peak_error": peak.eta_error}
    if strain[-1] < 0.28:
        return found
    state = critical_state(strain, {"eta": sign * eta, "e": record["e"], "p": p, "Z": record["Z"]})
    found |= {
        "eta_critical": sign * state.mean["eta"],
        "eta_error": state.error["eta"],
        "drift_eta": state.drift["eta"],
    }
    found |= {"drift_e": state.drift["e"], "Z": state.mean["Z"]}
    return found | {f"{k}{end}": v[k] for k in ("e", "p") for end, v in (("", state.mean), ("_error", state.error))}


def table(rows: pd.DataFrame) -> None:
    """Print what the rows say of proofs, of eta by path and direction, and of the critical state line."""
    print(f"{len(rows)} rows, {rows.failure.notna().sum()} failed: {'; '.join(rows.failure.dropna().unique()) or '-'}")
    worst = rows.groupby("path")[["servo_mean", "servo_max", "energy_error", "inertial_number"]].max()
    print(worst.to_string())
    part = rows[(rows.part == "states") & rows.eta_critical.notna()]
    index = ["direction", "mu_s", "mu_iso"]
    print(part.pivot_table(index=index, columns="path", values="eta_critical").round(3).to_string())
    for direction in DIRECTIONS:
        one = part[part.direction == direction].set_index(index)
        for path in ("constant_p", "undrained"):
            both = one[one.path == "drained"].join(one[one.path == path], rsuffix="_other", how="inner")
            off = both.eta_critical_other - both.eta_critical
            if len(off):
                error, largest = off.std() / math.sqrt(len(off)), off.abs().max()
                print(f"{direction}, {path} less drained: mean {off.mean():+.3f}, standard error {error:.3f}, "
                      f"largest {largest:.3f}, {len(off)} pairs")  # fmt: skip
    means = part.pivot_table(index="mu_s", columns=["path", "direction"], values="eta_critical")
    compression = means["drained", "compression"]
    predicted = {name: surface(compression.to_numpy()) for name, surface in EXTENSION.items()}
    print("means over the densities, and drained extension as predicted from drained compression")
    print(means.assign(**predicted).round(3).to_string())
    line_table(rows[rows.part == "line"])


def line_table(rows: pd.DataFrame) -> None:
    """Print the critical states at N = 2,000, and e of the undrained ones less that of the drained line.

    The line is a power law e = e_0 - a p^c through the drained states of the lowest and of the two highest p'.
    """
    shown = rows[["path", "mu_iso", "sigma_3", "end", "strain", "liquefied_from", "e", "p", "p_error", "eta_critical"]]
    print(shown.to_string(index=False))
    drained = rows[rows.path == "drained"].sort_values("p")
    e, p = (drained[name].to_numpy()[[0, -2, -1]] for name in ("e", "p"))
    c = brentq(lambda c: (e[0] - e[1]) * (p[2] ** c - p[0] ** c) - (e[0] - e[2]) * (p[1] ** c - p[0] ** c), 0.05, 3.0)
    a = (e[0] - e[2]) / (p[2] ** c - p[0] ** c)
    for row in rows[(rows.path == "undrained") & rows.e.notna()].itertuples():
        line = e[0] - a * (row.p**c - p[0] ** c)
        print(
            f"undrained from mu_iso = {row.mu_iso:g}: e = {row.e:.4f}, line {line:.4f}, difference {row.e - line:+.4f}"
        )


if __name__ == "__main__":
    main()
