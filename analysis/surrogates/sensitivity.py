"""Variance shares of the inputs in a response when the inputs depend on each other.

First-order Sobol' indices of dependent inputs overlap.  Three complementary shares of the variance are therefore given:
the *first-order* index Var(E[y|x_i]) / Var(y), which includes the effect of the other inputs through the dependence;
the *independent total* index E[Var(y|all others)] / Var(y) (Mara & Tarantola 2012), the effect of x_i if the other
inputs are known; and the *Shapley effect* (Owen & Prieur 2017), whose sum is 1.  It is the mean over all orders of the
inputs of what x_i explains in addition to those before it; for two inputs that is the mean of the first two shares.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from .surrogate import Surrogate

#: Least number of samples in a class, over the number of coefficients that are fitted in it.
_PER_COEFFICIENT = 24


@dataclass(frozen=True)
class Sensitivity:
    """Shares of the variance at each strain, one column per input.

    first (T, d) first-order; alone (T, d) independent total; shapley (T, d), with the sum 1; shared (T,) = 1 - sum of
    `alone`, the share that either input explains through the dependence (negative if they act only together);
    variance (T,) in the squared unit of the response.
    """

    first: np.ndarray
    alone: np.ndarray
    shapley: np.ndarray
    shared: np.ndarray
    variance: np.ndarray


def indices(samples: ArrayLike, values: ArrayLike, classes: int | None = None) -> Sensitivity:
    """Given-data estimate from samples (n, d) of the joint inputs and the responses (T, n) or (n,), without noise.

    Conditional means over `classes` equally filled classes of each input (by default n^(1/3), at most 64), with a
    straight line inside each class.  For several inputs together the classes of the first are divided into classes of
    the next, and so on, with a plane inside each.  Where a response does not vary, the shares are NaN.
    Raises ValueError for fewer than 100 samples or another number of responses.
    """
    samples, values = np.asarray(samples, float), np.atleast_2d(np.asarray(values, float))
    n, d = samples.shape
    if values.shape[1] != n or n < 100:
        raise ValueError(f"sensitivity: {values.shape[1]} responses for {n} samples, expected the same number, >= 100")
    classes = classes or int(min(64, max(4, round(n ** (1 / 3)))))
    variance = values.var(axis=1)
    moving = variance > 1e-24 * np.maximum(np.abs(values).max(axis=1), 1e-300) ** 2
    safe = np.where(moving, variance, np.nan)
    explained = {(): 0.0 * safe, tuple(range(d)): safe / safe}
    for size in range(1, d):
        for subset in combinations(range(d), size):
            rest = (_residual_variance(samples[:, subset[0]], values, classes) if size == 1
                    else _residual_about_planes(samples[:, subset], values))  # fmt: skip
            explained[subset] = np.clip(1 - rest / safe, 0.0, 1.0)
    every = tuple(range(d))
    first = np.stack([explained[(i,)] for i in every], axis=1)
    alone = np.stack([1 - explained[every[:i] + every[i + 1 :]] for i in every], axis=1)
    shapley = 0.5 * (first + alone) if d == 2 else _shapley(explained, d)
    return Sensitivity(first=first, alone=alone, shapley=shapley, shared=1 - alone.sum(axis=1), variance=variance)


def from_surrogate(surface: Surrogate, samples: ArrayLike) -> Sensitivity:
    """Sensitivity of the responses of a Surrogate along strain, for samples (n, d) of the joint inputs."""
    return indices(samples, surface.predict(samples))


def _shapley(explained: dict[tuple[int, ...], np.ndarray], d: int) -> np.ndarray:
    """Shapley effects (T, d) from the share of the variance that every subset of the inputs explains."""
    effects = []
    for i in range(d):
        others = [k for k in range(d) if k != i]
        total = 0.0 * explained[()]
        for size in range(d):
            weight = math.factorial(size) * math.factorial(d - size - 1) / math.factorial(d)
            for subset in combinations(others, size):
                total = total + weight * (explained[tuple(sorted((*subset, i)))] - explained[subset])
        effects.append(total)
    return np.stack(effects, axis=1)


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


def _residual_about_planes(x: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Variance (T,) about a plane inside the classes of x (n, k), unbiased for the parameters of each plane."""
    n, k = x.shape
    classes = max(2, int((n / (_PER_COEFFICIENT * (k + 1))) ** (1 / k)))
    parts = [np.arange(n)]
    for column in x.T:
        parts = [piece for part in parts
                 for piece in np.array_split(part[np.argsort(column[part], kind="stable")], classes)]  # fmt: skip
    total = np.zeros(len(values))
    for part in parts:
        off = x[part] - x[part].mean(axis=0)
        scale = off.std(axis=0)
        off = off / np.where(scale > 0, scale, 1.0)
        y = values[:, part] - values[:, part].mean(axis=1, keepdims=True)
        slopes, _, rank, _ = np.linalg.lstsq(off, y.T, rcond=1e-9)
        residual = np.sum((y.T - off @ slopes) ** 2, axis=0)
        total += residual * len(part) / max(len(part) - 1 - rank, 1)
    return total / n
