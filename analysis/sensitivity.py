"""Where a response's variance comes from when mu_s and G_p depend on each other.

For dependent inputs first-order Sobol' indices overlap, so three complementary numbers are given, all shares of the
variance: the *first-order* index Var(E[y|x_i]) / Var(y), which includes what x_i knows through the other; the
*independent total* index E[Var(y|x_j)] / Var(y) (Mara & Tarantola 2012), what x_i adds once the other is known; and the
*Shapley effect*, their mean for two inputs (Owen & Prieur 2017), which adds up to one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sensitivity:
    """Shares of the variance at each strain, columns mu_s and G_p.

    first (T, 2) first-order; alone (T, 2) independent total; shapley (T, 2), sums to one; shared (T,) = 1 - the sum of
    alone: what either of them explains through the dependence (negative: they act only together); variance (T,).
    """

    first: np.ndarray
    alone: np.ndarray
    shapley: np.ndarray
    shared: np.ndarray
    variance: np.ndarray


def indices(samples, values, classes: int | None = None) -> Sensitivity:
    """Given-data estimate from samples (n, 2) of the joint inputs and the responses there (T, n), without noise.

    Conditional means over `classes` equally filled classes of each input (by default n^(1/3), at most 64) with a
    straight line inside each class.  Where a response does not vary, the shares are NaN.
    """
    samples, values = np.asarray(samples, float), np.atleast_2d(np.asarray(values, float))
    n = len(samples)
    if values.shape[1] != n or n < 100:
        raise ValueError(f"sensitivity: {values.shape[1]} responses for {n} samples, expected the same number, >= 100")
    classes = classes or int(min(64, max(4, round(n ** (1 / 3)))))
    variance = values.var(axis=1)
    moving = variance > 1e-24 * np.maximum(np.abs(values).max(axis=1), 1e-300) ** 2
    safe = np.where(moving, variance, np.nan)
    first = np.stack([1 - _left_over(samples[:, i], values, classes) / safe for i in range(2)], axis=1)
    first = np.clip(first, 0.0, 1.0)
    alone = 1 - first[:, ::-1]
    return Sensitivity(first, alone, 0.5 * (first + alone), 1 - alone.sum(axis=1), variance)


def from_surrogate(surface, samples) -> Sensitivity:
    """Sensitivity of a Surrogate's responses along strain under samples (n, 2) of the joint inputs."""
    return indices(samples, surface.predict(samples))


def _left_over(x, values, classes):
    """Variance (T,) left inside the classes of x around a straight line, unbiased for the two parameters of each."""
    order = np.argsort(x, kind="stable")
    total = np.zeros(len(values))
    for part in np.array_split(order, classes):
        off = x[part] - x[part].mean()
        y = values[:, part] - values[:, part].mean(axis=1, keepdims=True)
        spread = off @ off
        slope = (y @ off) / spread if spread > 0 else np.zeros(len(y))
        rest = np.sum((y - slope[:, None] * off) ** 2, axis=1)
        total += rest * len(part) / max(len(part) - 2, 1)
    return total / len(x)
