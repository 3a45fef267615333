"""The joint distribution against closed forms of the bivariate lognormal, and its maps there and back."""

from __future__ import annotations

import json

import numpy as np
import pytest
from paths import PAIRS_FILE
from scipy import stats

from analysis.copulas import Copula, CopulaError
from analysis.copulas.multivariate import GaussianCopula
from analysis.inputs.joint import Joint, bootstrap_joints, fit_joint
from analysis.inputs.marginals import Marginal
from analysis.inputs.pairs import InputError, read_pairs

PAIRS = read_pairs(PAIRS_FILE)
FRICTION = Marginal("lognormal", {"median": 0.214, "sigma_ln": 0.469})
MODULUS = Marginal("lognormal", {"median": 25.7e9, "sigma_ln": 0.354})
RATIO = Marginal("normal", {"mean": 0.2, "sd": 0.02})
JOINT = Joint((FRICTION, MODULUS), Copula("gaussian", (-0.738,)))
OTHERS = [("student", (-0.7, 5.0)), ("frank", (-5.0,)), ("plackett", (0.1,)), ("clayton90", (1.5,)), ("joe270", (2.0,))]


def test_the_pdf_is_the_bivariate_lognormal():
    x = JOINT.sample(50, np.random.default_rng(1))
    logs = (np.log(x) - np.log([0.214, 25.7e9])) / [0.469, 0.354]
    exact = stats.multivariate_normal([0, 0], [[1, -0.738], [-0.738, 1]]).pdf(logs) / (0.469 * 0.354 * x.prod(axis=1))
    assert JOINT.pdf(x) == pytest.approx(exact, rel=1e-9)
    assert JOINT.pdf(np.array([-0.1, 2e10])) == 0.0


def test_moments_are_the_bivariate_lognormals():
    mean, covariance = JOINT.moments()
    assert mean == pytest.approx([0.214 * np.exp(0.469**2 / 2), 25.7e9 * np.exp(0.354**2 / 2)])
    assert covariance[0, 1] == pytest.approx(mean.prod() * np.expm1(-0.738 * 0.469 * 0.354), rel=1e-8)
    assert np.sqrt(covariance[0, 0]) == pytest.approx(mean[0] * np.sqrt(np.expm1(0.469**2)))


@pytest.mark.parametrize("case", [("gaussian", (-0.738,)), *OTHERS], ids=str)
def test_maps_go_there_and_back_and_the_distribution_counts(case):
    joint = Joint((FRICTION, MODULUS), Copula(*case))
    x = joint.sample(20_000, np.random.default_rng(2))
    assert joint.from_normal(joint.to_normal(x[:500])) == pytest.approx(x[:500], rel=1e-7)
    assert joint.inverse_rosenblatt(joint.rosenblatt(x[:500])) == pytest.approx(x[:500], rel=1e-7)
    z = joint.to_normal(x)
    assert np.cov(z.T) == pytest.approx(np.eye(2), abs=0.04)
    for point in ([0.2, 25e9], [0.3, 20e9], [0.12, 40e9]):
        assert joint.cdf(np.array(point)) == pytest.approx(np.mean(np.all(x <= point, axis=1)), abs=0.012)
    mean, covariance = joint.moments()
    assert mean == pytest.approx(x.mean(axis=0), rel=0.02)
    assert covariance[0, 1] == pytest.approx(np.cov(x.T)[0, 1], rel=0.05)


def test_conditionals_are_those_of_the_lognormal():
    x1 = 0.15
    centre = np.log(25.7e9) - 0.738 * 0.354 / 0.469 * (np.log(x1) - np.log(0.214))
    spread = 0.354 * np.sqrt(1 - 0.738**2)
    exact = stats.lognorm(spread, scale=np.exp(centre))
    x2 = exact.ppf([0.05, 0.5, 0.95])
    assert JOINT.conditional_cdf(x2, x1) == pytest.approx([0.05, 0.5, 0.95], abs=1e-12)
    assert JOINT.conditional_ppf(np.array([0.05, 0.5, 0.95]), x1) == pytest.approx(x2, rel=1e-10)


def test_expectations_of_many_functions_at_once():
    value = JOINT.expectation(lambda x: np.stack([np.ones(len(x)), x[:, 0], np.log(x[:, 1])], axis=1))
    assert value == pytest.approx([1.0, FRICTION.mean, np.log(25.7e9)], rel=1e-9)


