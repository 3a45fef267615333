"""Figure 16, not in the paper: peak and critical state along interparticle friction, runs and their surface."""

from __future__ import annotations

import numpy as np
from matplotlib.lines import Line2D

from analysis.figures import panels, style
from analysis.friction_effect import RESPONSES, along_friction

TITLES = {("peak", "eta"): "peak of every run"}


@style.styled
def along(results):
    """A state a panel: the points, and the response surface along the points' ridge with its 95 % band."""
    densities, points = results.family_densities(), results.family_points()
    markers, looks = style.density_markers(densities), style.density_style(densities)
    mu_s = np.geomspace(points["mu_s"].min(), points["mu_s"].max(), 60)
    figure = style.new_figure(7.2, 5.6)
    for axis, letter, (state, symbol) in zip(figure.subplots(2, 2).flat, "abcd", RESPONSES, strict=True):
        for mu_iso in (m for m in densities if symbol in results.state_symbols(state, m)):
            values = style.shown(symbol, results.measured(state, symbol, mu_iso))
            axis.plot(style.shown("mu_s", points["mu_s"]), values, markers[mu_iso], ms=3.5, mfc="none", mew=0.7,
                      color=looks[mu_iso]["color"], alpha=0.7)  # fmt: skip
        for mu_iso, (value, half) in along_friction(results, state, symbol, mu_s).items():
            x, y, wide = style.shown("mu_s", mu_s), style.shown(symbol, value), style.shown(symbol, half)
            axis.plot(x, y, color=looks[mu_iso]["color"], linestyle=looks[mu_iso]["linestyle"])
            axis.fill_between(x, y - wide, y + wide, color=looks[mu_iso]["color"], alpha=0.15, lw=0)
        axis.set(xlabel=style.label("mu_s"), ylabel=style.label(symbol), xscale="log")
        axis.set_xticks([0.05, 0.1, 0.2, 0.5, 1.0], labels=["0.05", "0.1", "0.2", "0.5", "1"])
        axis.set_xlim(mu_s[0] / 1.1, mu_s[-1] * 1.1)
        axis.minorticks_off()
        panels.panel_title(axis, letter, TITLES.get((state, symbol), f"{state} state"))
    keys = [Line2D([], [], marker=markers[m], mfc="none", mew=0.7, ms=3.5, **look) for m, look in looks.items()]
    figure.axes[0].legend(handles=keys, loc="upper left")
    return figure
