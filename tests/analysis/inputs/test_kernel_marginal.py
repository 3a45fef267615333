"""The kernel density as a marginal: against scipy, sums written out, and densities with known integrals."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import integrate, stats

from analysis.copulas import Copula
from analysis.inputs import kernel_marginal, marginals
from analysis.inputs.joint import Joint, fit_joint
from analysis.inputs.marginal_families import MarginalError
from analysis.points.selection import select_points


def two_humps(n=94, seed=1):
    rng = np.random.default_rng(seed)
    return np.exp(np.where(rng.random(n) < 0.5, -2.0, -1.0) + 0.15 * rng.normal(size=n))


FIT = marginals.fit(two_humps(), "kernel")


def test_functions_agree_with_scipy():
    """scipy's kernel density of the logarithms of the centres."""
    h, logs = FIT.params["bandwidth_ln"], np.log(FIT.values)
    oracle = stats.gaussian_kde(logs, bw_method=h / logs.std(ddof=1))
    x = np.quantile(two_humps(), np.linspace(0.005, 0.995, 15))
    assert FIT.pdf(x) == pytest.approx(oracle(np.log(x)) / x, rel=1e-10)
    below = [oracle.integrate_box_1d(-np.inf, y) for y in np.log(x)]
    assert FIT.cdf(x) == pytest.approx(below, rel=1e-9) and FIT.sf(x) == pytest.approx(1 - np.array(below), rel=1e-9)
    assert FIT.pdf([-1.0, 0.0]) == pytest.approx([0.0, 0.0], abs=0) and FIT.cdf(-1.0) == 0.0


def test_moments_are_those_of_the_density_and_of_the_sample():
    x = two_humps()
    area, mean, square = (
        integrate.quad(lambda t, k=k: t**k * FIT.pdf(t), 0, 2, limit=400, points=[0.13, 0.2, 0.37])[0] for k in range(3)
    )
    assert area == pytest.approx(1.0, abs=1e-8)
    assert (FIT.mean, FIT.std) == pytest.approx((mean, np.sqrt(square - mean**2)), rel=1e-7)
    logs = np.log(FIT.values)
    assert logs.mean() == pytest.approx(np.log(x).mean())
    assert logs.var() + FIT.params["bandwidth_ln"] ** 2 == pytest.approx(np.log(x).var())
    assert (FIT.mean, FIT.std) == pytest.approx((x.mean(), x.std()), rel=0.02)


def test_quantiles_go_back_to_their_probabilities():
    u = np.concatenate([[1e-300, 1e-30, 1e-6], np.random.default_rng(1).random(300), [1 - 1e-9, 1 - 2.0**-53]])
    assert FIT.cdf(FIT.ppf(u[:-2])) == pytest.approx(u[:-2], rel=1e-9)
    assert FIT.sf(FIT.ppf(u[-2:])) == pytest.approx(1 - u[-2:], rel=1e-6)
    assert FIT.ppf([0.0, 1.0]).tolist() == [0.0, np.inf]
    narrow = marginals.Marginal("kernel", {"bandwidth_ln": 0.01}, (0.1, 0.5))
    assert narrow.ppf([0.25, 0.75]) == pytest.approx([0.1, 0.5], rel=1e-9)
    assert narrow.cdf(narrow.ppf(0.5)) == pytest.approx(0.5)


def test_the_bandwidth_is_the_best_one_of_a_normal_density():
    """h = (4/3)^(1/5) sd n^(-1/5) minimises the asymptotic error there (Silverman 1986, Eq. 3.28)."""
    rng = np.random.default_rng(2)
    found = [kernel_marginal.bandwidth(np.exp(0.4 * rng.normal(size=400))) for _ in range(40)]
    assert np.mean(found) == pytest.approx((4 / 3) ** 0.2 * 0.4 * 400**-0.2, rel=0.05)
    of_one_hump = (4 / 3) ** 0.2 * 0.15 * 47**-0.2
    assert of_one_hump < FIT.params["bandwidth_ln"] < 1.5 * of_one_hump


