"""Packings that collapse: their grains take on less friction than the packing was consolidated with.

What held the packing up is taken away, and it falls to a denser one.  No limit of equilibrium is broken on the way, but
how dense the packing becomes depends on the grains' inertia too, as the stability map tells
(data/benchmarks/stability.csv, cells whose mu_s is below mu_iso).  So a plan counts such points, and a report its runs.
"""

from __future__ import annotations

import numpy as np


def collapsed_runs(results) -> np.ndarray:
    """Which of `results.runs` (R,) are probes and shear runs that start from a collapsed packing."""
    runs, mu_s = results.runs, np.full(len(results.runs), np.inf)
    for family in results.families:
        own = (runs["family"] == family).to_numpy() & (runs["stage"] != "consolidate").to_numpy()
        mu_s[own] = runs["point"][own].map(results.family_points(family).set_index("id")["mu_s"])
    return mu_s < runs["mu_iso"].to_numpy(float)


def largest_loss(results) -> float:
    """Largest share of its void ratio that a point's packing loses between consolidation and shear; 0 if none does."""
    means = {mu_iso: results.consolidated("e", mu_iso) for mu_iso in results.family_densities()}
    return max((1 - np.nanmin(results.state("initial", "e", mu_iso)) / (found @ share)
                for mu_iso, (found, share) in means.items() if len(found)), default=0.0)  # fmt: skip
