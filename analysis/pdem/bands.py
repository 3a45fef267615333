"""Bands on PDFs from the number of pairs: the points have other probabilities if the inputs are fitted to resamples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from . import evolution
from .pdf import PDF
from .weighted import normalised

LEVEL = 0.95


def with_input_band(pdf: PDF, values: ArrayLike, probabilities: np.ndarray, level: float = LEVEL) -> PDF:
    """The PDF of points with values (T, Q), with a pointwise band low, high (T, X) from probabilities (B, Q).

    With kernels of the width of the PDF, the quantiles of the refitted PDFs over their mean are the band over p; points
    without a value (NaN) drop out.
    """
    values = np.asarray(values, float)
    tails = [0.5 - 0.5 * level, 0.5 + 0.5 * level]
    low, high = np.empty_like(pdf.p), np.empty_like(pdf.p)
    for k, (dx, edge) in enumerate(zip(pdf.dx, pdf.edges[:, 0], strict=True)):
        known = np.isfinite(values[k])
        probability = normalised(probabilities[:, known])
        path = ((values[k, known] - edge) / dx)[:, None]
        width = np.full(len(path), pdf.shown_width[k] / dx)
        kernels = evolution.translate(path, np.ones_like(path), width, pdf.p.shape[1]) / dx
        refitted = probability @ kernels
        middle = refitted.mean(axis=0)
        change = np.quantile(refitted, tails, axis=0) / np.where(middle > 0, middle, 1.0)
        low[k], high[k] = pdf.p[k] * np.where(middle > 0, change, 1.0)
    return replace(pdf, low=low, high=high)
