"""Goodness of fit of a copula: Cramer-von Mises distance of Rosenblatt's transform to independence; two references.

The test is the same for both orders of the two columns, and it allows for ties: `bootstrap_test`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .fitting import fit_rows, pseudo_observations
from .model import evaluate, family_of, transposed

#: Elements of the largest temporary array of the sum over pairs; small, so that it stays in the processor's cache.
_CHUNK = 250_000
#: Larger samples are compared with simulated samples of this size: the distribution of S no longer depends on n there.
LARGEST_SIMULATED = 5000
#: Larger samples have their sum over pairs by sorted halves, which is faster there.
LARGEST_SQUARE = 1500
#: Simulated values that are equal to S up to rounding count as equal: tied samples have few values of S.
_EQUAL = 1e-9


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
    double = _sum_over_pairs(a, b) if n <= LARGEST_SQUARE else np.array(list(map(_sum_by_halves, a, b)))
    return (n / 9.0 - 0.5 * single + double / n).reshape(z.shape[:-2])


def _sum_over_pairs(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sums over i and j of min(a_i, a_j) min(b_i, b_j) for rows (R, n) with a falling: n^2 steps, in blocks."""
    count, n = a.shape
    inner = np.empty((count, n))
    rows, columns = max(1, _CHUNK // (n * n)), min(n, max(1, _CHUNK // n))
    edges = np.linspace(0, n, -(-n // columns) + 1).astype(
        int
    )  # no block of one column: its sum would have another order
    for i, end in zip(edges[:-1], edges[1:], strict=True):
        block = slice(i, end)
        earlier = np.triu(np.ones((end - i, end - i)), 1)
        for start in range(0, count, rows):
            part = slice(start, start + rows)
            smaller = np.minimum(b[part, :end, None], b[part, None, block])
            smaller[:, i:] *= earlier
            inner[part, block] = smaller.sum(axis=1)
    return (a * (2.0 * inner + b)).sum(axis=1)


def _sum_by_halves(a: np.ndarray, b: np.ndarray) -> float:
    """The same sum of one row (n,): n log(n)^2 steps, by merging sorted halves.

    At every level a block of 2 h values is sorted; for b_j in its second half, the sum of min(b_i, b_j) over the first
    half is the sum of the smaller b_i plus b_j for each of the others.
    """
    size = 1 << max(1, (len(a) - 1).bit_length())
    padded_a, padded_b = np.zeros((2, size))
    padded_a[: len(a)], padded_b[: len(b)] = a, b
    total, half = float((a * b).sum()), 1
    while half < size:
        block_a, block_b = padded_a.reshape(-1, 2 * half), padded_b.reshape(-1, 2 * half)
        order = np.argsort(block_b, axis=1, kind="stable")
        sorted_b = np.take_along_axis(block_b, order, axis=1)
        first = order < half
        smaller = np.cumsum(np.where(first, sorted_b, 0.0), axis=1)
        others = half - np.cumsum(first, axis=1)
        weight = np.where(first, 0.0, np.take_along_axis(block_a, order, axis=1))
        total += 2.0 * float((weight * (smaller + sorted_b * others)).sum())
        half *= 2
    return total


def independent_reference(n: int, n_boot: int, rng: np.random.Generator) -> np.ndarray:
    """S (n_boot,) of samples of n pairs of independent uniforms: the reference of Eq. 4, too wide for fitted ranks.

    Above LARGEST_SIMULATED pairs the samples have that size.
    """
    return cramer_von_mises(rng.random((n_boot, min(n, LARGEST_SIMULATED), 2)))


def bootstrap_test(
    pairs: np.ndarray, family: str, parameters: ArrayLike, n_boot: int, rng: np.random.Generator
) -> tuple[float, float]:
    """S of pseudo-observations (n, 2) under a fitted copula with parameters (k,), and its p-value by bootstrap.

    S is the mean of the two orders of Rosenblatt's transform.  Parametric bootstrap: each replicate draws n pairs from
    the fitted copula, gives them the ties of the sample, fits the family again and computes S*; p = (1/2 + number of
    S* >= S) / (n_boot + 1).  Exchanged columns, with the family turned accordingly, have the same p with the same
    random numbers.  Above LARGEST_SIMULATED pairs the replicates have that size; a larger sample that has ties is
    replaced by so many of its pairs, because with ties S grows with n.
    """
    values: np.ndarray = np.asarray(parameters, dtype=float)
    if _exchanged(pairs):
        pairs, family = pairs[:, ::-1], transposed(family)
    table = np.sort(pairs, axis=0)
    if len(pairs) > LARGEST_SIMULATED:
        if np.any(np.diff(table, axis=0) == 0.0):
            ordered = pairs[np.lexsort(pairs.T[::-1])]
            part = ordered[rng.choice(len(pairs), LARGEST_SIMULATED, replace=False)]
            pairs = pseudo_observations(part.T).T
            values = fit_rows(pairs[None, :, 0], pairs[None, :, 1], family)[0]
            table = np.sort(pairs, axis=0)
        else:
            table = without_ties(LARGEST_SIMULATED)
    S = float(statistic(pairs[None], family, values[None])[0])
    simulated = simulate_statistics(family, values, table, n_boot, rng)
    return S, float((0.5 + np.sum(simulated >= S * (1.0 - _EQUAL))) / (n_boot + 1.0))


def statistic(pairs: np.ndarray, family: str, parameters: np.ndarray) -> np.ndarray:
    """S (R,) of samples of pseudo-observations (R, n, 2) under the copula with parameters (R, k): mean of two orders.

    The orders are Rosenblatt's transforms (u, P(V <= v | U = u)) and (v, P(U <= u | V = v)).
    """
    other = statistic_of_one_order(pairs[..., ::-1], transposed(family), parameters)
    return 0.5 * (statistic_of_one_order(pairs, family, parameters) + other)


def statistic_of_one_order(pairs: np.ndarray, family: str, parameters: np.ndarray) -> np.ndarray:
    """S (R,) as in `statistic`, of Rosenblatt's transform (u, P(V <= v | U = u)) alone: the paper's Eq. 5."""
    u, v = pairs[..., 0], pairs[..., 1]
    columns = [parameters[:, [j]] for j in range(parameters.shape[1])]
    return cramer_von_mises(np.stack([u, evaluate(family_of(family), "conditional", u, v, *columns)], axis=-1))


def without_ties(n: int) -> np.ndarray:
    """Sorted pseudo-observations (n, 2) of n pairs without ties: k / (n + 1) in both columns."""
    return np.repeat(np.arange(1, n + 1)[:, None] / (n + 1.0), 2, axis=1)


def simulate_statistics(
    family: str, parameters: np.ndarray, table: np.ndarray, count: int, rng: np.random.Generator
) -> np.ndarray:
    """S (count,) of samples drawn from the copula with parameters (k,), each ranked and fitted again.

    table (n, 2) holds the sorted pseudo-observations of the sample: the value of rank k of a column gets the k-th of
    them, so that every simulated sample has the ties of the sample.  The random numbers go to the columns in the given
    order.
    """
    w = rng.random((count, len(table), 2))
    v = evaluate(family_of(family), "inverse", w[..., 0], w[..., 1], *parameters)[0]
    pairs = np.stack([column[_order(x)] for column, x in zip(table.T, (w[..., 0], v), strict=True)], axis=-1)
    start = parameters[0] if len(parameters) == 1 else None
    return statistic(pairs, family, fit_rows(pairs[..., 0], pairs[..., 1], family, start))


def _order(x: np.ndarray) -> np.ndarray:
    """Places 0 to n - 1 of the values of each row of x (R, n) in that row."""
    order = np.argsort(x, axis=1)
    places = np.empty_like(order)
    np.put_along_axis(places, order, np.arange(x.shape[1])[None], axis=1)
    return places


def _exchanged(pairs: np.ndarray) -> bool:
    """True if the columns of pairs (n, 2) are exchanged for the test; the order of the rows makes no difference.

    Of the two lists of pairs, sorted by their first and then by their second column, the lexically smaller one is used.
    """
    ours, other = (x[np.lexsort(x.T[::-1])].ravel() for x in (pairs, pairs[:, ::-1]))
    different = np.flatnonzero(ours != other)
    return bool(different.size and other[different[0]] < ours[different[0]])
