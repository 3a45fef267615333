"""Figures 2 to 4: pairs and their marginals, the joint density with the points, the grading."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..inputs.joint import Joint
from ..inputs.marginals import Marginal
from ..inputs.sieve_curve import curvature
from ..micromechanics import grading
from ..points.selection import select_points
from ..results.reader import Results
from . import panels, style

PAIR = ("mu_s", "G_p")
#: Places of the panels of Figure 3 in a grid of 2 x 6.
PLACES = (np.s_[0, :3], np.s_[0, 3:], np.s_[1, :2], np.s_[1, 2:4], np.s_[1, 4:])


@style.styled
def data_marginals(results: Results) -> Figure:
    """Figure 2: the pairs, and a histogram with the fitted PDFs for each of the two properties."""
    figure = style.new_figure(7.6, 2.9, narrow_height=6.3)
    scatter, *others = figure.subplots(*style.grid(1, 3))
    mu_s, G_p = results.pairs.T
    scatter.plot(mu_s, style.shown("G_p", G_p), "o", ms=3.5, color="0.25", mfc="none", mew=0.8)
    scatter.set(xlabel=style.label("mu_s"), ylabel=style.label("G_p"), xlim=(0, None), ylim=(0, None))
    panels.panel_title(scatter, "a", f"{len(mu_s)} {_kind(results)}pairs")
    for axis, symbol, letter, values in zip(others, PAIR, "bc", (mu_s, G_p), strict=True):
        factor = panels.pdf_factor(symbol)
        edges = np.linspace(0, 1.02 * values.max(), 16)
        axis.hist(values * factor, bins=edges * factor, density=True, color="0.85", edgecolor="white", lw=0.5)
        x = np.linspace(edges[0], edges[-1] * 1.1, 300)[1:]
        fits = [Marginal.from_dict(record) for record in results.inputs["marginals"].get(symbol, [])]
        for k, fit in enumerate(fits[:4]):
            look = {"color": panels.CONTOUR_MAP(1.0 - 0.25 * k), "linestyle": style.LINES[k], "lw": 2 - 0.3 * k}
            text = fit.family + (f", AIC + {fit.aic - (fits[0].aic or 0.0):.1f}" if k and fit.aic is not None else "")
            axis.plot(x * factor, fit.pdf(x) / factor, label=text, **look)
        axis.set(xlabel=style.label(symbol), ylabel=style.pdf_label(symbol), xlim=(0, x[-1] * factor))
        if fits:
            axis.legend(fontsize=6.5)
        panels.panel_title(axis, letter)
    return figure


@style.styled
def joint_points(results: Results) -> Figure:
    """Figure 3: joint density as surface and contours, the representative points and their distribution functions."""
    joint = Joint.from_dict(results.inputs["joint"])
    points = results.points
    figure = style.new_figure(7.6, 6.4, narrow_height=9.4)
    doubled = select_points(joint, 2 * len(points))
    reach = [(0.4 * min(points[s].min(), pairs.min()), 1.05 * max(points[s].max(), pairs.max(), more.max()))
             for s, pairs, more in zip(PAIR, results.pairs.T, doubled.x.T, strict=True)]  # fmt: skip
    x, y = np.meshgrid(*(np.linspace(*ends, 120) for ends in reach), indexing="ij")
    factor = panels.pdf_factor("G_p")
    height = joint.pdf(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape) / factor
    grid = figure.add_gridspec(5, 1) if style.is_narrow() else figure.add_gridspec(2, 6)
    first, *others = range(5) if style.is_narrow() else PLACES
    solid = figure.add_subplot(grid[first], projection="3d")
    labels = (style.short_label(PAIR[0]), style.short_label(PAIR[1]))
    panels.draw_surface(solid, x, y * factor, height, labels, "(a) joint density")
    flat, dots, twice, steps = (figure.add_subplot(grid[place]) for place in others)
    levels = panels.pdf_levels(height.max())
    filled = flat.contourf(x, y * factor, height, levels=levels, cmap=panels.CONTOUR_MAP, extend="max")
    panels.colour_bar(figure, filled, flat, "Joint probability density (1/GPa)")
    flat.plot(results.pairs[:, 0], style.shown("G_p", results.pairs[:, 1]), "o", ms=2.5, mfc="white", mec="k", mew=0.5)
    panels.panel_title(flat, "b", f"with the {_kind(results)}pairs")
    sets = ((dots, "c", points.x, points.probability),
            (twice, "d", doubled.x, doubled.probability))  # fmt: skip
    for axis, letter, place, probability in sets:
        axis.contour(x, y * factor, height, levels=levels[::3], colors="0.7", linewidths=0.7)
        axis.scatter(place[:, 0], factor * place[:, 1], s=500 * probability + 3,
                     color=panels.CONTOUR_MAP(0.85), alpha=0.8, edgecolor="white", linewidth=0.4)  # fmt: skip
        panels.panel_title(axis, letter, f"{len(place)} points" + (", area: probability" if letter == "c" else ""))
    for axis in (flat, dots, twice):
        axis.set(xlabel=style.label("mu_s"), ylabel=style.label("G_p"), xlim=reach[0], ylim=np.array(reach[1]) * factor)
    if not style.is_narrow():
        twice.set_ylabel("")
    _distribution_steps(steps, joint, points)
    panels.panel_title(steps, "e", "distribution functions")
    return figure


def _kind(results):
    """A word for pairs that were not measured, as their file's name has it."""
    return "reconstructed " if "reconstructed" in results.inputs.get("source", "") else ""


