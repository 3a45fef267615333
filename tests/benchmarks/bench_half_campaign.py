"""The laptop campaign with half its points and packings, from the same runs: what half the cost does to the numbers.

    /usr/bin/python3 tests/benchmarks/bench_half_campaign.py        (two minutes, no YADE; --table: only the table)

The half has the points of the packings 1 to 10: 50 of 100 points, which represent the joint distribution, since the
packings are dealt so.  It is analysed as a campaign whose other points were spared.  Writes
data/benchmarks/half_campaign.csv, with a row for every density and quoted state: the mean without noise in both
campaigns and the half width of its 95 % interval (`_pm`); the part of this half width that the runs have (`_runs`; the
rest is that of the measured pairs, which both share); and the difference of mean, standard deviation, 5 and 95 %
quantile over the standard deviation.  `within`: the means differ by at most sqrt(half_runs^2 - whole_runs^2),
which 95 % of the differences should be, since the half is part of the whole.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.results import read_results  # noqa: E402
from analysis.results.build import build_results  # noqa: E402
from analysis.results.models import state_moments  # noqa: E402
from analysis.results.quote import quoted  # noqa: E402
from analysis.results.reader import Results  # noqa: E402
from analysis.runs.archive import NAME, Archive, write_archive  # noqa: E402
from campaign.config import read_config  # noqa: E402
from campaign.evaluate import INPUT_BOOTSTRAP, campaign_info, plan_frame  # noqa: E402
from campaign.plan import make_rows  # noqa: E402
from campaign.prepare import read_points  # noqa: E402

LAPTOP, OUT = ROOT / "data" / "laptop", ROOT / "data" / "benchmarks" / "half_campaign.csv"
CONFIG = ROOT / "campaign" / "laptop.toml"
HALF = 10
NAMES = ("mean", "sd", "q05", "q95")
COLUMNS = [0, 1, 2, 4]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="store_true", help="only print the table there is")
    if not parser.parse_args().table:
        whole = read_results(LAPTOP / "results.h5")
        with tempfile.TemporaryDirectory() as folder:
            half = of_half(Path(folder))
            pd.DataFrame(rows(whole, half)).to_csv(OUT, index=False, float_format="%.4g")
        for name, results in (("whole", whole), ("half", half)):
            runs = results.runs[(results.runs["status"] == "done") & (results.runs["family"] != "G_p")]
            hours = runs["cpu_seconds"].sum() / 3600
            print(f"{name}: {len(runs)} runs without the second family, {hours:.2f} core-hours")
    table = pd.read_csv(OUT)
    print(table.to_string(index=False))
    print(f"half width of the mean from the runs, half over whole: {(table.half_runs / table.whole_runs).median():.2f} "
          f"(median); within: {table.within.sum()} of {len(table)}")  # fmt: skip


def of_half(folder: Path) -> Results:
    """Results of the half campaign, from the archive."""
    config = read_config(CONFIG)
    for name in ("points.csv", "inputs.json"):
        (folder / name).symlink_to(LAPTOP / name)
    points, archive = read_points(folder), Archive(LAPTOP / NAME)
    rows = [row for row in make_rows(config, points) if row.family != "G_p"]
    spared = frozenset(row.run_id for row in rows if row.packing > HALF)
    write_archive(folder / NAME, {run_id: archive[run_id] for run_id in archive if run_id not in spared})
    path = build_results(folder, plan_frame(folder, rows, spared), points, campaign_info(config, folder),
                         input_bootstrap=INPUT_BOOTSTRAP)  # fmt: skip
    return read_results(path)


def rows(whole: Results, half: Results) -> list[dict]:
    """A row of the table per density and state."""
    found = []
    for mu_iso in whole.family_densities():
        for state, symbol in quoted(whole):
            both = [state_moments(results, state, symbol, mu_iso) for results in (whole, half)]
            if any(one is None for one in both):
                continue
            row = {"mu_iso": mu_iso, "state": state, "quantity": symbol}
            (value, pm, runs), (value_half, pm_half, runs_half) = map(numbers, both)
            row |= {"whole": value[0], "whole_pm": pm, "whole_runs": runs}
            row |= {"half": value_half[0], "half_pm": pm_half, "half_runs": runs_half}
            row |= dict(zip((f"{name}_difference" for name in NAMES), (value_half - value) / value[1], strict=True))
            expected = np.sqrt(max(runs_half**2 - runs**2, 0.0))
            found.append(row | {"within": bool(abs(value_half[0] - value[0]) <= expected)})
    return found


def numbers(moments) -> tuple[np.ndarray, float, float]:
    """Mean, sd and quantiles (4,), half width of the mean's interval, and the part of it that the runs have."""
    estimate = moments.distribution.denoised
    half = max(estimate.high[0, 0] - estimate.value[0, 0], estimate.value[0, 0] - estimate.low[0, 0])
    return estimate.value[0, COLUMNS], float(half), float(half * np.sqrt(moments.runs_share))


if __name__ == "__main__":
    main()
