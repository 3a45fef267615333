"""Panels that several figures share: PDF contours along strain, PDFs at a state, mean with band, 3D surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation

from ..pdem import evolution, weighted
from ..pdem.bands import with_input_band
from ..pdem.pdf import PDF
from ..results.models import runs_with_moments, state_model
from ..results.reader import Response, Results
from . import style


def _from_white(name, share=0.3):
    """A perceptually even map, dark at the top, whose lowest part fades to white."""
    colours = colormaps[name].reversed()(np.linspace(0, 1, 256))
    fade = np.clip(1 - np.linspace(0, 1, 256) / share, 0, 1)[:, None] ** 0.8
    colours[:, :3] = colours[:, :3] * (1 - fade) + fade
    return ListedColormap(colours, name=f"{name}_from_white")


CONTOUR_MAP = _from_white(style.COLOURS)
#: Half the area between two PDFs from which on both are shown, and the line width of the second.
VISIBLE, THIN = 0.05, 0.7


def top_pdf(response: Response, start: float = 0.02) -> float:
    """PDF value at the end of the colour scale: nine strains in ten stay below it, the narrow start left out."""
    last = response.strain[response.going][-1]
    rows = response.pdf.p[(response.strain >= min(start, last)) & response.going]
    return float(np.quantile(rows.max(axis=1), 0.9))


def visible_range(responses: Sequence[Response], symbol: str, start: int = 0) -> tuple[float, float]:
    """Lowest and highest value, in shown units, at which some response has a visible PDF from row `start` on."""
    low, high = [], []
    for response in responses:
        seen = np.flatnonzero((response.pdf.p[start:] > 0.02 * top_pdf(response)).any(axis=0))
        low.append(response.pdf.x[seen[0]])
        high.append(response.pdf.x[seen[-1]])
    return tuple(style.shown(symbol, [min(low), max(high)]))


def contours(axis: Axes, response: Response, top: float | None = None) -> QuadContourSet:
    """Filled PDF contours of one response over axial strain; returns the mappable for a colour bar."""
    symbol, factor = response.quantity.symbol, response.quantity.shown_factor
    top = top_pdf(response) if top is None else top
    filled = axis.contourf(
        style.shown("eps_a", response.strain), style.shown(symbol, response.pdf.x), response.pdf.p.T / factor,
        levels=pdf_levels(top / factor), cmap=CONTOUR_MAP, extend="max",
    )  # fmt: skip
    axis.set_xlabel(response.loading.strain_label)
    return filled


def contours_with_mean(axis: Axes, response: Response, top: float | None = None) -> QuadContourSet:
    """Filled PDF contours with the mean as a line; returns the mappable for a colour bar."""
    filled = contours(axis, response, top)
    symbol = response.quantity.symbol
    axis.plot(style.shown("eps_a", response.strain), style.shown(symbol, response.mean), color="k", lw=1.0)
    return filled


def pdf_levels(top: float) -> np.ndarray:
    """Contour levels at round numbers up to about `top`; the lowest stands just above zero so that nothing is blank."""
    levels = MaxNLocator(16, steps=[1, 2, 2.5, 5, 10]).tick_values(0, top)
    return np.concatenate([[0.02 * top], levels[(levels > 0.03 * top) & (levels <= 1.001 * top)]])


def contour_row(figure: SubFigure, results: Results, symbol: str, family: str, title: str) -> None:
    """One contour panel per density on common axes, with one colour bar; lines are means."""
    densities = results.family_densities(family)
    axes = figure.subplots(*style.grid(1, len(densities)), squeeze=False).ravel()
    responses = [results.response(symbol, mu_iso, family) for mu_iso in densities]
    top = max(top_pdf(response) for response in responses)
    filled = None
    for axis, response in zip(axes, responses, strict=True):
        filled = contours_with_mean(axis, response, top)
        axis.set_ylim(*visible_range(responses, symbol))
    if style.is_narrow():
        for axis, mu_iso in zip(axes, densities, strict=True):
            axis.set_ylabel(style.density_title(mu_iso, densities).split(",")[0])
            axis.label_outer()
        figure.supylabel(style.label(symbol))
    else:
        for axis, mu_iso in zip(axes, densities, strict=True):
            axis.set_title(style.density_title(mu_iso, densities), fontsize=8.5)
            axis.label_outer()
        axes[0].set_ylabel(style.label(symbol))
    figure.suptitle(title, x=0.01, ha="left", fontsize=9.5)
    colour_bar(figure, filled, list(axes), style.pdf_label(symbol))


def colour_bar(figure: Figure | SubFigure, filled: QuadContourSet, axes: Axes | list[Axes], text: str) -> None:
    """Colour bar with a few round ticks within its range."""
    levels = filled.levels
    ticks = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]).tick_values(0, levels[-1])
    bar = figure.colorbar(filled, ax=axes, pad=0.01, ticks=ticks[(ticks >= levels[0]) & (ticks <= levels[-1])])
    bar.set_label(text)
    bar.ax.tick_params(labelsize=7)


def state_pdf(results: Results, state: str, symbol: str, mu_iso: float, family: str = "coupled") -> PDF | None:
    """PDF of a quantity at a state over the points as simulated, or None if fewer than two points have a value."""
    return _pdf_of_points(results, results.shown_state(state, symbol, mu_iso, family), mu_iso, family)


def denoised_pdf(results: Results, state: str, symbol: str, mu_iso: float, family: str = "coupled") -> PDF | None:
    """The same of the denoised values of these points, without the noise of packings and runs.

    None with fewer than 8 values, or if all are equal: the model is then too uncertain to be shown.
    """
    simulated = results.shown_state(state, symbol, mu_iso, family)
    known = simulated[np.isfinite(simulated)]
    model = (
        state_model(results, state, symbol, mu_iso, family)
        if len(known) >= runs_with_moments(results) and np.ptp(known) > 0
        else None
    )
    if model is None:
        return None
    values = np.where(np.isfinite(simulated), model.predict(results.family_points(family).x)[0], np.nan)
    return _pdf_of_points(results, values, mu_iso, family)


def _pdf_of_points(results: Results, values: np.ndarray, mu_iso: float, family: str) -> PDF | None:
    """PDF of values (Q,) of the points, with the band from the pairs."""
    known = np.isfinite(values)
    probability = results.probability(mu_iso, family)
    if np.count_nonzero(probability[known]) < 2:
        return None
    pdf = evolution.state_pdf(values, weighted.normalised(probability, known))
    drawn = results.bootstrap_probability(mu_iso, family)
    return pdf if drawn is None else with_input_band(pdf, values[None], drawn)


def differ_visibly(one: PDF, other: PDF) -> bool:
    """Whether two PDFs (T = 1) differ by more than VISIBLE: half the area between them, which is at most 1."""
    x = np.union1d(one.x, other.x)
    gap = np.abs(np.interp(x, one.x, one.p[0], 0, 0) - np.interp(x, other.x, other.p[0], 0, 0))
    return bool(0.25 * np.sum((gap[1:] + gap[:-1]) * np.diff(x)) > VISIBLE)


def state_pdfs(
    axis: Axes, results: Results, state: str, symbol: str, family: str = "coupled", legend: bool = False
) -> None:
    """PDFs of a quantity at a state, one line per density, with the band from the pairs; the points as ticks below.

    The PDF is the denoised one where there is a model.  A thin line shows it as simulated where this differs visibly.
    """
    densities = results.family_densities(family)
    factor, both = pdf_factor(symbol), False
    for row, (mu_iso, look) in enumerate(style.density_style(densities).items()):
        simulated = state_pdf(results, state, symbol, mu_iso, family)
        if simulated is None:
            continue
        pdf = denoised_pdf(results, state, symbol, mu_iso, family) or simulated
        axis.plot(pdf.x * factor, pdf.p[0] / factor, **look)
        if pdf.low is not None and pdf.high is not None:
            axis.fill_between(pdf.x * factor, pdf.low[0] / factor, pdf.high[0] / factor,
                              color=look["color"], alpha=0.2, lw=0)  # fmt: skip
        if differ_visibly(pdf, simulated):
            axis.plot(simulated.x * factor, simulated.p[0] / factor, color=look["color"], ls=look["linestyle"], lw=THIN)
            both = True
        values = style.shown(symbol, results.shown_state(state, symbol, mu_iso, family))
        below = ScaledTranslation(0, -(3.5 + 4 * row) / 72, axis.figure.dpi_scale_trans)
        axis.plot(values, np.zeros(len(values)), "|", transform=axis.get_xaxis_transform() + below,
                  color=look["color"], ms=4, mew=0.7, clip_on=False)  # fmt: skip
    if not axis.lines:
        withheld(axis, f"{state} state: not reached")
        return
    axis.set_ylim(bottom=0)
    axis.tick_params(axis="x", pad=4 * len(densities) + 4, length=0)
    axis.set_xlabel(style.label(symbol))
    axis.set_ylabel(style.pdf_label(symbol))
    handles = [line for line in axis.lines if legend and not line.get_label().startswith("_")]
    for text, width in (("denoised", None), ("as simulated", THIN)) if both else ():
        handles += axis.plot([], [], color="0.35", lw=width, label=text)
    if handles:
        axis.set_ylim(top=1.35 * axis.get_ylim()[1])
        axis.legend(handles=handles, loc="upper right", ncols=1)


def pdf_factor(symbol: str) -> float:
    """Displayed units per SI unit of a quantity."""
    return float(style.shown(symbol, 1.0))


def mean_band(axis: Axes, results: Results, symbol: str, family: str = "coupled", legend: bool = True) -> None:
    """Mean of every density along strain with a band of two standard deviations to either side."""
    densities = results.family_densities(family)
    for mu_iso, look in style.density_style(densities).items():
        response = results.response(symbol, mu_iso, family)
        strain = style.shown("eps_a", response.strain)
        mean, spread = style.shown(symbol, response.mean), style.shown(symbol, response.std)
        axis.fill_between(strain, mean - 2 * spread, mean + 2 * spread, color=look["color"], alpha=0.13, lw=0)
        axis.plot(strain, mean, **look)
    axis.set_xlabel(results.loading.strain_label)
    axis.set_ylabel(style.label(symbol))
    axis.set_xlim(left=0)
    if legend and style.is_narrow():
        axis.legend(loc="lower right")
    elif legend:
        axis.legend(loc="best", title=r"mean $\pm$ 2 standard deviations")


def surface(axis: Axes, response: Response, top: float | None = None, title: str = "") -> None:
    """PDF surface over strain and value; values above the top are cut off.

    It starts where the PDFs of neighbouring strains begin to overlap: before that the surface would be single spikes.
    """
    symbol, factor = response.quantity.symbol, response.quantity.shown_factor
    top = top_pdf(response) if top is None else top
    apart = np.abs(np.diff(response.mean)) > 0.6 * np.hypot(response.std, response.pdf.shown_width)[1:]
    start = np.flatnonzero(apart)[-1] + 1 if apart.any() and not apart[-1] else 0
    low, high = visible_range([response], symbol, start)
    x = style.shown(symbol, response.pdf.x)
    columns = np.flatnonzero((x >= low) & (x <= high))
    columns = columns[:: max(1, len(columns) // 110)]
    rows = np.unique(np.linspace(start, np.flatnonzero(response.going)[-1], 80).astype(int))
    height = np.minimum(response.pdf.p[np.ix_(rows, columns)], 1.05 * top) / factor
    strain, value = np.meshgrid(style.shown("eps_a", response.strain[rows]), x[columns], indexing="ij")
    draw_surface(axis, strain, value, height, (style.short_label("eps_a"), style.short_label(symbol)), title)


def draw_surface(
    axis: Axes, x: np.ndarray, y: np.ndarray, height: np.ndarray, labels: tuple[str, str], title: str = ""
) -> None:
    """A 3D surface coloured by height, dark at the top, seen from the side of the far strains."""
    axis.plot_surface(x, y, height, cmap=CONTOUR_MAP, rcount=90, ccount=110, linewidth=0, antialiased=False)
    axis.view_init(elev=34, azim=-58)
    axis.set_xlabel(labels[0], labelpad=3)
    axis.set_ylabel(labels[1], labelpad=3)
    axis.text2D(0.99, 0.8, "PDF", transform=axis.transAxes, ha="right", fontsize=8)
    axis.tick_params(labelsize=7, pad=3)  # else the labels at the near corner meet
    for side in (axis.xaxis, axis.yaxis, axis.zaxis):
        side.set_major_locator(MaxNLocator(3 if style.is_narrow() else 5))
    axis.set_title(title, y=0.98, loc="left")
    axis.set_box_aspect((1.25, 1, 0.7), zoom=0.88)


def withheld(axis: Axes, text: str) -> None:
    """An empty panel that states why nothing is shown."""
    axis.set_axis_off()
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", va="center", color="0.35")


def panel_title(axis: Axes, letter: str, title: str = "") -> None:
    """Letter and title of a panel at its upper left."""
    axis.set_title(style.wrapped(f"({letter}) {title}".rstrip()))


def share_range(*axes: Axes) -> None:
    """Give axes the widest of their ranges in x, so that places and widths can be compared; empty ones have none."""
    axes = tuple(axis for axis in axes if axis.lines)
    x = [axis.get_xlim() for axis in axes]
    for axis in axes:
        axis.set_xlim(min(a for a, _ in x), max(b for _, b in x))
