"""Widths of the kernels that make a PDF from points with probabilities."""

from __future__ import annotations

import numpy as np
from scipy import special

from .pdf import PdemError
from .weighted import moments, quantiles

RULES = ("quarter", "silverman", "spacing", "mesh")
#: The densest quarter must hold at least so many points; otherwise two of eight points that happen to lie close
#: together would determine the width.
_IN_QUARTER = 6


def kernel_width(h: np.ndarray, probability: np.ndarray, rule: str = "quarter") -> np.ndarray:
    """Kernel width (T,) for values h (T, Q) with normalised probabilities (T, Q), from the data.

    "quarter": 0.9 s n_eff^(-1/5), n_eff = 1 / sum P^2; s is the standard deviation of a normal distribution whose
    densest quarter is as narrow as that of the points, and at most theirs.  It follows a PDF with several humps.  With
    n_eff below 24 a larger share takes the place of the quarter: 6 / n_eff, and at most 90 %.
    "silverman": 0.9 min(std, IQR/1.349) n_eff^(-1/5), n_eff = 1 / sum P^2 (Silverman 1986).
    "mesh": zero, so that the mesh determines the width.
    "spacing": 1.5 times the typical distance between neighbouring points, for smooth responses at regular points, whose
    scatter about the distribution is far below that of random samples.
    Raises PdemError for another rule.
    """
    if rule not in RULES:
        raise PdemError(f"bandwidth rule {rule!r} is not one of {', '.join(RULES)}")
    if rule == "spacing":
        return 1.5 * point_spacing(h, probability)
    if rule == "mesh":
        return np.zeros(len(h))
    std = moments(h, probability)[1]
    if rule == "quarter":
        scale = _scale_of_the_densest(h, probability)
        scale = np.where(scale > 0, np.minimum(std, scale), std)
    else:
        low, high = quantiles(h, probability, [0.25, 0.75]).T
        scale = np.where(high > low, np.minimum(std, (high - low) / 1.349), std)
    return 0.9 * scale * np.sum(probability**2, axis=1) ** 0.2


def _scale_of_the_densest(h: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Standard deviation (T,) of a normal distribution whose densest share is as narrow as that of the points."""
    levels = np.linspace(0.05, 0.95, 37)
    values = quantiles(h, probability, levels)
    shares = _IN_QUARTER * np.sum(probability**2, axis=1)
    steps = np.clip(np.ceil(np.round(shares / 0.025, 6)), 10, 36).astype(int)
    scale = np.empty(len(h))
    for n in np.unique(steps):
        rows = steps == n
        densest = np.min(values[rows, n:] - values[rows, :-n], axis=1)
        scale[rows] = densest / round(2.0 * float(special.ndtri(0.5 + 0.0125 * n)), 4)  # 0.6373 for the quarter
    return scale


def point_spacing(h: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Typical distance (T,) between neighbouring points: the range of the central 90 % divided by their number.

    h (T, Q), probability (T, Q) normalised.
    """
    low, high = quantiles(h, probability, [0.05, 0.95]).T
    return (high - low) / (0.9 * np.maximum(np.count_nonzero(probability, axis=1), 1))
