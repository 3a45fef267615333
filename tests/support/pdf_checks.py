"""Measures of PDFs that only tests and benchmarks use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.pdem import evolution
from analysis.pdem.pdf import PDF, common_cdfs
from analysis.surrogates.surrogate import Surrogate


def l1_distance(a: PDF, b: PDF) -> np.ndarray:
    """Integral (T,) of |p_a - p_b| over x at each strain."""
    return np.stack([np.abs(np.diff(one) - np.diff(two)).sum() for _, one, two in common_cdfs(a, b)])


def with_surface_band(
    pdf: PDF, surface: Surrogate, bootstrap: np.ndarray, rng: np.random.Generator, level: float = 0.95
) -> PDF:
    """The PDF with a pointwise band low, high (T, X) on p, from draws of the surface and the kernel widths of the PDF.

    bootstrap (B, n, 2), one sample from each refitted input distribution.  The bias of the kernel is not in the band:
    it covers the true PDF convolved with the same kernel.
    """
    bootstrap = np.asarray(bootstrap, float)
    draws = surface.draws(len(bootstrap), rng)
    basis = [surface.basis(x) for x in bootstrap]
    tails = [0.5 - 0.5 * level, 0.5 + 0.5 * level]
    low, high = np.empty_like(pdf.p), np.empty_like(pdf.p)
    probability = np.full(bootstrap.shape[:2], 1.0 / bootstrap.shape[1])
    cells = pdf.p.shape[1]
    for k, (dx, edge) in enumerate(zip(pdf.dx, pdf.edges[:, 0], strict=True)):
        path = np.stack([b @ c[k] for b, c in zip(basis, draws, strict=True)])
        path = np.clip((path - edge) / dx, 0.0, cells - 1e-9)
        p = evolution.translate(path, probability, np.full(len(path), pdf.bandwidth[k] / dx), cells) / dx
        low[k], high[k] = np.quantile(p, tails, axis=0)
    return replace(pdf, low=low, high=high)
