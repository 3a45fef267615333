"""Cost of the PDF surface of 100 points x 200 strains x 400 cells: plain per-point loop, TVD and exact, in one run.

    /usr/bin/python3 tests/benchmarks/bench_pdem_cost.py

Writes data/benchmarks/pdem_cost.csv: a row for each packing noise of the stress ratio (0.03 goes with 1,000 spheres).
The plain loop takes the same steps, one point after another, with numpy over the cells.  CPU time, best of three (loop:
one).  `tvd_rule` starts from the wide kernel that the exact surface shows, `tvd` from the mesh, as usual.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import analytic_cases as cases  # noqa: E402

from analysis.pdem import evolution  # noqa: E402

OUT = ROOT / "data" / "benchmarks" / "pdem_cost.csv"
POINTS, STRAINS, CELLS = 100, 200, 400
#: Settings of `evolve`; "exact" is what a campaign does.
METHODS = {"tvd": {"method": "tvd"}, "tvd_rule": {"method": "tvd", "rule": "silverman"}, "exact": {}}


def timed(function, times: int = 3) -> float:
    """Least CPU time of some calls."""
    spent = []
    for _ in range(times):
        begin = time.process_time()
        function()
        spent.append(time.process_time() - begin)
    return min(spent)


def peak_memory(function) -> float:
    """Largest memory held during a call over the size of the density it returns."""
    tracemalloc.start()
    pdf = function()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / pdf.p.nbytes


def measure(noise: float) -> dict:
    """All times and ratios for one packing noise."""
    strain = np.linspace(0.0, 0.4, STRAINS)
    inputs = cases.joint_inputs(cases.sobol_normals(POINTS, 1))
    h = cases.dem_like_paths(inputs, strain)
    h[1:] += noise * np.random.default_rng(2).normal(size=h[1:].shape)
    probability = np.full(POINTS, 1.0 / POINTS)

    def surface(name):
        return lambda: evolution.evolve(h, probability, strain, cells=CELLS, **METHODS[name])

    calls = {name: surface(name) for name in METHODS}
    row = {"noise": noise}
    for name, call in calls.items():
        row[f"{name}_ms"] = 1e3 * timed(call)
    for name in ("tvd", "tvd_rule"):
        pdf = calls[name]()
        dx = pdf.dx[0]
        path, every = (h - pdf.edges[0, 0]) / dx, np.broadcast_to(probability, h.shape)
        begin = time.process_time()
        plain, steps = cases.plain_tvd_loop(path, every, pdf.bandwidth[0] / dx, CELLS)
        row[f"loop_{name}_ms"] = 1e3 * (time.process_time() - begin)
        row[f"{name}_steps"] = steps
        row[f"{name}_over_loop_difference"] = np.abs(plain - pdf.p * dx).sum(axis=1).max()
        row[f"{name}_faster_than_loop"] = row[f"loop_{name}_ms"] / row[f"{name}_ms"]
        row[f"exact_faster_than_{name}"] = row[f"{name}_ms"] / row["exact_ms"]
    for name, call in calls.items():
        row[f"{name}_memory_over_result"] = peak_memory(call)
    return row


if __name__ == "__main__":
    table = pd.DataFrame([measure(noise) for noise in (0.0, 0.006, 0.015, 0.03)])
    OUT.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT, index=False, float_format="%.4g")
    print(table.T.to_string(float_format="%.3g"))
