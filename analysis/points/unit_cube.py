"""Sets of points in the unit cube to start from, and an order in which every beginning is a fair set of its own."""

from __future__ import annotations

import functools

import numpy as np
from scipy import stats


def uniform_set(method: str, n: int, d: int, seed: int) -> np.ndarray:
    """n points of the open unit cube, (n, d): `sobol` (scrambled), `lhs`, `mc` (random), `lattice` (rank one, shifted)
    or `fairest`: the one of 16 lattices, 16 Sobol' sets and 64 Latin hypercubes with the smallest centred discrepancy.
    """
    if method == "fairest":
        rng = np.random.default_rng(seed)
        tries = [name for name, count in (("lattice", 16), ("sobol", 16), ("lhs", 64)) for _ in range(count)]
        return min((uniform_set(name, n, d, int(rng.integers(2**31))) for name in tries), key=kernel_discrepancy)
    if method == "lhs":
        points = stats.qmc.LatinHypercube(d, seed=seed).random(n)
    elif method == "mc":
        points = np.random.default_rng(seed).random((n, d))
    elif method == "lattice":
        shift = np.random.default_rng(seed).random(d)
        points = (np.arange(n)[:, None] * np.array(lattice_generator(n, d)) / n + shift) % 1.0
    else:
        points = stats.qmc.Sobol(d, seed=seed).random_base2(max(1, int(np.ceil(np.log2(n)))))[:n]
    return np.clip(points, 2.0**-33, 1.0 - 2.0**-33)


@functools.lru_cache(maxsize=64)
def lattice_generator(n: int, d: int, trials: int = 400) -> tuple[int, ...]:
    """The vector (1, a, b, ...) mod n with the smallest P_2 error, component by component.

    Each component is one of all numbers that have no divisor in common with n, or of `trials` of them if n is large.
    """
    candidates = [a for a in range(1, n) if np.gcd(a, n) == 1]
    if len(candidates) > trials:
        candidates = sorted(np.random.default_rng(0).choice(candidates, trials, replace=False).tolist())
    k = np.arange(n)

    def error(vector):
        u = np.outer(k, vector) % n / n
        return np.prod(1.0 + 2.0 * np.pi**2 * (u * u - u + 1.0 / 6.0), axis=1).mean()

    vector: tuple[int, ...] = (1,)
    while len(vector) < d:
        vector = min(((*vector, a) for a in candidates), key=lambda longer: (round(error(longer), 12), longer))
    return vector


def fair_order(w: np.ndarray, probability: np.ndarray, first: int = 0) -> np.ndarray:
    """An order (n,) of points w (n, d) of the unit cube in which every beginning stands for the whole weighted set.

    Greedy (kernel herding): the next point is the one that brings the beginning, equally weighted, nearest to the whole
    set with its `probability` in the centred discrepancy (Hickernell 1998). The first `first` points stay in place.
    """
    kernel = _kernel(w)
    target = kernel @ probability
    own = np.diag(kernel)
    chosen = list(range(first))
    free = np.arange(len(w)) >= first
    field = kernel[:, :first].sum(axis=1)
    energy, overlap = field[:first].sum(), target[:first].sum()
    for count in range(first + 1, len(w) + 1):
        distance = (energy + 2.0 * field + own) / count**2 - 2.0 * (overlap + target) / count
        q = int(np.argmin(np.where(free, distance, np.inf)))
        energy, overlap = energy + 2.0 * field[q] + own[q], overlap + target[q]
        field = field + kernel[q]
        free[q] = False
        chosen.append(q)
    return np.array(chosen)


def kernel_discrepancy(w: np.ndarray) -> float:
    """Squared centred discrepancy (Hickernell 1998) of equally weighted points w (n, d) of the unit cube."""
    off = np.abs(w - 0.5)
    mean_field = np.prod(1.0 + 0.5 * off - 0.5 * off**2, axis=1)
    return float(_kernel(w).mean() - 2.0 * mean_field.mean() + (13.0 / 12.0) ** w.shape[1])


def _kernel(w: np.ndarray) -> np.ndarray:
    off = np.abs(w - 0.5)
    return np.prod(1.0 + 0.5 * (off[:, None] + off[None, :] - np.abs(w[:, None] - w[None, :])), axis=2)
