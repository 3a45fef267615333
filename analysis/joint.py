"""The joint distribution of the input variables: marginals bound by a copula (Sklar's theorem, Eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from analysis import copulas, marginals
from analysis.copulas.elliptical import normal_score
from analysis.copulas.multivariate import GaussianCopula, fit_gaussian
from analysis.inputs import check_pairs

_REACH = 7.5


@dataclass(frozen=True)
class Joint:
    """d marginals and their copula: `Copula` for two variables, `GaussianCopula` for any number.

    Arrays of points are (..., d) in the units of the marginals (mu_s: 1, G_p: Pa).
    """

    marginals: tuple[marginals.Marginal, ...]
    copula: copulas.Copula | GaussianCopula

    def __post_init__(self):
        object.__setattr__(self, "marginals", tuple(self.marginals))
        if len(self.marginals) != self.copula.dimension:
            raise copulas.CopulaError(
                f"{len(self.marginals)} marginals do not go with a copula of {self.copula.dimension} variables"
            )

    @property
    def dimension(self) -> int:
        """Number of variables d."""
        return len(self.marginals)

    def uniforms(self, x) -> np.ndarray:
        """Marginal probabilities F_i(x_i) of points x (..., d)."""
        x = np.asarray(x, dtype=float)
        return np.stack([m.cdf(x[..., i]) for i, m in enumerate(self.marginals)], axis=-1)

    def from_uniforms(self, u) -> np.ndarray:
        """Marginal quantiles of probabilities u (..., d); 0 and 1 give the last finite quantile."""
        u = np.clip(np.asarray(u, dtype=float), 1e-300, 1.0 - 2.0**-53)
        return np.stack([m.ppf(u[..., i]) for i, m in enumerate(self.marginals)], axis=-1)

    def logpdf(self, x) -> np.ndarray:
        """Log of the joint density at x (..., d); Eq. 1."""
        x = np.asarray(x, dtype=float)
        own = sum(m.logpdf(x[..., i]) for i, m in enumerate(self.marginals))
        u = self.uniforms(x)
        dependence = self.copula.logpdf(u[..., 0], u[..., 1]) if self._bivariate else self.copula.logpdf(u)
        return np.where(np.isfinite(own), own + dependence, -np.inf)

    def pdf(self, x) -> np.ndarray:
        """Joint density at x (..., d), in 1 / (unit of x_1 * unit of x_2 ...)."""
        return np.exp(self.logpdf(x))

    def cdf(self, x) -> np.ndarray:
        """P(X_1 <= x_1, X_2 <= x_2, ...) at x (..., d)."""
        u = self.uniforms(x)
        return self.copula.cdf(u[..., 0], u[..., 1]) if self._bivariate else self.copula.cdf(u)

    def rosenblatt(self, x) -> np.ndarray:
        """Points x (..., d) to independent uniforms, each variable conditioned on those before it."""
        return self.copula.rosenblatt(self.uniforms(x))

    def inverse_rosenblatt(self, w) -> np.ndarray:
        """Independent uniforms (..., d) to points of this distribution."""
        return self.from_uniforms(self.copula.inverse_rosenblatt(np.asarray(w, dtype=float)))

    def to_normal(self, x) -> np.ndarray:
        """Points x (..., d) to independent standard normals z, the space in which representative points have their
        cells.
        """
        w = self.rosenblatt(x)
        tiny = 1e-300
        return normal_score(np.maximum(w, tiny), np.maximum(1.0 - w, tiny))

    def from_normal(self, z) -> np.ndarray:
        """Independent standard normals (..., d) to points of this distribution."""
        return self.inverse_rosenblatt(special.ndtr(np.asarray(z, dtype=float)))

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n independent points, shape (n, d)."""
        return self.inverse_rosenblatt(rng.random((n, self.dimension)))

    def conditional_cdf(self, x2, x1) -> np.ndarray:
        """P(X_2 <= x2 | X_1 = x1) of the first two variables."""
        pair = np.stack(np.broadcast_arrays(np.asarray(x1, float), np.asarray(x2, float)), axis=-1)
        return self._first_two().rosenblatt(pair)[..., 1]

    def conditional_ppf(self, p, x1) -> np.ndarray:
        """The x2 with P(X_2 <= x2 | X_1 = x1) = p."""
        u1 = self.marginals[0].cdf(x1)
        w = np.stack(np.broadcast_arrays(u1, np.asarray(p, float)), axis=-1)
        return self.marginals[1].ppf(self._first_two().copula.inverse_rosenblatt(w)[..., 1])

    def expectation(self, function, nodes: int | None = None) -> np.ndarray:
        """E[function(x)] by Gauss-Legendre quadrature over independent normals; function maps (m, d) to (m,) or (m,
        k).
        """
        nodes = nodes or {1: 400, 2: 200, 3: 48}.get(self.dimension, 16)
        t, weight = np.polynomial.legendre.leggauss(nodes)
        t, weight = _REACH * t, _REACH * weight * np.exp(-0.5 * (_REACH * t) ** 2) / np.sqrt(2.0 * np.pi)
        z = np.stack(np.meshgrid(*[t] * self.dimension, indexing="ij"), axis=-1).reshape(-1, self.dimension)
        weights = np.prod(np.stack(np.meshgrid(*[weight] * self.dimension, indexing="ij"), axis=-1), axis=-1).ravel()
        return np.tensordot(weights / weights.sum(), function(self.from_normal(z)), axes=(0, 0))

    def moments(self, nodes: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Exact means (d,) and covariance matrix (d, d); the off-diagonal terms by quadrature with so many nodes."""
        mean = np.array([m.mean for m in self.marginals])
        std = np.array([m.std for m in self.marginals])
        upper = [(i, j) for i in range(self.dimension) for j in range(i)]
        covariance = np.diag(std**2)
        if upper:

            def products(x):
                y = (x - mean) / std
                return np.stack([y[:, i] * y[:, j] for i, j in upper], axis=1)

            for (i, j), value in zip(upper, self.expectation(products, nodes), strict=True):
                covariance[i, j] = covariance[j, i] = value * std[i] * std[j]
        return mean, covariance

    def to_dict(self) -> dict:
        """A JSON-ready dictionary."""
        return {"marginals": [m.to_dict() for m in self.marginals], "copula": self.copula.to_dict()}

    @staticmethod
    def from_dict(data: dict) -> Joint:
        """The inverse of to_dict."""
        kind = GaussianCopula if "correlation" in data["copula"] else copulas.Copula
        return Joint(tuple(map(marginals.Marginal.from_dict, data["marginals"])), kind.from_dict(data["copula"]))

    @property
    def _bivariate(self) -> bool:
        return isinstance(self.copula, copulas.Copula)

    def _first_two(self) -> Joint:
        if self.dimension == 2:
            return self
        return Joint(self.marginals[:2], GaussianCopula(tuple(row[:2] for row in self.copula.correlation[:2])))


@dataclass(frozen=True)
class JointFit:
    """Everything that fitting a set of pairs decided: the joint distribution, the tables behind it, and the reasons."""

    joint: Joint
    marginals: tuple[tuple[marginals.Marginal, ...], ...]
    copulas: tuple[copulas.CopulaFit, ...]
    note: str

    def to_dict(self) -> dict:
        """A JSON-ready dictionary: joint, marginal tables (one list a variable), copula table, note."""
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
) -> JointFit:
    """Fit marginals (smallest AIC) and copula (smallest AIC among those the bootstrap accepts) to pairs (n, 2).

    More than two columns, (n, d), are joined by a Gaussian copula; its table of copulas is empty.
    """
    pairs = check_pairs(pairs)
    tables = tuple(tuple(marginals.fit_all(column, marginal_families, seed=seed)) for column in pairs.T)
    if pairs.shape[1] > 2:
        joint = Joint(tuple(table[0] for table in tables), fit_gaussian(pairs))
        return JointFit(joint, tables, (), f"gaussian: the only copula here for {pairs.shape[1]} variables; no test")
    fits = copulas.select(pairs[:, 0], pairs[:, 1], copula_families, n_boot, np.random.default_rng(seed))
    best, note = copulas.choose(fits)
    return JointFit(Joint(tuple(table[0] for table in tables), best.copula), tables, tuple(fits), note)


def bootstrap_joints(
    pairs: np.ndarray, n_boot: int, rng: np.random.Generator, joint: Joint | None = None
) -> list[Joint]:
    """Joint distributions refitted to n_boot resamplings (with replacement) of the pairs (n, d): the input's
    uncertainty.

    Families are those of `joint`, or those that `fit_joint` picks for the pairs (by AIC alone) when it is None.
    """
    pairs = check_pairs(pairs)
    joint = fit_joint(pairs, n_boot=0).joint if joint is None else joint
    drawn = pairs[rng.integers(0, len(pairs), (n_boot, len(pairs)))]
    names = [list(m.params) for m in joint.marginals]
    columns = [marginals.fit_rows(drawn[..., i], m.family) for i, m in enumerate(joint.marginals)]
    if isinstance(joint.copula, GaussianCopula):
        refitted = [fit_gaussian(rows) for rows in drawn]
    else:
        u, v = copulas.pseudo_observations(drawn[..., 0]), copulas.pseudo_observations(drawn[..., 1])
        dependence = copulas.fit_rows(u, v, joint.copula.family)
        refitted = [copulas.Copula(joint.copula.family, tuple(row.tolist())) for row in dependence]
    return [
        Joint(
            tuple(
                marginals.Marginal(m.family, dict(zip(names[i], columns[i][k].tolist(), strict=True)))
                for i, m in enumerate(joint.marginals)
            ),
            refitted[k],
        )
        for k in range(n_boot)
    ]
