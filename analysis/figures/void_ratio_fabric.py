"""Figures 8 to 12: one state quantity each, as contours, PDFs at peak and critical state, and two surfaces."""

from __future__ import annotations

from functools import partial

from matplotlib.figure import Figure

from ..results.reader import Results
from . import panels, style


@style.styled
def behaviour(results: Results, symbol: str) -> Figure:
    """PDF contours along strain per density, PDFs at the peak and at the critical state, two surfaces."""
    densities = results.family_densities()
    figure = style.new_figure(7.6, 8.4, narrow_height=7.6)
    rows = figure.subfigures(3, 1, height_ratios=[1.0, 1.3, 0.85] if style.is_narrow() else [1.0, 1.0, 1.15])
    panels.contour_row(rows[0], results, symbol, "coupled",
                       "(a) along axial strain; line: mean")  # fmt: skip
    left, right = rows[1].subplots(*style.grid(1, 2))
    panels.state_pdfs(left, results, "peak", symbol, legend=True)
    panels.panel_title(left, "b", "at the peak of the stress ratio")
    panels.state_pdfs(right, results, "critical", symbol)
    panels.panel_title(right, "c", "critical state")
    panels.share_range(left, right)
    chosen = [densities[0], densities[-1]][: len(densities)]
    responses = [results.response(symbol, mu_iso) for mu_iso in chosen]
    top = max(panels.top_pdf(response) for response in responses)
    for k, (mu_iso, response) in enumerate(zip(chosen, responses, strict=True)):
        axis = rows[2].add_subplot(1, 2, k + 1, projection="3d")
        title = f"({'de'[k]}) {style.density_title(mu_iso, densities)}"
        panels.surface(axis, response, top, title)
    return figure


void_ratio = partial(behaviour, symbol="e")
mechanical_void_ratio = partial(behaviour, symbol="e_m")
coordination = partial(behaviour, symbol="Z")
mechanical_coordination = partial(behaviour, symbol="Z_m")
fabric = partial(behaviour, symbol="Phi_dev")
