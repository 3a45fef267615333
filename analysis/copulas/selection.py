"""Choosing a copula: fit every candidate, test each by parametric bootstrap, take the smallest AIC among the
accepted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from analysis import goodness
from analysis.copulas.family import CopulaError
from analysis.copulas.fitting import CopulaFit, fit, pseudo_observations
from analysis.copulas.model import FAMILIES

PAPER_FAMILIES = ("gaussian", "student", "frank", "plackett")
_TURNING = ("clayton", "gumbel", "joe")
LEVEL = 0.05


def select(
    x,
    y,
    families: tuple[str, ...] | None = None,
    n_boot: int = 1000,
    rng: np.random.Generator | None = None,
) -> list[CopulaFit]:
    """Fit and test copulas on n pairs and return them best first: accepted ones by AIC, then rejected ones by AIC.

    `families=None` takes every candidate whose sign fits the data; a bare `clayton`, `gumbel` or `joe` stands for its
    two rotations of the right sign. `n_boot=0` skips the tests and orders by AIC alone. x, y (n,) are ranked first.
    """
    u, v = np.asarray(x, dtype=float).ravel(), np.asarray(y, dtype=float).ravel()
    rng = np.random.default_rng(1) if rng is None else rng
    fits = [fit(u, v, family) for family in candidates(u, v, families)]
    if n_boot:
        pairs = np.stack([pseudo_observations(u), pseudo_observations(v)], axis=1)
        reference = goodness.independent_reference(len(pairs), n_boot, rng)
        fits = [_tested(one, pairs, n_boot, reference, rng) for one in fits]
    return sorted(fits, key=lambda one: (one.accepted is False, one.aic))


def choose(fits: list[CopulaFit]) -> tuple[CopulaFit, str]:
    """The first of `select`'s list and a sentence on why it was taken."""
    best = fits[0]
    if best.accepted is None:
        return best, f"{best.family}: smallest pseudo-AIC ({best.aic:.2f}) of {len(fits)} families; no test was made"
    if best.accepted:
        count = sum(1 for one in fits if one.accepted)
        return (
            best,
            f"{best.family}: smallest pseudo-AIC ({best.aic:.2f}) of the {count} families the bootstrap accepts",
        )
    return best, (
        f"{best.family}: the bootstrap rejects all {len(fits)} families "
        f"(largest p = {max(one.p_bootstrap for one in fits):.3f}); "
        f"the smallest pseudo-AIC ({best.aic:.2f}) is taken nevertheless"
    )


def candidates(x, y, families: tuple[str, ...] | None = None) -> tuple[str, ...]:
    """The families to try on pairs x, y (n,): rotations are resolved by the sign of Kendall's tau."""
    positive = not stats.kendalltau(x, y)[0] < 0.0
    chosen = (*PAPER_FAMILIES, "independence", *_TURNING) if families is None else families
    names: list[str] = []
    for name in chosen:
        if name in _TURNING:
            names += [name, f"{name}180"] if positive else [f"{name}90", f"{name}270"]
        elif name in FAMILIES:
            names.append(name)
        else:
            raise CopulaError(f"unknown copula family {name!r}; known: {', '.join(FAMILIES)}")
    return tuple(dict.fromkeys(names))


def _tested(one: CopulaFit, pairs: np.ndarray, n_boot: int, reference: np.ndarray, rng) -> CopulaFit:
    S, p = goodness.bootstrap_test(pairs, one.family, one.parameters, n_boot, rng)
    return replace(
        one, S=S, p_paper=float(np.mean(reference > S)), p_bootstrap=p, accepted=bool(p > LEVEL), n_boot=n_boot
    )
