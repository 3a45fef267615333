"""What the campaign's bookkeeping costs and survives: scale, overhead and the kill test, as CSV under data/benchmarks.

    /usr/bin/python3 tests/benchmarks/bench_campaign.py [scale] [overhead] [kill] [faults]

scale     planning, status and analyse's bookkeeping for 100, 1,000 and 10,000 rows, products synthesised: CPU seconds
overhead  a campaign of 20 short runs: wall time over (the sum of the runs' own times / runs at once)
kill      a campaign in YADE killed 20 times at random moments, against the same one undisturbed
faults    the fault table that tests/test_faults.py leaves in build/
"""

from __future__ import annotations

import csv
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import h5py  # noqa: E402
import synthetic_runs  # noqa: E402
from campaign_cases import make_real, make_small, same_arrays  # noqa: E402
from test_local import kill_and_restart  # noqa: E402

from campaign import evaluate  # noqa: E402
from campaign.config import read_config  # noqa: E402
from campaign.plan import make_rows, write_plan  # noqa: E402
from campaign.prepare import read_planned_points  # noqa: E402
from campaign.status import campaign_status, status_text  # noqa: E402

OUT = ROOT / "data" / "benchmarks"


def scale(place: Path) -> None:
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
    evaluate._digest(config, folder, rows)
    campaign_status(config, folder, rows)


def overhead(place: Path) -> None:
    """Wall time of 20 runs that use a core each, against the sum of their own times over the runs at once."""
    lines = []
    for seconds in (5.0, 10.0):
        more = "[run]\njobs = 2\n"
        small = make_small(place / f"{seconds:g}", n=2, more=more, cpu_seconds=seconds)
        text = small.toml.read_text().replace("N = 64", "N = 64\npackings = [1, 2]")
        small.toml.write_text(text)
        began = time.monotonic()
        done = small.command("run", "--quiet")
        wall = time.monotonic() - began
        assert done.returncode == 0, done.stderr
        own = [float(line) for line in (small.folder / "own_seconds.txt").read_text().split()]
        ratio = wall / (sum(own) / 2)
        lines.append({"runs": len(own), "jobs": 2, "cpu_s_a_run": seconds, "mean_own_s": round(sum(own) / 20, 2),
                      "wall_s": round(wall, 1), "ratio": round(ratio, 3)})  # fmt: skip
        print(lines[-1], flush=True)
    _write("campaign_overhead.csv", lines)


def kill(place: Path) -> None:
    """The same campaign in YADE twice, once killed 20 times; every number of every product compared."""
    whole, killed = make_real(place / "whole", n=4), make_real(place / "killed", n=4)
    assert whole.command("run", "--quiet", CAMPAIGN_YADE="yade").returncode == 0, whole.status()
    survived = kill_and_restart(killed, 20, random.Random(7), 25.0, CAMPAIGN_YADE="yade")
    resumed = same = 0
    for row in whole.rows:
        with h5py.File(whole.folder / row.product) as a, h5py.File(killed.folder / row.product) as b:
            resumed += bool(b.attrs["resumed"])
            same += same_arrays(a, b)
    line = {"runs": len(whole.rows), "kills_survived": survived, "products": killed.total("done"),
            "bit_identical": same, "resumed_inside": resumed}  # fmt: skip
    print(line)
    _write("campaign_kill.csv", [line])


def faults(place: Path) -> None:
    """Run the fault tests and keep the table that they write."""
    subprocess.run([sys.executable, "-m", "pytest", "-q", "tests/test_faults.py"], cwd=ROOT, check=True)
    with open(ROOT / "build" / "faults.csv", newline="") as file:
        lines = list(csv.DictReader(file))
    for line in lines:  # folders and processes of that day say nothing
        line["what the user sees"] = re.sub(r"/\S*/(?=run\b)|(?<=process )\d+", "", line["what the user sees"])
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


if __name__ == "__main__":
    for word in sys.argv[1:] or ("scale", "overhead", "kill", "faults"):
        with tempfile.TemporaryDirectory() as folder:
            {"scale": scale, "overhead": overhead, "kill": kill, "faults": faults}[word](Path(folder))
