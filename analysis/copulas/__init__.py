"""Copulas of two variables: families, fits to ranks, goodness of fit, selection; elliptical copulas for more.

`select` fits and tests the families on pairs, `choose` takes the best one, `multivariate` is for more than two columns.
Rule: numpy, scipy and `errors_and_files` only; no file, no pandas, and no other package of the analysis.
"""

from __future__ import annotations

from .family import CopulaError
from .fitting import CopulaFit, fit, fit_rows, pseudo_observations
from .model import FAMILIES, Copula
from .selection import PAPER_FAMILIES, candidates, choose, select

__all__ = [
    "FAMILIES",
    "PAPER_FAMILIES",
    "Copula",
    "CopulaError",
    "CopulaFit",
    "candidates",
    "choose",
    "fit",
    "fit_rows",
    "pseudo_observations",
    "select",
]
