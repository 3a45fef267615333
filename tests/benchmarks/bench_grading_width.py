"""Which width of the grading reproduces the paper's Table 3: consolidations of 1,000 spheres, two packings per width.

    python3 tests/benchmarks/bench_grading_width.py              about 40 minutes of CPU; resumable
    python3 tests/benchmarks/bench_grading_width.py --table      prints the tables from the rows that are there

The runs have the settings of a campaign (time-step factor 1, balanced inertia, full stiffness). Rows go to
data/benchmarks/grading_width.csv as they finish. The table has, per width, the deviation of the twelve means from the
paper's, and the shares of grains without stress; the last lines give the width with the smallest sum of squares.
"""

from __future__ import annotations

import argparse

import numpy as np
import pandas as pd
from bench_rows import append, finished
from bench_table3 import SYMBOLS, state
from dem_runs import ROOT, RunCrashed, RunFailed, assembly, digest, run

from analysis.runs.run_file import read_run
from analysis.tables.published import INITIAL_STATE

ROWS = ROOT / "data" / "benchmarks" / "grading_width.csv"
KEYS = ("scripts", "N", "distribution", "sigma_ln", "mu_iso", "packing")
COLUMNS = (*KEYS, "steps", "cpu_seconds", "failure", *SYMBOLS, "inactive", "inactive_volume", "I_G", "I_G_active",
           "size_ratio")  # fmt: skip
N, PACKINGS, DENSITIES = 1000, (1, 2), (0.04, 0.1, 0.001)
WIDTHS = (
    *(("lognormal", sigma_ln) for sigma_ln in (0.174, 0.30, 0.10, 0.25, 0.35)), ("loguniform", 0.30),
    ("loguniform", 0.174),
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="store_true")
    if not parser.parse_args().table:
        done = finished(ROWS, KEYS)
        cases = [(*width, mu_iso, p) for p in PACKINGS for width in WIDTHS for mu_iso in DENSITIES]
        for distribution, sigma_ln, mu_iso, packing in cases:
            if (digest(), str(N), distribution, f"{sigma_ln:g}", f"{mu_iso:g}", str(packing)) not in done:
                try:
                    append(ROWS, COLUMNS, consolidated(distribution, sigma_ln, mu_iso, packing))
                except RunCrashed as error:
                    print(f"crashed, no row: {error}", flush=True)
    compare(pd.read_csv(ROWS))


def consolidated(distribution: str, sigma_ln: float, mu_iso: float, packing: int) -> dict:
    """The row of one consolidation, failed or not."""
    row = {"scripts": digest(), "N": N, "distribution": distribution, "sigma_ln": sigma_ln, "mu_iso": mu_iso,
           "packing": packing, "failure": ""}  # fmt: skip
    try:
        start = assembly(N, packing, sigma_ln, distribution)
        product = read_run(run("consolidate", assembly=start, mu_iso=mu_iso, G_p=25.7e9, seed=packing))
    except RunFailed as error:
        return row | {"failure": str(error)}
    values, d, count = state(product)
    row |= values
    idle = count < 2
    row |= {"inactive": float(idle.mean()), "inactive_volume": float((d[idle] ** 3).sum() / (d**3).sum())}
    row |= {"size_ratio": float(d.max() / d.min())}
    return row | {key: product.timing[key] for key in ("steps", "cpu_seconds")}


def deviations(rows: pd.DataFrame) -> pd.DataFrame:
    """Deviation of each of the twelve means from the paper's, relative: a line per width, a column per mean."""
    means = rows.groupby(["distribution", "sigma_ln", "mu_iso"])[list(SYMBOLS)].mean().unstack("mu_iso")
    published = [INITIAL_STATE[symbol, mu_iso][0] for symbol, mu_iso in means.columns]
    table = means / published - 1.0
    return table.set_axis([f"{symbol} {mu_iso:g}" for symbol, mu_iso in means.columns], axis=1)


def best_width(table: pd.DataFrame) -> tuple[float, pd.Series]:
    """The sigma_ln with the smallest sum of squares, and the deviations there: each deviation is a quadratic in it."""
    x = table.index.to_numpy(float)
    fits = [np.polynomial.Polynomial.fit(x, table[name], min(2, len(x) - 1)) for name in table]
    grid = np.linspace(x.min(), x.max(), 501)
    squares = sum(fit(grid) ** 2 for fit in fits)
    best = float(grid[np.argmin(squares)])
    return best, pd.Series([float(fit(best)) for fit in fits], index=table.columns)


def compare(rows: pd.DataFrame) -> None:
    """Print the deviations from the paper by width, the grains without stress, and the best width."""
    rows = rows[(rows.scripts == rows.scripts.iloc[-1]) & rows.failure.isna()]
    for (distribution, sigma_ln, mu_iso), some in rows.groupby(["distribution", "sigma_ln", "mu_iso"]):
        text = ", ".join(
            f"{s} {some[s].mean():.3f} ({some[s].mean() / INITIAL_STATE[s, mu_iso][0] - 1:+.1%})" for s in SYMBOLS
        )
        idle = f"inactive {some.inactive.mean():.1%} of the grains, {some.inactive_volume.mean():.1%} of the volume"
        print(f"{distribution} {sigma_ln:g}, mu_iso {mu_iso:g}, {len(some)} packings: {text}, {idle}")
    table = deviations(rows).dropna()
    for (distribution, sigma_ln), line in table.iterrows():
        print(f"{distribution} {sigma_ln:g}: root mean square of the twelve deviations "
              f"{np.sqrt((line**2).mean()):.2%}, largest {line.abs().max():.2%}")  # fmt: skip
    for distribution, some in table.groupby(level=0):
        some = some.droplevel(0)
        if len(some) > 2:
            best, left = best_width(some)
            print(f"{distribution}: nearest at sigma_ln = {best:.3f}, root mean square "
                  f"{np.sqrt((left**2).mean()):.2%}, largest {left.abs().max():.2%}")  # fmt: skip


if __name__ == "__main__":
    main()
