"""Fills data/laptop from the finished laptop campaign: results.h5, example runs, tables, figures and the report.

/usr/bin/python3 data/make_laptop.py [runs/laptop]

Whatever fidelity.csv and beyond.csv the benchmarks have left in data/laptop goes into the report.  The example runs are
the chain consolidate -> probe -> shear of one point at one density, the point nearest to the median friction.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from analysis.results import read_results  # noqa: E402
from campaign.evaluate import report_of_file  # noqa: E402

TARGET = ROOT / "data" / "laptop"
LIMIT_MIB = 25


def main(folder: Path, target: Path = TARGET) -> None:
    """Copy, draw and say what it takes; a results.h5 above 25 MiB is refused."""
    size = (folder / "results.h5").stat().st_size / 2**20
    if size > LIMIT_MIB:
        sys.exit(f"{folder}/results.h5: {size:.1f} MiB, limit {LIMIT_MIB} MiB")
    target.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(folder / "results.h5", target / "results.h5")
    results = read_results(target / "results.h5")
    (target / "example_runs").mkdir(exist_ok=True)
    for run_id in example_runs(results):
        shutil.copyfile(folder / "products" / f"{run_id}.h5", target / "example_runs" / f"{run_id}.h5")
    print(report_of_file(target / "results.h5", target))
    for path in (target, target / "example_runs"):
        kept = sum(p.stat().st_size for p in path.rglob("*") if p.is_file()) / 2**20
        print(f"{path.relative_to(target.parent)}: {kept:.1f} MiB, results.h5 {size:.1f} MiB")


def example_runs(results) -> list[str]:
    """Ids of the chain of the point nearest to the median friction, at the middle density, first packing."""
    runs = results.runs
    points = results.family_points()
    point = points.loc[(points["mu_s"] - points["mu_s"].median()).abs().idxmin(), "id"]
    mu_iso = results.family_densities()[len(results.family_densities()) // 2]
    first = runs[(runs["mu_iso"] == mu_iso) & (runs["packing"] == runs["packing"].min()) & (runs["status"] == "done")]
    chain = first[first["point"].isin([point, -1]) & first["family"].isin(["coupled", "shared"])]
    return list(chain.drop_duplicates("stage")["run_id"])


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "runs" / "laptop")
