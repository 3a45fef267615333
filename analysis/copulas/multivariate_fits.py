"""Fits of the Gaussian and Student's copula of d >= 2 variables by maximum pseudo-likelihood, and the choice by AIC."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from . import multivariate
from .elliptical import LARGEST_NU, SMALLEST_NU, student_score
from .family import CopulaError
from .fitting import pseudo_observations
from .multivariate import GaussianCopula, StudentCopula, fit_gaussian

FAMILIES = ("gaussian", "student")
#: Steps of the iteration for a correlation matrix, and the change of a correlation that ends it.
_STEPS, _CLOSE = 200, 1e-9
#: Inverse degrees of freedom that are tried before the best of them is improved.
_KAPPAS = np.array([1.0 / LARGEST_NU, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0 / SMALLEST_NU])


@dataclass(frozen=True)
class MultivariateFit:
    """One copula of d variables fitted to n rows; `names` are those of its parameters.

    `loglik`, `aic` and `bic` are pseudo-likelihood values, because they are computed from ranks.  There is no test of
    the fit: `accepted` and `p_bootstrap` are None, as in an untested `CopulaFit`.
    """

    copula: GaussianCopula | StudentCopula
    names: tuple[str, ...]
    n: int
    loglik: float
    accepted: bool | None = None
    p_bootstrap: float | None = None

    @property
    def family(self) -> str:
        """Name of the family."""
        return "student" if isinstance(self.copula, StudentCopula) else "gaussian"

    @property
    def parameters(self) -> tuple[float, ...]:
        """The correlations, row by row below the diagonal, and for Student's copula the degrees of freedom."""
        return copula_parameters(self.copula)

    @property
    def aic(self) -> float:
        """Akaike's criterion."""
        return 2 * len(self.parameters) - 2 * self.loglik

    @property
    def bic(self) -> float:
        """Bayesian criterion."""
        return len(self.parameters) * float(np.log(self.n)) - 2 * self.loglik

    @property
    def at_bounds(self) -> tuple[tuple[str, float, str], ...]:
        """Parameters at an end of their range: (name, limit, the simpler copula that it practically is, or "")."""
        if not isinstance(self.copula, StudentCopula):
            return ()
        nu = self.copula.degrees_of_freedom
        ends = ((LARGEST_NU, "gaussian", nu >= 0.99 * LARGEST_NU), (SMALLEST_NU, "", nu <= 1.01 * SMALLEST_NU))
        return tuple((self.names[-1], limit, simpler) for limit, simpler, reached in ends if reached)

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary."""
        numbers = {name: getattr(self, name) for name in ("n", "loglik", "aic", "bic")}
        return {"family": self.family, "parameters": list(self.parameters), "names": list(self.names), **numbers}


def copula_parameters(copula: GaussianCopula | StudentCopula) -> tuple[float, ...]:
    """The parameters in the order of `parameter_names`."""
    matrix = np.array(copula.correlation)
    correlations = tuple(matrix[np.tril_indices(len(matrix), -1)].tolist())
    return (*correlations, float(copula.degrees_of_freedom)) if isinstance(copula, StudentCopula) else correlations


def parameter_names(variables: Sequence[str], family: str) -> tuple[str, ...]:
    """Names of the parameters of a copula of these variables: rho(one, other), and for Student's degrees_of_freedom."""
    pairs = tuple(f"rho({variables[j]}, {variables[i]})" for i in range(len(variables)) for j in range(i))
    return (*pairs, "degrees_of_freedom") if family == "student" else pairs


def select_multivariate(
    x: np.ndarray, variables: Sequence[str], families: Sequence[str] | None = None
) -> list[MultivariateFit]:
    """Fit the copulas of FAMILIES that are in `families` (None: all) to x (n, d); the smallest AIC first.

    `variables` (d) name the columns.  Raises CopulaError if none of FAMILIES is in `families`, or for values that
    cannot be fitted.
    """
    wanted = [name for name in FAMILIES if families is None or name in families]
    if not wanted:
        raise CopulaError(
            f"{', '.join(families or ())}: no copula of {len(variables)} variables here; choose from "
            f"{', '.join(FAMILIES)}"
        )
    u = pseudo_observations(np.asarray(x, dtype=float).T).T
    fits = []
    for family in wanted:
        copula = fit_gaussian(x) if family == "gaussian" else fit_student(x)
        loglik = float(copula.logpdf(u).sum())
        fits.append(MultivariateFit(copula, parameter_names(variables, family), len(u), loglik))
    return sorted(fits, key=lambda fit: fit.aic)


def fit_student(x: np.ndarray) -> StudentCopula:
    """Fit Student's copula to x (n, d) by maximum pseudo-likelihood.

    The correlations maximise the likelihood for given degrees of freedom, which are profiled over [1, 200].  Raises
    CopulaError as `fit_gaussian`.
    """
    start = np.array(fit_gaussian(x).correlation)
    u = pseudo_observations(np.asarray(x, dtype=float).T).T
    tried = []
    for kappa in _KAPPAS:
        tried.append(_student(u, kappa, start))
        start = np.array(tried[-1].correlation)
    best = int(np.argmax([copula.logpdf(u).sum() for copula in tried]))
    start = np.array(tried[best].correlation)
    ends = _KAPPAS[max(best - 1, 0)], _KAPPAS[min(best + 1, len(_KAPPAS) - 1)]
    found = optimize.minimize_scalar(
        lambda kappa: -_student(u, kappa, start).logpdf(u).sum(), bounds=ends, method="bounded", options={"xatol": 1e-5}
    )
    improved = _student(u, float(found.x), start)
    return max((tried[best], improved), key=lambda copula: float(copula.logpdf(u).sum()))


def _student(u: np.ndarray, kappa: float, start: np.ndarray) -> StudentCopula:
    """The most likely correlations for 1 / kappa degrees of freedom, by expectation and conditional maximisation.

    Student's variables are normal ones over a random scale: with the expected scales w = (nu + d) / (nu + z' R^-1 z) as
    weights, R maximises the normal likelihood of the weighted mean products (Liu and Rubin 1995).
    """
    nu, d = min(1.0 / kappa, LARGEST_NU), u.shape[1]
    scores = student_score(u, 1.0 - u, nu)
    R = start
    for _ in range(_STEPS):
        squares = np.einsum("ni,ij,nj->n", scores, np.linalg.inv(R), scores)
        weights = (nu + d) / (nu + squares)
        S = (scores * weights[:, None]).T @ scores / len(u)
        values, vectors = np.linalg.eigh(S)
        floor = multivariate.SMALLEST_EIGENVALUE * values[-1]
        before, R = R, multivariate.most_likely((vectors * np.maximum(values, floor)) @ vectors.T)
        if np.abs(R - before).max() < _CLOSE:
            break
    return StudentCopula(tuple(map(tuple, R.tolist())), nu)
