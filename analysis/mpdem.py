"""Joint densities of two responses at one strain or state: the decoupled M-PDEM (Eq. 15; Lyu et al. 2024).

p(x1, x2) = sum over q of p1_q(x1) p2_q(x2) / P_q.  Product kernels dilute dependence, by sqrt((1 - b1^2/s1^2)(1 -
b2^2/s2^2)) where the spread is kept, so the correlation and conditional means come from the points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis import pdem
from analysis.density import Density


@dataclass(frozen=True)
class JointDensity:
    """Joint PDF of two responses on equal cells, with its statistics from the points.

    x1 (X1,), x2 (X2,) cell centres; p (X1, X2), p.sum() * dx1 * dx2 == 1; `first` and `second` are the PDEM densities
    of the two (T = 1), which p returns as its marginals; correlation and rank_correlation (Spearman) of the points;
    mutual_information in nats, of the shown density; diluted_correlation is what the shown density would give.
    """

    x1: np.ndarray
    x2: np.ndarray
    p: np.ndarray
    first: Density
    second: Density
    correlation: float
    rank_correlation: float
    diluted_correlation: float
    mutual_information: float
    lost_probability: float
    values1: np.ndarray
    values2: np.ndarray
    probability: np.ndarray

    def marginal(self, axis: int) -> np.ndarray:
        """Marginal density of the first (axis 0) or the second (axis 1) response from the joint one."""
        other = self.second if axis == 0 else self.first
        return self.p.sum(axis=1 - axis) * other.dx[0]

    def conditional_mean(self, at, width: float | None = None) -> np.ndarray:
        """Mean of the second response (n,) where the first has the values `at` (n,).

        Local linear regression on the points with a Gaussian window, by default the first response's kernel width.
        """
        width = self.first.bandwidth[0] if width is None else width
        off = self.values1[None, :] - np.atleast_1d(np.asarray(at, float))[:, None]
        scaled = off / width
        w = self.probability * np.exp(-0.5 * (scaled**2 - np.min(scaled**2, axis=1, keepdims=True)))
        w /= w.sum(axis=1, keepdims=True)
        mean_off = np.sum(w * off, axis=1)
        spread = np.sum(w * (off - mean_off[:, None]) ** 2, axis=1)
        mean = w @ self.values2
        slope = np.sum(w * (off - mean_off[:, None]) * self.values2, axis=1) / (spread + 1e-6 * width**2)
        return mean - slope * mean_off


def joint_density(
    values1, values2, probability, bandwidth1=None, bandwidth2=None, cells: int = 200, keep_spread=True, **options
) -> JointDensity:
    """Joint PDF of two quantities with one value a point each.

    values1, values2 (Q,), probability (Q,); a point without a finite value in either is lost to both (and counted).
    bandwidths in the unit of each, by default `pair_widths`; keep_spread and options as in `pdem.evolve` (max_lost).
    Returns a JointDensity; its marginals are PDEM's own densities.  Raises pdem.PdemError.
    """
    one, two = np.asarray(values1, float), np.asarray(values2, float)
    if one.shape != two.shape or one.ndim != 1:
        raise pdem.PdemError(f"joint density: values of the shapes {one.shape} and {two.shape}, expected the same (Q,)")
    both = np.isfinite(one) & np.isfinite(two)
    one, two = np.where(both, one, np.nan), np.where(both, two, np.nan)
    if both.any() and (bandwidth1 is None or bandwidth2 is None):
        rule = pair_widths(one[both], two[both], np.asarray(probability, float)[both])
        bandwidth1, bandwidth2 = (r if b is None else b for r, b in zip(rule, (bandwidth1, bandwidth2), strict=True))
    options |= {"cells": cells, "keep_spread": keep_spread}
    first = pdem.state_density(one, probability, bandwidth=bandwidth1, **options)
    second = pdem.state_density(two, probability, bandwidth=bandwidth2, **options)
    one, two = one[both], two[both]
    weight = np.asarray(probability, float)[both]
    weight = weight / weight.sum()
    k1, k2 = _kernels(one, first, keep_spread), _kernels(two, second, keep_spread)
    mass = _with_marginals((k1.T * weight) @ k2, first.p[0] * first.dx[0], second.p[0] * second.dx[0])
    return JointDensity(
        x1=first.x,
        x2=second.x,
        p=mass / (first.dx[0] * second.dx[0]),
        first=first,
        second=second,
        correlation=correlation(one, two, weight),
        rank_correlation=correlation(_ranks(one, weight), _ranks(two, weight), weight),
        diluted_correlation=_diluted(one, two, weight, first, second, keep_spread),
        mutual_information=_mutual_information(mass),
        lost_probability=float(first.lost_probability[0]),
        values1=one,
        values2=two,
        probability=weight,
    )


def pair_widths(one, two, weight) -> tuple[float, float]:
    """Kernel widths for a pair: 3.5 n^(-1/2) (1 - rho^2)^(1/4) standard deviations each, n = 1 / sum P^2.

    That is about the distance between points that fill a plane evenly, shorter where dependence squeezes them towards a
    line; never more than the rule for a single response (`pdem.kernel_width`).
    """
    weight = weight / weight.sum()
    rho = np.nan_to_num(correlation(one, two, weight))
    share = 3.5 * np.sqrt(np.sum(weight**2)) * max(1.0 - rho**2, 0.0) ** 0.25
    both, weights = np.stack([one, two]), np.broadcast_to(weight, (2, len(weight)))
    std = pdem.moments(both, weights)[1]
    first, second = np.minimum(share * std, pdem.kernel_width(both, weights))
    return float(first), float(second)


def correlation(one, two, weight) -> float:
    """Pearson correlation of weighted points; NaN where one of them does not vary."""
    off1, off2 = one - weight @ one, two - weight @ two
    spread = np.sqrt((weight @ off1**2) * (weight @ off2**2))
    return float(weight @ (off1 * off2) / spread) if spread > 0 else float("nan")


def _kernels(values, density, keep_spread):
    """Probability (Q, X) of every cell from each point's own kernel."""
    dx = density.dx[0]
    if keep_spread:
        values = density.mean + pdem.shrinkage(density.bandwidth, density.std) * (values - density.mean)
    path = (values[:, None] - density.x[0]) / dx + 0.5
    return pdem.translate(path, np.ones_like(path), np.full(len(path), density.bandwidth[0] / dx), len(density.x))


def _with_marginals(mass, one, two):
    """Take out what rounding left between the joint density and PDEM's own marginals (a relative 1e-10)."""
    for axis, wanted in ((1, one), (0, two)):
        sums = mass.sum(axis=axis)
        mass = mass * np.expand_dims(np.where(sums > 0, wanted / np.where(sums > 0, sums, 1.0), 0.0), axis)
    return mass


def _ranks(values, weight):
    """Weighted mid-ranks in 0 ... 1; equal values share theirs."""
    level, index = np.unique(values, return_inverse=True)
    share = np.bincount(index, weight, minlength=len(level))
    return (np.cumsum(share) - 0.5 * share)[index]


def _diluted(one, two, weight, first, second, keep_spread):
    factor = 1.0
    for density in (first, second):
        v, b = density.std[0] ** 2, density.bandwidth[0] ** 2
        factor *= pdem.shrinkage(density.bandwidth, density.std)[0] if keep_spread else np.sqrt(v / (v + b))
    return float(correlation(one, two, weight) * factor)


def _mutual_information(mass):
    independent = mass.sum(axis=1)[:, None] * mass.sum(axis=0)
    some = (mass > 0) & (independent > 0)
    return float(np.sum(mass[some] * np.log(mass[some] / independent[some])))
