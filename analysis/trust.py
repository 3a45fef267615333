"""How far a campaign's numbers can be trusted: counts, proofs, noise, widths and losses as small frames."""

from __future__ import annotations

import numpy as np
import pandas as pd

from analysis import weighted
from analysis.packing_noise import common_error, packing_scatter
from analysis.quantities import QUANTITIES
from analysis.results import read_results

#: Name -> words and the limit beyond which a run fails (those of yade_scripts/proofs.py); NaN: a figure without one.
PROOFS = {
    "max_inertial_number": ("largest inertial number", 2.5e-3),
    "servo_mean_error": ("mean error of the confining stress", 0.01),
    "servo_max_error": ("largest error of the confining stress", 0.05),
    "energy_error": ("energy balance error, as far as energies were summed", 0.10),
    "F_unb": ("unbalanced force", float("nan")),
}


def run_counts(results) -> pd.DataFrame:
    """One row per stage and family, and one in all: runs planned, done, failed, spared, steady early; core-hours."""
    runs = read_results(results).runs
    parts = [(stage, family, part) for (stage, family), part in runs.groupby(["stage", "family"], sort=False)]
    rows = []
    for stage, family, part in [*parts, ("all", "", runs)]:
        counts = {word: int((part["status"] == word).sum()) for word in ("done", "failed", "spared")}
        rows.append(
            {"stage": stage, "family": family, "planned": len(part), **counts,
             "steady early": int((part["reason"] == "steady").sum()),
             "core-hours": part["cpu_seconds"].sum() / 3600, "steps, mean": part["steps"].mean()}
        )  # fmt: skip
    return pd.DataFrame(rows)


def proofs(results) -> pd.DataFrame:
    """Median and largest value of every proof over the shear runs that have it, and the limit it must keep."""
    runs = read_results(results).runs
    shear = runs[(runs["stage"] == "shear") & (runs["status"] == "done")]
    rows = []
    for name, (words, limit) in PROOFS.items():
        values = shear[name].abs().dropna()
        if len(values):
            rows.append(
                {
                    "proof": words,
                    "median": values.median(),
                    "largest": values.max(),
                    "limit": limit,
                    "run of the largest": shear.loc[values.idxmax(), "run_id"],
                }
            )
    return pd.DataFrame(rows, columns=["proof", "median", "largest", "limit", "run of the largest"])


def noise(results, symbols=("eta", "e", "Z", "Phi_dev")) -> pd.DataFrame:
    """Per density and quantity at the critical state: spread of the points against what one run's average is worth.

    Standard errors come from block averages within a run (divided by the root of their number where several packings
    serve a point), the scatter from replicate packings at the same point (standard deviation, averaged over the points
    that have some; NaN without).  `common` is what all points of a density may share and claims and bands allow for.
    All in shown units.
    """
    results = read_results(results)
    rows = []
    for k, mu_iso in enumerate(results.family_densities()):
        weight = results.weights(mu_iso)
        for symbol in symbols:
            factor = QUANTITIES[symbol].shown_factor
            spread = float(weighted.std(results.state("critical", symbol, mu_iso), weight))
            error = results.state_error("critical", symbol, mu_iso)
            own = np.nan if error is None else float(weighted.mean(error**2, weight)) ** 0.5
            rows.append(
                {
                    "mu_iso": mu_iso,
                    "quantity": symbol,
                    "spread of points": factor * spread,
                    "error of one run": factor * own,
                    "its share of variance": (own / spread) ** 2 if spread else np.nan,
                    "between packings": factor * packing_scatter(results, "critical", symbol, mu_iso),
                    "common": factor * common_error(results, "critical", symbol)[0][k],
                }
            )
    return pd.DataFrame(rows)


def widths(results, symbols=("eta", "e", "Z", "Phi_dev")) -> pd.DataFrame:
    """Kernel width of the shown densities beside the points' standard deviation and spacing, at the last strain."""
    results = read_results(results)
    rows = []
    for mu_iso in results.family_densities():
        for symbol in symbols:
            response = results.response(symbol, mu_iso)
            density, factor = response.density, QUANTITIES[symbol].shown_factor
            rows.append(
                {
                    "mu_iso": mu_iso,
                    "quantity": symbol,
                    "spread of points": factor * float(response.std[-1]),
                    "width shown": factor * float(density.shown_width[-1]),
                    "spacing of points": factor * float(density.spacing[-1]),
                    "method": density.method,
                }
            )
    return pd.DataFrame(rows)


def losses(results) -> pd.DataFrame:
    """Per family and density: shear runs planned, done, failed, continued as steady, and the probability lost."""
    results = read_results(results)
    names = ("planned", "done", "failed", "extended", "lost_probability")
    rows = []
    for family in results.families:
        for mu_iso in results.family_densities(family):
            counts = results.counts(mu_iso, family)
            rows.append({"family": family, "mu_iso": mu_iso} | {name.replace("_", " "): counts[name] for name in names})
    return pd.DataFrame(rows)
