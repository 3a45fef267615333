"""Runs the laptop campaign from where data/laptop left it and fills data/laptop from it.

/usr/bin/python3 data/make_laptop.py [--unfinished] [runs/laptop]

data/laptop keeps an archive of all runs (runs.h5) with the points they belong to, so the campaign goes on from there on
any machine: only what is missing is run.  Then results.h5, tables, figures, the report and the example runs are made,
with whatever fidelity.csv and beyond.csv the benchmarks have left in data/laptop.  The example runs are the chain
consolidate -> probe -> shear of one point at one density, the point nearest to the median friction.  --unfinished keeps
the runs of a sitting in the archive and stops there.
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

from analysis.results.reader import read_results  # noqa: E402
from campaign.evaluate import report_of_file  # noqa: E402

TARGET = ROOT / "data" / "laptop"
#: What a campaign goes on from.
ARCHIVE = ("runs.h5", "points.csv", "inputs.json")
LIMIT_MIB = 25


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "runs" / "laptop")
    parser.add_argument("--unfinished", action="store_true", help="archive the runs there are, run nothing")
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
    """Give a folder that has no campaign yet the archive, the points and the failures kept in the repository."""
    if (folder / "points.csv").exists() or not (target / "runs.h5").exists():
        return
    (folder / "products").mkdir(parents=True, exist_ok=True)
    for name in ARCHIVE:
        shutil.copyfile(target / name, folder / name)
    for path in target.glob("*.failed.json"):
        shutil.copyfile(path, folder / "products" / path.name)


def keep(folder: Path, target: Path) -> None:
    """Copy archive, points and failures; an archive above 25 MiB is refused."""
    target.mkdir(parents=True, exist_ok=True)
    _small_enough(folder / "runs.h5")
    for path in [*(folder / name for name in ARCHIVE), *(folder / "products").glob("*.failed.json")]:
        shutil.copyfile(path, target / path.name)


def fill(folder: Path, target: Path) -> None:
    """Copy results and example runs, draw, and say what it takes; a results.h5 above 25 MiB is refused."""
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
            print(f"{run_id}: no product here, only its archive; the example runs lack it", file=sys.stderr)
    print(report_of_file(target / "results.h5", target))
    for path in (target, target / "example_runs"):
        kept = sum(p.stat().st_size for p in path.rglob("*") if p.is_file()) / 2**20
        print(f"{path.relative_to(target.parent)}: {kept:.1f} MiB, results.h5 {size:.1f} MiB")


def example_runs(results) -> list[str]:
    """Ids of the chain of the point nearest to the median friction, at the middle density, first packing."""
    runs = results.runs
    points = results.family_points()
    point = int(points.id[np.argmin(np.abs(points.mu_s - np.median(points.mu_s)))])
    mu_iso = results.family_densities()[len(results.family_densities()) // 2]
    first = runs[(runs["mu_iso"] == mu_iso) & (runs["packing"] == runs["packing"].min()) & (runs["status"] == "done")]
    chain = first[first["point"].isin([point, -1]) & first["family"].isin(["coupled", "shared"])]
    return list(chain.drop_duplicates("stage")["run_id"])


def _small_enough(path: Path) -> float:
    """Size in MiB of a file for the repository; ends with one line if it is too large."""
    size = path.stat().st_size / 2**20
    if size > LIMIT_MIB:
        sys.exit(f"{path}: {size:.1f} MiB, limit {LIMIT_MIB} MiB")
    return size


if __name__ == "__main__":
    main()
