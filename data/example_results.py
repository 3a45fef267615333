"""How to use the results.h5 of a campaign alone: moments, a probability, figures and tables.

/usr/bin/python3 data/example_results.py data/laptop/results.h5 example.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the folder of the repository, which holds analysis/

import matplotlib.pyplot as plt

from analysis import plot_mean_band, plot_pdf_contours, plot_state_pdfs, read_results
from analysis.pdem import state_pdf
from analysis.quantities import QUANTITIES
from analysis.results import ResultsError


def main(path: str, picture: str) -> None:
    """Print moments and an exceedance probability per density, and draw four plots of the stress ratio."""
    results = read_results(path)
    print(f"{len(results.points)} points, densities mu_iso = {results.densities}, strains to {results.strain[-1]:.2f}")
    family = results.families[-1]  # "coupled": both properties vary; "G_p": mu_s is fixed

    figure, axes = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
    points = results.family_points(family)  # points.mu_s, points.G_p (Pa), points.probability, each (Q,)
    for mu_iso in results.family_densities(family):
        # A response along strain: eta.values (T, Q), eta.mean and eta.std (T,), its PDF eta.pdf.
        eta = results.response("eta", mu_iso, family)
        # A state: one value per point.  The points have other probabilities if a run failed.
        critical = results.state("critical", "eta", mu_iso, family)
        pdf = state_pdf(critical, results.probability(mu_iso, family))
        print(f"mu_iso = {mu_iso:g}: eta at the end {eta.mean[-1]:.3f} +- {eta.std[-1]:.3f}, "
              f"probability of a critical eta above 0.6: {pdf.exceedance(0.6)[0]:.2f}")  # fmt: skip
        axes[1, 1].plot(points.mu_s, critical, "o", label=f"$\\mu_{{iso}}$ = {mu_iso:g}")

    plot_pdf_contours(eta, ax=axes[0, 0])  # of the loosest density, the last one of the loop
    axes[0, 0].set_title(f"PDF and mean, $\\mu_{{iso}}$ = {mu_iso:g}")
    plot_mean_band(results, "eta", family, ax=axes[0, 1])
    plot_state_pdfs(results, "critical", "eta", family, ax=axes[1, 0])
    axes[1, 0].set_title("Critical state")
    axes[1, 1].set(xlabel=QUANTITIES["mu_s"].label, ylabel=QUANTITIES["eta"].label, title="Critical state, every point")
    axes[1, 1].legend()
    figure.savefig(picture)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(f"usage: {sys.argv[0]} RESULTS.h5 PICTURE.png")
    try:
        main(*sys.argv[1:3])
    except ResultsError as error:
        sys.exit(str(error))
