"""Copulas of two variables: families, fitting on ranks, tests of fit and selection; a Gaussian one for more
variables.
"""

from __future__ import annotations

from analysis.copulas.family import CopulaError
from analysis.copulas.fitting import CopulaFit, fit, fit_rows, pseudo_observations
from analysis.copulas.model import FAMILIES, Copula
from analysis.copulas.selection import PAPER_FAMILIES, candidates, choose, select

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
