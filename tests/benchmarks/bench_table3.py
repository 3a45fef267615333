"""Initial states against the paper's Table 3: consolidation at full stiffness, three packings a density.

    python3 tests/benchmarks/bench_table3.py [--N 4000] [--sigma-ln 0.174]      about an hour of CPU; resumable

Rows go to data/benchmarks/table3.csv as they finish; the means beside the paper's are printed at the end.  Published
packings of equal spheres, and what a loose state depends on beside friction: bench_equal_spheres.py.
"""

from __future__ import annotations

import argparse

import numpy as np
import pandas as pd
from bench_rows import append, finished
from dem_runs import ROOT, SIGMA_LN, RunCrashed, RunFailed, assembly, digest, run

from analysis.micromechanics import grading
from analysis.micromechanics.metrics import contact_count, snapshot_metrics
from analysis.runs.run_file import Run, read_run, read_snapshot
from analysis.tables.published import INITIAL_STATE

ROWS = ROOT / "data" / "benchmarks" / "table3.csv"
SYMBOLS = ("e", "e_m", "Z", "Z_m")
COLUMNS = ("scripts", "N", "sigma_ln", "mu_iso", "packing", "steps", "cpu_seconds", "failure", *SYMBOLS,
           "I_G", "I_G_active", "overshoot", "F_unb", "stress_error")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--N", type=int, default=4000)
    parser.add_argument("--sigma-ln", type=float, default=SIGMA_LN)
    args = parser.parse_args()
    done = finished(ROWS, ("scripts", "N", "sigma_ln", "mu_iso", "packing"))
    for packing in (1, 2, 3):
        for mu_iso in (0.04, 0.1, 0.001):
            if (digest(), str(args.N), f"{args.sigma_ln:g}", f"{mu_iso:g}", str(packing)) not in done:
                try:
                    append(ROWS, COLUMNS, consolidated(args.N, args.sigma_ln, mu_iso, packing))
                except RunCrashed as error:
                    print(f"crashed, no row: {error}", flush=True)
    compare(pd.read_csv(ROWS))


def consolidated(N: int, sigma_ln: float, mu_iso: float, packing: int) -> dict:
    """One consolidation's row, failed or not."""
    row = {"scripts": digest(), "N": N, "sigma_ln": sigma_ln, "mu_iso": mu_iso, "packing": packing, "failure": ""}
    try:
        start = assembly(N, packing, sigma_ln)
        product = read_run(run("consolidate", assembly=start, mu_iso=mu_iso, G_p=25.7e9, seed=packing))
    except RunFailed as error:
        return row | {"failure": str(error)}
    row |= state(product)[0]
    row |= {key: product.proofs[key] for key in ("overshoot", "F_unb", "stress_error")}
    return row | {key: product.timing[key] for key in ("steps", "cpu_seconds")}


def state(product: Run) -> tuple[dict[str, float], np.ndarray, np.ndarray]:
    """Void ratios, coordination numbers and grading indices at the end, and the grains' diameters and contacts (N,)."""
    snapshot = read_snapshot(product, -1)
    metrics = snapshot_metrics(snapshot)
    d, count = 2.0 * snapshot.radius, contact_count(snapshot.N, snapshot.contact_ids)
    values = {symbol: metrics[symbol] for symbol in SYMBOLS}
    return values | {"I_G": grading.grading_index(d), "I_G_active": grading.active_grading_index(d, count)}, d, count


def compare(rows: pd.DataFrame) -> None:
    """Print each mean beside the paper's, newest scripts only."""
    rows = rows[(rows.scripts == rows.scripts.iloc[-1]) & rows.failure.isna()]
    for (N, sigma_ln, mu_iso), some in rows.groupby(["N", "sigma_ln", "mu_iso"]):
        text = ", ".join(
            f"{s} {some[s].mean():.3f} ({some[s].mean() / INITIAL_STATE[s, mu_iso][0] - 1:+.1%})" for s in SYMBOLS
        )
        print(f"N {N}, sigma_ln {sigma_ln:g}, mu_iso {mu_iso:g}, {len(some)} packings: {text}")


if __name__ == "__main__":
    main()
