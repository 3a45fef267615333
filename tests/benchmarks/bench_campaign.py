"""What the campaign's bookkeeping costs and survives: scale, overhead and the kill test, as CSV under data/benchmarks.

    /usr/bin/python3 tests/benchmarks/bench_campaign.py [scale] [overhead] [kill] [faults]
    /usr/bin/python3 tests/benchmarks/bench_campaign.py kill --config campaign/demo.toml --whole runs/demo

scale     planning, status and analyse's bookkeeping for 100, 1,000 and 10,000 rows, products synthesised: CPU seconds
overhead  a campaign of 20 short runs in YADE: wall time over (the sum of the runs' own times / runs at once)
kill      a campaign in YADE (--config, by default the demo) killed 20 times at random moments, against the same one
          undisturbed (--whole FOLDER: run there, or taken from there as far as it is finished)
faults    the fault table that tests/campaign/test_faults.py leaves in build/
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import h5py  # noqa: E402
import synthetic_runs  # noqa: E402
from campaign_cases import make_real, make_small, plan_real, undisturbed  # noqa: E402
from kill_runs import SCATTER, compare, kill_and_restart  # noqa: E402

from campaign import evaluate  # noqa: E402
from campaign.config import read_config  # noqa: E402
from campaign.plan import make_rows, write_plan  # noqa: E402
from campaign.prepare import read_planned_points  # noqa: E402
from campaign.status import campaign_status, status_text  # noqa: E402

OUT = ROOT / "data" / "benchmarks"


def scale(place: Path, asked) -> None:
    """CPU seconds of planning and looking at 100, 1,000 and 10,000 rows."""
    lines = []
    for n in (25, 250, 2500):
        small = make_small(place / str(n), n=2)
        synthetic_runs.write_config(place / str(n), n)
        config, folder = read_config(small.toml), small.folder
        synthetic_runs.planned(config, folder, n)
        rows = make_rows(config, read_planned_points(config, folder))
        ready = {stage: place / str(n) / "ready" / f"{stage}.h5" for stage in ("consolidate", "probe", "shear")}
        for path in ready.values():
            with h5py.File(path, "r+") as file:
                del file["snapshots"]
        spent = {"plan": _cpu(lambda c=config, f=folder: write_plan(make_rows(c, read_planned_points(c, f)), f))}
        for row in rows:
            synthetic_runs.write_product(folder, row, ready[row.stage])
        for name in ("first_status", "status"):
            spent[name] = _cpu(lambda c=config, f=folder, r=rows: status_text(campaign_status(c, f, r)))
        spent["analyse_bookkeeping"] = _cpu(lambda c=config, f=folder, r=rows: _bookkeeping(c, f, r))
        lines.append({"rows": len(rows), **{f"{k}_cpu_s": round(v, 3) for k, v in spent.items()}})
        shutil.rmtree(place / str(n))
        print(lines[-1], flush=True)
    _write("campaign_scale.csv", lines)


def _bookkeeping(config, folder, rows) -> None:
    evaluate.plan_frame(folder, rows)
    evaluate.results_digest(config, folder, rows)
    campaign_status(config, folder, rows)


#: Runs YADE and notes when it began and ended, seconds.
TIMED_YADE = """#!/bin/sh
began=$(date +%s.%N)
yade "$@"
code=$?
echo "$began $(date +%s.%N)" >>own_times.txt
exit $code
"""


def overhead(place: Path, asked) -> None:
    """Wall time of 20 short runs in YADE, two at once, against the sum of their own times over two.

    A run's own time is that of its YADE process; without YADE's start, what its product says.  The rest is told apart:
    before the first process begins, after the last has ended, and places empty in between.
    """
    small = make_real(place, n=8, packings=4)
    (place / "timed_yade").write_text(TIMED_YADE)
    (place / "timed_yade").chmod(0o755)
    small.yade = str(place / "timed_yade")
    began = time.time()
    done = small.command("run", "--quiet", "--jobs", "2")
    ended = time.time()
    assert done.returncode == 0, done.stderr
    times = [tuple(map(float, line.split())) for line in (small.folder / "own_times.txt").read_text().splitlines()]
    own, wall = sum(b - a for a, b in times), ended - began
    before, after = min(a for a, _ in times) - began, ended - max(b for _, b in times)
    inside = sum(_seconds(small.folder / row.product, "wall_seconds") for row in small.rows)
    line = {"runs": len(times), "jobs": 2, "mean_own_s": own / len(times), "wall_s": wall, "ratio": wall / (own / 2),
            "ratio_without_yade_start": wall / (inside / 2), "before_first_s": before, "after_last_s": after,
            "places_empty_s": (wall - before - after) - own / 2}  # fmt: skip
    line = {k: round(v, 3) if isinstance(v, float) else v for k, v in line.items()}
    print(line)
    _write("campaign_overhead.csv", [line])


def kill(place: Path, asked) -> None:
    """A campaign in YADE twice, once killed at random moments; every number of every product compared."""
    whole = undisturbed(asked.config, asked.whole or place / "whole")
    slowest = max(_seconds(whole.folder / row.product, "cpu_seconds") for row in whole.rows)
    killed = plan_real(asked.config, place / "killed", like=whole.folder)
    if asked.checkpoint:
        killed.yade = str(Path(__file__).with_name("checkpoint_often.py"))
        os.environ["CHECKPOINT_SECONDS"] = str(asked.checkpoint)
    survived = kill_and_restart(killed, asked.kills, random.Random(asked.seed), slowest)
    told = compare(whole, killed, survived.interrupted)
    line = {"campaign": whole.config.name, "checkpoint_s": asked.checkpoint or "default", "runs": len(whole.rows),
            "kills_survived": survived.kills, "products": killed.total("done"),
            "interruptions": survived.interrupted.total(), "first_kill_at": round(survived.shares[0], 3),
            "last_kill_at": round(survived.shares[-1], 3),
            **{k: round(v, 5) if isinstance(v, float) else v for k, v in told.items()}}  # fmt: skip
    print(line)
    _replace("campaign_kill.csv", line, ("campaign", "checkpoint_s"))
    print(f"{survived.kills} kills survived")
    assert survived.kills == asked.kills, f"the campaign ended after {survived.kills} of {asked.kills} kills"
    assert told["untouched_identical"] == told["untouched"] and told["begun_anew_identical"] == told["begun_anew"], line
    assert all(told[f"resumed_{name}_difference"] <= limit for name, limit in SCATTER.items()), line


def _seconds(product: Path, which: str) -> float:
    with h5py.File(product) as file:
        return float(file["timing"].attrs[which])


def faults(place: Path, asked) -> None:
    """Run the fault tests and keep the table that they write."""
    subprocess.run([sys.executable, "-m", "pytest", "-q", "tests/campaign/test_faults.py"], cwd=ROOT, check=True)
    with open(ROOT / "build" / "faults.csv", newline="") as file:
        lines = list(csv.DictReader(file))
    for line in lines:  # folders, processes and random names of that day say nothing
        words = re.sub(
            r"/\S*/(?=run\b)| \(process \d+ on \S+\)|(?<=-)[0-9a-f]{8}(?=,|$)", "", line["what the user sees"]
        )
        line["what the user sees"] = words
    _write("campaign_faults.csv", lines)


def _cpu(call) -> float:
    began = time.process_time()
    call()
    return time.process_time() - began


def _write(name: str, lines: list[dict]) -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    with open(OUT / name, "w", newline="") as file:
        writer = csv.DictWriter(file, list(lines[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)


def _replace(name: str, line: dict, keys: tuple[str, ...]) -> None:
    """Put a line into a table in place of the one with the same keys."""
    old = []
    if (OUT / name).exists():
        with open(OUT / name, newline="") as file:
            old = [row for row in csv.DictReader(file) if any(row[key] != str(line[key]) for key in keys)]
    _write(name, [*old, line])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", metavar="WORD", help="what to measure (default: all four)")
    parser.add_argument("--config", type=Path, default=ROOT / "campaign" / "demo.toml")
    parser.add_argument("--whole", type=Path, help="folder of the undisturbed campaign (default: a temporary one)")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--checkpoint", type=float, help="seconds between checkpoints (default: the scripts' own)")
    return parser


if __name__ == "__main__":
    asked = _parser().parse_args()
    for word in asked.words or ("scale", "overhead", "kill", "faults"):
        with tempfile.TemporaryDirectory() as folder:
            {"scale": scale, "overhead": overhead, "kill": kill, "faults": faults}[word](Path(folder), asked)
