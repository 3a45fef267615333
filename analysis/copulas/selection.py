"""Selection of a copula: fit all candidates, test them by parametric bootstrap, take the least AIC of the accepted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from . import goodness
from .family import CopulaError
from .fitting import CopulaFit, fit, pseudo_observations
from .model import FAMILIES

PAPER_FAMILIES = ("gaussian", "student", "frank", "plackett")
_TURNING = ("clayton", "gumbel", "joe")
#: Significance level of the bootstrap test.
LEVEL = 0.05


def select(
    x: ArrayLike,
    y: ArrayLike,
    families: tuple[str, ...] | None = None,
    n_boot: int = 1000,
    rng: np.random.Generator | None = None,
) -> list[CopulaFit]:
    """Fit and test copulas on n pairs and return them best first: accepted ones by AIC, then rejected ones by AIC.

    x, y (n,) are ranked first.  `families=None` tries every candidate that can have the sign of dependence of the data;
    `clayton`, `gumbel` and `joe` without an angle mean their two rotations of that sign.  `n_boot=0` skips the tests
    and sorts by AIC alone.  Raises CopulaError as `fit` does.
    """
    u, v = np.asarray(x, dtype=float).ravel(), np.asarray(y, dtype=float).ravel()
    rng = np.random.default_rng(1) if rng is None else rng
    fits = [fit(u, v, family) for family in candidates(u, v, families)]
    if n_boot:
        pairs = np.stack([pseudo_observations(u), pseudo_observations(v)], axis=1)
        reference = goodness.independent_reference(len(pairs), n_boot, rng)
        seed = int(rng.integers(2**63))
        fits = [_tested(candidate, pairs, n_boot, reference, seed) for candidate in fits]
    return sorted(fits, key=lambda candidate: (candidate.accepted is False, candidate.aic))


def choose(fits: list[CopulaFit]) -> tuple[CopulaFit, str]:
    """The first fit of the list that `select` returns, and a sentence on why it is chosen."""
    best = fits[0]
    if best.accepted is None:
        return best, f"{best.family}: smallest pseudo-AIC ({best.aic:.2f}) of {len(fits)} families; no test was made"
    if best.accepted:
        count = sum(1 for candidate in fits if candidate.accepted)
        return (
            best,
            f"{best.family}: smallest pseudo-AIC ({best.aic:.2f}) of the {count} families the bootstrap accepts",
        )
    largest = max(candidate.p_bootstrap for candidate in fits if candidate.p_bootstrap is not None)
    return best, (
        f"{best.family}: the bootstrap rejects all {len(fits)} families "
        f"(largest p = {largest:.3f}); "
        f"the smallest pseudo-AIC ({best.aic:.2f}) is taken nevertheless"
    )


def candidates(x: ArrayLike, y: ArrayLike, families: tuple[str, ...] | None = None) -> tuple[str, ...]:
    """The families to try on pairs x, y (n,), with the rotations that the sign of Kendall's tau allows.

    Raises CopulaError for an unknown family.
    """
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


def _tested(fitted: CopulaFit, pairs: np.ndarray, n_boot: int, reference: np.ndarray, seed: int) -> CopulaFit:
    """The fit with the results of its test; every family has the same random numbers."""
    parameters = np.array(fitted.parameters)
    S, p = goodness.bootstrap_test(pairs, fitted.family, parameters, n_boot, np.random.default_rng(seed))
    of_paper = goodness.statistic_of_one_order(pairs[None], fitted.family, parameters[None])[0]
    p_paper = float(np.mean(reference > of_paper))
    return replace(fitted, S=S, p_paper=p_paper, p_bootstrap=p, accepted=bool(p > LEVEL), n_boot=n_boot)
