"""Joint PDF of two responses at one strain or state: the decoupled M-PDEM (Eq. 15; Lyu et al. 2024).

p(x1, x2) = sum over q of p1_q(x1) p2_q(x2) / P_q.  Product kernels reduce the correlation, by about the factor
sqrt((1 - b1^2/s1^2)(1 - b2^2/s2^2)) if the spread is kept.  The reported correlation and the conditional mean therefore
come from the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import evolution
from .pdf import PDF, PdemError
from .weighted import moments, normalised
from .widths import kernel_width

#: Factor of `pair_widths`: kernels of about the distance between points that fill a plane evenly.
_PAIR_FACTOR = 3.5
#: Share of width^2 added to the variance of the points in a window, so that a window with one point has a slope.
_SLOPE_RIDGE = 1e-6


@dataclass(frozen=True)
class JointPDF:
    """Joint PDF of two responses on equal cells, with statistics of the points.

    x1 (X1,), x2 (X2,) cell centres; p (X1, X2) with p.sum() * dx1 * dx2 == 1.  `first` and `second` are the PDFs of the
    two responses (T = 1); they are the marginals of p.  `correlation` and `rank_correlation` (Spearman) are those of
    the points, `diluted_correlation` that of p.  `mutual_information` of p is in nats.  values1, values2, probability
    (Q,) are the points with both values, `lost_probability` that of the others.
    """

    x1: np.ndarray
    x2: np.ndarray
    p: np.ndarray
    first: PDF
    second: PDF
    correlation: float
    rank_correlation: float
    diluted_correlation: float
    mutual_information: float
    lost_probability: float
    values1: np.ndarray
    values2: np.ndarray
    probability: np.ndarray

    def marginal(self, axis: int) -> np.ndarray:
        """Marginal PDF (X,) of the first (axis 0) or the second (axis 1) response, from the joint PDF."""
        other = self.second if axis == 0 else self.first
        return self.p.sum(axis=1 - axis) * other.dx[0]

    def conditional_mean(self, at: ArrayLike, width: float | None = None) -> np.ndarray:
        """Mean (n,) of the second response where the first one has the values `at` (n,).

        Local linear regression on the points with a Gaussian window of standard deviation `width`, by default the
        kernel width of the first response.
        """
        width = self.first.bandwidth[0] if width is None else width
        off = self.values1[None, :] - np.atleast_1d(np.asarray(at, float))[:, None]
        scaled = off / width
        w = normalised(self.probability * np.exp(-0.5 * (scaled**2 - np.min(scaled**2, axis=1, keepdims=True))))
        mean_off = np.sum(w * off, axis=1)
        spread = np.sum(w * (off - mean_off[:, None]) ** 2, axis=1)
        mean = w @ self.values2
        slope = np.sum(w * (off - mean_off[:, None]) * self.values2, axis=1) / (spread + _SLOPE_RIDGE * width**2)
        return mean - slope * mean_off


def joint_pdf(
    values1: ArrayLike,
    values2: ArrayLike,
    probability: ArrayLike,
    bandwidth1: float | None = None,
    bandwidth2: float | None = None,
    cells: int = 200,
    keep_spread: bool = True,
    **options: Any,
) -> JointPDF:
    """Joint PDF of two quantities with one value per point each.

    values1, values2 (Q,), probability (Q,); a point needs a finite value of both, and otherwise counts as lost.
    bandwidth1, bandwidth2 in the units of the quantities, by default `pair_widths`; keep_spread and options (max_lost)
    as in `evolution.evolve`.  Returns a JointPDF whose marginals are the PDFs of `evolution.state_pdf`.
    Raises PdemError.
    """
    one, two = np.asarray(values1, float), np.asarray(values2, float)
    if one.shape != two.shape or one.ndim != 1:
        raise PdemError(f"joint PDF: values of the shapes {one.shape} and {two.shape}, expected the same (Q,)")
    both = np.isfinite(one) & np.isfinite(two)
    one, two = np.where(both, one, np.nan), np.where(both, two, np.nan)
    if both.any() and (bandwidth1 is None or bandwidth2 is None):
        default1, default2 = pair_widths(one[both], two[both], np.asarray(probability, float)[both])
        bandwidth1 = default1 if bandwidth1 is None else bandwidth1
        bandwidth2 = default2 if bandwidth2 is None else bandwidth2
    options |= {"cells": cells, "keep_spread": keep_spread}
    first = evolution.state_pdf(one, probability, bandwidth=bandwidth1, **options)
    second = evolution.state_pdf(two, probability, bandwidth=bandwidth2, **options)
    one, two = one[both], two[both]
    probability = normalised(np.asarray(probability, float)[both])
    k1, k2 = (_kernels(*pair, probability, keep_spread) for pair in ((one, first), (two, second)))
    mass = _with_marginals((k1.T * probability) @ k2, first.p[0] * first.dx[0], second.p[0] * second.dx[0])
    return JointPDF(
        x1=first.x,
        x2=second.x,
        p=mass / (first.dx[0] * second.dx[0]),
        first=first,
        second=second,
        correlation=_correlation(one, two, probability),
        rank_correlation=_correlation(_ranks(one, probability), _ranks(two, probability), probability),
        diluted_correlation=_diluted(mass, first.x, second.x),
        mutual_information=_mutual_information(mass),
        lost_probability=float(first.lost_probability[0]),
        values1=one,
        values2=two,
        probability=probability,
    )


def pair_widths(one: np.ndarray, two: np.ndarray, probability: np.ndarray) -> tuple[float, float]:
    """Kernel widths for a pair of values (Q,): 3.5 n^(-1/2) (1 - rho^2)^(1/4) standard deviations, n = 1 / sum P^2.

    That is about the distance between points that fill a plane evenly, and less where the dependence moves them towards
    a line; it is never more than the width for a single response (`widths.kernel_width`).
    """
    probability = normalised(probability)
    rho = np.nan_to_num(_correlation(one, two, probability))
    factor = _PAIR_FACTOR * np.sqrt(np.sum(probability**2)) * max(1.0 - rho**2, 0.0) ** 0.25
    both, rows = np.stack([one, two]), np.broadcast_to(probability, (2, len(probability)))
    std = moments(both, rows)[1]
    first, second = np.minimum(factor * std, kernel_width(both, rows))
    return float(first), float(second)


def _correlation(one: np.ndarray, two: np.ndarray, probability: np.ndarray) -> float:
    """Pearson correlation of values (Q,) with normalised probabilities; NaN if one of the two is constant.

    For points that all have a value this equals `weighted.correlation` but for rounding in the last bit.
    """
    off1, off2 = one - probability @ one, two - probability @ two
    spread = np.sqrt((probability @ off1**2) * (probability @ off2**2))
    return float(probability @ (off1 * off2) / spread) if spread > 0 else float("nan")


def _kernels(values: np.ndarray, pdf: PDF, probability: np.ndarray, keep_spread: bool) -> np.ndarray:
    """Probability (Q, X) of every cell from the kernel of each point alone."""
    dx = pdf.dx[0]
    path, width = (values[None] - pdf.x[0]) / dx + 0.5, pdf.bandwidth / dx
    if keep_spread:
        path = evolution.sharpened(path, probability[None], width, len(pdf.x))
    return evolution.translate(path.T, np.ones_like(path.T), np.full(len(values), width[0]), len(pdf.x))


def _with_marginals(mass: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Probabilities (X1, X2) scaled to the marginals one (X1,) and two (X2,), to remove a relative error of 1e-10."""
    for axis, marginal in ((1, one), (0, two)):
        sums = mass.sum(axis=axis)
        mass = mass * np.expand_dims(np.where(sums > 0, marginal / np.where(sums > 0, sums, 1.0), 0.0), axis)
    return mass


def _ranks(values: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Weighted mid-ranks (Q,) in 0 ... 1; equal values have equal ranks."""
    level, index = np.unique(values, return_inverse=True)
    step = np.bincount(index, probability, minlength=len(level))
    return (np.cumsum(step) - 0.5 * step)[index]


def _diluted(mass: np.ndarray, x1: np.ndarray, x2: np.ndarray) -> float:
    """Correlation of the joint PDF with probabilities (X1, X2), which the kernels reduce below that of the points."""
    one, two = np.meshgrid(x1, x2, indexing="ij")
    return _correlation(one.ravel(), two.ravel(), normalised(mass.ravel()))


def _mutual_information(mass: np.ndarray) -> float:
    """Sum of p ln(p / (p1 p2)) in nats over the cells (X1, X2)."""
    independent = mass.sum(axis=1)[:, None] * mass.sum(axis=0)
    positive = (mass > 0) & (independent > 0)
    return float(np.sum(mass[positive] * np.log(mass[positive] / independent[positive])))
