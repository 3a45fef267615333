"""The copulas beside pyvinecopulib and OpenTURNS; skipped where a library is not installed.

On a grid of powers of two down to 2^-30 from every edge.  Where a library iterates or rounds its parameter itself, the
comparison is left to the other one and to the closed forms of test_copulas.py.
"""

from __future__ import annotations

import numpy as np
import pytest
from copula_cases import CASES, U, V

from analysis.copulas import Copula

GRID = np.stack([U, V], axis=1)


@pytest.mark.parametrize("case", [case for case in CASES if case[0] not in ("plackett", "independence")], ids=str)
def test_pyvinecopulib(case):
    pv = pytest.importorskip("pyvinecopulib")
    family, parameters = case
    name = family.rstrip("0123456789")
    other = pv.Bicop(
        family=getattr(pv.BicopFamily, name),
        rotation=int(family[len(name) :] or 0),
        parameters=np.array(parameters, dtype=float).reshape(-1, 1),
    )
    copula = Copula(family, parameters)
    assert copula.logpdf(U, V) == pytest.approx(np.log(other.pdf(GRID)), abs=1e-8)
    if name != "student" or float(parameters[1]).is_integer():
        assert copula.cdf(U, V) == pytest.approx(other.cdf(GRID), abs=1e-8)
    #: its Joe and Gumbel conditionals lose digits next to one edge, up to 7e-8 against extended precision
    loose = name in ("joe", "gumbel")
    assert copula.conditional(U, V) == pytest.approx(other.hfunc1(GRID), abs=1e-7 if loose else 1e-8)
    if name in ("gaussian", "student", "frank"):
        assert copula.inverse(U, V) == pytest.approx(other.hinv1(GRID), abs=1e-8)


def turns_copula(ot, family, parameters):
    if family == "gaussian":
        return ot.NormalCopula(ot.CorrelationMatrix([[1.0, parameters[0]], [parameters[0], 1.0]]))
    if family == "student":
        return ot.StudentCopula(parameters[1], ot.CorrelationMatrix([[1.0, parameters[0]], [parameters[0], 1.0]]))
    if family == "independence":
        return ot.IndependentCopula(2)
    return getattr(ot, f"{family.capitalize()}Copula")(parameters[0])


@pytest.mark.parametrize("case", [c for c in CASES if not c[0][-1].isdigit() and c[0] != "joe"], ids=str)
def test_openturns(case):
    ot = pytest.importorskip("openturns")
    family, parameters = case
    copula, other = Copula(family, parameters), turns_copula(ot, family, parameters)
    # Its Student copula gives an infinite PDF in the corners and negative values of the distribution function
    middle = (np.minimum(U, V) > 1e-4) & (np.maximum(U, V) < 1 - 1e-4)
    inner = middle if family == "student" else np.full(U.shape, True)
    logpdf = np.array([other.computeLogPDF(point) for point in GRID])
    conditional = np.array([other.computeConditionalCDF(point[1], [point[0]]) for point in GRID])
    quantile = np.array([other.computeConditionalQuantile(point[1], [point[0]]) for point in GRID])
    assert copula.logpdf(U, V)[inner] == pytest.approx(logpdf[inner], rel=1e-10, abs=1e-8)
    assert copula.conditional(U, V) == pytest.approx(conditional, abs=1e-8)
    if family != "plackett":
        assert copula.inverse(U, V) == pytest.approx(quantile, abs=1e-8)
    if family != "student":
        cdf = np.array([other.computeCDF(point) for point in GRID])
        assert copula.cdf(U, V) == pytest.approx(cdf, abs=1e-8)
