"""Stated distributions: points with the moments that were asked for, the paper's statistics, bootstrap, refusals."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest
from scipy import stats
from stated_cases import EXAMPLES

from analysis.copulas import Copula, CopulaError
from analysis.copulas.multivariate import GaussianCopula, StudentCopula
from analysis.inputs import SpecifiedInputs, bootstrap_specified, joint_from_distributions
from analysis.inputs.dependence_stated import partial_range
from analysis.inputs.family import MarginalError
from analysis.inputs.joint import Joint
from analysis.inputs.marginals import Marginal
from analysis.inputs.specified_text import band_text
from analysis.points.selection import select_points

STATED = tomllib.loads("""
[variables.mu_s]
family = "lognormal"
mean = 0.25
cov = 0.30
[variables.G_p_GPa]
family = "lognormal"
median = 29.0
sigma_ln = 0.25
[dependence]
copula = "gaussian"
measure = "pearson"
mu_s.G_p_GPa = -0.5
""")
MODULUS = STATED["variables"]["G_p_GPa"]
RATIO = {"family": "normal", "mean": 0.2, "sd": 0.02}


def specified(extra=None, dependence=None, **options):
    variables = STATED["variables"] | (extra or {})
    return joint_from_distributions(variables, STATED["dependence"] if dependence is None else dependence, **options)


def carried(points):
    """Means, coefficients of variation and Pearson correlation of weighted points."""
    w, x = points.probability, points.x
    mean = w @ x
    sd = np.sqrt(w @ (x - mean) ** 2)
    return mean, sd / mean, w @ ((x - mean) / sd).prod(axis=1)


@pytest.mark.parametrize("n", [8, 100])
def test_the_points_of_the_example_have_what_was_asked_for(n):
    points = select_points(specified().joint, n)
    mean, cov, correlation = carried(points)
    assert mean == pytest.approx([0.25, 29e9 * np.exp(0.25**2 / 2)], rel=0.003)
    assert cov == pytest.approx([0.30, np.sqrt(np.expm1(0.25**2))], rel=0.02)
    assert correlation == pytest.approx(-0.5, abs=0.02)
    assert points.moment_warnings() == []


@pytest.mark.parametrize("family", EXAMPLES)
def test_points_of_every_family_have_its_moments_and_lie_in_its_support(family):
    one = EXAMPLES[family]
    found = specified({"mu_s": {"family": family} | one.params})
    points = select_points(found.joint, 50)
    mean, cov, correlation = carried(points)
    assert mean[0] == pytest.approx(one.mean, rel=0.003) and cov[0] == pytest.approx(one.std / one.mean, rel=0.02)
    assert correlation == pytest.approx(-0.5, abs=0.02)
    assert np.all(np.isfinite(one.logpdf(points.x[:, 0])))


def test_the_papers_statistics_give_the_points_of_a_fit_with_the_same_parameters():
    fitted = Joint(
        (Marginal("lognormal", {"median": 0.214, "sigma_ln": 0.469}),
         Marginal("lognormal", {"median": 25.7e9, "sigma_ln": 0.354})),
        Copula("gaussian", (-0.738,)),
    )  # fmt: skip
    stated = joint_from_distributions(
        {"mu_s": {"family": "lognormal", "median": 0.214, "sigma_ln": 0.469},
         "G_p_GPa": {"family": "lognormal", "median": 25.7, "sigma_ln": 0.354}},
        {"measure": "parameter", "mu_s": {"G_p_GPa": -0.738}},
    )  # fmt: skip
    assert stated.joint == fitted
    ours, theirs = select_points(stated.joint, 100), select_points(fitted, 100)
    assert np.array_equal(ours.x, theirs.x) and np.array_equal(ours.probability, theirs.probability)


def test_units_and_youngs_modulus_state_the_same_joint():
    plain = specified().joint
    for key, factor in (("G_p_MPa", 1e3), ("G_p_Pa", 1e9), ("G_p", 1e9), ("E_p_GPa", 2.4)):
        variables = {"mu_s": STATED["variables"]["mu_s"], key: MODULUS | {"median": 29.0 * factor}}
        found = joint_from_distributions(variables, STATED["dependence"])
        assert [m.mean for m in found.joint.marginals] == pytest.approx([m.mean for m in plain.marginals], rel=1e-14)
    harder = joint_from_distributions({"mu_s": STATED["variables"]["mu_s"], "E_p_GPa": MODULUS, "nu": {"value": 0.3}})
    assert harder.joint.marginals[1].params["median"] == pytest.approx(29e9 / 2.6)
    assert harder.constants == {"nu": 0.3}


def test_constants_and_the_order_of_the_variables():
    constants = {"G_p_GPa": {"value": 29.0}, "d50_mm": {"family": "constant", "value": 0.3}}
    found = joint_from_distributions({"nu": RATIO} | constants | {"mu_s": STATED["variables"]["mu_s"]})
    assert found.names == ("mu_s", "nu") and found.constants == {"G_p": 29e9, "d50": 0.3e-3}
    assert found.joint.copula == Copula("independence")
    assert found.text[1:4] == ["G_p: constant, 29 GPa", found.text[2], "d50: constant, 0.3 mm"]
    assert found.text[-1] == "dependence: none is stated, so mu_s, nu are independent"
    alone = joint_from_distributions({"mu_s": STATED["variables"]["mu_s"], "G_p_GPa": {"value": 29.0}})
    assert alone.joint.dimension == 1 and alone.joint.sample(5, np.random.default_rng(1)).shape == (5, 1)
    assert alone.joint.cdf(np.array([[0.25]])) == pytest.approx(alone.joint.marginals[0].cdf(0.25))


def test_three_variables_have_the_correlations_asked_for_and_absent_pairs_are_uncorrelated():
    found = specified({"nu": RATIO}, STATED["dependence"] | {"nu": {"mu_s": 0.3}})
    assert isinstance(found.joint.copula, GaussianCopula) and found.joint.copula.correlation[1][2] == 0.0
    x = found.joint.sample(200_000, np.random.default_rng(2))
    assert np.corrcoef(x.T)[np.triu_indices(3, 1)] == pytest.approx([-0.5, 0.3, 0.0], abs=0.01)
    assert any("G_p and nu" in line and "no value is stated" in line for line in found.text)
    assert SpecifiedInputs.from_dict(json.loads(json.dumps(found.to_dict()))) == found


def test_students_copula_of_three_variables():
    student = {"copula": "student", "degrees_of_freedom": 6, "measure": "kendall", "mu_s": {"G_p": -0.4, "nu": 0.3}}
    found = specified({"nu": RATIO}, student)
    assert isinstance(found.joint.copula, StudentCopula) and found.joint.copula.degrees_of_freedom == 6.0
    x = found.joint.sample(4000, np.random.default_rng(2))
    tau = [stats.kendalltau(x[:, i], x[:, j])[0] for i, j in ((0, 1), (0, 2), (1, 2))]
    assert tau == pytest.approx([-0.4, 0.3, 0.0], abs=0.03)
    assert Joint.from_dict(json.loads(json.dumps(found.joint.to_dict()))) == found.joint


def test_the_text_states_moments_quantiles_and_dependence():
    friction, _, dependence = specified().text
    assert "lognormal (median = 0.23946, sigma_ln = 0.29356); stated for mu_s: mean = 0.25, cov = 0.3" in friction
    assert "mean 0.25, sd 0.075, cov 0.3, 5 and 95 % quantiles 0.1477 and 0.3881" in friction
    assert dependence == (
        "mu_s and G_p: gaussian copula (rho = -0.5292), pearson -0.500, kendall -0.355, spearman -0.511"
    )
    assert "no bands" in band_text(0) and "40 measurements" in band_text(40)


def test_the_interval_of_a_correlation_given_the_others():
    low, high = partial_range(np.array([[1, 0, 0.8], [0, 1, 0.5], [0.8, 0.5, 1]]), 0, 1)
    assert (low, high) == pytest.approx((0.4 - 0.6 * np.sqrt(0.75), 0.4 + 0.6 * np.sqrt(0.75)))


@pytest.mark.parametrize("family", EXAMPLES)
def test_the_bootstrap_has_the_scatter_of_so_many_measurements(family):
    found = specified({"mu_s": {"family": family} | EXAMPLES[family].params})
    many = bootstrap_specified(found, 40, 300, np.random.default_rng(4))
    means = np.array([[m.mean for m in joint.marginals] for joint in many])
    expected = [m.std / np.sqrt(40) for m in found.joint.marginals]
    assert means.std(axis=0) == pytest.approx(expected, rel=0.2)
    assert np.abs(means.mean(axis=0) / [m.mean for m in found.joint.marginals] - 1).max() < 0.02
    assert {joint.marginals[0].family for joint in many} == {family}
    rho = np.array([joint.copula.parameters[0] for joint in many])
    assert rho.std() == pytest.approx((1 - 0.5**2) / np.sqrt(40), rel=0.25)


@pytest.mark.parametrize("dependence", [
    {"copula": "student", "degrees_of_freedom": 5.0}, {"copula": "frank"}, {"copula": "clayton90"}])  # fmt: skip
def test_the_bootstrap_refits_every_copula(dependence):
    found = specified(dependence=STATED["dependence"] | {"measure": "kendall"} | dependence)
    many = bootstrap_specified(found, 60, 50, np.random.default_rng(5))
    tau = np.array([joint.copula.tau for joint in many])
    assert tau.mean() == pytest.approx(-0.5, abs=0.05) and 0.02 < tau.std() < 0.12
    assert {joint.copula.family for joint in many} == {dependence["copula"]}


def test_the_bootstrap_of_three_variables_and_of_one():
    for extra in ({}, {"copula": "student", "degrees_of_freedom": 4.0, "measure": "kendall"}):
        found = specified({"nu": RATIO}, STATED["dependence"] | extra)
        many = bootstrap_specified(found, 40, 60, np.random.default_rng(6))
        rho = np.array([joint.copula.correlation[0][1] for joint in many])
        assert rho.mean() == pytest.approx(found.joint.copula.correlation[0][1], abs=0.07) and rho.std() > 0.05
        assert {type(joint.copula) for joint in many} == {type(found.joint.copula)}
    alone = joint_from_distributions({"mu_s": STATED["variables"]["mu_s"], "G_p_GPa": {"value": 29.0}})
    assert len(bootstrap_specified(alone, 10, 3, np.random.default_rng(1))) == 3
    assert {
        joint.copula for joint in bootstrap_specified(specified(dependence={}), 40, 5, np.random.default_rng(1))
    } == {Copula("independence")}
    with pytest.raises(MarginalError, match="pairs_behind = 9 is below 10"):
        bootstrap_specified(alone, 9, 3, np.random.default_rng(1))


def test_the_same_generator_gives_the_same_bootstrap():
    one, other = (bootstrap_specified(specified(), 20, 4, np.random.default_rng(7)) for _ in range(2))
    assert one == other


def test_kendalls_tau_of_a_sample_is_the_one_stated():
    found = specified(dependence={"measure": "kendall", "copula": "gumbel90", "G_p": {"mu_s": -0.4}})
    x = found.joint.sample(4000, np.random.default_rng(8))
    assert stats.kendalltau(*x.T)[0] == pytest.approx(-0.4, abs=0.03)


@pytest.mark.parametrize("extra, words", [
    ({"mu_s": {"family": "lognormal", "mean": 0.25}}, "variables.mu_s: a lognormal distribution needs two figures"),
    ({"mu_s": {"family": "beta", "mean": 0.25, "sd": 0.1}}, "variables.mu_s: unknown family 'beta'; known: lognormal"),
    ({"mu_s": {"mean": 0.25, "sd": 0.1}}, "variables.mu_s: the key family is missing"),
    ({"mu_s": {"family": "Lognormal", "mean": 0.25, "sd": 0.1}}, "did you mean 'lognormal'"),
    ({"mu_s": 0.25}, "variables.mu_s: 0.25 must be a section"),
    ({"mu_s": {"value": 25.0}}, r"variables.mu_s: value = 25 is outside \[0.0001, 5\]"),
    ({"mu_s": {"value": 0.25, "sd": 0.1}}, "a constant has no sd"),
    ({"mu_s": {"value": "x"}}, "value = 'x' must be a number"),
    ({"mu_s": {"family": "constant"}}, "a constant needs the key value"),
    ({"mu_s": {"family": "normal", "value": 0.25}}, "is for a constant, not for the family 'normal'"),
    ({"mu_s": {"family": "normal", "mean": 0.25, "cov": 0.5}}, "0.023 of the probability lies below 0.0001"),
    ({"mu_s": {"family": "lognormal", "mean": 25.0, "cov": 0.3}}, "the limits of mu_s; is the unit right"),
    ({"nu": {"family": "uniform", "low": 0.1, "high": 0.6}}, "of the probability lies above 0.49, the limit of nu"),
    ({"G_p_MPa": MODULUS}, "variables.G_p_GPa and variables.G_p_MPa both state G_p; keep one"),
    ({"G_p_kPa": MODULUS}, "unknown key variables.G_p_kPa; known: mu_s, G_p_GPa, nu"),
    ({"mu_s": {"value": 0.2}, "G_p_GPa": {"value": 29.0}}, "every variable is a constant"),
])  # fmt: skip
def test_variables_that_cannot_be_used_are_refused_in_one_line(extra, words):
    with pytest.raises(MarginalError, match=words) as refused:
        specified(extra)
    assert "\n" not in str(refused.value)


def test_a_needed_variable_and_a_constant_nu_for_youngs_modulus():
    with pytest.raises(MarginalError, match="variables.G_p_GPa is missing"):
        joint_from_distributions({"mu_s": STATED["variables"]["mu_s"]})
    with pytest.raises(MarginalError, match="variables.E_p_GPa: E_p needs a constant nu"):
        joint_from_distributions({"mu_s": STATED["variables"]["mu_s"], "E_p_GPa": MODULUS, "nu": RATIO})


def test_doubtful_values_are_mentioned():
    found = specified({"mu_s": {"family": "normal", "mean": 0.25, "cov": 0.3}})
    assert found.warnings == (
        "mu_s: 0.00043 of the probability lies below 0.0001, the limit of mu_s; a truncated family has no such values",
    )
    cut = specified({"mu_s": {"family": "truncated_normal", "mean": 0.25, "cov": 0.3}})
    assert cut.warnings == () and "low and high: the limit of all values" in cut.text[0]


@pytest.mark.parametrize("dependence, words", [
    ({"mu_s": {"G_p_GPa": -0.5}}, "dependence.measure is missing; it is one of pearson, kendall"),
    ({"measure": "pearsn", "mu_s": {"G_p_GPa": -0.5}}, "'pearsn' must be one of .*; did you mean 'pearson'"),
    ({"measure": "pearson", "copula": "claton", "mu_s": {"G_p_GPa": 0.5}}, "did you mean 'clayton'"),
    ({"measure": "pearson", "mu_s": {"G_p_GPa": -0.95}},
     r"dependence.mu_s.G_p_GPa = -0.95 \(pearson\) is outside \[-0.9288, 0.9995\]"),
    ({"measure": "parameter", "copula": "clayton", "mu_s": {"G_p_GPa": -3}}, "theta = -3 is outside"),
    ({"measure": "kendall", "copula": "student", "mu_s": {"G_p_GPa": 0.1}}, "degrees_of_freedom is missing"),
    ({"measure": "kendall", "degrees_of_freedom": 5, "mu_s": {"G_p_GPa": 0.1}}, "is for the copula student only"),
    ({"measure": "kendall", "copula": "student", "degrees_of_freedom": 0.5, "mu_s": {"G_p_GPa": 0.1}},
     r"degrees_of_freedom = 0.5 is outside \[1, 200\]"),
    ({"measure": "kendall", "mu_s": 0.5}, "must name a second variable"),
    ({"measure": "kendall", "mu_s": {"mu_s": 0.5}}, "joins mu_s with itself"),
    ({"measure": "kendall", "mu_s": {"nu": 0.5}}, "nu is no random variable"),
    ({"measure": "kendall", "mu_s": {"G_p_GPa": "x"}}, "must be a finite number"),
    ({"measure": "kendall", "mu_s": {"G_p_GPa": 0.5}, "G_p": {"mu_s": 0.4}}, "contradicts dependence.mu_s.G_p_GPa"),
    ({"foo": 1}, "unknown key 'foo'"),
    ({"measure": "kendall"}, "the copula gaussian needs a value of a pair"),
    ({"copula": "independence", "mu_s": {"G_p_GPa": 0.5}}, "the copula independence has no values"),
])  # fmt: skip
def test_dependence_that_cannot_be_used_is_refused_in_one_line(dependence, words):
    with pytest.raises(CopulaError, match=words) as refused:
        specified(dependence=dependence)
    assert "\n" not in str(refused.value)


def test_dependence_of_other_than_two_variables():
    pairs = {"measure": "pearson", "mu_s": {"G_p_GPa": -0.8, "nu": 0.8}, "G_p_GPa": {"nu": 0.5}}
    words = r"= -0.8 \(pearson\) contradicts the values of the other pairs, with which it lies between -0.07\d+ and 0.9"
    with pytest.raises(CopulaError, match=words):
        specified({"nu": RATIO}, pairs)
    with pytest.raises(CopulaError, match="joins two variables only, and 3 are random"):
        specified({"nu": RATIO}, STATED["dependence"] | {"copula": "frank"})
    with pytest.raises(CopulaError, match="only G_p is random"):
        specified({"mu_s": {"value": 0.25}}, {"measure": "kendall"})
    with pytest.raises(CopulaError, match="mu_s is a constant; the random variables are G_p"):
        specified({"mu_s": {"value": 0.25}})
