"""Tables and figure of `bench_dem.py`: bias and scatter of every response of every setting, and error against cost."""

from __future__ import annotations

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
#: What the difference between the high and the low point is called, and what a bias may be at a point and of it.
SPREAD, BIAS_LIMIT, SPREAD_LIMIT = "high - low", 0.02, 0.05


def summarise(rows: pd.DataFrame, folder: Path | None) -> None:
    """Print the biases with their 95 % half widths, in %; with a folder, put the table and its figure there."""
    table = pd.concat([errors(rows, REFERENCE), errors(rows, BASE)])
    if not len(table):
        print("no two settings have a case in common yet, so there is no table of errors")
        return
    if folder:
        table.to_csv(folder / "dem_errors.csv", index=False, float_format="%.5g")
        draw(table[table.against == REFERENCE], folder / "dem_errors.png")
    words = [f"{100 * b:+.1f} ± {100 * h:.1f}" for b, h in zip(table.bias, table.bias_half_width, strict=True)]
    told = table.assign(words=words).pivot(index=["against", "setting", "of"], columns="response", values="words")
    print(told[list(RESPONSES)].to_string())
    main = table[(table.against == REFERENCE) & table.response.isin(MAIN)]
    print(f"within the limits against {REFERENCE}, {', '.join(MAIN)}:")
    for setting, some in main.groupby("setting", sort=False):
        spread, biases = 100 * some[some.of == SPREAD].bias_half_width, some[some.of != SPREAD]
        print(f"  {setting}: {biases.within.value_counts().to_dict()} of {len(biases)} biases; "
              f"spread between points known to {spread.min():.0f} to {spread.max():.0f} %")  # fmt: skip


def errors(rows: pd.DataFrame, against: str) -> pd.DataFrame:
    """Relative bias of every setting and response against another setting, its 95 % half width, scatter and cost.

    A pair is the same packing, density and point; one that lacks a value of either setting is left out.  `of` tells
    what is compared: the mean of the points, one point, or the difference between the high and the low one, which
    carries the propagation; all relative to the other setting's mean over the densities.  Pairs count as independent:
    each of the fifteen has a consolidation of its own.  `scatter` is a single pair's.  `within`: the whole interval
    lies inside the limit (yes), outside (no), or neither (open).
    """
    good, out = rows[rows.failure.isna()], []
    base = good[good.setting == against].set_index(CASE)
    for setting in (name for name in dict.fromkeys(rows.setting) if name != against):
        some = good[good.setting == setting].set_index(CASE)
        common = some.index.intersection(base.index)
        if not len(common):
            continue
        some, other = some.loc[common], base.loc[common]
        told = {"setting": setting, "against": against,
                "failed": int((rows.setting == setting).sum() - (good.setting == setting).sum())}  # fmt: skip
        cost = {"steps": some.steps.mean(), "particle_steps": some.particle_steps.mean(),
                "particle_steps_ratio": some.particle_steps.sum() / other.particle_steps.sum()}  # fmt: skip
        for name in RESPONSES:
            off = (some[name] - other[name]).dropna()
            level = other[name][off.index].groupby(["mu_iso", "point"]).mean().unstack("point").mean()
            for of, weights in contrasts(level.index).items():
                bias, half, scatter, n = _estimate(off, weights, (weights * level).sum())
                limit = SPREAD_LIMIT if of == SPREAD else BIAS_LIMIT
                within = "yes" if abs(bias) + half <= limit else "no" if abs(bias) - half > limit else "open"
                out.append(told | {"response": name, "of": of, "cases": n, "bias": bias, "bias_half_width": half,
                                   "scatter": scatter, "limit": limit, "within": within} | cost)  # fmt: skip
    return pd.DataFrame(out)


def contrasts(points) -> dict[str, pd.Series]:
    """What is compared: weights of the points in their mean, in each alone, and in the high one minus the low one."""
    zero = pd.Series(0.0, index=points)
    out = {"all": zero + 1 / len(points)} | {point: zero + (zero.index == point) for point in points}
    return out | ({SPREAD: zero + (points == "high") - (points == "low")} if {"high", "low"} <= set(points) else {})


def _estimate(off: pd.Series, weights: pd.Series, level: float):
    """Bias over the level, its half width, a single pair's scatter, and pairs: a weighted sum of the points' means."""
    used = off[off.index.get_level_values("point").isin(weights.index[weights != 0])].groupby("point")
    variance, count, weights = used.var(ddof=1), used.count(), weights[weights != 0]
    freedom = int((count - 1).sum())
    error = np.sqrt((weights**2 * variance / count).sum(skipna=False)) / abs(level)
    half = t.ppf(0.975, freedom) * error if freedom else np.nan
    return (weights * used.mean()).sum() / level, half, np.sqrt(variance.mean()) / abs(level), int(count.sum())


def draw(table: pd.DataFrame, path: Path) -> None:
    """Largest |bias| of the main responses over all points against particle-steps, with the Pareto front."""
    fig, ax = plt.subplots(figsize=(6.4, 4.2), constrained_layout=True)
    main = table[table.response.isin(MAIN) & (table.of == "all")]
    main = main.assign(size=main.bias.abs()).dropna(subset="bias").sort_values("size")
    worst = main.groupby("setting").tail(1).set_index("setting")
    ax.errorbar(
        worst.particle_steps,
        100 * worst["size"],
        yerr=100 * worst.bias_half_width.fillna(0.0),
        fmt="o",
        color="#30638e",
        capsize=3,
    )
    for k, (setting, row) in enumerate(worst.sort_values(["particle_steps", "size"]).iterrows()):
        left = row.particle_steps > 0.6 * worst.particle_steps.max()
        ax.annotate(
            f"{setting} ({row.response.split('_')[0]})",
            (row.particle_steps, 100 * row["size"]),
            fontsize=7,
            xytext=(-6 if left else 6, 5 if k % 2 else -11),
            textcoords="offset points",
            ha="right" if left else "left",
        )
    front = worst.sort_values("particle_steps")
    front = front[front["size"].cummin() == front["size"]]
    ax.plot(front.particle_steps, 100 * front["size"], color="#d1495b", lw=1, label="Pareto front")
    ax.margins(x=0.2)
    ax.set(xscale="log", xlabel="particle-steps of a shear run", ylabel="largest bias against the reference (%)")
    ax.set_title("Bias of peak and critical $\\eta$, critical $e$ and $Z$, mean of all points; bars: 95 %", fontsize=10)
    ax.legend(frameon=False)
    fig.savefig(path, dpi=130)
    plt.close(fig)
