"""The Gaussian and Student's copula of any number of variables, for more properties than friction and stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special, stats

from .elliptical import LARGEST_NU, SMALLEST_NU, normal_score, student_score
from .family import CopulaError
from .fitting import pseudo_observations

_TINY = 1e-300
SMALLEST_EIGENVALUE = 1e-6
#: Quadrature over the scale of Student's variables, in standard normals of its probability.
_SCALE_NODES, _SCALE_WEIGHTS = (7.0 * values for values in np.polynomial.legendre.leggauss(40))


class _Correlated:
    """What copulas with a correlation matrix (d, d) of scores have in common."""

    correlation: tuple[tuple[float, ...], ...]

    @property
    def dimension(self) -> int:
        """Number of variables d."""
        return len(self.correlation)

    @property
    def _factor(self) -> np.ndarray:
        return np.linalg.cholesky(np.array(self.correlation))


@dataclass(frozen=True)
class GaussianCopula(_Correlated):
    """A Gaussian copula with correlation matrix (d, d) of the normal scores; functions as in `Copula`, of u (..., d).

    Raises CopulaError for a matrix that is not symmetric and positive definite with a unit diagonal.
    """

    correlation: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "correlation", _checked("gaussian", self.correlation))

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


@dataclass(frozen=True)
class StudentCopula(_Correlated):
    """Student's copula with correlation matrix (d, d) and degrees of freedom nu; functions of u (..., d).

    The first k variables of Student's distribution make the next one, scaled by sqrt((nu + k) / (nu + q_k)), a Student
    variable of nu + k degrees of freedom, where q_k is the squared length of the first k independent components.

    Raises CopulaError for a matrix that is not symmetric and positive definite with a unit diagonal, and for nu outside
    [1, 200].
    """

    correlation: tuple[tuple[float, ...], ...]
    degrees_of_freedom: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "correlation", _checked("student", self.correlation))
        if not SMALLEST_NU <= self.degrees_of_freedom <= LARGEST_NU:
            limits = f"[{SMALLEST_NU:g}, {LARGEST_NU:g}]"
            raise CopulaError(f"student: degrees_of_freedom = {self.degrees_of_freedom:g} is outside {limits}")

    def logpdf(self, u: np.ndarray) -> np.ndarray:
        """Log PDF of the copula at u (..., d)."""
        nu, d = self.degrees_of_freedom, self.dimension
        scores = self._scores(u)
        z = np.linalg.solve(self._factor, scores[..., None])[..., 0]
        constant = special.gammaln(0.5 * (nu + d)) + (d - 1) * special.gammaln(0.5 * nu)
        constant -= d * special.gammaln(0.5 * (nu + 1.0)) + np.log(np.diag(self._factor)).sum()
        joint = 0.5 * (nu + d) * np.log1p((z**2).sum(axis=-1) / nu)
        return constant - joint + 0.5 * (nu + 1.0) * np.log1p(scores**2 / nu).sum(axis=-1)

    def cdf(self, u: np.ndarray) -> np.ndarray:
        """C(u) at u (..., d): scipy's normal integral over the scale of the scores (error 1e-5, 1e-4 at nu = 1)."""
        scores = self._scores(u)
        probability, weight = special.ndtr(_SCALE_NODES), np.exp(-0.5 * _SCALE_NODES**2) * _SCALE_WEIGHTS
        scale = np.sqrt(2.0 * special.gammaincinv(0.5 * self.degrees_of_freedom, probability) / self.degrees_of_freedom)
        normal = stats.multivariate_normal(np.zeros(self.dimension), np.array(self.correlation))
        values = normal.cdf(scores[..., None, :] * scale[:, None]).reshape(*scores.shape[:-1], len(scale))
        return values @ (weight / weight.sum())

    def rosenblatt(self, u: np.ndarray) -> np.ndarray:
        """Values u (..., d) of this copula to independent uniforms (..., d), in the order of the variables."""
        z = np.linalg.solve(self._factor, self._scores(u)[..., None])[..., 0]
        before = np.cumsum(z**2, axis=-1) - z**2
        nu = self.degrees_of_freedom + np.arange(self.dimension)
        return special.stdtr(nu, z * np.sqrt(nu / (self.degrees_of_freedom + before)))

    def inverse_rosenblatt(self, w: np.ndarray) -> np.ndarray:
        """Independent uniforms (..., d) to values of this copula."""
        w = np.asarray(w, dtype=float)
        z = np.empty(w.shape)
        before = np.zeros(w.shape[:-1])
        for k in range(self.dimension):
            nu = self.degrees_of_freedom + k
            score = student_score(np.maximum(w[..., k], _TINY), np.maximum(1.0 - w[..., k], _TINY), nu)
            z[..., k] = score * np.sqrt((self.degrees_of_freedom + before) / nu)
            before = before + z[..., k] ** 2
        return special.stdtr(self.degrees_of_freedom, z @ self._factor.T)

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n independent rows, shape (n, d)."""
        return self.inverse_rosenblatt(rng.random((n, self.dimension)))

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary."""
        correlation = [list(row) for row in self.correlation]
        return {"family": "student", "correlation": correlation, "degrees_of_freedom": self.degrees_of_freedom}

    @staticmethod
    def from_dict(data: dict[str, Any]) -> StudentCopula:
        """The inverse of to_dict."""
        return StudentCopula(tuple(tuple(row) for row in data["correlation"]), data["degrees_of_freedom"])

    def _scores(self, u: np.ndarray) -> np.ndarray:
        u = np.asarray(u, dtype=float)
        return student_score(np.maximum(u, _TINY), np.maximum(1.0 - u, _TINY), self.degrees_of_freedom)


