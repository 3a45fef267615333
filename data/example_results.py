"""How to use a campaign's results.h5 alone: numbers, a probability, and a figure in thirty lines.

/usr/bin/python3 data/example_results.py data/laptop/results.h5 example.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import matplotlib.pyplot as plt

from analysis.pdem import evolution
from analysis.quantities import QUANTITIES
from analysis.results.reader import ResultsError, read_results


def main(path, picture):
    """Print moments and an exceedance probability per density, and draw the critical stress ratio against mu_s."""
    results = read_results(path)
    print(f"{len(results.points)} points, densities mu_iso = {results.densities}, strains to {results.strain[-1]:.2f}")
    figure, axis = plt.subplots(figsize=(5, 3.5), layout="constrained")
    family = results.families[-1]  # "coupled", or with mu_s fixed "G_p" alone
    for mu_iso in results.family_densities(family):
        eta = results.response("eta", mu_iso, family)  # eta.values (strain, point), eta.probability (point,)
        critical = results.state("critical", "eta", mu_iso, family)  # one value a point
        pdf = evolution.state_pdf(critical, results.probability(mu_iso, family))
        print(f"mu_iso = {mu_iso:g}: eta at the end {eta.mean[-1]:.3f} +- {eta.std[-1]:.3f}, "
              f"probability of a critical eta above 0.6: {pdf.exceedance(0.6)[0]:.2f}")  # fmt: skip
        axis.plot(results.family_points(family)["mu_s"], critical, "o", label=f"$\\mu_{{iso}}$ = {mu_iso:g}")
    axis.set(xlabel=QUANTITIES["mu_s"].label, ylabel="Critical " + QUANTITIES["eta"].label)
    axis.legend()
    figure.savefig(picture)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(f"usage: {sys.argv[0]} RESULTS.h5 PICTURE.png")
    try:
        main(*sys.argv[1:3])
    except ResultsError as error:
        sys.exit(str(error))
