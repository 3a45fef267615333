"""Figures 14 and 15: joint PDFs of the stress ratio with void ratios and with coordination numbers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from ..pdem import joint_pdf
from ..results.reader import Results
from . import panels, style


@style.styled
def joint_figure(results: Results, symbols: Sequence[str], state: str = "critical") -> Figure:
    """Joint PDFs of eta with each of two quantities at a state, as contours with the points and as surfaces."""
    densities = results.family_densities()
    figure = style.new_figure(7.4, 7.0, narrow_height=9.4)
    for row, symbol in enumerate(symbols):
        eta, other, probability = results.pooled(state, ("eta", symbol), densities)
        if np.count_nonzero(probability > 0) < 2:
            panels.withheld(figure.add_subplot(2, 1, row + 1), f"{state} state: not reached")
            continue
        joint = joint_pdf.joint_pdf(eta, other, probability)
        flat = figure.add_subplot(*style.grid(2, 2), 2 * row + 1)
        factor = panels.pdf_factor(symbol)
        filled = flat.contourf(joint.x1, joint.x2 * factor, joint.p.T / factor, cmap=panels.CONTOUR_MAP,
                               levels=panels.pdf_levels(joint.p.max() / factor), extend="max")  # fmt: skip
        _points(flat, results, state, symbol, legend=row == 0)
        seen = np.flatnonzero((joint.p > 0.01 * joint.p.max()).any(axis=1))
        line = np.linspace(joint.values1.min(), joint.values1.max(), 100)
        flat.plot(line, joint.conditional_mean(line) * factor, color="k", lw=1.2)
        flat.set(xlabel=style.label("eta"), ylabel=style.label(symbol), xlim=_reach(joint.x1[seen], eta))
        also = np.flatnonzero((joint.p > 0.01 * joint.p.max()).any(axis=0))
        flat.set_ylim(*_reach(joint.x2[also] * factor, other * factor))
        panels.panel_title(flat, "ac"[row], f"{state} state, correlation of the points {joint.correlation:+.2f}")
        panels.colour_bar(figure, filled, flat, "Joint probability density")
        solid = figure.add_subplot(*style.grid(2, 2), 2 * row + 2, projection="3d")
        keep = np.ix_(seen, also)
        x, y = np.meshgrid(joint.x1[seen], joint.x2[also] * factor, indexing="ij")
        labels = (style.short_label("eta"), style.short_label(symbol))
        panels.draw_surface(solid, x, y, joint.p[keep] / factor, labels, f"({'bd'[row]})")
    together = f"Points of all {len(densities)} densities; line" if len(densities) > 1 else "Line"
    figure.suptitle(f"{together}: conditional mean", fontsize=9)
    return figure


def _reach(seen, values):
    """Least and largest of the visible density and, with a margin, of the points."""
    margin = 0.03 * np.ptp(seen)
    return min(seen[0], np.nanmin(values) - margin), max(seen[-1], np.nanmax(values) + margin)


def _points(axis, results, state, symbol, legend):
    densities = results.family_densities()
    markers = style.density_markers(densities)
    for mu_iso, look in style.density_style(densities).items():
        x, y = (style.shown(s, results.shown_state(state, s, mu_iso)) for s in ("eta", symbol))
        axis.scatter(x, y,
                     s=8 + 150 * results.probability(mu_iso), marker=markers[mu_iso], facecolor="white",
                     edgecolor=look["color"], linewidth=0.8, label=look["label"], zorder=3)  # fmt: skip
    if legend:
        axis.legend(loc="best", fontsize=6.5)


def eta_void_ratios(results: Results) -> Figure:
    """Figure 14: with the void ratio, undrained with p' in its place, and with the mechanical void ratio."""
    return joint_figure(results, ("p" if results.loading.is_undrained else "e", "e_m"))


eta_coordination = partial(joint_figure, symbols=("Z", "Z_m"))
