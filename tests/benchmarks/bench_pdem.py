"""Error and cost of PDEM on the random oscillator: points 25 ... 400, cells 100 ... 1,600, three settings side by side.

x(t) = 0.1 cos(omega t), omega uniform on 5 pi/4 ... 7 pi/4, t to 10.  `l1_median` and `l1_worst` are L1 distances at
five times, away from the singular ends (|x| < 0.09); `l1_whole` is the worst over all x.  The setting "exact" is that
of a campaign.  Writes data/benchmarks/pdem_oscillator.csv and .png, and beside them pdem_order.csv (a density moved at
a constant velocity against its exact translate) and pdem_joint.csv (M-PDEM of a linear-Gaussian pair).  Two minutes.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import analytic_cases as cases  # noqa: E402

from analysis.pdem import evolution, joint_pdf, tvd  # noqa: E402

OUT = ROOT / "data" / "benchmarks"
TIMES = np.linspace(0, 10, 501)
SHOWN = np.array([50, 100, 200, 300, 450])  # t = 1, 2, 4, 6, 9
#: Settings of `evolve`: those of a campaign, the other method, and a kernel for regular points.
METHODS = {"exact": {}, "tvd": {"method": "tvd"}, "exact, spacing": {"rule": "spacing"}}


def oscillator() -> pd.DataFrame:
    """One row per setting, number of points and mesh."""
    rows = []
    for points in (25, 50, 100, 200, 400):
        h, probability = cases.oscillator_paths(points, TIMES)
        for cells in (100, 200, 400, 800, 1600):
            for name in METHODS:
                begin = time.process_time()
                pdf = evolution.evolve(h, probability, TIMES, cells=cells, **METHODS[name])
                rows.append({"method": name, "points": points, "cells": cells, "cpu_s": time.process_time() - begin})
                rows[-1].update(_errors(pdf))
    return pd.DataFrame(rows)


def _errors(pdf) -> dict:
    l1, whole, mean, std = [], [], [], []
    for k in SHOWN:
        exact = np.diff(cases.oscillator_cdf(pdf.edges[k], TIMES[k]))
        inner = np.abs(pdf.x) < 0.09
        error = np.abs(pdf.p[k] * pdf.dx[k] - exact)
        l1.append(error[inner].sum())
        whole.append(error.sum())
        m, s = cases.oscillator_moments(TIMES[k])
        mean.append(abs(pdf.mean[k] - m) / 0.1)
        std.append(abs(pdf.std[k] / s - 1))
    return {
        "l1_median": np.median(l1),
        "l1_worst": max(l1),
        "l1_whole": max(whole),
        "mean_error_over_amplitude": max(mean),
        "std_error": max(std),
        "kernel_over_dx": np.median(pdf.bandwidth / pdf.dx),
        "diffusion_over_dx": pdf.numerical_width[-1] / pdf.dx[-1],
    }


def order() -> pd.DataFrame:
    """Constant velocity against the exact translate: L1 error of a density so many cells wide, moved by four widths."""
    rows = []
    for limiter in tvd.LIMITERS:
        for width in (8, 16, 32, 64):
            path = 8.0 * width + np.linspace(0, 4 * width, 80 * width + 1)[:, None]
            p, _ = tvd.transport(path, np.ones_like(path), width, 20 * width, limiter)
            exact = tvd.kernel_cells(path[-1], np.array([width]), np.zeros(1), 20 * width)[:, 0]
            off = (np.arange(len(exact)) + 0.5) / width - 12.0
            smooth = (np.abs(off) > 0.5) & (np.abs(off) < 2.5)
            error = np.abs(p[-1] - exact)[smooth].sum()
            growth = np.diff(np.abs(np.diff(p, axis=1)).sum(axis=1)).max()
            rows.append({"limiter": limiter, "cells_per_width": width, "l1_smooth": error, "variation_growth": growth})
    table = pd.DataFrame(rows)
    table["order"] = -np.log2(table["l1_smooth"]).groupby(table["limiter"]).diff()
    return table


def joint() -> pd.DataFrame:
    """M-PDEM of a linear-Gaussian pair: y1 = z1, y2 = rho z1 + sqrt(1 - rho^2) z2, against the bivariate normal."""
    rows = []
    for rho in (0.3, 0.5, -0.738, 0.95):
        for points in (50, 100, 200, 400):
            z = cases.golden_normals(points)
            one, two = z[:, 0], rho * z[:, 0] + np.sqrt(1 - rho**2) * z[:, 1]
            found = joint_pdf.joint_pdf(one, two, np.full(points, 1 / points))
            rows.append({"rho": rho, "points": points, "correlation_error": abs(found.correlation - rho)})
            cell = found.first.dx[0] * found.second.dx[0]
            rows[-1]["l1"] = np.abs(found.p - cases.bivariate_normal(found.x1, found.x2, rho)).sum() * cell
            gaps = [np.abs(found.marginal(0) - found.first.p[0]), np.abs(found.marginal(1) - found.second.p[0])]
            rows[-1]["marginal_gap"] = max(gap.max() for gap in gaps)
            information = -0.5 * np.log(1 - rho**2)
            rows[-1]["mutual_information"], rows[-1]["exact_information"] = found.mutual_information, information
    return pd.DataFrame(rows)


#: Line and label of each setting.
LINES = {
    "exact": ("s-", "exact (a campaign)"),
    "tvd": ("o--", "TVD, minmod"),
    "exact, spacing": ("^:", 'exact, rule="spacing"'),
}


def draw(table: pd.DataFrame) -> None:
    """L1 error against cells and against CPU time, one line per setting and number of points."""
    fig, axes = plt.subplots(1, 2, figsize=(8.4, 3.4), sharey=True, constrained_layout=True)
    shades = plt.get_cmap("viridis")(np.linspace(0.05, 0.85, table["points"].nunique()))
    for (points, part), shade in zip(table.groupby("points"), shades, strict=True):
        for name, (style, _) in LINES.items():
            rows = part[part["method"] == name]
            for axis, column in zip(axes, ("cells", "cpu_s"), strict=True):
                axis.loglog(rows[column], rows["l1_median"], style, color=shade, ms=4, lw=1.2)
        axes[0].plot([], [], color=shade, lw=3, label=f"{points} points")
    for style, label in LINES.values():
        axes[1].plot([], [], style, color="k", ms=4, lw=1.2, label=label)
    for axis, label in zip(axes, ("Cells", "CPU time of the surface, 501 times (s)"), strict=True):
        axis.axhline(0.06, color="0.6", lw=0.8)
        axis.text(0.99, 0.064, "0.06", transform=axis.get_yaxis_transform(), ha="right", fontsize=7, color="0.4")
        axis.set_xlabel(label)
        axis.legend(frameon=False, fontsize=7.5, loc="upper left")
        axis.grid(alpha=0.25, which="both", lw=0.4)
    axes[0].set_ylabel("L1 distance to the exact PDF")
    axes[0].set_ylim(2e-3, 4e1)
    axes[0].set_yticks([1e-2, 1e-1, 1.0])
    fig.suptitle("Random oscillator: error and cost of PDEM", fontsize=10)
    fig.savefig(OUT / "pdem_oscillator.png", dpi=110)


if __name__ == "__main__":
    OUT.mkdir(parents=True, exist_ok=True)
    for name, table in (("pdem_order", order()), ("pdem_joint", joint()), ("pdem_oscillator", oscillator())):
        table.to_csv(OUT / f"{name}.csv", index=False, float_format="%.4g")
        print(name, table.to_string(index=False, float_format="%.3g"), sep="\n")
    draw(table)
