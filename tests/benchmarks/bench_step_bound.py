"""The stability bound of sheared packings over the time step in use, from the snapshots of the runs of campaigns.

    /usr/bin/python3 tests/benchmarks/bench_step_bound.py FOLDER ...     folders of products (a minute, no YADE)
    /usr/bin/python3 tests/benchmarks/bench_step_bound.py --table        only what the rows say

The bound is 2 / omega_max of the contact network, the step that of YADE's stepper, both from the contacts of a snapshot
(`tests/support/step_bound.py`).  Writes data/benchmarks/step_bound.csv, a row a shear run: the number of its snapshots
after the start, and the least, median and largest ratio of the bound to the step.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

from step_bound import balanced_inertia, largest_step, own_inertia, stepper_step  # noqa: E402

from analysis.runs.run_file import read_run, read_snapshot  # noqa: E402

ROWS = ROOT / "data" / "benchmarks" / "step_bound.csv"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--table", action="store_true", help="only what the rows say")
    args = parser.parse_args()
    if not args.table:
        paths = sorted({path.name: path for folder in args.folders for path in folder.glob("shear_*.h5")}.items())
        pd.DataFrame([measured(path) for _, path in paths]).to_csv(ROWS, index=False, float_format="%.4g")
    rows = pd.read_csv(ROWS)
    middle = rows["median"].median()
    print(rows.to_string(index=False))
    print(f"{len(rows)} runs, {rows.snapshots.sum()} snapshots: bound over step {rows.least.min():.3f} to "
          f"{rows.largest.max():.3f}, median of the runs' medians {middle:.3f}")  # fmt: skip


def measured(path: Path) -> dict:
    """The row of one shear run."""
    run = read_run(path)
    p, margins = run.parameters, []
    for k, (_, strain, _) in enumerate(run.snapshots):
        if strain != 0.0:
            s = read_snapshot(run, k)
            inertia = (balanced_inertia if p["density_scaling"] else own_inertia)(s.radius, p["rho"])
            margins.append(largest_step(s, *inertia) / stepper_step(s, *inertia) / p["timestep_factor"])
    row = {"run_id": run.run_id, **{k: p[k] for k in ("N", "mu_s", "mu_iso", "density_scaling", "timestep_factor")}}
    return row | {
        "snapshots": len(margins),
        "least": min(margins),
        "median": np.median(margins),
        "largest": max(margins),
    }


if __name__ == "__main__":
    main()
