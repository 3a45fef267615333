"""Specimens of the paper's size in LAMMPS: Table 3 at three densities; peak, critical state, rate and MPI at one point.

    /usr/bin/python3 tests/benchmarks/bench_paper_size.py [N]        default 23,312 spheres; 35 minutes of CPU
    /usr/bin/python3 tests/benchmarks/bench_paper_size.py ranks      1 and 2 MPI ranks to 2 % strain, on two free cores
    /usr/bin/python3 tests/benchmarks/bench_paper_size.py table      what the rows say

Consolidation at three densities; at the medium one a probe, then shear from the same state: to 40 % strain at the
inertial number of a campaign, and to 5 % at a lower one and at the paper's. Rows of data/benchmarks/paper_size.csv: a
run each, with its states, costs and the curve at six strains. `seconds` is elapsed time, which depends on what else
the machine does.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

from analysis.quantities import CRITICAL_FROM  # noqa: E402
from analysis.runs.gate import check_product  # noqa: E402
from analysis.runs.run_file import Run, read_run  # noqa: E402
from analysis.runs.states import run_states  # noqa: E402
from analysis.tables import published  # noqa: E402
from tests.benchmarks import dem_runs, lammps_runs  # noqa: E402
from tests.benchmarks.bench_rows import append, finished  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "paper_size.csv"
PAPER_N, MU_ISO, MU_S, G_P, G_REF = 23312, 0.04, 0.214, 25.7e9, 25.7e9
DENSITIES = (MU_ISO, 0.1, 0.001)
#: Inertial number and last strain of the shear runs; the last rate is the paper's.
SHEARS = ((2.4e-3, 0.40), (1e-3, 0.05), (1e-4, 0.05))
RANKS_STRAIN = 0.02
STRAINS = (0.005, 0.01, 0.02, 0.03, 0.04, 0.048)
INITIAL = ("e", "e_m", "Z", "Z_m")
KEYS = ("stage", "N", "mu_iso", "inertial_number", "strain_end", "ranks", "scripts")
STATES = tuple(f"{symbol}_{state}" for state in ("peak", "critical") for symbol in ("eta", *INITIAL))
CURVE = tuple(f"{symbol}_{strain:g}" for symbol in ("eta", "Z") for strain in STRAINS)
COLUMNS = (*KEYS, "failed", "cpu_seconds", "seconds", "steps", *INITIAL, "G_0", "K_0", *STATES, "eps_peak", *CURVE)


def main(*arguments: str) -> int:
    """Run what is missing; 0, or 1 when a run failed."""
    if arguments == ("table",):
        table(pd.read_csv(TABLE))
        return 0
    if shutil.which("lmp") is None:
        print("skipped: no lmp on the path (Debian's package lammps)")
        return 0
    if arguments == ("ranks",):
        return sum(row("shear", PAPER_N, 2.4e-3, RANKS_STRAIN, ranks) for ranks in (1, 2)) and 1
    N = int(arguments[0]) if arguments else PAPER_N
    failed = row("consolidate", N, 0.0, 0.0) + row("probe", N, 0.0, 0.0)
    failed += sum(row("shear", N, *shear) for shear in SHEARS)
    return (failed + sum(row("consolidate", N, 0.0, 0.0, mu_iso=mu_iso) for mu_iso in DENSITIES)) and 1


def row(stage: str, N: int, inertial_number: float, strain_end: float, ranks: int = 1, mu_iso: float = MU_ISO) -> bool:
    """Add the row of one run unless it is there; whether it failed."""
    values = (stage, N, mu_iso, inertial_number, strain_end, ranks, lammps_runs.scripts())
    keys = dict(zip(KEYS, values, strict=True))
    if tuple(f"{v:.6g}" if isinstance(v, float) else str(v) for v in keys.values()) in finished(TABLE, KEYS):
        return False
    try:
        found = measured(product(stage, N, inertial_number, strain_end, ranks, mu_iso))
    except dem_runs.RunFailed as error:
        found = {"failed": str(error)}
    append(TABLE, COLUMNS, keys | found)
    return "failed" in found


def product(stage: str, N: int, inertial_number: float, strain_end: float, ranks: int, mu_iso: float) -> Path:
    """The product of a run, with those of the runs that it starts from."""
    os.environ["BENCH_RANKS"] = "1"
    first = lammps_runs.run("consolidate", assembly=dem_runs.assembly(N, 1), mu_iso=mu_iso, G_p=G_REF, seed=1)
    if stage == "consolidate":
        return first
    probe = lammps_runs.run("probe", start=first, mu_s=MU_S, G_p=G_P)
    if stage == "probe":
        return probe
    os.environ["BENCH_RANKS"] = str(ranks)
    own = {"seed": ranks} if strain_end == RANKS_STRAIN else {}  # no run uses it; it tells the products apart
    return lammps_runs.run("shear", start=probe, mu_s=MU_S, G_p=G_P, inertial_number=inertial_number,
                           strain_end=strain_end, **own)  # fmt: skip


def measured(path: Path) -> dict:
    """States and costs of a run whose proofs hold."""
    run = read_run(path)
    check_product(run)
    out = {"cpu_seconds": float(run.timing["cpu_seconds"]), "seconds": float(run.timing["wall_seconds"]),
           "steps": int(run.timing["steps"])}  # fmt: skip
    if run.stage == "consolidate":
        out |= {symbol: float(run.record[symbol][-1]) for symbol in INITIAL}
    elif run.stage == "probe":
        assert run.probe is not None
        out |= {name: float(run.probe[name]) for name in ("G_0", "K_0")}
    else:
        out |= sheared(run)
    return out


def sheared(run: Run) -> dict:
    """Peak and critical state of a shear run as far as it has them, and its curve."""
    found = run_states(run)
    out = {"eps_peak": found.states.get("peak", {}).get("eps_peak", np.nan)}
    for state in ("peak", "critical"):
        reached = state == "peak" or run.strain[-1] > CRITICAL_FROM
        values = found.states.get(state, {}) if reached else {}
        out |= {f"{symbol}_{state}": values.get(symbol, np.nan) for symbol in ("eta", *INITIAL)}
    for symbol in ("eta", "Z"):
        out |= {f"{symbol}_{at:g}": float(np.interp(at, found.eps_a, found.responses[symbol])) for at in STRAINS}
    return out


def table(rows: pd.DataFrame) -> None:
    """Print the initial state beside the paper's Table 3, states, rates beside each other, and the gain of ranks."""
    rows = rows[rows["failed"].isna()]
    for first in rows[rows["stage"] == "consolidate"].to_dict("records"):
        for symbol in INITIAL:
            mean, scatter = published.INITIAL_STATE[symbol, first["mu_iso"]]
            print(f"mu_iso = {first['mu_iso']:g}, {symbol}: {first[symbol]:.4f}, the paper {mean} ± {scatter} "
                  f"({100 * (first[symbol] / mean - 1):+.1f} %)")  # fmt: skip
    shear = rows[rows["stage"] == "shear"]
    columns = [*KEYS[1:5], "cpu_seconds", "seconds", "steps", *STATES]
    print(shear[columns].dropna(axis=1, how="all").to_string(index=False))
    print(shear[["inertial_number", "strain_end", *CURVE]].to_string(index=False))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
