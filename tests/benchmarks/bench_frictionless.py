"""Packings without friction, sheared with and without damping: solid fraction, dilatancy and stress ratio.

    python3 tests/benchmarks/bench_frictionless.py            what is missing (15 minutes of CPU; resumable)
    python3 tests/benchmarks/bench_frictionless.py --table    only the rows there are

Spheres are consolidated with mu_iso = 0.001 and sheared with mu_s = 0.001, drained, to STRAIN.  `phi_0` is the solid
fraction at rest, `phi` and `eta` are means over the second half of the strain, `dilatancy` is the volume gained there
over the axial strain.  Published: equal spheres without friction keep the solid fraction of random close packing, 0.64,
under slow shear, without dilatancy (Peyneau and Roux, Phys. Rev. E 78, 011307, 2008).
"""

from __future__ import annotations

import argparse
import os

import numpy as np
import pandas as pd
from bench_rows import append, finished
from dem_runs import ROOT, RunFailed, assembly, row_digest, run

from analysis.runs.peak_critical import stress_ratio
from analysis.runs.run_file import read_run

ROWS = ROOT / "data" / "benchmarks" / "frictionless.csv"
COLUMNS = ("scripts", "N", "packing", "damping", "strain", "failure", "phi_0", "phi", "dilatancy",
           "eta", "Z", "servo_mean_error", "energy_error", "steps", "cpu_seconds")  # fmt: skip
MU, G_P = 0.001, 25.7e9
#: Spheres, packing and damping.
CASES = ((1000, 1, 0.0), (1000, 1, 0.2), (1000, 1, 0.5), (400, 1, 0.2), (400, 2, 0.2), (1000, 2, 0.2))
STRAIN = 0.1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="store_true", help="only show the rows there are")
    args = parser.parse_args()
    done = finished(ROWS, ("scripts", "N", "packing", "damping"))
    for case in CASES if not args.table else ():
        if (row_digest(), *(f"{value:g}" for value in case)) not in done:
            append(ROWS, COLUMNS, measured(*case))
    print(pd.read_csv(ROWS).to_string(index=False))


def measured(N: int, packing: int, damping: float) -> dict:
    """The row of one run, failed or not."""
    start = run("consolidate", assembly=assembly(N, packing), mu_iso=MU, G_p=G_P, seed=packing)
    row = {"scripts": row_digest(), "N": N, "packing": packing, "damping": f"{damping:g}",
           "strain": STRAIN, "failure": "",
           "phi_0": 1.0 / (1.0 + float(read_run(start).record["e"][-1]))}  # fmt: skip
    try:
        shear = read_run(run("shear", start=start, mu_s=MU, G_p=G_P, damping=damping,
                             strain_end=STRAIN, snapshots=""))  # fmt: skip
    except RunFailed as error:
        return row | {"failure": str(error)}
    strain, e, eps_v = (shear.record[k] for k in ("eps_a", "e", "eps_v"))
    late = strain > 0.5 * STRAIN
    eta = stress_ratio(shear.record["sigma"])
    row |= {"phi": np.mean(1.0 / (1.0 + e[late])), "dilatancy": -np.polyfit(strain[late], eps_v[late], 1)[0]}
    row |= {"eta": eta[late].mean(), "Z": shear.record["Z"][late].mean()}
    row |= {k: float(shear.proofs[k]) for k in ("servo_mean_error", "energy_error")}
    return row | {k: shear.timing[k] for k in ("steps", "cpu_seconds")}


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