def from_dict(data: dict[str, Any]) -> GaussianCopula | StudentCopula:
    """The copula of which `data` is the dictionary."""
    kind = StudentCopula if "degrees_of_freedom" in data else GaussianCopula
    return kind.from_dict(data)


def _checked(family: str, correlation: Any) -> tuple[tuple[float, ...], ...]:
    """A correlation matrix as tuples; raises CopulaError unless it is one."""
    matrix = np.asarray(correlation, dtype=float)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.allclose(matrix, matrix.T, atol=1e-12):
        raise CopulaError(f"{family}: the correlation matrix must be square and symmetric")
    if not np.allclose(np.diag(matrix), 1.0, atol=1e-12) or np.linalg.eigvalsh(matrix)[0] <= 0.0:
        raise CopulaError(f"{family}: the correlation matrix needs a unit diagonal and positive eigenvalues")
    return tuple(tuple(float(value) for value in row) for row in matrix)


def fit_gaussian(x: np.ndarray) -> GaussianCopula:
    """Fit the Gaussian copula to x (n, d) by maximum pseudo-likelihood in all correlations together.

    The likelihood depends on the data only through the mean products S (d, d) of their normal scores.  If S is
    singular, as for n <= d or for columns of the same order, the likelihood has no maximum: eigenvalues of S below 1e-6
    are raised to 1e-6.  Raises CopulaError for fewer than 5 rows, a constant column or non-finite values.
    """
    x = np.asarray(x, dtype=float)
    if x.ndim != 2 or len(x) < 5 or x.shape[1] < 2:
        raise CopulaError(f"gaussian: values of the shape {x.shape}; need at least 5 rows and 2 columns")
    if not np.all(np.isfinite(x)):
        raise CopulaError("gaussian: a value is not finite")
    if np.any(np.ptp(x, axis=0) == 0.0):
        raise CopulaError("gaussian: one column is constant, so it has no ranks and no dependence")
    scores = _scores(pseudo_observations(x.T))
    values, vectors = np.linalg.eigh(scores @ scores.T / len(x))
    matrix = most_likely((vectors * np.maximum(values, SMALLEST_EIGENVALUE)) @ vectors.T)
    return GaussianCopula(tuple(map(tuple, matrix)))


def student_of_known_degrees(x: np.ndarray, degrees_of_freedom: float) -> StudentCopula:
    """Student's copula of x (n, d) with given degrees of freedom: correlations sin(pi tau / 2) of Kendall's tau.

    Eigenvalues of the matrix below 1e-6 are raised to 1e-6.  Raises CopulaError for a constant column.
    """
    d = x.shape[1]
    matrix = np.eye(d)
    for i in range(d):
        for j in range(i):
            tau = stats.kendalltau(x[:, i], x[:, j])[0]
            if not np.isfinite(tau):
                raise CopulaError("student: one column is constant, so it has no ranks and no dependence")
            matrix[i, j] = matrix[j, i] = np.sin(0.5 * np.pi * tau)
    values, vectors = np.linalg.eigh(matrix)
    if values[0] < SMALLEST_EIGENVALUE:
        matrix = (vectors * np.maximum(values, SMALLEST_EIGENVALUE)) @ vectors.T
        matrix /= np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
        np.fill_diagonal(matrix, 1.0)
    return StudentCopula(tuple(map(tuple, matrix)), degrees_of_freedom)


def most_likely(S: np.ndarray) -> np.ndarray:
    """Correlation matrix R (d, d) that maximises -(ln det R + tr(R^-1 S)) / 2, S (d, d) positive definite.

    Newton's method on the correlations (Fisher scoring where the second derivatives have a wrong sign); a step is
    halved until R is positive definite and the likelihood increases.
    """
    i, j = np.tril_indices(len(S), -1)
    scale = np.sqrt(np.diag(S))
    R = S / np.outer(scale, scale)
    np.fill_diagonal(R, 1.0)
    value = _loglik(R, S)
    for _ in range(100):
        Q = np.linalg.inv(R)
        P = Q @ S @ Q
        slope = (P - Q)[i, j]
        information = 0.5 * _traces(Q, Q, i, j)
        bend = 0.5 * (_traces(Q, P, i, j) + _traces(P, Q, i, j)) - information
        concave = np.linalg.eigvalsh(bend)[0] > 0.0
        step = np.zeros_like(S)
        step[i, j] = np.linalg.solve(bend if concave else information, slope)
        step += step.T
        gain = 0.5 * float(np.sum((P - Q) * step))
        while gain > 1e-12 and _loglik(R + step, S) < value:
            step, gain = 0.5 * step, 0.5 * gain
        R = R + step
        if gain <= 1e-12:
            break
        value = _loglik(R, S)
    return R


def _loglik(R: np.ndarray, S: np.ndarray) -> float:
    """-(ln det R + tr(R^-1 S)) / 2, or minus infinity where R is not positive definite."""
    try:
        factor = np.linalg.cholesky(R)
    except np.linalg.LinAlgError:
        return -np.inf
    return float(-np.log(np.diag(factor)).sum() - 0.5 * np.trace(np.linalg.solve(R, S)))


def _traces(A: np.ndarray, B: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """tr(A E_a B E_b) of symmetric A, B for all pairs a, b of correlations (i, j); E_a is 1 at (i, j) and (j, i)."""
    ii, ij, ji, jj = np.ix_(i, i), np.ix_(i, j), np.ix_(j, i), np.ix_(j, j)
    return A[ij] * B[ji] + A[ii] * B[jj] + A[jj] * B[ii] + A[ji] * B[ij]


def _scores(u: np.ndarray) -> np.ndarray:
    u = np.asarray(u, dtype=float)
    return normal_score(np.maximum(u, _TINY), np.maximum(1.0 - u, _TINY))
