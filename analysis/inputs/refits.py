"""Fits to many bootstrap samples of pairs at once, which may choose their families again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import copulas
from ..copulas.model import evaluate, family_of
from . import kernel_marginal, marginals

#: A family is left out of the choice if its AIC exceeds the smallest one by this and by as many standard deviations.
_AIC_MARGIN, _DEVIATIONS = 10.0, 6.0


@dataclass(frozen=True)
class Candidates:
    """Families from which every bootstrap sample chooses by AIC: one tuple per marginal, and the copulas."""

    marginals: tuple[tuple[str, ...], ...]
    copulas: tuple[str, ...]

    @staticmethod
    def tried(marginal_fits: Mapping[str, Sequence[Any]], copula_fits: Sequence[Any]) -> Candidates | None:
        """The families that were fitted, from tables of fits or of their dicts, best first; None if there are none.

        `marginal_fits` is keyed by symbol.  A kernel density is not offered beside families: bootstrap samples repeat
        values, which it would follow.  A chosen kernel density stays.
        """
        tables = [[_family(fit) for fit in table] for table in marginal_fits.values()]
        if not all(tables) or not tables or not copula_fits:
            return None
        kernel = kernel_marginal.NAME
        chosen = (table[:1] if table[0] == kernel else [name for name in table if name != kernel] for table in tables)
        return Candidates(tuple(map(tuple, chosen)), tuple(map(_family, copula_fits)))


def _family(fit: Any) -> str:
    return str(fit["family"] if isinstance(fit, Mapping) else fit.family)


def refitted_marginals(
    samples: np.ndarray, families: Sequence[str], fitted: marginals.Marginal
) -> list[marginals.Marginal]:
    """The family of smallest AIC for each row of samples (R, n); a kernel density keeps the bandwidth of `fitted`."""
    if fitted.family == kernel_marginal.NAME:
        h = fitted.params["bandwidth_ln"]
        return [
            marginals.Marginal(fitted.family, fitted.params, tuple(kernel_marginal.centres(row, h))) for row in samples
        ]
    estimates, aic = [], []
    for family in families:
        kind = marginals.family_of(family)
        estimates.append(kind.mle(samples))
        loglik = kind.logpdf(samples, *(estimates[-1][:, [j]] for j in range(estimates[-1].shape[1]))).sum(axis=1)
        aic.append(2.0 * len(kind.names) - 2.0 * np.where(np.isfinite(loglik), loglik, -np.inf))
    best = np.argmin(aic, axis=0)
    names = [marginals.family_of(family).names for family in families]
    return [
        marginals.Marginal(families[k], dict(zip(names[k], estimates[k][row].tolist(), strict=True)))
        for row, k in enumerate(best)
    ]


def refitted_copulas(u: np.ndarray, v: np.ndarray, families: Sequence[str]) -> list[copulas.Copula]:
    """The family of smallest pseudo-AIC for each row of pseudo-observations u, v (R, n), without a test of fit."""
    estimates = [copulas.fit_rows(u, v, family) for family in families]
    if len(families) == 1:
        best = np.zeros(len(u), dtype=int)
    else:
        logliks = [_logliks(u, v, f, e).sum(axis=1) for f, e in zip(families, estimates, strict=True)]
        penalty = [2.0 * len(family_of(family).names) for family in families]
        best = np.argmin(np.array(penalty)[:, None] - 2.0 * np.array(logliks), axis=0)
    return [copulas.Copula(families[k], tuple(estimates[k][row].tolist())) for row, k in enumerate(best)]


def possible_copulas(u: np.ndarray, v: np.ndarray, families: Sequence[str]) -> tuple[str, ...]:
    """The families that a bootstrap sample of pseudo-observations u, v (n,) may choose with any real probability.

    The difference of the log-likelihoods of two families in bootstrap samples has nearly a normal distribution: its
    mean is that of the sample, its variance n times the variance over the pairs.  Families more than six standard
    deviations and an AIC of 10 behind the best one are left out.
    """
    if len(families) == 1:
        return tuple(families)
    logliks = [_logliks(u[None], v[None], f, copulas.fit_rows(u[None], v[None], f))[0] for f in families]
    aic = np.array([2.0 * len(family_of(f).names) - 2.0 * one.sum() for f, one in zip(families, logliks, strict=True)])
    best = int(np.argmin(aic))
    limit = [_AIC_MARGIN + 2.0 * _DEVIATIONS * np.sqrt(len(u)) * np.std(one - logliks[best]) for one in logliks]
    return tuple(f for f, behind, most in zip(families, aic - aic[best], limit, strict=True) if behind <= most)


def _logliks(u: np.ndarray, v: np.ndarray, family: str, estimates: np.ndarray) -> np.ndarray:
    """Log PDF (R, n) of each pair of pseudo-observations u, v (R, n) under the copula of its row (R, k)."""
    columns = [estimates[:, [j]] for j in range(estimates.shape[1])]
    return evaluate(family_of(family), "logpdf", u, v, *columns)
