"""Figures 17 and 18, of undrained tests: effective stress paths; pore pressure, p' and early ends along strain."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy import ndimage

from ..pdem import weighted
from ..quantities import EARLY_ENDS
from ..results.reader import Results
from . import panels, style

#: Cells of a decade of stress in the contours of the stress path, and the width of the kernel in cells.
CELLS, KERNEL = 60, 3.5
#: Share of p' below which |q| is not shown: the start of a path at rest.
LEAST = 0.02
MARKS = {"liquefied": "x", "stiff": "s"}


@style.styled
def stress_path(results: Results) -> Figure:
    """|q| against p' of every point on logarithmic axes, one panel per density, with M lines and what ends a path.

    Contours: where the paths run, their length in decades weighted by the probabilities, per square decade.
    """
    densities = results.family_densities()
    figure = style.new_figure(min(3.0 * len(densities) + 1.0, 9.6), 3.7, narrow_height=2.7 * len(densities))
    axes = figure.subplots(*style.grid(1, len(densities)), squeeze=False, sharex=True, sharey=True).ravel()
    for axis, letter, mu_iso in zip(axes, "abcdefghijk", densities, strict=False):
        paths = _paths(results, mu_iso)
        if not np.isfinite(paths[1]).any():
            panels.withheld(axis, f"{style.density_title(mu_iso, densities)}:\nall tests ended at the start")
            continue
        _occupied(axis, *paths, results.probability(mu_iso))
        for q in np.flatnonzero(results.probability(mu_iso) > 0):
            axis.plot(paths[0][:, q], paths[1][:, q], color="0.25", lw=0.4, alpha=0.6)
        _marks(axis, results, mu_iso, paths)
        panels.panel_title(axis, letter, style.density_title(mu_iso, densities))
        axis.set(xscale="log", yscale="log", xlabel=style.label("p"))
    for axis, mu_iso in zip(axes, densities, strict=True):  # the axes are shared: a line needs their final range
        for state, look in (("critical", "-"), ("transformation", ":")) if axis.axison else ():
            _line(axis, results, mu_iso, state, look)
    for axis in axes if style.is_narrow() else axes[:1]:
        axis.set_ylabel(style.label("q") if results.loading.sign > 0 else style.label("q").replace("$q$", "$-q$"))
    if any(axis.axison for axis in axes):
        first = next(axis for axis in axes if axis.axison)
        first.legend(handles=_handles(), loc="lower right", fontsize=6.5)
    return figure


def _paths(results: Results, mu_iso: float) -> tuple[np.ndarray, np.ndarray]:
    """p' and |q| (T, Q) in displayed units; NaN where a test has ended, and |q| where it is near zero."""
    p, q = (results.response(symbol, mu_iso).values for symbol in ("p", "q"))
    q = results.loading.sign * q
    with np.errstate(invalid="ignore"):
        q = np.where(q > LEAST * p, q, np.nan)
    return style.shown("p", p), style.shown("q", q)


def _occupied(axis: Axes, p: np.ndarray, q: np.ndarray, probability: np.ndarray) -> None:
    """Contours of the length of paths p', q (T, Q) on logarithmic axes, weighted by probability (Q,)."""
    parts = []
    for of_p, of_q, own in zip(np.log10(p.T), np.log10(q.T), probability, strict=True):
        known = np.isfinite(of_q)
        if own == 0 or known.sum() < 2:
            continue
        length = np.append(0.0, np.cumsum(np.hypot(np.diff(of_p[known]), np.diff(of_q[known]))))
        along = np.linspace(0.0, length[-1], 2 + round(4 * CELLS * length[-1]))
        places = (np.interp(along, length, values[known]) for values in (of_p, of_q))
        parts.append(np.stack([*places, np.full(len(along), own * length[-1] / len(along))]))
    if not parts:
        return
    x, y, share = np.concatenate(parts, axis=1)
    edges = [np.arange(v.min() - 0.25, v.max() + 0.25 + 1.0 / CELLS, 1.0 / CELLS) for v in (x, y)]
    mass = np.histogram2d(x, y, edges, weights=share)[0]
    density = ndimage.gaussian_filter(mass, KERNEL) * CELLS**2
    middle = [10 ** (0.5 * (e[1:] + e[:-1])) for e in edges]
    axis.contourf(*middle, density.T, levels=panels.pdf_levels(float(density.max())), cmap=panels.CONTOUR_MAP,
                  extend="max", alpha=0.85)  # fmt: skip


def _line(axis: Axes, results: Results, mu_iso: float, state: str, look: str) -> None:
    """The line |q| = M p' of the mean stress ratio at a state."""
    eta = float(weighted.mean(np.abs(results.shown_state(state, "eta", mu_iso)), results.probability(mu_iso)))
    if np.isfinite(eta):
        x = np.array(axis.get_xlim())
        axis.plot(x, eta * x, color="#b00040", lw=1.1, ls=look)
        axis.set(xlim=x)


