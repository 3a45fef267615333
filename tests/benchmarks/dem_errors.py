"""Tables and figure of `bench_dem.py`: bias and scatter of every response of every setting, and error against cost."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from scipy.stats import t

REFERENCE, BASE, CASE = "reference", "base", ["packing", "mu_iso", "point"]
#: Their error is shown relative to the reference's mean over the compared cases.
RESPONSES = (
    "eta_peak",
    "eps_peak_peak",
    "D_p_peak",
    "eta_critical",
    "e_critical",
    "e_m_critical",
    "Z_critical",
    "Z_m_critical",
    "Phi_dev_critical",
    "G_0",
)
MAIN = ("eta_peak", "eta_critical", "e_critical", "Z_critical")


def summarise(path: Path, scripts: str, write: bool = True) -> pd.DataFrame:
    """Print the table of errors of the rows of these scripts; `write` puts it and its figure beside the rows."""
    rows = pd.read_csv(path, keep_default_na=True)
    rows = rows[rows.scripts == scripts]
    if not len(rows):
        sys.exit(f"{path}: no row of these scripts ({scripts})")
    table = pd.concat([errors(rows, REFERENCE), errors(rows, BASE)])
    if write:
        table.to_csv(path.with_name("dem_errors.csv"), index=False, float_format="%.5g")
        draw(table[table.against == REFERENCE], path.with_name("dem_errors.png"))
    print(table.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
    return table


def errors(rows: pd.DataFrame, against: str) -> pd.DataFrame:
    """Per setting and response, `against` another setting: cases, relative bias, its 95 % half width, scatter, cost.

    A pair is the same packing, density and point.  The critical state forgets its packing, so that
    pairing helps little there; the half width says so.
    """
    good = rows[rows.failure.isna()]
    base = good[good.setting == against].set_index(CASE)
    out = []
    for setting in dict.fromkeys(rows.setting):
        if setting == against:
            continue
        some = good[good.setting == setting].set_index(CASE)
        common = some.index.intersection(base.index)
        for name in RESPONSES:
            if not len(common):
                continue
            own, other = some.loc[common, name], base.loc[common, name]
            relative = (own - other) / other.mean()
            n = len(relative)
            half = t.ppf(0.975, n - 1) * relative.std(ddof=1) / np.sqrt(n) if n > 1 else np.nan
            out.append(
                {
                    "setting": setting,
                    "against": against,
                    "response": name,
                    "cases": len(common),
                    "failed": int((rows.setting == setting).sum() - len(some)),
                    "bias": relative.mean(),
                    "bias_half_width": half,
                    "scatter": relative.std(ddof=1),
                    "steps": some.loc[common, "steps"].mean(),
                    "particle_steps": some.loc[common, "particle_steps"].mean(),
                    "particle_steps_ratio": some.loc[common, "particle_steps"].sum()
                    / base.loc[common, "particle_steps"].sum(),
                }
            )
    return pd.DataFrame(out)


def draw(table: pd.DataFrame, path: Path) -> None:
    """Largest |bias| of the main responses against particle-steps, with the Pareto front."""
    fig, ax = plt.subplots(figsize=(6.4, 4.2), constrained_layout=True)
    main = table[table.response.isin(MAIN)]
    worst = main.assign(size=main.bias.abs()).sort_values("size").groupby("setting").last()
    ax.errorbar(
        worst.particle_steps,
        100 * worst["size"],
        yerr=100 * worst.bias_half_width.fillna(0.0),
        fmt="o",
        color="#30638e",
        capsize=3,
    )
    for setting, row in worst.iterrows():
        ax.annotate(
            f"{setting} ({row.response.split('_')[0]})",
            (row.particle_steps, 100 * row["size"]),
            fontsize=8,
            xytext=(5, 4),
            textcoords="offset points",
        )
    front = worst.sort_values("particle_steps")
    front = front[front["size"].cummin() == front["size"]]
    ax.plot(front.particle_steps, 100 * front["size"], color="#d1495b", lw=1, label="Pareto front")
    ax.set(xscale="log", xlabel="particle-steps of a shear run", ylabel="largest bias against the reference (%)")
    ax.set_title("Bias of peak and critical $\\eta$, critical $e$ and $Z$; bars: 95 %", fontsize=10)
    ax.legend(frameon=False)
    fig.savefig(path, dpi=130)
    plt.close(fig)
