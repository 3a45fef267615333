"""Linear algebra of the response surfaces: many strains at once, one basis, leave-one-out errors in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import linalg, optimize

#: A larger set of terms is taken only if its leave-one-out error is below this share of the smaller set's, because the
#: errors of nested sets differ by chance.
_LARGER_SET = 0.98
#: Strains at most from which the hyperparameters of the Gaussian process are fitted; more cost time and change little.
_LIKELIHOOD_STRAINS = 20


def powers(z: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Products z1^i z2^j (n, M) of z (n, 2) for the exponents terms (M, 2)."""
    top = int(terms.max(initial=0))
    ladder = np.stack([np.ones_like(z), *(z**k for k in range(1, top + 1))])
    return ladder[terms[:, 0], :, 0].T * ladder[terms[:, 1], :, 1].T


def polynomial_terms(max_degree: tuple[int, int]) -> list[np.ndarray]:
    """Sets of exponents (M, 2): up to i and j in the two inputs, with a sum of at most the larger of i and j."""
    sets = []
    for i in range(max_degree[0] + 1):
        for j in range(min(i, max_degree[1]) + 1) if i else range(1, max_degree[1] + 1):
            grid = [(a, b) for a in range(i + 1) for b in range(j + 1) if a + b <= max(i, j)]
            sets.append(np.array(grid))
    return sets