def _marks(axis: Axes, results: Results, mu_iso: float, paths: tuple[np.ndarray, np.ndarray]) -> None:
    """Phase transformation, critical state, and the last value of the tests that ended early."""
    for state, marker in (("transformation", "^"), ("critical", "o")):
        p, eta = (results.shown_state(state, symbol, mu_iso) for symbol in ("p", "eta"))
        axis.plot(style.shown("p", p), style.shown("q", np.abs(eta) * p), marker, ms=4, mfc="white", mec="k", mew=0.7)
    ids = results.family_points().id
    for kind, marker in MARKS.items():
        for q in np.flatnonzero(np.isin(ids, results.ended(kind, mu_iso).point)):
            rows = np.flatnonzero(np.isfinite(paths[1][:, q]))
            if len(rows):
                axis.plot(paths[0][rows[-1], q], paths[1][rows[-1], q], marker, ms=4, color="#b00040", mfc="none")


def _handles() -> list[Line2D]:
    looks = [("^", "phase transformation"), ("o", "critical state")]
    handles = [Line2D([], [], marker=m, color="k", mfc="white", mew=0.7, ms=4, ls="none", label=t) for m, t in looks]
    handles += [Line2D([], [], marker=marker, color="#b00040", mfc="none", ms=4, ls="none", label=EARLY_ENDS[kind])
                for kind, marker in MARKS.items()]  # fmt: skip
    lines = (("-", "mean critical stress ratio"), (":", "mean at phase transformation"))
    return handles + [Line2D([], [], color="#b00040", lw=1.1, ls=look, label=text) for look, text in lines]


@style.styled
def pore_pressure(results: Results) -> Figure:
    """PDF contours of r_u per density; p' of the tests that go on, and the probability of early ends, along strain."""
    densities = results.family_densities()
    figure = style.new_figure(7.6, 6.4, narrow_height=2.4 * len(densities) + 4.6)
    ratios = [1.0 * len(densities), 1.9] if style.is_narrow() else [1.0, 1.1]
    upper, lower = figure.subfigures(2, 1, height_ratios=ratios)
    axes = upper.subplots(*style.grid(1, len(densities)), squeeze=False, sharex=True).ravel()
    filled = None
    for axis, mu_iso in zip(axes, densities, strict=True):
        response = results.response("r_u", mu_iso)
        filled = panels.contours_with_mean(axis, response)
        axis.set_ylim(*panels.visible_range([response], "r_u"))
        axis.set_title(style.density_title(mu_iso, densities), fontsize=8.5)
    for axis in axes if style.is_narrow() else axes[:1]:
        axis.set_ylabel(style.label("r_u"))
    upper.suptitle("(a) PDF of the tests that go on, scale of each panel its own; line: mean", x=0.01, ha="left",
                   fontsize=9.5)  # fmt: skip
    assert filled is not None  # a campaign has at least one density
    left, right = lower.subplots(*style.grid(1, 2))
    _pressures(left, results)
    panels.panel_title(left, "b", "median and 5 to 95 %")
    _ends(right, results)
    panels.panel_title(right, "c", "tests that have ended")
    return figure


def _pressures(axis: Axes, results: Results) -> None:
    """Median of p' and its 5 to 95 % range along strain, of the tests that go on."""
    for mu_iso, look in style.density_style(results.family_densities()).items():
        response = results.response("p", mu_iso)
        low, middle, high = (style.shown("p", response.quantile(level)) for level in (0.05, 0.5, 0.95))
        axis.plot(response.strain_pct, middle, **look)
        axis.fill_between(response.strain_pct, low, high, color=look["color"], alpha=0.15, lw=0)
    axis.set(yscale="log", xlabel=results.loading.strain_label, ylabel=style.label("p"), xlim=(0, None))
    axis.legend(loc="best")


def _ends(axis: Axes, results: Results) -> None:
    """Probability along strain of having liquefied and of having become stiff, with 95 % intervals."""
    strain = style.shown("eps_a", results.strain)
    any_end = False
    for mu_iso, look in style.density_style(results.family_densities()).items():
        for kind, line in zip(EARLY_ENDS, ("-", "--"), strict=True):
            ended = results.ended(kind, mu_iso)
            if not len(ended.point):
                continue
            any_end = True
            axis.plot(strain, ended.probability, color=look["color"], ls=line, drawstyle="steps-post",
                      label=f"{look['label'].split(',')[0]}: {EARLY_ENDS[kind]}")  # fmt: skip
            axis.fill_between(strain, ended.low, ended.high, step="post", color=look["color"], alpha=0.12, lw=0)
    axis.set(xlabel=results.loading.strain_label, ylabel="Probability", ylim=(0, 1), xlim=(0, None))
    if any_end:
        axis.legend(loc="best")
    else:
        axis.text(0.5, 0.5, "no test ended early", transform=axis.transAxes, ha="center", va="center", color="0.35")
