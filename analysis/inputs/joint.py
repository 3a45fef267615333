"""The joint distribution of the input variables: marginals joined by a copula (Sklar's theorem, Eq. 1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from .. import copulas
from ..copulas import multivariate
from ..copulas.elliptical import normal_score
from ..copulas.multivariate import GaussianCopula, StudentCopula, fit_gaussian, student_of_known_degrees
from ..copulas.multivariate_fits import MultivariateFit, select_multivariate
from . import marginals, refits
from .pairs import InputError, check_pairs

#: Resampled values that are refitted at a time, where samples have more than _LARGEST_AT_ONCE pairs.
_AT_ONCE, _LARGEST_AT_ONCE = 4_000_000, 5000
#: Limit of the quadrature in standard deviations of the normals; the probability beyond it is 6e-14.
_REACH = 7.5
#: Largest correlation of two of more than two variables; beyond it the points cannot tell them apart.
_LARGEST_CORRELATION = 0.999


@dataclass(frozen=True)
class Joint:
    """d marginals and their copula: `Copula` for two variables, `GaussianCopula`, `StudentCopula` for any number.

    Arrays of points are (..., d) in the units of the marginals (mu_s: 1, G_p: Pa).  Raises CopulaError if the copula
    has another number of variables.
    """

    marginals: tuple[marginals.Marginal, ...]
    copula: copulas.Copula | GaussianCopula | StudentCopula

    def __post_init__(self) -> None:
        object.__setattr__(self, "marginals", tuple(self.marginals))
        if len(self.marginals) != self.copula.dimension:
            raise copulas.CopulaError(
                f"{len(self.marginals)} marginals do not fit a copula of {self.copula.dimension} variables"
            )

    @property
    def dimension(self) -> int:
        """Number of variables d."""
        return len(self.marginals)

    def uniforms(self, x: ArrayLike) -> np.ndarray:
        """Marginal probabilities F_i(x_i) of points x (..., d)."""
        x = np.asarray(x, dtype=float)
        return np.stack([m.cdf(x[..., i]) for i, m in enumerate(self.marginals)], axis=-1)

    def from_uniforms(self, u: ArrayLike) -> np.ndarray:
        """Marginal quantiles (..., d) at probabilities u (..., d); 0 and 1 give the last finite quantile."""
        inside = np.clip(np.asarray(u, dtype=float), 1e-300, 1.0 - 2.0**-53)
        return np.stack([m.ppf(inside[..., i]) for i, m in enumerate(self.marginals)], axis=-1)

    def logpdf(self, x: ArrayLike) -> np.ndarray:
        """Log of the joint PDF at x (..., d); Eq. 1."""
        x = np.asarray(x, dtype=float)
        of_marginals = sum(m.logpdf(x[..., i]) for i, m in enumerate(self.marginals))
        u = self.uniforms(x)
        if isinstance(self.copula, copulas.Copula):
            of_copula = self.copula.logpdf(u[..., 0], u[..., 1])
        else:
            of_copula = self.copula.logpdf(u)
        return np.where(np.isfinite(of_marginals), of_marginals + of_copula, -np.inf)

    def pdf(self, x: ArrayLike) -> np.ndarray:
        """Joint PDF at x (..., d), in 1 / (unit of x_1 * unit of x_2 ...)."""
        return np.exp(self.logpdf(x))

    def cdf(self, x: ArrayLike) -> np.ndarray:
        """P(X_1 <= x_1, X_2 <= x_2, ...) at x (..., d)."""
        u = self.uniforms(x)
        if isinstance(self.copula, copulas.Copula):
            return self.copula.cdf(u[..., 0], u[..., 1])
        return self.copula.cdf(u)

    def rosenblatt(self, x: ArrayLike) -> np.ndarray:
        """Points x (..., d) to independent uniforms (..., d), each variable conditional on those before it."""
        return self.copula.rosenblatt(self.uniforms(x))

    def inverse_rosenblatt(self, w: ArrayLike) -> np.ndarray:
        """Independent uniforms (..., d) to points of this distribution."""
        return self.from_uniforms(self.copula.inverse_rosenblatt(np.asarray(w, dtype=float)))

    def to_normal(self, x: ArrayLike) -> np.ndarray:
        """Points x (..., d) to independent standard normals (..., d), where the cells of the points are defined."""
        w = self.rosenblatt(x)
        tiny = 1e-300
        return normal_score(np.maximum(w, tiny), np.maximum(1.0 - w, tiny))

    def from_normal(self, z: ArrayLike) -> np.ndarray:
        """Independent standard normals (..., d) to points of this distribution."""
        return self.inverse_rosenblatt(special.ndtr(np.asarray(z, dtype=float)))

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n independent points, shape (n, d)."""
        return self.inverse_rosenblatt(rng.random((n, self.dimension)))

    def conditional_cdf(self, x2: ArrayLike, x1: ArrayLike) -> np.ndarray:
        """P(X_2 <= x2 | X_1 = x1) of the first two variables."""
        pair = np.stack(np.broadcast_arrays(np.asarray(x1, float), np.asarray(x2, float)), axis=-1)
        return self.pair(0, 1).rosenblatt(pair)[..., 1]

    def conditional_ppf(self, p: ArrayLike, x1: ArrayLike) -> np.ndarray:
        """x2 from P(X_2 <= x2 | X_1 = x1) = p, of the first two variables."""
        u1 = self.marginals[0].cdf(x1)
        w = np.stack(np.broadcast_arrays(u1, np.asarray(p, float)), axis=-1)
        return self.marginals[1].ppf(self.pair(0, 1).copula.inverse_rosenblatt(w)[..., 1])

    def expectation(self, function: Callable[[np.ndarray], np.ndarray], nodes: int | None = None) -> np.ndarray:
        """E[function(x)] by Gauss-Legendre quadrature over independent normals, `nodes` per variable.

        function maps points (m, d) to (m,) or (m, k); the result is a number or (k,).
        """
        nodes = nodes or {1: 400, 2: 200, 3: 48}.get(self.dimension, 16)
        t, weight = np.polynomial.legendre.leggauss(nodes)
        t, weight = _REACH * t, _REACH * weight * np.exp(-0.5 * (_REACH * t) ** 2) / np.sqrt(2.0 * np.pi)
        z = np.stack(np.meshgrid(*[t] * self.dimension, indexing="ij"), axis=-1).reshape(-1, self.dimension)
        weights = np.prod(np.stack(np.meshgrid(*[weight] * self.dimension, indexing="ij"), axis=-1), axis=-1).ravel()
        return np.tensordot(weights / weights.sum(), function(self.from_normal(z)), axes=(0, 0))

    def moments(self, nodes: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Exact means (d,) and covariance matrix (d, d).

        An off-diagonal term is a quadrature as in `expectation` over the two variables, whatever d is.
        """
        mean = np.array([m.mean for m in self.marginals])
        std = np.array([m.std for m in self.marginals])
        covariance = np.diag(std**2)
        for i in range(self.dimension):
            for j in range(i):
                two, centre, scale = self.pair(j, i), mean[[j, i]], std[[j, i]]

                def product(x: np.ndarray, centre: np.ndarray = centre, scale: np.ndarray = scale) -> np.ndarray:
                    y = (x - centre) / scale
                    return (y[:, 1] * y[:, 0])[:, None]

                covariance[i, j] = covariance[j, i] = two.expectation(product, nodes)[0] * std[i] * std[j]
        return mean, covariance

    def pair(self, i: int, j: int) -> Joint:
        """The joint distribution of the variables i < j alone."""
        if self.dimension == 2 or isinstance(self.copula, copulas.Copula):
            return self
        rows = self.copula.correlation
        part = tuple(tuple(rows[a][b] for b in (i, j)) for a in (i, j))
        return Joint((self.marginals[i], self.marginals[j]), replace(self.copula, correlation=part))

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary."""
        return {"marginals": [m.to_dict() for m in self.marginals], "copula": self.copula.to_dict()}

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Joint:
        """The inverse of to_dict."""
        restored = multivariate.from_dict if "correlation" in data["copula"] else copulas.Copula.from_dict
        return Joint(tuple(map(marginals.Marginal.from_dict, data["marginals"])), restored(data["copula"]))


@dataclass(frozen=True)
class JointFit:
    """Result of a fit to pairs: the joint distribution, all fitted marginals and copulas (best first), the reason."""

    joint: Joint
    marginals: tuple[tuple[marginals.Marginal, ...], ...]
    copulas: tuple[copulas.CopulaFit | MultivariateFit, ...]
    note: str

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary: joint, marginal tables (one list per variable), copula table, note."""
        return {
            "joint": self.joint.to_dict(),
            "marginals": [[m.to_dict() for m in table] for table in self.marginals],
            "copulas": [c.to_dict() for c in self.copulas],
            "note": self.note,
        }


def fit_joint(
    pairs: np.ndarray,
    marginal_families: tuple[str, ...] = tuple(marginals.FAMILIES),
    copula_families: tuple[str, ...] | None = None,
    n_boot: int = 1000,
    seed: int = 1,
    names: Sequence[str] = ("mu_s", "G_p"),
) -> JointFit:
    """Fit marginals (smallest AIC) and a copula (smallest AIC among those the bootstrap accepts) to measured pairs.

    Parameters
    ----------
    pairs : array (n, d)
        Columns in SI units, for two variables mu_s (1) and G_p (Pa).  More than two get the Gaussian or Student's
        copula, the one with the smaller AIC, without a test of its fit.
    marginal_families : tuple of str
        Families to try for every marginal.
    copula_families : tuple of str, optional
        Families to try for the copula, by default all that can have the sign of dependence of the pairs.
    n_boot : int
        Bootstrap samples for the test of each copula; 0 for no test.
    seed : int
        Seed of the random numbers.
    names : sequence of str
        Symbols of the columns, for the parameters of a copula of more than two variables.

    Returns
    -------
    JointFit
        The joint distribution, all fitted marginals and copulas (best first), and the reason of the choice.

    Raises
    ------
    InputError, MarginalError, CopulaError
        For pairs that cannot be fitted or an unknown family.

    Examples
    --------
    >>> fit = fit_joint(read_pairs("data/pairs_reconstructed.csv"), n_boot=0)
    >>> [marginal.family for marginal in fit.joint.marginals], fit.joint.copula.family
    (['lognormal', 'lognormal'], 'gaussian')
    >>> round(fit.joint.copula.tau, 2)
    -0.53
    """
    pairs = check_pairs(pairs)
    tables = tuple(tuple(marginals.fit_all(column, marginal_families, seed=seed)) for column in pairs.T)
    if pairs.shape[1] > 2:
        d = pairs.shape[1]
        named = names if len(names) == d else [f"x{i + 1}" for i in range(d)]
        found = select_multivariate(pairs, named, copula_families)
        _refuse_repeated(found[0].copula.correlation, names if len(names) == d else [])
        joint = Joint(tuple(table[0] for table in tables), found[0].copula)
        note = f"{found[0].family}: smallest pseudo-AIC; the fit of a copula of {d} variables is not tested"
        return JointFit(joint, tables, tuple(found), note)
    fits = copulas.select(pairs[:, 0], pairs[:, 1], copula_families, n_boot, np.random.default_rng(seed))
    best, note = copulas.choose(fits)
    return JointFit(Joint(tuple(table[0] for table in tables), best.copula), tables, tuple(fits), note)


def _refuse_repeated(correlation: Sequence[Sequence[float]], names: Sequence[str]) -> None:
    """Raise InputError if one of more than two variables is a function of another, as far as ranks can tell."""
    matrix = np.abs(np.array(correlation)) - np.eye(len(correlation))
    i, j = (int(k) for k in np.unravel_index(np.argmax(matrix), matrix.shape))
    if matrix[i, j] > _LARGEST_CORRELATION:
        one, other = (names[k] if names else f"column {k + 1}" for k in sorted((i, j)))
        raise InputError(
            f"{one} and {other} have a correlation of {correlation[i][j]:.5f}, limit ±{_LARGEST_CORRELATION}: one is a "
            "function of the other; leave one of the two out"
        )


def bootstrap_joints(
    pairs: np.ndarray,
    n_boot: int,
    rng: np.random.Generator,
    joint: Joint | None = None,
    candidates: refits.Candidates | None = None,
) -> list[Joint]:
    """Joint distributions refitted to n_boot bootstrap samples of the pairs (n, d): the uncertainty of the inputs.

    With `candidates` every sample chooses its families again by AIC; only the copula of over two variables stays, as do
    the degrees of freedom of Student's.  Without them the families are those of `joint`; if this is None too, those
    that `fit_joint` selects for the pairs by AIC alone.
    """
    pairs = check_pairs(pairs)
    joint = fit_joint(pairs, n_boot=0).joint if joint is None else joint
    families: refits.Candidates = candidates or _families(joint)
    if isinstance(joint.copula, copulas.Copula):
        u, v = copulas.pseudo_observations(pairs.T)
        possible = refits.possible_copulas(u, v, families.copulas)
        families = refits.Candidates(families.marginals, possible)
    block = n_boot if len(pairs) <= _LARGEST_AT_ONCE else max(1, _AT_ONCE // len(pairs))
    counts = [min(block, n_boot - start) for start in range(0, n_boot, max(1, block))]
    return [refitted for count in counts for refitted in _refitted(pairs, count, rng, joint, families)]


def _families(joint: Joint) -> refits.Candidates:
    """The families of a joint distribution as the only candidates."""
    family = joint.copula.family if isinstance(joint.copula, copulas.Copula) else "gaussian"
    return refits.Candidates(tuple((m.family,) for m in joint.marginals), (family,))


def _refitted(
    pairs: np.ndarray, n_boot: int, rng: np.random.Generator, joint: Joint, families: refits.Candidates
) -> list[Joint]:
    """The joint distributions of `bootstrap_joints`, of samples that fit into memory at once."""
    resampled = pairs[rng.integers(0, len(pairs), (n_boot, len(pairs)))]
    columns = [
        refits.refitted_marginals(resampled[..., i], names, fitted)
        for i, (names, fitted) in enumerate(zip(families.marginals, joint.marginals, strict=True))
    ]
    dependence: Sequence[copulas.Copula | GaussianCopula | StudentCopula]
    if isinstance(joint.copula, copulas.Copula):
        u, v = (copulas.pseudo_observations(resampled[..., i]) for i in (0, 1))
        dependence = refits.refitted_copulas(u, v, families.copulas)
    elif isinstance(joint.copula, StudentCopula):
        dependence = [student_of_known_degrees(rows, joint.copula.degrees_of_freedom) for rows in resampled]
    else:
        dependence = [fit_gaussian(rows) for rows in resampled]
    return [Joint(of_row, copula) for of_row, copula in zip(zip(*columns, strict=True), dependence, strict=True)]
