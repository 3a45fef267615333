"""A small picture of the test, as SVG: a specimen of spheres under a confining stress and an axial strain."""

from __future__ import annotations

import numpy as np

from ..quantities import DRAINED, Loading
from . import loading_words
from .symbols import plain

WIDTH, HEIGHT = 250, 230
#: Left, top, width and height of the specimen in the picture.
BOX = (75.0, 52.0, 100.0, 126.0)
#: Median diameter of the spheres in the picture.
DIAMETER = 13.0


def test_picture(diameters: np.ndarray, stress: str, strain: str, loading: Loading = DRAINED) -> str:
    """SVG of a specimen with sizes drawn from `diameters` (N,) and the words for the stress and the strain.

    In extension the axial arrows lead away from the specimen.
    """
    left, top, width, height = BOX
    right, bottom = left + width, top + height
    middle = left + width / 2
    parts = [f'<rect class="cell" x="{left}" y="{top}" width="{width}" height="{height}"/>', *_spheres(diameters)]
    for x in np.linspace(left + 15, right - 15, 4):
        far, near = (22, 3) if loading.sign > 0 else (3, 22)
        parts += [_arrow(x, top - far, x, top - near), _arrow(x, bottom + far, x, bottom + near)]
    for y in np.linspace(top + 15, bottom - 15, 4):
        parts += [_arrow(left - 22, y, left - 3, y, "lateral"), _arrow(right + 22, y, right + 3, y, "lateral")]
    stress_words, strain_words = plain(stress), plain(strain)
    axial = "strain" if loading.sign > 0 else "extension"
    what, held, description = loading_words.picture(loading, stress, strain)
    parts += [
        _text(middle, 12, f"axial {axial} {_low('ε', 'a')} = 0 … {strain_words}</tspan>"),
        _text(middle, 26, "(logarithmic), increased slowly"),
        _text(middle, HEIGHT - 12, f"{what} {_low('σ', '3')}{stress_words}</tspan>"),
        _text(middle, HEIGHT + 1, plain(held)),
    ]  # fmt: skip
    words = plain(description)
    return (f'<svg class="test" viewBox="0 0 {WIDTH} {HEIGHT + 6}" role="img" aria-label="{words}">'
            f"{''.join(parts)}</svg>")  # fmt: skip


def _spheres(diameters: np.ndarray) -> list[str]:
    """Circles that do not overlap, their sizes spread over the given ones: each is put at the first free place."""
    left, top, width, height = BOX
    rng = np.random.default_rng(1)
    sizes = np.quantile(diameters, rng.random(400)) / np.median(diameters) * DIAMETER / 2
    placed: list[tuple[float, float, float]] = []
    for radius in sizes:
        for _ in range(60):
            x, y = (
                left + radius + rng.random() * (width - 2 * radius),
                top + radius + rng.random() * (height - 2 * radius),
            )
            if all((x - a) ** 2 + (y - b) ** 2 >= (radius + r) ** 2 for a, b, r in placed):
                placed.append((x, y, radius))
                break
    return [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}"/>' for x, y, r in placed]


def _arrow(x0: float, y0: float, x1: float, y1: float, kind: str = "axial") -> str:
    """A line from the first point to the second one, with a head."""
    length = float(np.hypot(x1 - x0, y1 - y0))
    u, v = (x1 - x0) / length, (y1 - y0) / length
    back_x, back_y = x1 - 6 * u, y1 - 6 * v
    corners = ((x1, y1), (back_x - 3.5 * v, back_y + 3.5 * u), (back_x + 3.5 * v, back_y - 3.5 * u))
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    return (f'<line class="{kind}" x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1 - 4 * u:.1f}" y2="{y1 - 4 * v:.1f}"/>'
            f'<polygon class="{kind}" points="{head}"/>')  # fmt: skip


def _text(x: float, y: float, content: str) -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}">{content}</text>'


def _low(letter: str, below: str) -> str:
    """A letter with a subscript; the text after it, up to </tspan>, is back on the line."""
    return f'{letter}<tspan class="low" dy="3">{below}</tspan><tspan dy="-3">'
