"""Published sieve curves: the sizes of the spheres beside those of the curve, and a real consolidation of each.

    python3 tests/benchmarks/bench_sieve.py [--N 1000]           about two minutes of CPU; resumable
    python3 tests/benchmarks/bench_sieve.py --sizes              the sizes only, without YADE

Rows go to data/benchmarks/sieve.csv as they finish. A curve whose spheres are refused at this N has a row without a
consolidation, with the refusal. Each row has the errors of D10, D30, D50, D60, Cu and Cc, and the largest distance of
the spheres' curve from the given one at its sieves, as a share of the mass; a sphere passes a sieve of its own size.
"""

from __future__ import annotations

import argparse

import numpy as np
from bench_rows import append, finished
from dem_runs import BUILD, ROOT, RunFailed, digest, run

from analysis.assembly import place, write_assembly
from analysis.inputs.sieve_curve import SieveCurve, errors, read_sieve, shortfall
from analysis.micromechanics.metrics import contact_count, snapshot_metrics
from analysis.runs.run_file import read_run, read_snapshot

ROWS = ROOT / "data" / "benchmarks" / "sieve.csv"
CURVES = ("toyoura", "taylor_cu3", "taylor_cu4")
SIZES = ("D10", "D30", "D50", "D60", "Cu", "Cc")
METRICS = ("e", "e_m", "Z", "Z_m")
KEYS = ("scripts", "curve", "N", "mu_iso")
COLUMNS = (*KEYS, "refused", "failure", "steps", "cpu_seconds", "size_ratio", "Cu_of_curve", "Cc_of_curve",
           *(f"{name}_error" for name in SIZES), "sieve_error", *METRICS, "inactive", "inactive_volume",
           "stress_error")  # fmt: skip
MU_ISO, SEED = 0.04, 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--N", type=int, default=1000)
    parser.add_argument("--sizes", action="store_true")
    args = parser.parse_args()
    done = set() if args.sizes else finished(ROWS, KEYS)
    for name in CURVES:
        curve = read_sieve(ROOT / "data" / "sieve" / f"{name}.csv")
        row = {"scripts": digest(), "curve": name, "N": args.N, "mu_iso": MU_ISO, **sizes(curve, args.N)}
        if args.sizes:
            print(", ".join(f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}"
                            for key, value in row.items() if value != ""))  # fmt: skip
        elif (digest(), name, str(args.N), f"{MU_ISO:g}") not in done:
            append(ROWS, COLUMNS, row if row["refused"] else row | consolidated(curve, name, args.N))


def sizes(curve: SieveCurve, N: int) -> dict:
    """Characteristic sizes of the curve and the errors of N spheres."""
    d = curve.diameters(N)
    mass = d**3 / np.sum(d**3)
    passing = np.array([mass[d <= size].sum() for size in curve.size])
    found = {f"{key}_error": value for key, value in errors(curve, d).items()}
    return {"refused": shortfall(curve, d), "size_ratio": curve.ratio, "Cu_of_curve": curve.uniformity,
            "Cc_of_curve": curve.curvature, **found,
            "sieve_error": float(np.abs(passing - curve.passing).max())}  # fmt: skip


def consolidated(curve: SieveCurve, name: str, N: int) -> dict:
    """Consolidation with the settings of a campaign: what the packing is, or why the run failed."""
    start = BUILD / f"assembly_sieve_{name}_{N}_{SEED}.h5"
    if not start.exists():
        write_assembly(start, place(curve.diameters(N), SEED), {"N": N, "seed": SEED, "sieve": curve.name})
    try:
        product = read_run(run("consolidate", assembly=start, mu_iso=MU_ISO, G_p=25.7e9, seed=SEED,
                               d50=curve.sizes["D50"]))  # fmt: skip
    except RunFailed as error:
        return {"failure": str(error)}
    snapshot = read_snapshot(product, -1)
    metrics, d = snapshot_metrics(snapshot), 2.0 * snapshot.radius
    idle = contact_count(snapshot.N, snapshot.contact_ids) < 2
    return {
        **{key: product.timing[key] for key in ("steps", "cpu_seconds")}, **{key: metrics[key] for key in METRICS},
        "inactive": float(idle.mean()), "inactive_volume": float((d[idle] ** 3).sum() / (d**3).sum()),
        "stress_error": product.proofs["stress_error"],
    }  # fmt: skip


if __name__ == "__main__":
    main()
