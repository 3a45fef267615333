"""Copulas of any number of variables fitted to ranks: against the fits of two variables, and known parameters."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import copulas
from analysis.copulas.multivariate import GaussianCopula, StudentCopula, fit_gaussian
from analysis.copulas.multivariate_fits import fit_student, parameter_names, select_multivariate

R = ((1.0, -0.7, 0.3), (-0.7, 1.0, -0.1), (0.3, -0.1, 1.0))
VARIABLES = ("mu_s", "G_p", "nu")


@pytest.mark.parametrize("seed", [0, 1])
def test_of_two_variables_it_is_the_fit_of_the_bivariate_family(seed):
    x = copulas.Copula("student", (-0.6, 4.0)).sample(200, np.random.default_rng(seed))
    usual, found = copulas.fit(x[:, 0], x[:, 1], "student"), fit_student(x)
    assert found.correlation[0][1] == pytest.approx(usual.parameters[0], abs=1e-5)
    assert found.degrees_of_freedom == pytest.approx(usual.parameters[1], rel=1e-4)
    u = np.column_stack([copulas.pseudo_observations(column) for column in x.T])
    assert found.logpdf(u).sum() == pytest.approx(usual.loglik, abs=1e-6)


@pytest.mark.parametrize("true", [StudentCopula(R, 4.0), GaussianCopula(R)])
def test_the_smaller_aic_is_that_of_the_true_family(true):
    x = true.sample(400, np.random.default_rng(1))
    best, other = select_multivariate(x, VARIABLES)
    assert isinstance(best.copula, type(true)) and best.aic < other.aic
    assert np.array(best.copula.correlation) == pytest.approx(np.array(R), abs=0.1)
    assert best.names[:3] == ("rho(mu_s, G_p)", "rho(mu_s, nu)", "rho(G_p, nu)")
    assert best.aic == pytest.approx(2 * len(best.parameters) - 2 * best.loglik) and best.accepted is None
    if best.family == "student":
        assert best.parameters[3] == pytest.approx(4.0, rel=0.5) and best.at_bounds == ()
        assert np.array(fit_gaussian(x).correlation) != pytest.approx(np.array(best.copula.correlation), abs=1e-4)


def test_degrees_of_freedom_at_the_end_of_their_range_are_the_gaussian_copula():
    x = GaussianCopula(R).sample(300, np.random.default_rng(1))
    student = next(fit for fit in select_multivariate(x, VARIABLES) if fit.family == "student")
    assert student.at_bounds == (("degrees_of_freedom", 200.0, "gaussian"),)


def test_only_the_families_asked_for_are_fitted_and_others_are_refused():
    x = GaussianCopula(R).sample(50, np.random.default_rng(2))
    [only] = select_multivariate(x, VARIABLES, ("gaussian", "frank"))
    assert only.family == "gaussian"
    with pytest.raises(
        copulas.CopulaError, match="frank: no copula of 3 variables here; choose from gaussian, student"
    ):
        select_multivariate(x, VARIABLES, ("frank",))
    with pytest.raises(copulas.CopulaError, match="one column is constant"):
        fit_student(np.column_stack([x[:, :2], np.ones(50)]))


def test_names_of_parameters_follow_the_rows_below_the_diagonal():
    assert parameter_names(("a", "b"), "gaussian") == ("rho(a, b)",)
    assert parameter_names(VARIABLES, "student")[-2:] == ("rho(G_p, nu)", "degrees_of_freedom")
