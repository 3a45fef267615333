"""The Gaussian copula of d >= 2 variables, for further properties besides friction and stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special, stats

from .elliptical import normal_score
from .family import CopulaError
from .fitting import fit, pseudo_observations

_TINY = 1e-300


@dataclass(frozen=True)
class GaussianCopula:
    """A Gaussian copula with correlation matrix (d, d) of the normal scores; functions as in `Copula`, of u (..., d).

    Raises CopulaError for a matrix that is not symmetric and positive definite with a unit diagonal.
    """

    correlation: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        matrix = np.asarray(self.correlation, dtype=float)
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.allclose(matrix, matrix.T, atol=1e-12):
            raise CopulaError("gaussian: the correlation matrix must be square and symmetric")
        if not np.allclose(np.diag(matrix), 1.0, atol=1e-12) or np.linalg.eigvalsh(matrix)[0] <= 0.0:
            raise CopulaError("gaussian: the correlation matrix needs a unit diagonal and positive eigenvalues")
        object.__setattr__(self, "correlation", tuple(tuple(float(value) for value in row) for row in matrix))

    @property
    def dimension(self) -> int:
        """Number of variables d."""
        return len(self.correlation)

    @property
    def _factor(self) -> np.ndarray:
        return np.linalg.cholesky(np.array(self.correlation))

    def logpdf(self, u: np.ndarray) -> np.ndarray:
        """Log PDF of the copula at u (..., d)."""
        scores = _scores(u)
        z = np.linalg.solve(self._factor, scores[..., None])[..., 0]
        return 0.5 * ((scores**2).sum(axis=-1) - (z**2).sum(axis=-1)) - np.log(np.diag(self._factor)).sum()

    def cdf(self, u: np.ndarray) -> np.ndarray:
        """C(u) at u (..., d), by scipy's multivariate normal integral (error about 1e-5)."""
        return stats.multivariate_normal(np.zeros(self.dimension), np.array(self.correlation)).cdf(_scores(u))

    def rosenblatt(self, u: np.ndarray) -> np.ndarray:
        """Values u (..., d) of this copula to independent uniforms (..., d), in the order of the variables."""
        return special.ndtr(np.linalg.solve(self._factor, _scores(u)[..., None])[..., 0])

    def inverse_rosenblatt(self, w: np.ndarray) -> np.ndarray:
        """Independent uniforms (..., d) to values of this copula."""
        return special.ndtr(_scores(w) @ self._factor.T)

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n independent rows, shape (n, d)."""
        return self.inverse_rosenblatt(rng.random((n, self.dimension)))

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary."""
        return {"family": "gaussian", "correlation": [list(row) for row in self.correlation]}

    @staticmethod
    def from_dict(data: dict[str, Any]) -> GaussianCopula:
        """The inverse of to_dict."""
        return GaussianCopula(tuple(tuple(row) for row in data["correlation"]))


def fit_gaussian(x: np.ndarray) -> GaussianCopula:
    """Fit the Gaussian copula to x (n, d) by pairwise maximum pseudo-likelihood.

    If the matrix of the pairs is not positive definite, its eigenvalues are raised to 1e-6 and its diagonal is scaled
    to 1.  Raises CopulaError for a constant column or non-finite values.
    """
    x = np.asarray(x, dtype=float)
    u = pseudo_observations(x.T)
    d = x.shape[1]
    matrix = np.eye(d)
    for i in range(d):
        for j in range(i):
            matrix[i, j] = matrix[j, i] = fit(u[i], u[j], "gaussian").parameters[0]
    values, vectors = np.linalg.eigh(matrix)
    if values[0] < 1e-6:
        matrix = vectors @ np.diag(np.maximum(values, 1e-6)) @ vectors.T
        scale = np.sqrt(np.diag(matrix))
        matrix = matrix / np.outer(scale, scale)
        np.fill_diagonal(matrix, 1.0)
    return GaussianCopula(tuple(map(tuple, 0.5 * (matrix + matrix.T))))


def _scores(u: np.ndarray) -> np.ndarray:
    u = np.asarray(u, dtype=float)
    return normal_score(np.maximum(u, _TINY), np.maximum(1.0 - u, _TINY))
