"""Figure 13: small-strain stiffness and dilatancy at the peak, as PDFs and against the property that drives each."""

from __future__ import annotations

from matplotlib.figure import Figure

from ..results.reader import Results
from . import panels, style


@style.styled
def stiffness_dilatancy(results: Results) -> Figure:
    """PDFs of G_0 and of D^p per density, and every point against G_p and mu_s, if these are random.

    Undrained tests have no D^p.
    """
    densities = results.family_densities()
    points, markers = results.family_points(), style.density_markers(densities)
    rows = [("probe", "G_0", "G_p"), ("peak", "D_p", "mu_s")]
    if results.loading.is_undrained:  # at constant volume there is no dilatancy
        rows = rows[:1]
    figure = style.new_figure(7.2, 2.8 * len(rows), narrow_height=4.2 * len(rows))
    axes = figure.subplots(*style.grid(len(rows), 2)).reshape(len(rows), 2)
    for (left, right), letters, (state, symbol, cause) in zip(axes, ("ab", "cd"), rows, strict=False):
        driver = cause if cause in points.names else points.names[0]
        if symbol not in results.state_symbols(state, densities[0]):
            left.text(0.5, 0.5, f"{style.label(symbol)}: not run", transform=left.transAxes, ha="center")
            right.set_visible(False)
            continue
        panels.state_pdfs(left, results, state, symbol, legend=True)
        panels.panel_title(left, letters[0])
        for mu_iso, look in style.density_style(densities).items():
            values = style.shown(symbol, results.shown_state(state, symbol, mu_iso))
            right.plot(style.shown(driver, points[driver]), values,
                       markers[mu_iso], ms=4, color=look["color"], mfc="none", mew=0.9,
                       label=look["label"])  # fmt: skip
        right.set(xlabel=style.label(driver), ylabel=style.label(symbol))
        panels.panel_title(right, letters[1], "every point")
    return figure
