"""One look for every figure: sizes, colours that stay apart in grey, axis labels from the registry, small PNG files."""

from __future__ import annotations

import functools
import io
import logging
import math
import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.text import Text
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike

from ..quantities import QUANTITIES
from ..results.densities import density_names

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
#: One column wide, legends lie closer to the curves.
NARROW_RC = {"legend.frameon": True, "legend.framealpha": 0.75, "legend.edgecolor": "none", "legend.borderpad": 0.2,
             "legend.labelspacing": 0.25, "lines.linewidth": 1.2}  # fmt: skip
#: Columns of a journal that a figure in print takes -> its width (mm).
PRINT_WIDTH = {1: 88.0, 2: 180.0}
#: The same -> smallest and largest text in print (pt).
PRINT_TEXT = {1: (7.0, 7.5), 2: (7.0, 9.5)}
#: How print files are written: PDF with embedded TrueType fonts, SVG with text as outlines, no random names.
PRINT_RC = {"pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "grain-scatter"}
_one_column: ContextVar[bool] = ContextVar("one_column", default=False)


@contextmanager
def one_column(narrow: bool = True) -> Iterator[None]:
    """Figures that are made in this context are one column of a journal wide; their panels stand below each other."""
    token = _one_column.set(narrow)
    try:
        yield
    finally:
        _one_column.reset(token)


def is_narrow() -> bool:
    """Whether figures are one column wide."""
    return _one_column.get()


def grid(rows: int, columns: int) -> tuple[int, int]:
    """Rows and columns of a grid of panels: these, or all panels below each other in one column."""
    return (rows * columns, 1) if is_narrow() else (rows, columns)


def new_figure(width: float = 7.2, height: float = 4.8, narrow_height: float = 3.0) -> Figure:
    """An empty figure of that size in inches, laid out by constraint; no global state is touched.

    One column wide, it has the width of the column and the height `narrow_height`.
    """
    size = (PRINT_WIDTH[1] / 25.4, narrow_height) if is_narrow() else (width, height)
    return Figure(figsize=size, layout="constrained")


def wrapped(title: str) -> str:
    """A title in lines that fit above a panel of the figure."""
    return _filled(title, 44) if is_narrow() else title


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


def save_print(figure: Figure, path: str | Path, columns: int, dpi: int, source: str = "") -> Path:
    """Write a figure for print as PDF, SVG or PNG (ending of the path), so many columns wide; returns the path.

    Text has 7 pt at least.  Surfaces, and a PNG as a whole, have `dpi` dots per inch.  The file names its source and no
    date, so that the same figure gives the same bytes.
    """
    path = Path(path)
    width, height = figure.get_size_inches()
    scale = PRINT_WIDTH[columns] / 25.4 / width
    figure.set_size_inches(scale * width, scale * height)
    smallest, largest = PRINT_TEXT[columns]
    for text in figure.findobj(Text):
        text.set_fontsize(min(max(min(scale, 1.0) * text.get_fontsize(), smallest), largest))
    for surface in figure.findobj(Poly3DCollection):
        surface.set_rasterized(True)
        surface.axes.set_box_aspect((1.25, 1, 0.7), zoom=0.75)
        surface.axes.xaxis.labelpad = surface.axes.yaxis.labelpad = 4
    _break_long_labels(figure)
    metadata: dict[str, dict[str, str | None]] = {
        ".pdf": {"CreationDate": None, "Creator": None, "Producer": None, "Subject": source},
        ".svg": {"Date": None, "Creator": None, "Source": source},
        ".png": {"Software": None, "Source": source},
    }
    fonts = logging.getLogger("fontTools")
    level = fonts.level
    fonts.setLevel(logging.ERROR)  # it warns of dates in the fonts of matplotlib
    try:
        with mpl.rc_context(PRINT_RC):
            figure.savefig(path, dpi=dpi, facecolor="white", metadata=metadata[path.suffix])
    finally:
        fonts.setLevel(level)
    return path


def _break_long_labels(figure: Figure) -> None:
    """Set labels that are longer than their flat axis in two lines."""
    figure.draw_without_rendering()
    for axes in (axes for axes in figure.axes if axes.name != "3d"):
        room, x, y = axes.get_window_extent(), axes.xaxis.label, axes.yaxis.label
        for label, excess in (
            (x, x.get_window_extent().width / room.width),
            (y, y.get_window_extent().height / room.height),
        ):
            if excess > 1.1:
                label.set_text(_filled(label.get_text(), math.ceil(0.65 * len(label.get_text()))))


def _filled(text: str, width: int) -> str:
    """Text in lines of at most so many characters; a formula is not broken."""
    kept = re.sub(r"\$[^$]*\$", lambda formula: formula[0].replace(" ", "\0"), text)
    return textwrap.fill(kept, width, break_long_words=False).replace("\0", " ")


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Decorator of a drawing function: it runs under the project's settings and leaves the global ones alone."""

    @functools.wraps(draw)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> T:
        with mpl.rc_context(RC | (NARROW_RC if is_narrow() else {})):
            return draw(*args, **kwargs)

    return wrapped


def density_style(densities: Sequence[float]) -> dict[float, dict[str, Any]]:
    """Colour, line style and label of each consolidation friction, dark and solid for the densest."""
    shades = colormaps[COLOURS](np.linspace(0.0, 0.82, max(len(densities), 2)))
    names = density_names(densities)
    return {
        mu_iso: {
            "color": shades[k],
            "linestyle": LINES[k % len(LINES)],
            "label": rf"{names[mu_iso]}, $\mu_{{iso}}$ = {mu_iso:g}",
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


def varying(symbols: Sequence[str]) -> str:
    """What varies, for a title: "mu_s varies", "mu_s and G_p vary together"."""
    signs = [f"${QUANTITIES[symbol].tex}$" for symbol in symbols]
    if len(signs) == 1:
        return f"{signs[0]} varies"
    return f"{', '.join(signs[:-1])} and {signs[-1]} vary together"


def pdf_label(symbol: str) -> str:
    """Label of an axis of probability density over a quantity."""
    unit = QUANTITIES[symbol].shown_unit or QUANTITIES[symbol].unit
    return ("PDF" if is_narrow() else "Probability density") + ("" if unit in ("", "1") else f" (1/{unit})")
