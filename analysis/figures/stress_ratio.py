"""Figures 5 to 7: the stress ratio along strain, its PDF surfaces, and where peak and critical state lie."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from ..results.reader import Results
from . import panels, style


@style.styled
def stress_ratio(results: Results) -> Figure:
    """Figure 5: PDF contours of eta (below with G_p alone, if it was run), means, PDFs at peak and critical."""
    alone = "G_p" in results.families
    figure = style.new_figure(7.6, 8.6 if alone else 6.4, narrow_height=9.4 if alone else 7.2)
    last = 2.1 if style.is_narrow() else 1.15
    rows = figure.subfigures(3 if alone else 2, 1, height_ratios=[1.0] * alone + [1.0, last])
    panels.contour_row(rows[0], results, "eta", "coupled", f"(a) {style.varying(results.points.names)}; line: mean")
    if alone:
        fixed = results.family_points("G_p").mu_s[0]
        panels.contour_row(rows[1], results, "eta", "G_p",
                           rf"(b) $G_p$ varies alone, $\mu_s$ = {fixed:g}")  # fmt: skip
    ratios = {} if style.is_narrow() else {"width_ratios": [1.35, 1, 1]}
    left, middle, right = rows[-1].subplots(*style.grid(1, 3), **ratios)
    panels.mean_band(left, results, "eta")
    title = r"mean $\pm$ 2 standard deviations" if style.is_narrow() else "mean"
    panels.panel_title(left, "c" if alone else "b", title)
    panels.state_pdfs(middle, results, "peak", "eta")
    panels.panel_title(middle, "d" if alone else "c", "at the peak")
    panels.state_pdfs(right, results, "critical", "eta")
    panels.panel_title(right, "e" if alone else "d", "critical state")
    if not style.is_narrow():
        right.set_ylabel("")
    panels.share_range(middle, right)
    return figure


@style.styled
def surfaces(results: Results) -> Figure:
    """Figure 6: a PDF surface of eta for every density, the densest also in plan; two panels a row."""
    densities = results.family_densities()
    rows = math.ceil((1 + len(densities)) / 2)
    figure = style.new_figure(7.2, 3.3 * rows, narrow_height=2.1 * (1 + len(densities)))
    grid = (1 + len(densities), 1) if style.is_narrow() else (rows, 2)
    plan = figure.add_subplot(*grid, 1)
    response = results.response("eta", densities[0])
    panels.colour_bar(figure, panels.contours(plan, response), plan, style.pdf_label("eta"))
    plan.set_ylabel(style.label("eta"))
    plan.set_ylim(*panels.visible_range([response], "eta"))
    panels.panel_title(plan, "a", style.density_title(densities[0], densities) + ", in plan")
    for k, mu_iso in enumerate(densities):
        axis = figure.add_subplot(*grid, k + 2, projection="3d")
        title = f"({chr(ord('b') + k)}) {style.density_title(mu_iso, densities)}"
        panels.surface(axis, results.response("eta", mu_iso), title=title)
    return figure


@style.styled
def peak_and_critical(results: Results) -> Figure:
    """Figure 7: every point's peak and critical state in stress ratio and void ratio (undrained: p') against strain."""
    densities = results.family_densities()
    figure = style.new_figure(7.4, 3.9, narrow_height=5.2)
    axes = figure.subplots(*style.grid(1, 2))
    for axis, symbol, letter in zip(axes, ("eta", "p" if results.loading.is_undrained else "e"), "ab", strict=True):
        for mu_iso, look in style.density_style(densities).items():
            response = results.response(symbol, mu_iso)
            strain = style.shown("eps_a", response.strain)
            axis.plot(strain, style.shown(symbol, response.mean), **look)
            at = style.shown("eps_peak", results.shown_state("peak", "eps_peak", mu_iso))
            axis.scatter(at, style.shown(symbol, results.shown_state("peak", symbol, mu_iso)), s=16, marker="^",
                         color=look["color"], edgecolor="white", linewidth=0.4, zorder=3)  # fmt: skip
            place = strain[-1] * (1.04 + 0.035 * densities.index(mu_iso))
            critical = style.shown(symbol, results.shown_state("critical", symbol, mu_iso))
            axis.scatter(np.full(len(critical), place), critical, s=16, marker="o", facecolor="none",
                         edgecolor=look["color"], linewidth=0.9, zorder=3)  # fmt: skip
        axis.set_xlabel(results.loading.strain_label)
        axis.set_ylabel(style.label(symbol))
        axis.set_xlim(left=0)
        axis.axvspan(1.02 * strain[-1], axis.get_xlim()[1], color="0.95", zorder=0)
        panels.panel_title(axis, letter, "lines: means")
    marks = [("^", "full", "peak of a point"), ("o", "none", "critical state of a point, averaged")]
    for marker, fill, text in marks:
        axes[1].plot([], [], marker=marker, fillstyle=fill, color="0.35", linestyle="none", label=text)
    axes[1].legend(loc="best", fontsize=7)
    return figure
