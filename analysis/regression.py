"""The linear algebra under the response surfaces: many strains at once, one basis, leave-one-out in closed form."""

from __future__ import annotations

import numpy as np
from scipy import linalg, optimize


def powers(z, terms) -> np.ndarray:
    """Products z1^i z2^j (n, M) for the exponents terms (M, 2)."""
    top = int(terms.max(initial=0))
    ladder = np.stack([np.ones_like(z), *(z**k for k in range(1, top + 1))])
    return ladder[terms[:, 0], :, 0].T * ladder[terms[:, 1], :, 1].T


def polynomial_terms(max_degree: tuple[int, int]) -> list[np.ndarray]:
    """Sets of exponents to choose from: degree i in the first, j in the second, total at most the larger of the two."""
    sets = []
    for i in range(max_degree[0] + 1):
        for j in range(min(i, max_degree[1]) + 1) if i else range(1, max_degree[1] + 1):
            grid = [(a, b) for a in range(i + 1) for b in range(j + 1) if a + b <= max(i, j)]
            sets.append(np.array(grid))
    return sets


def best_polynomial(z, values, max_degree) -> dict:
    """Least squares with the set of exponents of the least pooled leave-one-out error; fields of a Surrogate."""
    fewest = int(np.isfinite(values).sum(axis=1).min())
    scatter = np.nanvar(values, axis=1)
    moving = scatter > 0
    best, least = None, np.inf
    for terms in polynomial_terms(max_degree):
        if len(terms) > max(2, (2 * fewest) // 3) or fewest - len(terms) < 2:
            continue
        result = least_squares(powers(z, terms), values)
        error = np.mean(result["loo_error"][moving] ** 2 / scatter[moving]) if moving.any() else 0.0
        # A larger set has to earn its place: leave-one-out errors of nested sets differ by chance.
        if error < 0.98 * least:
            best, least = dict(terms=terms, length=np.ones(2), **result), error
    return best


def least_squares(basis, values) -> dict:
    """Coefficients, their covariance for unit noise, noise and leave-one-out residuals for values (T, Q) on (Q, M)."""
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


def _empty(values, size):
    rows = len(values)
    out = {"coefficients": np.zeros((rows, size)), "covariance": np.zeros((rows, size, size))}
    return out | {"noise": np.empty(rows), "dof": np.empty(rows), "loo": np.full(values.shape, np.nan)}


def masks(values):
    """The patterns of known values (Q,) and the strains (indices) each of them holds for."""
    patterns, which = np.unique(np.isfinite(values), axis=0, return_inverse=True)
    return [(mask, np.flatnonzero(which.ravel() == k)) for k, mask in enumerate(patterns)]


def gp_basis(z, points, length) -> np.ndarray:
    """1, z1, z2 and the kernel to every point (n, 3 + Q)."""
    return np.concatenate([np.ones((len(z), 1)), z, _kernel(z, points, length)], axis=1)


def best_gp(z, values) -> dict:
    """Universal kriging with a linear mean; lengths and noise ratio by the restricted likelihood of all strains."""
    full = np.isfinite(values).all(axis=1)
    scatter = np.nanstd(values, axis=1)
    pick = np.flatnonzero(full & (scatter > 0))
    if not len(pick):
        pick = np.flatnonzero(scatter > 0)[:1] if (scatter > 0).any() else np.array([0])
    pick = pick[:: max(1, len(pick) // 20)]
    mask = np.isfinite(values[pick]).all(axis=0)
    y = values[np.ix_(pick, mask)] / np.maximum(scatter[pick], 1e-300)[:, None]

    def cost(theta):
        return -_restricted_likelihood(z[mask], y, np.exp(theta[:2]), np.exp(theta[2]))

    starts = [np.log([a, b, ratio]) for a, b in ((1.5, 3.0), (3.0, 3.0)) for ratio in (0.01, 0.3)]
    bounds = [(np.log(0.4), np.log(20))] * 2 + [(np.log(1e-6), np.log(1e2))]
    found = min((optimize.minimize(cost, s, bounds=bounds, method="L-BFGS-B") for s in starts), key=lambda r: r.fun)
    length, ratio = np.exp(found.x[:2]), float(np.exp(found.x[2]))
    return dict(terms=z, length=length, **_kriging(z, values, length, ratio))


def _kernel(a, b, length):
    return np.exp(-0.5 * np.sum(((a[:, None, :] - b[None, :, :]) / length) ** 2, axis=2))


def _restricted_likelihood(z, y, length, ratio):
    n = len(z)
    trend = np.concatenate([np.ones((n, 1)), z], axis=1)
    low = linalg.cholesky(_kernel(z, z, length) + ratio * np.eye(n), lower=True)
    white, target = (linalg.solve_triangular(low, a, lower=True) for a in (trend, y.T))
    q, r = np.linalg.qr(white)
    rest = target - q @ (q.T @ target)
    variance = np.sum(rest**2, axis=0) / (n - 3)
    fit = -0.5 * (n - 3) * np.sum(np.log(np.maximum(variance, 1e-300)))
    return fit - len(y) * (np.log(np.diag(low)).sum() + np.log(np.abs(np.diag(r))).sum())


def _kriging(z, values, length, ratio):
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


def root(covariance) -> np.ndarray:
    """A matrix whose product with its transpose is the given one, singular ones included."""
    value, vector = np.linalg.eigh(covariance)
    return vector * np.sqrt(np.maximum(value, 0.0))
