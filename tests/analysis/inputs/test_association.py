"""Correlations of two variables with a copula, and parameters for them, against closed forms and other quadratures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate
from stated_cases import EXAMPLES

from analysis.copulas import Copula, CopulaError
from analysis.inputs import association as rules
from analysis.inputs.association import association, attainable, with_association
from analysis.inputs.marginals import Marginal

WIDE = Marginal("lognormal", {"median": 29.0, "sigma_ln": 0.8})
NARROW = Marginal("lognormal", {"median": 0.25, "sigma_ln": 0.4})
UNIFORM = Marginal("uniform", {"low": 0.1, "high": 0.4})
TRIANGLE = EXAMPLES["triangular"]


def lognormal_pearson(rho):
    return math.expm1(0.8 * 0.4 * rho) / math.sqrt(math.expm1(0.8**2) * math.expm1(0.4**2))


@pytest.mark.parametrize("rho", [-0.999, -0.738, 0.0, 0.5, 0.99])
def test_pearsons_correlation_of_two_lognormals_with_a_gaussian_copula(rho):
    found = association("pearson", Copula("gaussian", (rho,)), NARROW, WIDE)
    assert found == pytest.approx(lognormal_pearson(rho), abs=1e-9)


@pytest.mark.parametrize("theta", [0.09, 0.5, 7.0])
def test_spearmans_correlation_of_plackett(theta):
    exact = (theta + 1) / (theta - 1) - 2 * theta * math.log(theta) / (theta - 1) ** 2
    assert association("spearman", Copula("plackett", (theta,)), NARROW, WIDE) == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize("theta", [-5.4, 3.0])
def test_spearmans_correlation_of_frank(theta):
    debye = [k / theta**k * integrate.quad(lambda t, k=k: t**k / math.expm1(t), 0, theta)[0] for k in (1, 2)]
    exact = 1 - 12 / theta * (debye[0] - debye[1])
    assert association("spearman", Copula("frank", (theta,)), NARROW, WIDE) == pytest.approx(exact, abs=1e-7)


def test_spearmans_correlation_of_a_gaussian_copula_in_closed_form_is_that_of_uniform_marginals():
    copula = Copula("gaussian", (-0.6,))
    exact = 6 / math.pi * math.asin(-0.3)
    assert association("spearman", copula, NARROW, WIDE) == pytest.approx(exact, abs=1e-14)
    assert association("pearson", copula, UNIFORM, UNIFORM) == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize("copula", [Copula("clayton270", (1.5,)), Copula("frank", (-4.0,)), Copula("joe", (2.0,))],
                         ids=lambda copula: copula.family)  # fmt: skip
def test_pearsons_correlation_is_hoeffdings_integral_of_the_distribution_function(copula):
    nodes, weights = np.polynomial.legendre.leggauss(60)
    edges = [np.concatenate([one.ppf([1e-9, 1e-5, 0.01, 0.2, 0.5]), one.ppf([0.8, 0.99, 1 - 1e-5, 1 - 1e-9])])
             for one in (TRIANGLE, NARROW)]  # fmt: skip
    edges[0] = np.sort([*edges[0], TRIANGLE.params["mode"]])
    half = [0.5 * np.diff(e) for e in edges]
    x, y = ((h[:, None] * (nodes + 1) + e[:-1, None]).ravel() for h, e in zip(half, edges, strict=True))
    wx, wy = ((h[:, None] * weights).ravel() for h in half)
    u, v = TRIANGLE.cdf(x)[:, None], NARROW.cdf(y)
    covariance = wx @ (copula.cdf(*np.broadcast_arrays(u, v)) - u * v) @ wy
    exact = covariance / (TRIANGLE.std * NARROW.std)
    assert association("pearson", copula, TRIANGLE, NARROW) == pytest.approx(exact, abs=2e-6)


def test_the_attainable_range_of_two_lognormals_and_of_others():
    assert attainable(NARROW, WIDE) == pytest.approx((lognormal_pearson(-1), lognormal_pearson(1)), abs=1e-8)
    assert attainable(UNIFORM, UNIFORM) == pytest.approx((-1, 1), abs=1e-9)
    for first, second in ((TRIANGLE, NARROW), (EXAMPLES["weibull"], EXAMPLES["truncated_normal"])):
        same, opposite = (integrate.quad(lambda u, s=s, a=first, b=second: float(a.ppf(u) * b.ppf(u if s else 1 - u)),
                                         0, 1, limit=400, epsabs=1e-12)[0] for s in (True, False))  # fmt: skip
        scale, centre = first.std * second.std, first.mean * second.mean
        assert attainable(first, second) == pytest.approx(
            ((opposite - centre) / scale, (same - centre) / scale), abs=1e-6
        )


CASES = [
    ("gaussian", -0.5), ("student", 0.5), ("frank", -0.5), ("plackett", 0.3), ("clayton", 0.5), ("clayton90", -0.4),
    ("gumbel180", 0.6),
]  # fmt: skip


@pytest.mark.parametrize("theta", [1e-4, 1.2, 5.0, 50.0])
def test_the_order_of_the_variables_does_not_matter(theta):
    """Also where rounding takes conditional probabilities beyond 1, and at the ends of the family."""
    copula = Copula("clayton", (theta,))
    ours, theirs = association("pearson", copula, NARROW, TRIANGLE), association("pearson", copula, TRIANGLE, NARROW)
    assert ours == pytest.approx(theirs, abs=1e-7)


@pytest.mark.parametrize("rho, nu", [(0.5, 2.0), (-0.7, 2.5)])
def test_students_correlation_of_few_degrees_by_two_rules(rho, nu):
    copula = Copula("student", (rho, nu))
    ours = association("pearson", copula, NARROW, TRIANGLE)
    assert ours == pytest.approx(rules._over_normals(copula, NARROW, TRIANGLE, 300), abs=2e-6)
    assert ours == pytest.approx(rules._over_density(copula, NARROW, TRIANGLE), abs=1e-9)


@pytest.mark.parametrize("family, value", CASES)
@pytest.mark.parametrize("measure", ["pearson", "kendall", "spearman"])
def test_the_parameter_gives_the_measure_that_was_asked_for(family, value, measure):
    def copula_of(parameter):
        return Copula(family, (parameter, 5.0) if family == "student" else (parameter,))

    copula = with_association(measure, value, copula_of, family, NARROW, TRIANGLE)
    assert association(measure, copula, NARROW, TRIANGLE) == pytest.approx(value, abs=1e-6)


def test_parameters_in_closed_form():
    rho = with_association("pearson", -0.5, lambda r: Copula("gaussian", (r,)), "gaussian", NARROW, WIDE).parameters[0]
    assert lognormal_pearson(rho) == pytest.approx(-0.5, abs=1e-9)
    for family, tau, parameter in (("gaussian", 0.5, math.sqrt(0.5)), ("clayton", 0.5, 2.0), ("gumbel", 0.5, 2.0)):
        found = with_association("kendall", tau, lambda r, f=family: Copula(f, (r,)), family, NARROW, WIDE)
        assert found.parameters[0] == pytest.approx(parameter, rel=1e-9)
    joe = with_association("kendall", -0.3, lambda r: Copula("joe270", (r,)), "joe270", NARROW, WIDE)
    assert joe.tau == pytest.approx(-0.3, abs=1e-12)


@pytest.mark.parametrize("measure, family, value, words", [
    ("pearson", "gaussian", -0.9, r"is outside \[-0.6944, 0.9562\], the range of these two distributions"),
    ("pearson", "clayton90", -0.69, r"is outside \[-0.68\d+, -.*\], what a clayton90 copula can have"),
    ("kendall", "clayton", -0.3, "what a clayton copula can have; take clayton90 or clayton270"),
    ("kendall", "joe270", 0.3, "take joe or joe180"),
    ("spearman", "gumbel", 0.0, "leave the section"),
    ("spearman", "gaussian", -1.2, r"is outside \[-1, 1\], the range of any two variables"),
])  # fmt: skip
def test_what_marginals_or_family_cannot_have_is_refused_with_the_range(measure, family, value, words):
    with pytest.raises(CopulaError, match=words):
        with_association(measure, value, lambda r: Copula(family, (r,)), family, NARROW, WIDE)


def test_a_correlation_that_the_quadrature_does_not_reach_is_refused():
    with pytest.raises(CopulaError, match='limit 1e-06; state measure = "kendall"'):
        association("pearson", Copula("student", (0.95, 1.0)), NARROW, WIDE)