def test_the_functional_is_the_sum_over_all_pairs():
    y, g = np.random.default_rng(3).normal(size=60), 0.3
    z = (y[:, None] - y) / g
    fourth = (z**4 - 6 * z**2 + 3) * stats.norm.pdf(z) / g**5
    assert kernel_marginal._functional(y, 4, g) == pytest.approx(fourth.mean(), rel=1e-3)


def test_the_aic_leaves_each_value_out():
    x, h = two_humps(30), 0.2
    left_out = 0.0
    for k in range(30):
        others = np.log(np.delete(x, k))
        left_out += np.log(stats.norm.pdf((np.log(x[k]) - others) / h).mean() / h / x[k])
    assert kernel_marginal.left_out_loglik(x, h) == pytest.approx(left_out)


def test_it_is_taken_for_two_humps_and_not_for_one():
    families = ("kernel", "lognormal", "gamma")
    assert marginals.fit_all(two_humps(), families, n_sim=0)[0].family == "kernel"
    one = [np.random.default_rng(seed).lognormal(-1.5, 0.4, 94) for seed in range(20)]
    assert sum(marginals.fit_all(x, families, n_sim=0)[0].family == "kernel" for x in one) <= 3
    assert "kernel" not in marginals.FAMILIES and FIT.ks_p_fitted is None


def test_rounded_values_leave_no_gaps():
    x = np.maximum(np.round(np.random.default_rng(4).lognormal(-1.5, 0.45, 94) / 0.05), 1) * 0.05
    fitted = marginals.fit(x, "kernel")
    humps = np.diff(np.sign(np.diff(fitted.pdf(np.linspace(0.1, 0.45, 200))))) < 0
    assert np.sum(humps) == 1


def test_a_fit_survives_json():
    data = json.loads(json.dumps(FIT.to_dict()))
    assert marginals.Marginal.from_dict(data) == FIT and len(data["values"]) == 94
    assert "values" not in marginals.fit(two_humps(), "gamma", n_sim=0).to_dict()


def test_points_carry_its_moments():
    pairs = np.column_stack([two_humps(), 25e9 * two_humps(seed=2)])
    fitted = fit_joint(pairs, ("kernel",), ("gaussian",), n_boot=0).joint
    joint = Joint(fitted.marginals, Copula("gaussian", (-0.5,)))
    chosen = select_points(joint, 30)
    assert chosen.probability @ chosen.mu_s == pytest.approx(joint.marginals[0].mean, rel=1e-6)
    assert max(np.abs(chosen.moment_errors)) < 1e-6
    z = np.random.default_rng(1).normal(size=(50, 2))
    assert joint.to_normal(joint.from_normal(z)) == pytest.approx(z, rel=1e-7, abs=1e-9)


@pytest.mark.parametrize(("family", "params", "values", "words"), [
    ("kernel", {"bandwidth_ln": 0.1}, (), "has 0 centres"),
    ("kernel", {"bandwidth_ln": 0.0}, (0.1,), "bandwidth_ln = 0.0 is out of range"),
    ("kernel", {"bandwidth_ln": 0.1}, (0.1, -2.0), "not a positive number"),
    ("kernel", {"bandwidth_ln": 0.1}, (0.1, np.nan), "not a positive number"),
    ("normal", {"mean": 1.0, "sd": 1.0}, (0.1,), "has 1 centres"),
])  # fmt: skip
def test_bad_parameters_are_refused(family, params, values, words):
    with pytest.raises(MarginalError, match=words):
        marginals.Marginal(family, params, values)


def test_values_that_cannot_be_fitted_are_refused():
    for x, words in (([0.1, -0.2, 0.3], "outside its support"), ([0.2] * 5, "no scatter"), ([0.1, 0.2], "2 values")):
        with pytest.raises(MarginalError, match=words):
            marginals.fit(x, "kernel")
    with pytest.raises(MarginalError, match="known: .*gumbel, kernel"):
        marginals.fit([0.1, 0.2, 0.3], "kernels")
