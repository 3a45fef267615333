"""Goodness of fit of a copula: Cramer-von Mises distance of Rosenblatt's transform to independence; two references."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .fitting import fit_rows, pseudo_observations
from .model import evaluate, family_of

_CHUNK = 3_000_000  # elements of the largest temporary array


def cramer_von_mises(z: np.ndarray) -> np.ndarray:
    """The distance S (Eq. 5 with the sum over j in place of the misprinted product) of samples z (..., n, 2).

    S = n/9 - 1/2 sum_i (1-z1i^2)(1-z2i^2) + 1/n sum_i sum_j (1-max(z1i,z1j))(1-max(z2i,z2j)),
    Genest, Remillard and Beaudoin (2009).  Returns an array of shape (...).
    """
    z = np.asarray(z, dtype=float)
    rows = z.reshape(-1, *z.shape[-2:])
    n = rows.shape[1]
    single = ((1.0 - rows[..., 0] ** 2) * (1.0 - rows[..., 1] ** 2)).sum(axis=1)
    order = np.argsort(rows[..., 0], axis=1)
    a = np.take_along_axis(1.0 - rows[..., 0], order, axis=1)
    b = np.take_along_axis(1.0 - rows[..., 1], order, axis=1)
    double = np.empty(len(rows))
    step = max(1, _CHUNK // (n * n))
    later = np.triu(np.ones((n, n)), 1).T
    for start in range(0, len(rows), step):
        part = slice(start, start + step)
        smaller = np.minimum(b[part, :, None], b[part, None, :])
        inner = np.einsum("rij,ij->ri", smaller, later)
        double[part] = (a[part] * (2.0 * inner + b[part])).sum(axis=1)
    return (n / 9.0 - 0.5 * single + double / n).reshape(z.shape[:-2])


def independent_reference(n: int, n_boot: int, rng: np.random.Generator) -> np.ndarray:
    """S (n_boot,) of samples of n pairs of independent uniforms: the reference of Eq. 4, too wide for fitted ranks."""
    return cramer_von_mises(rng.random((n_boot, n, 2)))


def bootstrap_test(
    pairs: np.ndarray, family: str, parameters: ArrayLike, n_boot: int, rng: np.random.Generator
) -> tuple[float, float]:
    """S of pseudo-observations (n, 2) under a fitted copula with parameters (k,), and its p-value by bootstrap.

    Parametric bootstrap: each replicate draws n pairs from the fitted copula, ranks them, fits the family again and
    computes S*; p = (1/2 + number of S* >= S) / (n_boot + 1).
    """
    parameters = np.asarray(parameters, dtype=float)
    S = float(statistic(pairs[None], family, parameters[None])[0])
    simulated = simulate_statistics(family, parameters, len(pairs), n_boot, rng)
    return S, float((0.5 + np.sum(simulated >= S)) / (n_boot + 1.0))


def statistic(pairs: np.ndarray, family: str, parameters: np.ndarray) -> np.ndarray:
    """S (R,) of each sample of pseudo-observations (R, n, 2) under the copula with parameters (R, k)."""
    u, v = pairs[..., 0], pairs[..., 1]
    columns = [parameters[:, [j]] for j in range(parameters.shape[1])]
    return cramer_von_mises(np.stack([u, evaluate(family_of(family), "conditional", u, v, *columns)], axis=-1))


def simulate_statistics(
    family: str, parameters: np.ndarray, n: int, count: int, rng: np.random.Generator
) -> np.ndarray:
    """S (count,) of samples of n pairs drawn from the copula with parameters (k,), each ranked and fitted again."""
    w = rng.random((count, n, 2))
    v = evaluate(family_of(family), "inverse", w[..., 0], w[..., 1], *parameters)[0]
    pairs = np.stack([pseudo_observations(w[..., 0]), pseudo_observations(v)], axis=-1)
    start = parameters[0] if len(parameters) == 1 else None
    return statistic(pairs, family, fit_rows(pairs[..., 0], pairs[..., 1], family, start))
