"""How to use the results.h5 of a campaign alone: moments, a probability, figures and tables.

/usr/bin/python3 data/example_results.py                                    the laptop campaign, into example.png
/usr/bin/python3 data/example_results.py runs/demo/results.h5 picture.png   another one
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the folder of the repository, which holds analysis/

import matplotlib.pyplot as plt

from analysis import plot_mean_band, plot_pdf_contours, plot_state_pdfs, read_results
from analysis.quantities import QUANTITIES
from analysis.results import ResultsError

LAPTOP = Path(__file__).resolve().parent / "laptop" / "results.h5"


def main(path: str | Path = LAPTOP, picture: str = "example.png") -> None:
    """Print moments and an exceedance probability per density, and draw four plots of the stress ratio."""
    results = read_results(path)
    print(f"{len(results.points)} points, densities mu_iso = {results.densities}, strains to {results.strain[-1]:.2f}")
    family = results.families[-1]  # "coupled": both properties vary; "G_p": mu_s is fixed

    figure, axes = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
    points = results.family_points(family)  # points.mu_s, points.G_p (Pa), points.probability, each (Q,)
    for mu_iso, name in results.density_names(family).items():  # such as 0.001: dense; methods take either
        # A response along strain: eta.values (T, Q), eta.mean and eta.std (T,), its PDF eta.pdf; eta.strain_pct in %.
        eta = results.response("eta", name, family)
        # A state: one value per point, and its PDF over the points with their probabilities.
        critical = results.state("critical", "eta", name, family)
        pdf = results.state_pdf("critical", "eta", name, family)
        print(f"{name} (mu_iso = {mu_iso:g}): critical eta {pdf.mean:.3f} +- {pdf.std:.3f}, "
              f"probability of a critical eta above 0.6: {pdf.exceedance(0.6):.2f}")  # fmt: skip
        axes[1, 1].plot(points.mu_s, critical, "o", label=f"{name}, $\\mu_{{iso}}$ = {mu_iso:g}")

    plot_pdf_contours(eta, ax=axes[0, 0])  # of the loosest density, the last one of the loop
    axes[0, 0].set_title(f"PDF and mean, {name}")
    plot_mean_band(results, "eta", family, ax=axes[0, 1])
    plot_state_pdfs(results, "critical", "eta", family, ax=axes[1, 0])
    axes[1, 0].set_title("Critical state")
    axes[1, 1].set(xlabel=QUANTITIES["mu_s"].label, ylabel=QUANTITIES["eta"].label, title="Critical state, every point")
    axes[1, 1].legend()
    figure.savefig(picture)
    print(f"{picture}: PDF along strain, mean, and critical state")


if __name__ == "__main__":
    if len(sys.argv) > 3:
        sys.exit(f"usage: {sys.argv[0]} [RESULTS.h5 [PICTURE.png]]")
    try:
        main(*sys.argv[1:])
    except ResultsError as error:
        sys.exit(str(error))
