"""Variance shares of mu_s and G_p in a response when the two inputs depend on each other.

First-order Sobol' indices of dependent inputs overlap.  Three complementary shares of the variance are therefore given:
the *first-order* index Var(E[y|x_i]) / Var(y), which includes the effect of the other input through the dependence; the
*independent total* index E[Var(y|x_j)] / Var(y) (Mara & Tarantola 2012), the effect of x_i if the other input is known;
and the *Shapley effect* (Owen & Prieur 2017), for two inputs the mean of both, whose sum is 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .surrogate import Surrogate


@dataclass(frozen=True)
class Sensitivity:
    """Shares of the variance at each strain, columns mu_s and G_p.

    first (T, 2) first-order; alone (T, 2) independent total; shapley (T, 2), with the sum 1; shared (T,) = 1 - sum of
    `alone`, the share that either input explains through the dependence (negative if they act only together);
    variance (T,) in the squared unit of the response.
    """

    first: np.ndarray
    alone: np.ndarray
    shapley: np.ndarray
    shared: np.ndarray
    variance: np.ndarray


def indices(samples: ArrayLike, values: ArrayLike, classes: int | None = None) -> Sensitivity:
    """Given-data estimate from samples (n, 2) of the joint inputs and the responses (T, n) or (n,), without noise.

    Conditional means over `classes` equally filled classes of each input (by default n^(1/3), at most 64), with a
    straight line inside each class.  Where a response does not vary, the shares are NaN.
    Raises ValueError for fewer than 100 samples or another number of responses.
    """
    samples, values = np.asarray(samples, float), np.atleast_2d(np.asarray(values, float))
    n = len(samples)
    if values.shape[1] != n or n < 100:
        raise ValueError(f"sensitivity: {values.shape[1]} responses for {n} samples, expected the same number, >= 100")
    classes = classes or int(min(64, max(4, round(n ** (1 / 3)))))
    variance = values.var(axis=1)
    moving = variance > 1e-24 * np.maximum(np.abs(values).max(axis=1), 1e-300) ** 2
    safe = np.where(moving, variance, np.nan)
    first = np.stack([1 - _residual_variance(samples[:, i], values, classes) / safe for i in range(2)], axis=1)
    first = np.clip(first, 0.0, 1.0)
    alone = 1 - first[:, ::-1]
    return Sensitivity(
        first=first, alone=alone, shapley=0.5 * (first + alone), shared=1 - alone.sum(axis=1), variance=variance
    )


def from_surrogate(surface: Surrogate, samples: ArrayLike) -> Sensitivity:
    """Sensitivity of the responses of a Surrogate along strain, for samples (n, 2) of the joint inputs."""
    return indices(samples, surface.predict(samples))


def _residual_variance(x: np.ndarray, values: np.ndarray, classes: int) -> np.ndarray:
    """Variance (T,) about a straight line inside the classes of x, unbiased for the two parameters of each line."""
    order = np.argsort(x, kind="stable")
    total = np.zeros(len(values))
    for part in np.array_split(order, classes):
        off = x[part] - x[part].mean()
        y = values[:, part] - values[:, part].mean(axis=1, keepdims=True)
        spread = off @ off
        slope = (y @ off) / spread if spread > 0 else np.zeros(len(y))
        residual = np.sum((y - slope[:, None] * off) ** 2, axis=1)
        total += residual * len(part) / max(len(part) - 2, 1)
    return total / len(x)