def best_polynomial(z: np.ndarray, values: np.ndarray, max_degree: tuple[int, int]) -> dict[str, Any]:
    """Least squares with the set of exponents of the least pooled leave-one-out error, as fields of a Surrogate.

    z (Q, 2) standardised inputs, values (T, Q) with NaN for missing runs.
    """
    fewest = int(np.isfinite(values).sum(axis=1).min())
    scatter = np.nanvar(values, axis=1)
    moving = scatter > 0
    best: dict[str, Any] = {}
    least = np.inf
    for terms in polynomial_terms(max_degree):
        if len(terms) > max(2, (2 * fewest) // 3) or fewest - len(terms) < 2:
            continue
        result = least_squares(powers(z, terms), values)
        error = np.mean(result["loo_error"][moving] ** 2 / scatter[moving]) if moving.any() else 0.0
        if error < _LARGER_SET * least:
            best, least = dict(terms=terms, length=np.ones(2), **result), error
    return best


def least_squares(basis: np.ndarray, values: np.ndarray) -> dict[str, np.ndarray]:
    """Least squares of values (T, Q) on a basis (Q, M): coefficients, covariance for unit noise, noise, dof, loo.

    The result holds these fields of a Surrogate and loo_error.
    """
    size = basis.shape[1]
    out = _empty(values, size)
    for mask, at in masks(values):
        x, y = basis[mask], values[np.ix_(at, mask)]
        q, r = np.linalg.qr(x)
        inverse = np.linalg.pinv(r)
        residual = y - (y @ q) @ q.T
        leverage = np.minimum(np.sum(q * q, axis=1), 1 - 1e-9)
        out["coefficients"][at] = (y @ q) @ inverse.T
        out["covariance"][at] = inverse @ inverse.T
        out["dof"][at] = len(x) - size
        out["noise"][at] = np.sqrt(np.sum(residual**2, axis=1) / (len(x) - size))
        out["loo"][np.ix_(at, mask)] = residual / (1 - leverage)
    out["loo_error"] = np.sqrt(np.nanmean(out["loo"] ** 2, axis=1))
    return out


def _empty(values: np.ndarray, size: int) -> dict[str, np.ndarray]:
    """Arrays for the fields that depend on the strain, for values (T, Q) and `size` coefficients."""
    rows = len(values)
    out = {"coefficients": np.zeros((rows, size)), "covariance": np.zeros((rows, size, size))}
    return out | {"noise": np.empty(rows), "dof": np.empty(rows), "loo": np.full(values.shape, np.nan)}


def masks(values: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Distinct masks (Q,) of known values in values (T, Q), each with the indices of its strains."""
    patterns, which = np.unique(np.isfinite(values), axis=0, return_inverse=True)
    return [(mask, np.flatnonzero(which.ravel() == k)) for k, mask in enumerate(patterns)]


def gp_basis(z: np.ndarray, points: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Basis (n, 3 + Q) of a Gaussian process at z (n, 2): 1, z1, z2 and the kernel to each of points (Q, 2)."""
    return np.concatenate([np.ones((len(z), 1)), z, _kernel(z, points, length)], axis=1)


def best_gp(z: np.ndarray, values: np.ndarray) -> dict[str, Any]:
    """Universal kriging with a linear mean, as fields of a Surrogate.

    z (Q, 2) standardised inputs, values (T, Q) with NaN for missing runs.  Correlation lengths and noise ratio have the
    largest restricted likelihood, pooled over strains.
    """
    full = np.isfinite(values).all(axis=1)
    scatter = np.nanstd(values, axis=1)
    pick = np.flatnonzero(full & (scatter > 0))
    if not len(pick):
        pick = np.flatnonzero(scatter > 0)[:1] if (scatter > 0).any() else np.array([0])
    pick = pick[:: max(1, len(pick) // _LIKELIHOOD_STRAINS)]
    mask = np.isfinite(values[pick]).all(axis=0)
    y = values[np.ix_(pick, mask)] / np.maximum(scatter[pick], 1e-300)[:, None]

    def cost(theta: np.ndarray) -> float:
        return -_restricted_likelihood(z[mask], y, np.exp(theta[:2]), np.exp(theta[2]))

    starts = [np.log([a, b, ratio]) for a, b in ((1.5, 3.0), (3.0, 3.0)) for ratio in (0.01, 0.3)]
    bounds = [(np.log(0.4), np.log(20))] * 2 + [(np.log(1e-6), np.log(1e2))]
    best = min((optimize.minimize(cost, s, bounds=bounds, method="L-BFGS-B") for s in starts), key=lambda r: r.fun)
    length, ratio = np.exp(best.x[:2]), float(np.exp(best.x[2]))
    return dict(terms=z, length=length, **_kriging(z, values, length, ratio))


def _kernel(a: np.ndarray, b: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Squared-exponential kernel (n, m) between points a (n, 2) and b (m, 2)."""
    return np.exp(-0.5 * np.sum(((a[:, None, :] - b[None, :, :]) / length) ** 2, axis=2))


def _restricted_likelihood(z: np.ndarray, y: np.ndarray, length: np.ndarray, ratio: float) -> float:
    """Restricted log-likelihood of y (T, Q) at z (Q, 2), summed over strains; ratio: noise over process variance."""
    n = len(z)
    trend = np.concatenate([np.ones((n, 1)), z], axis=1)
    low = linalg.cholesky(_kernel(z, z, length) + ratio * np.eye(n), lower=True)
    white, target = (linalg.solve_triangular(low, a, lower=True) for a in (trend, y.T))
    q, r = np.linalg.qr(white)
    residual = target - q @ (q.T @ target)
    variance = np.sum(residual**2, axis=0) / (n - 3)
    fit = -0.5 * (n - 3) * np.sum(np.log(np.maximum(variance, 1e-300)))
    return fit - len(y) * (np.log(np.diag(low)).sum() + np.log(np.abs(np.diag(r))).sum())


def _kriging(z: np.ndarray, values: np.ndarray, length: np.ndarray, ratio: float) -> dict[str, np.ndarray]:
    """Universal kriging of values (T, Q) at z (Q, 2), as fields of a Surrogate and loo_error."""
    n = values.shape[1]
    out = _empty(values, n + 3)
    for mask, at in masks(values):
        x, y = z[mask], values[np.ix_(at, mask)]
        trend = np.concatenate([np.ones((len(x), 1)), x], axis=1)
        kernel = _kernel(x, x, length)
        inverse = np.linalg.inv(kernel + ratio * np.eye(len(x)))
        beta = np.linalg.solve(trend.T @ inverse @ trend, trend.T @ inverse)
        projected = inverse - inverse @ trend @ beta
        to_coefficients = np.concatenate([beta, projected])
        residual = y @ projected.T
        leverage = np.diag(projected)
        slots = np.concatenate([np.arange(3), 3 + np.flatnonzero(mask)])
        out["coefficients"][np.ix_(at, slots)] = y @ to_coefficients.T
        variance = np.maximum(np.sum(y * residual, axis=1) / (len(x) - 3), 0.0)
        out["noise"][at] = np.sqrt(ratio * variance)
        out["dof"][at] = len(x) - 3
        out["loo"][np.ix_(at, mask)] = residual / leverage
        block = np.zeros((n + 3, n + 3))
        block[np.ix_(slots, slots)] = to_coefficients @ to_coefficients.T
        out["covariance"][at] = block
    out["loo_error"] = np.sqrt(np.nanmean(out["loo"] ** 2, axis=1))
    return out


def root(covariance: np.ndarray) -> np.ndarray:
    """Matrix square root L (M, M) of a covariance (M, M), L L' = covariance, which may be singular."""
    value, vector = np.linalg.eigh(covariance)
    return vector * np.sqrt(np.maximum(value, 0.0))
