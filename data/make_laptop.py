"""Continue the laptop campaign from its archive in data/laptop, and fill data/laptop with the results.

/usr/bin/python3 data/make_laptop.py [--unfinished] [runs/laptop]

data/laptop holds an archive of all runs (runs.h5) and the points of these runs.  The campaign can therefore be
continued on any machine, and only missing runs are made.  Afterwards results.h5, tables, figures, the report and the
example runs are written; the report includes fidelity.csv and beyond.csv if the benchmarks have written them to
data/laptop.  The example runs are the chain consolidate -> probe -> shear of one point at one density: the point
nearest to the median friction.  --unfinished only archives the runs that exist.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from analysis.results import Results, read_results  # noqa: E402
from campaign.evaluate import report_of_file  # noqa: E402

TARGET = ROOT / "data" / "laptop"
#: The files from which a campaign is continued.
ARCHIVE = ("runs.h5", "points.csv", "inputs.json")
LIMIT_MIB = 25


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "runs" / "laptop")
    parser.add_argument("--unfinished", action="store_true", help="archive the runs that exist; run nothing")
    args = parser.parse_args()
    take_up(TARGET, args.folder)
    for command in ("archive",) if args.unfinished else ("all", "archive"):
        line = [sys.executable, "-m", "campaign", command, "campaign/laptop.toml", "--folder", str(args.folder)]
        if code := subprocess.run(line, cwd=ROOT).returncode:
            sys.exit(code)
    keep(args.folder, TARGET)
    if not args.unfinished:
        fill(args.folder, TARGET)


def take_up(target: Path, folder: Path) -> None:
    """Copy archive, points and failures from the repository to a folder that has no campaign yet."""
    if (folder / "points.csv").exists() or not (target / "runs.h5").exists():
        return
    (folder / "products").mkdir(parents=True, exist_ok=True)
    for name in ARCHIVE:
        shutil.copyfile(target / name, folder / name)
    for path in target.glob("*.failed.json"):
        shutil.copyfile(path, folder / "products" / path.name)


def keep(folder: Path, target: Path) -> None:
    """Copy archive, points and failures to the repository; an archive above 25 MiB is refused."""
    target.mkdir(parents=True, exist_ok=True)
    _small_enough(folder / "runs.h5")
    for path in [*(folder / name for name in ARCHIVE), *(folder / "products").glob("*.failed.json")]:
        shutil.copyfile(path, target / path.name)


def fill(folder: Path, target: Path) -> None:
    """Copy results and example runs, write the report, print the sizes; a results.h5 above 25 MiB is refused."""
    size = _small_enough(folder / "results.h5")
    target.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(folder / "results.h5", target / "results.h5")
    results = read_results(target / "results.h5")
    (target / "example_runs").mkdir(exist_ok=True)
    for run_id in example_runs(results):
        path, kept = folder / "products" / f"{run_id}.h5", target / "example_runs" / f"{run_id}.h5"
        if path.exists():
            shutil.copyfile(path, kept)
        elif not kept.exists():
            print(f"{run_id}: archived, but without a product; it is not among the example runs", file=sys.stderr)
    print(report_of_file(target / "results.h5", target))
    for path in (target, target / "example_runs"):
        kept = sum(p.stat().st_size for p in path.rglob("*") if p.is_file()) / 2**20
        print(f"{path.relative_to(target.parent)}: {kept:.1f} MiB, results.h5 {size:.1f} MiB")


def example_runs(results: Results) -> list[str]:
    """Ids of the chain of runs of the point nearest to the median friction, at the middle density."""
    runs = results.runs
    points = results.family_points()
    point = int(points.id[np.argmin(np.abs(points.mu_s - np.median(points.mu_s)))])
    mu_iso = results.family_densities()[len(results.family_densities()) // 2]
    there = runs[(runs["mu_iso"] == mu_iso) & (runs["status"] == "done") & runs["family"].isin(["coupled", "shared"])]
    packing = there.loc[there["point"] == point, "packing"].min()
    chain = there[there["point"].isin([point, -1]) & (there["packing"] == packing)]
    return list(chain.drop_duplicates("stage")["run_id"])


def _small_enough(path: Path) -> float:
    """Size in MiB of a file for the repository; exits with one line if it exceeds the limit."""
    size = path.stat().st_size / 2**20
    if size > LIMIT_MIB:
        sys.exit(f"{path}: {size:.1f} MiB, limit {LIMIT_MIB} MiB")
    return size


if __name__ == "__main__":
    main()
