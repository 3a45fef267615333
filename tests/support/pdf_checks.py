"""Measures of PDFs that only tests and benchmarks use."""

from __future__ import annotations

import numpy as np

from analysis.pdem.pdf import PDF, common_cdfs


def l1_distance(a: PDF, b: PDF) -> np.ndarray:
    """Integral (T,) of |p_a - p_b| over x at each strain."""
    return np.stack([np.abs(np.diff(one) - np.diff(two)).sum() for _, one, two in common_cdfs(a, b)])
