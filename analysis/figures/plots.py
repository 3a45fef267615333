"""Single plots for a script or a notebook; each draws into the axes it is given, or into new ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..results.reader import Response, Results
from . import panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_pdf_contours(response: Response, ax: Axes | None = None) -> Axes:
    """Plot the PDF of a response along axial strain as filled contours, with its mean as a line.

    Parameters
    ----------
    response : Response
        As `results.response` returns it.
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.

    Returns
    -------
    matplotlib Axes
        The axes; strain in %, the response in its displayed unit.

    Examples
    --------
    >>> ax = plot_pdf_contours(read_results("runs/demo/results.h5").response("eta", mu_iso=0.04))
    >>> ax.get_xlabel()
    'Axial strain $\\\\varepsilon_a$ (%)'
    """
    ax = _axes(ax)
    panels.contours_with_mean(ax, response)
    ax.set_ylabel(response.quantity.label)
    return ax


def plot_pdf_surface(response: Response, ax: Axes | None = None) -> Axes:
    """Plot the PDF of a response over axial strain as a surface.

    Parameters
    ----------
    response : Response
        As `results.response` returns it.
    ax : matplotlib Axes, optional
        Axes with `projection="3d"`; new ones by default.

    Returns
    -------
    matplotlib Axes
        The axes; strain in %, the response in its displayed unit.

    Examples
    --------
    >>> ax = plot_pdf_surface(read_results("runs/demo/results.h5").response("e", mu_iso=0.04))
    >>> ax.name
    '3d'
    """
    ax = _axes(ax, projection="3d")
    panels.surface(ax, response)
    return ax


def plot_mean_band(results: Results, symbol: str, family: str = "coupled", ax: Axes | None = None) -> Axes:
    """Plot the mean of a response along strain at every density, with two standard deviations to either side.

    Parameters
    ----------
    results : Results
        Open results.
    symbol : str
        A response: eta, e, e_m, Z, Z_m, Phi_dev or eps_v.
    family : str
        "coupled" (both properties vary) or "G_p" (mu_s fixed).
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.

    Returns
    -------
    matplotlib Axes
        The axes; strain in %, the response in its displayed unit.

    Examples
    --------
    >>> ax = plot_mean_band(read_results("runs/demo/results.h5"), "eta")
    >>> len(ax.lines)
    3
    """
    ax = _axes(ax)
    panels.mean_band(ax, results, symbol, family)
    return ax


def plot_state_pdfs(results: Results, state: str, symbol: str, family: str = "coupled", ax: Axes | None = None) -> Axes:
    """Plot the PDFs of a quantity at a state, one line per density, with the 95 % band from the pairs.

    Parameters
    ----------
    results : Results
        Open results.
    state : str
        "initial", "peak", "critical" or "probe".
    symbol : str
        A quantity of that state, such as eta or G_0.
    family : str
        "coupled" (both properties vary) or "G_p" (mu_s fixed).
    ax : matplotlib Axes, optional
        Where to draw; new axes by default.

    Returns
    -------
    matplotlib Axes
        The axes; the values of the points are ticks below.

    Examples
    --------
    >>> ax = plot_state_pdfs(read_results("runs/demo/results.h5"), "probe", "G_0")
    >>> ax.get_ylabel()
    'Probability density (1/MPa)'
    """
    ax = _axes(ax)
    panels.state_pdfs(ax, results, state, symbol, family, legend=True)
    return ax


def _axes(ax: Axes | None, **options: str) -> Axes:
    """The axes given, or new ones of pyplot, which a notebook or plt.show() displays."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.figure(layout="constrained").add_subplot(**options)
