"""Packings of equal spheres beside published ones: what solid fraction and contacts depend on, one change at a time.

    python3 tests/benchmarks/bench_equal_spheres.py            what is missing (12 minutes of CPU; resumable)
    python3 tests/benchmarks/bench_equal_spheres.py --table    only the means of the rows there are

Each row is one consolidation of N equal spheres.  `phi` is the solid fraction, Z and Z_m are those of a campaign.
Published coordination numbers of such packings count the force-carrying backbone only: `Z_backbone` is
2 contacts / grains after grains with fewer than LEAST contacts were taken out, again and again, contacts under
WEAK of the mean normal force left out; `rattlers` is the share of grains that are taken out.
"""

from __future__ import annotations

import argparse
import os

import numpy as np
import pandas as pd
from bench_rows import append, finished
from dem_runs import BUILD, D50, ROOT, RunCrashed, RunFailed, digest, run

from analysis.assembly import make_assembly, write_assembly
from analysis.micromechanics.metrics import snapshot_metrics
from analysis.micromechanics.snapshot import Snapshot
from analysis.runs.run_file import read_run, read_snapshot

ROWS = ROOT / "data" / "benchmarks" / "equal_spheres.csv"
SCENE = ROOT / "tests" / "yade" / "scenes" / "consolidate_otherwise.py"
MEASURED = ("phi", "Z", "Z_m", "Z_backbone", "rattlers")
COLUMNS = ("scripts", "case", "N", "mu_iso", "packing", "failure", *MEASURED, "F_unb", "overshoot", "steps",
           "cpu_seconds")  # fmt: skip
#: Agnolin and Roux, Phys. Rev. E 76, 061302 (2007), abstract: friction -> solid fraction, contacts on the backbone.
PUBLISHED = {0.0: (0.639, 6.0), 0.3: (0.593, 4.5)}
#: Contacts weaker than this share of the mean normal force carry nothing; fewest contacts of a grain of the backbone,
#: without friction and with it.
WEAK, LEAST = 1e-3, (4, 2)
N, PACKINGS = 500, {500: (1, 2, 3, 4), 2000: (1, 2)}
#: Case -> what differs from the campaign's consolidation at mu_iso = 0.3.  `solid_fraction` is that of the start.
CASES = {
    "campaign": {},
    "mu_iso 0": {"mu_iso": 0.0},
    "compression 10 x slower": {"COMPRESSION_I": 2e-4},
    "compression 10 x faster": {"COMPRESSION_I": 2e-2},
    "start at 0.45": {"solid_fraction": 0.45},
    "start at 0.30": {"solid_fraction": 0.30},
    "local damping 0.3": {"DAMPING": 0.3},
    "agitated start 0.1": {"agitation": 0.1},
    "agitated start 0.5": {"agitation": 0.5},
    "agitated start 1": {"agitation": 1.0},
    "agitated start 0.5 at 0.45": {"agitation": 0.5, "solid_fraction": 0.45},
    "sigma_3 10 kPa": {"sigma_3": 10e3},
    "own moment of inertia": {"density_scaling": 0},
    "N 2000": {"N": 2000},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="store_true", help="only show the rows there are")
    args = parser.parse_args()
    done = finished(ROWS, ("scripts", "case", "packing"))
    for case, changes in CASES.items():
        for packing in PACKINGS[changes.get("N", N)]:
            if not args.table and (digest(), case, str(packing)) not in done:
                try:
                    append(ROWS, COLUMNS, measured(case, changes, packing))
                except RunCrashed as error:
                    print(f"crashed, no row: {error}", flush=True)
    compare(pd.read_csv(ROWS))


def measured(case: str, changes: dict, packing: int) -> dict:
    """The row of one consolidation, failed or not."""
    values = {"mu_iso": 0.3, "N": N, "solid_fraction": 0.52, "G_p": 25.7e9, "seed": packing} | changes
    size, solid_fraction = values.pop("N"), values.pop("solid_fraction")
    row = {"scripts": digest(), "case": case, "N": size, "mu_iso": values["mu_iso"], "packing": packing, "failure": ""}
    start = BUILD / f"equal_{size}_{solid_fraction:g}_{packing}.h5"
    if not start.exists():
        write_assembly(start, make_assembly(size, D50, 0.0, packing, solid_fraction=solid_fraction))
    try:
        product = read_run(run("consolidate", scene=SCENE, assembly=start, **values))
    except RunFailed as error:
        return row | {"failure": str(error)}
    snapshot = read_snapshot(product, -1)
    metrics = snapshot_metrics(snapshot)
    row |= {"phi": 1.0 / (1.0 + metrics["e"]), "Z": metrics["Z"], "Z_m": metrics["Z_m"]}
    row |= backbone(snapshot, LEAST[values["mu_iso"] > 0.0])
    row |= {key: product.proofs[key] for key in ("F_unb", "overshoot")}
    return row | {key: product.timing[key] for key in ("steps", "cpu_seconds")}


def backbone(s: Snapshot, least: int) -> dict[str, float]:
    """Contacts per grain of the grains that carry force, and the share of the others."""
    force = np.linalg.norm(s.f_n, axis=1)
    ids = s.contact_ids[force > WEAK * force.mean()]
    while True:
        count = np.bincount(ids.ravel(), minlength=s.N)
        carries = count >= least
        kept = carries[ids].all(axis=1)
        if kept.all():
            return {"Z_backbone": 2.0 * len(ids) / carries.sum(), "rattlers": 1.0 - carries.mean()}
        ids = ids[kept]


def compare(rows: pd.DataFrame) -> None:
    """Print mean and standard error of each case, newest scripts only, beside the published values."""
    rows = rows[(rows.scripts == rows.scripts.iloc[-1]) & rows.failure.isna()]
    for case, some in rows.groupby("case", sort=False):
        of_mean = some[list(MEASURED)].sem()
        text = ", ".join(f"{k} {some[k].mean():.4f} ± {of_mean[k]:.4f}" for k in MEASURED)
        phi, Z = PUBLISHED[float(some["mu_iso"].iloc[0])]
        off = f"phi {some['phi'].mean() / phi - 1:+.1%}, Z_backbone {some['Z_backbone'].mean() / Z - 1:+.1%}"
        print(f"{case} ({len(some)} packings, N {some['N'].iloc[0]}): {text}; published {off}")


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