def test_a_third_variable_joins_by_a_gaussian_copula():
    matrix = ((1.0, -0.738, 0.3), (-0.738, 1.0, -0.1), (0.3, -0.1, 1.0))
    three = Joint((FRICTION, MODULUS, RATIO), GaussianCopula(matrix))
    x = three.sample(30_000, np.random.default_rng(3))
    mean, covariance = three.moments()
    assert mean == pytest.approx(x.mean(axis=0), rel=0.01)
    assert covariance[:2, :2] == pytest.approx(JOINT.moments()[1], rel=1e-6)
    scatter = np.sqrt(np.diag(covariance))
    assert covariance / np.outer(scatter, scatter) == pytest.approx(np.corrcoef(x.T), abs=0.02)
    assert three.from_normal(three.to_normal(x[:200])) == pytest.approx(x[:200], rel=1e-8)
    assert three.conditional_cdf(25e9, 0.2) == pytest.approx(JOINT.conditional_cdf(25e9, 0.2))
    assert Joint.from_dict(json.loads(json.dumps(three.to_dict()))) == three
    with pytest.raises(CopulaError, match="3 marginals"):
        Joint((FRICTION, MODULUS, RATIO), Copula("gaussian", (0.1,)))


def test_three_measured_columns_are_fitted_and_bootstrapped():
    matrix = ((1.0, -0.738, 0.3), (-0.738, 1.0, -0.1), (0.3, -0.1, 1.0))
    x = Joint((FRICTION, MODULUS, RATIO), GaussianCopula(matrix)).sample(400, np.random.default_rng(5))
    result = fit_joint(x, marginal_families=("lognormal", "normal"))
    assert [m.family for m in result.joint.marginals[:2]] == ["lognormal", "lognormal"]
    assert result.joint.marginals[2].mean == pytest.approx(0.2, abs=0.004)
    assert np.array(result.joint.copula.correlation) == pytest.approx(np.array(matrix), abs=0.1)
    assert [fit.family for fit in result.copulas] == [
        "gaussian",
        "student",
    ] and "3 variables is not tested" in result.note
    many = bootstrap_joints(x, 40, np.random.default_rng(6), result.joint)
    rho = np.array([joint.copula.correlation for joint in many])[:, 1, 0]
    assert rho.mean() == pytest.approx(result.joint.copula.correlation[1][0], abs=0.02)
    assert rho.std() == pytest.approx((1 - 0.738**2) / 20, rel=0.4)


def test_fitting_the_reconstructed_pairs_gives_the_papers_input():
    result = fit_joint(PAIRS, n_boot=100)
    assert [m.family for m in result.joint.marginals] == ["lognormal", "lognormal"]
    assert result.joint.copula.family == "gaussian"
    assert "smallest pseudo-AIC" in result.note
    data = json.loads(json.dumps(result.to_dict()))
    assert Joint.from_dict(data["joint"]) == result.joint
    assert len(data["marginals"][0]) == 5 and len(data["copulas"]) > 6


def test_the_bootstrap_scatters_as_the_standard_errors_say():
    fit = fit_joint(PAIRS, n_boot=0)
    many = bootstrap_joints(PAIRS, 400, np.random.default_rng(4), fit.joint)
    medians = [m.params["median"] for m in fit.joint.marginals]
    drawn = np.array([[m.params["median"] for m in joint.marginals] for joint in many])
    assert drawn.mean(axis=0) == pytest.approx(medians, rel=0.02)
    assert drawn.std(axis=0) == pytest.approx([m.se["median"] for m in fit.joint.marginals], rel=0.15)
    rho = np.array([joint.copula.parameters[0] for joint in many])
    assert rho.std() == pytest.approx(fit.copulas[0].se[0], rel=0.25)


def test_bad_pairs_are_refused():
    with pytest.raises(InputError, match="at least 10"):
        fit_joint(PAIRS[:5])
    with pytest.raises(InputError, match="the same"):
        fit_joint(np.column_stack([PAIRS[:, 0], np.full(94, 2e10)]))


def test_refits_in_blocks_are_those_at_once(monkeypatch):
    fit = fit_joint(PAIRS, n_boot=0).joint
    at_once = bootstrap_joints(PAIRS, 7, np.random.default_rng(4), fit)
    monkeypatch.setattr("analysis.inputs.joint._LARGEST_AT_ONCE", 50)
    monkeypatch.setattr("analysis.inputs.joint._AT_ONCE", 200)
    in_blocks = bootstrap_joints(PAIRS, 7, np.random.default_rng(4), fit)
    assert len(in_blocks) == 7
    for one, other in zip(at_once, in_blocks, strict=True):
        assert one.copula.parameters == pytest.approx(other.copula.parameters, rel=1e-9)
        assert one.marginals[1].params == pytest.approx(other.marginals[1].params, rel=1e-9)


def test_too_few_distinct_values_are_refused():
    few = PAIRS.copy()
    few[:, 0] = np.resize([0.1, 0.2, 0.3, 0.4], len(few))
    with pytest.raises(InputError, match="mu_s has 4 distinct values in 94 pairs; a fit needs at least 5"):
        fit_joint(few)


def test_values_of_no_common_unit_are_refused():
    wrong = PAIRS.copy()
    wrong[3, 0] = 5e-324
    with pytest.raises(InputError, match="pair 4, column 1 is .*differs from the median .* factor of 1e"):
        fit_joint(wrong)
