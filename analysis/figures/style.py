"""One look for every figure: sizes, colours that stay apart in grey, axis labels from the registry, small PNG files."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ..quantities import QUANTITIES

P = ParamSpec("P")
T = TypeVar("T")

COLOURS = "cividis"
LIMIT_BYTES = 300_000
LINES = ("-", "--", (0, (4, 1.2, 1, 1.2)), ":")
MARKERS = "^soDvP"
RC = {
    "font.size": 9, "axes.titlesize": 9.5, "axes.labelsize": 9, "legend.fontsize": 8, "xtick.labelsize": 8,
    "ytick.labelsize": 8, "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.7,
    "lines.linewidth": 1.6, "legend.frameon": False, "mathtext.fontset": "dejavusans", "axes.titlelocation": "left",
    "axes.grid": True, "grid.color": "0.9", "grid.linewidth": 0.5, "axes.axisbelow": True,
}  # fmt: skip


def new_figure(width: float = 7.2, height: float = 4.8) -> Figure:
    """An empty figure of that size in inches, laid out by constraint; no global state is touched."""
    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, path: str | Path, source: str = "", dpi: int = 150) -> Path:
    """Write a PNG below 300 kB that names its source: resolution gives way, not below 80 dots per inch; the path."""
    path = Path(path)
    while True:
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=dpi, facecolor="white",
                       metadata={"Software": None, "Source": source})  # fmt: skip
        if buffer.tell() <= LIMIT_BYTES or dpi <= 80:
            break
        dpi = max(80, int(0.85 * dpi))
    path.write_bytes(buffer.getvalue())
    return path


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Decorator of a drawing function: it runs under the project's settings and leaves the global ones alone."""

    @functools.wraps(draw)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> T:
        with mpl.rc_context(RC):
            return draw(*args, **kwargs)

    return wrapped


def density_style(densities: Sequence[float]) -> dict[float, dict[str, Any]]:
    """Colour, line style and label of each consolidation friction, dark and solid for the densest."""
    shades = colormaps[COLOURS](np.linspace(0.0, 0.82, max(len(densities), 2)))
    names = _names(len(densities))
    return {
        mu_iso: {
            "color": shades[k],
            "linestyle": LINES[k % len(LINES)],
            "label": rf"{names[k]}, $\mu_{{iso}}$ = {mu_iso:g}",
        }
        for k, mu_iso in enumerate(densities)
    }


def density_markers(densities: Sequence[float]) -> dict[float, str]:
    """Marker of each consolidation friction, from the start again when they run out."""
    return {mu_iso: MARKERS[k % len(MARKERS)] for k, mu_iso in enumerate(densities)}


def density_title(mu_iso: float, densities: Sequence[float]) -> str:
    """Title of a panel that shows one density."""
    return density_style(densities)[mu_iso]["label"]


def shown(symbol: str, values: ArrayLike) -> np.ndarray:
    """Values in the unit in which a person reads the quantity."""
    return np.asarray(values) * QUANTITIES[symbol].shown_factor


def label(symbol: str) -> str:
    """Axis label with the displayed unit."""
    return QUANTITIES[symbol].label


def short_label(symbol: str) -> str:
    """The symbol alone with its displayed unit, where a full name does not fit."""
    quantity = QUANTITIES[symbol]
    unit = quantity.shown_unit or quantity.unit
    sign = f"${quantity.tex}$" if quantity.tex else quantity.name
    return sign if unit in ("", "1") else f"{sign} ({unit})"


def pdf_label(symbol: str) -> str:
    """Label of an axis of probability density over a quantity."""
    unit = QUANTITIES[symbol].shown_unit or QUANTITIES[symbol].unit
    return "Probability density" + ("" if unit in ("", "1") else f" (1/{unit})")


def _names(count):
    return {1: ("one density",), 2: ("dense", "loose"), 3: ("dense", "medium", "loose")}.get(
        count, tuple(f"density {k + 1}" for k in range(count))
    )
