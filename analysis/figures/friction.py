"""Figure 16, not in the paper: peak and critical state along interparticle friction, runs and their surface."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..results.reader import Results
from . import panels, style

#: State and quantity of each panel.
PANELS = (("peak", "eta"), ("critical", "eta"), ("critical", "e"), ("critical", "Z"))
UNDRAINED_PANELS = (("transformation", "eta"), ("peak", "eta"), ("critical", "eta"), ("critical", "Z"))
TITLES = {("peak", "eta"): "peak of every point", ("transformation", "eta"): "phase transformation"}


@style.styled
def along(results: Results, curves: pd.DataFrame) -> Figure:
    """One state per panel: the points, and the denoised values along friction with their 95 % band, if there are any.

    curves: `tables.friction.friction_curves`.
    """
    densities, points = results.family_densities(), results.family_points()
    markers, looks = style.density_markers(densities), style.density_style(densities)
    figure = style.new_figure(7.2, 5.6, narrow_height=8.4)
    shown = UNDRAINED_PANELS if results.loading.is_undrained else PANELS
    for axis, letter, (state, symbol) in zip(figure.subplots(*style.grid(2, 2)).flat, "abcd", shown, strict=True):
        for mu_iso in (m for m in densities if symbol in results.state_symbols(state, m)):
            values = style.shown(symbol, results.measured(state, symbol, mu_iso))
            axis.plot(style.shown("mu_s", points.mu_s), values, markers[mu_iso], ms=3.5, mfc="none", mew=0.7,
                      color=looks[mu_iso]["color"], alpha=0.7)  # fmt: skip
        of_panel = curves[(curves["state"] == state) & (curves["quantity"] == symbol)]
        for mu_iso, curve in of_panel.groupby("mu_iso", sort=False):
            x, y, half = (curve[name].to_numpy(float) for name in ("mu_s", "value", "ci95"))
            axis.plot(x, y, color=looks[mu_iso]["color"], linestyle=looks[mu_iso]["linestyle"])
            axis.fill_between(x, y - half, y + half, color=looks[mu_iso]["color"], alpha=0.15, lw=0)
        axis.set(xlabel=style.label("mu_s"), ylabel=style.label(symbol), xscale="log")
        axis.set_xticks([0.05, 0.1, 0.2, 0.5, 1.0], labels=["0.05", "0.1", "0.2", "0.5", "1"])
        axis.set_xlim(points.mu_s.min() / 1.1, points.mu_s.max() * 1.1)
        axis.minorticks_off()
        panels.panel_title(axis, letter, TITLES.get((state, symbol), f"{state} state"))
    line = {} if len(curves) else {"linestyle": "none"}
    keys = [Line2D([], [], marker=markers[m], mfc="none", mew=0.7, ms=3.5, **look | line) for m, look in looks.items()]
    figure.axes[0].legend(handles=keys, loc="upper left")
    return figure