def _distribution_steps(axis, joint, points):
    """Step functions of the points against the marginal distribution functions, each property over its median."""
    for k, (symbol, marginal) in enumerate(zip(PAIR, joint.marginals, strict=True)):
        median = float(marginal.ppf(0.5))
        x = np.linspace(float(marginal.ppf(0.001)), float(marginal.ppf(0.999)), 400)
        order = np.argsort(points[symbol])
        value = points[symbol][order]
        share = np.cumsum(points.probability[order])
        colour = panels.CONTOUR_MAP(1.0 - 0.6 * k)
        name = style.short_label(symbol).split(" (")[0]
        axis.plot(x / median, marginal.cdf(x), color=colour, lw=1.0, label=f"{name}, exact")
        axis.step(value / median, share, where="post", color=colour, lw=1.6, linestyle=style.LINES[1 + k],
                  label=f"{name}, points")  # fmt: skip
    axis.set(xlabel="Value over its median", ylabel="Probability not exceeded", ylim=(0, 1.02))
    axis.legend()


@style.styled
def grading_curve(results: Results) -> Figure:
    """Figure 4: share by mass finer than a diameter, with the median size and the grading index.

    Where the grading was given by a sieve curve, its points are shown, too.
    """
    figure = style.new_figure(4.6, 3.2)
    axis = figure.subplots()
    diameter, finer = grading.grading_curve(results.diameters)
    curve = results.attrs["settings"].get("assembly", {}).get("sieve_curve")
    axis.step(style.shown("d50", diameter), 100 * finer, where="post", color=panels.CONTOUR_MAP(0.95),
              label="spheres" if curve else None)  # fmt: skip
    if curve:
        sieves = style.shown("d50", np.asarray(curve["size"], float))
        axis.plot(sieves, 100 * np.asarray(curve["passing"], float), "o", ms=4.5, color="k", mfc="white",
                  label="sieve curve")  # fmt: skip
        axis.legend(loc="lower right")
    d50 = style.shown("d50", grading.size_at(results.diameters, 0.5))
    axis.axvline(d50, color="0.5", lw=0.8, linestyle="--")
    axis.axhline(50, color="0.5", lw=0.8, linestyle="--")
    text = (
        f"{len(diameter)} spheres\n$d_{{50}}$ = {d50:.3f} mm\n$I_G$ = {grading.grading_index(results.diameters):.3f}\n"
    )
    text += f"$C_u$ = {grading.uniformity(results.diameters):.2f}"
    if curve:
        text += f"\n$C_c$ = {curvature(results.diameters):.2f}"
    axis.text(0.04, 0.96, text, transform=axis.transAxes, va="top")
    axis.set(xlabel="Diameter (mm)", ylabel="Finer by mass (%)", ylim=(0, 102), xscale="log")
    finest, coarsest = 1e3 * diameter[0], 1e3 * diameter[-1]
    marks = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0) if coarsest < 8.0 * finest else (1.0, 2.0, 5.0)
    ticks = [
        t for k in range(-4, 4) for m in marks if 0.7 * finest < (t := float(f"{m * 10.0**k:.3g}")) < 1.4 * coarsest
    ]
    axis.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axis.minorticks_off()
    return figure
