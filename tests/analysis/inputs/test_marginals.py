"""Marginal fits against scipy, closed forms and their own symmetries."""

from __future__ import annotations

import json

import numpy as np
import pytest
from paths import PAIRS_FILE
from scipy import integrate, stats

from analysis.inputs import marginals
from analysis.inputs.marginal_families import MarginalError
from analysis.inputs.pairs import read_pairs

PAIRS = read_pairs(PAIRS_FILE)
SCIPY = {
    "lognormal": lambda p: stats.lognorm(p["sigma_ln"], scale=p["median"]),
    "normal": lambda p: stats.norm(p["mean"], p["sd"]),
    "gamma": lambda p: stats.gamma(p["shape"], scale=p["scale"]),
    "weibull": lambda p: stats.weibull_min(p["shape"], scale=p["scale"]),
    "gumbel": lambda p: stats.gumbel_r(p["location"], p["scale"]),
}


@pytest.fixture
def sample():
    return 0.3 * np.random.default_rng(4).gamma(6.0, 1.0, 94)


@pytest.mark.parametrize("family", marginals.FAMILIES)
def test_functions_agree_with_scipy(family, sample):
    fit = marginals.fit(sample, family, n_sim=0)
    oracle = SCIPY[family](fit.params)
    x = np.quantile(sample, np.linspace(0.01, 0.99, 23))
    assert fit.logpdf(x) == pytest.approx(oracle.logpdf(x), rel=1e-10)
    assert fit.cdf(x) == pytest.approx(oracle.cdf(x), rel=1e-10)
    assert fit.sf(x) == pytest.approx(oracle.sf(x), rel=1e-10)
    assert fit.ppf(fit.cdf(x)) == pytest.approx(x, rel=1e-10)
    assert (fit.mean, fit.std) == pytest.approx((oracle.mean(), oracle.std()), rel=1e-10)
    assert integrate.quad(fit.pdf, *oracle.ppf([1e-12, 1 - 1e-12]), limit=300)[0] == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("family", marginals.FAMILIES)
def test_the_fit_is_a_maximum_of_the_likelihood(family, sample):
    fit = marginals.fit(sample, family, n_sim=0)
    for name, value in fit.params.items():
        for factor in (0.999, 1.001):
            shifted = SCIPY[family]({**fit.params, name: value * factor}).logpdf(sample).sum()
            assert shifted < fit.loglik
    assert fit.aic == pytest.approx(4.0 - 2.0 * fit.loglik)
    assert fit.bic == pytest.approx(2.0 * np.log(94) - 2.0 * fit.loglik)


@pytest.mark.parametrize("family", marginals.FAMILIES)
def test_standard_errors_are_the_scatter_of_the_estimates(family):
    truth = marginals.fit(0.2 * np.random.default_rng(1).gamma(8.0, 1.0, 500), family, n_sim=0)
    samples = truth.ppf(np.random.default_rng(2).random((2000, 94)))
    scatter = marginals.fit_rows(samples, family).std(axis=0)
    claimed = np.mean([list(marginals.fit(row, family, n_sim=0).se.values()) for row in samples[:100]], axis=0)
    assert claimed == pytest.approx(scatter, rel=0.12)


@pytest.mark.parametrize("family", marginals.FAMILIES)
def test_units_and_order_do_not_matter(family, sample):
    fit = marginals.fit(sample, family, n_sim=200)
    scaled = marginals.fit(1e9 * sample[::-1], family, n_sim=200)
    assert (scaled.ks, scaled.ad) == pytest.approx((fit.ks, fit.ad), rel=1e-9)
    assert scaled.aic - fit.aic == pytest.approx(2.0 * 94 * np.log(1e9), rel=1e-9)
    ratio = np.array(list(scaled.se.values())) / np.array(list(scaled.params.values()))
    assert ratio == pytest.approx(np.array(list(fit.se.values())) / np.array(list(fit.params.values())), rel=1e-4)


def test_goodness_statistics_agree_with_scipy(sample):
    fit = marginals.fit(sample, "normal", n_sim=0)
    assert fit.ks == pytest.approx(stats.kstest(sample, SCIPY["normal"](fit.params).cdf).statistic)
    known = stats.norm(sample.mean(), sample.std())
    i = np.arange(1, 95)
    z = np.sort(known.cdf(sample))
    assert fit.ad == pytest.approx(-94 - np.mean((2 * i - 1) * (np.log(z) + np.log(1 - z[::-1]))))


def test_fitted_parameters_tighten_the_critical_value():
    fit = marginals.fit(PAIRS[:, 0], "lognormal")
    assert fit.ks_critical == pytest.approx(0.140, abs=5e-4)
    assert fit.ks_critical_fitted == pytest.approx(0.092, abs=0.003)
    assert fit.ks_p_fitted < 0.05 and fit.ks_critical_fitted < fit.ks < fit.ks_critical


def test_the_fitted_test_holds_its_level():
    reference = marginals.fit(np.random.default_rng(1).lognormal(0.0, 0.4, 94), "lognormal").ks_critical_fitted
    ks = [marginals.fit(x, "lognormal", n_sim=0).ks for x in np.random.default_rng(2).lognormal(1.0, 0.7, (1500, 94))]
    assert 0.035 < np.mean(np.array(ks) > reference) < 0.065


def test_table_1_comes_back_from_the_reconstructed_pairs():
    friction, modulus = (marginals.fit_all(column)[0] for column in PAIRS.T)
    assert friction.family == modulus.family == "lognormal"
    assert list(friction.params.values()) == pytest.approx([0.214, 0.469], rel=0.01)
    assert list(modulus.params.values()) == pytest.approx([25.7e9, 0.354], rel=0.01)
    assert (friction.ks, modulus.ks) == pytest.approx((0.123, 0.102), rel=0.01)


def test_a_fit_survives_json():
    for one in marginals.fit_all(PAIRS[:, 1], n_sim=100):
        assert marginals.Marginal.from_dict(json.loads(json.dumps(one.to_dict()))) == one


@pytest.mark.parametrize(
    ("x", "family", "words"),
    [
        ([1.0, 2.0], "normal", "2 values"),
        ([1.0, np.nan, 2.0], "normal", "value 2 is not finite"),
        ([1.0, 2.0, -3.0], "lognormal", "-3 is outside its support"),
        ([2.0, 2.0, 2.0], "gamma", "no scatter"),
        ([1.0, 2.0, 3.0], "beta", "unknown marginal family 'beta'"),
    ],
)
def test_what_cannot_be_fitted_is_refused(x, family, words):
    with pytest.raises(MarginalError, match=words):
        marginals.fit(x, family)


def test_parameters_are_checked():
    with pytest.raises(MarginalError, match="expected the parameters median, sigma_ln"):
        marginals.Marginal("lognormal", {"median": 1.0})
    with pytest.raises(MarginalError, match="sigma_ln = -1"):
        marginals.Marginal("lognormal", {"median": 1.0, "sigma_ln": -1.0})


def test_many_values_are_tested_against_smaller_samples(monkeypatch):
    x = np.random.default_rng(5).lognormal(0.0, 0.4, 600)
    whole = marginals.fit(x, "lognormal")
    monkeypatch.setattr(marginals, "LARGEST_SIMULATED", 200)
    part = marginals.fit(x, "lognormal")
    assert (part.params, part.ks, part.ad) == (whole.params, whole.ks, whole.ad)
    assert part.ks_critical_fitted == pytest.approx(whole.ks_critical_fitted, rel=0.03)
    assert part.ad_critical_fitted == pytest.approx(whole.ad_critical_fitted, rel=0.05)
    assert part.ks_p_fitted == pytest.approx(whole.ks_p_fitted, abs=0.04)


@pytest.mark.parametrize(
    ("ks", "ad", "words"),
    [(0.2, 0.3, "accepted"), (0.01, 0.05, "rejected"), (0.01, 0.2, "rejected by KS alone"),
     (0.2, 0.01, "rejected by AD alone"), (None, None, "not tested")],
)  # fmt: skip
def test_a_verdict_needs_both_tests(ks, ad, words):
    one = marginals.Marginal("normal", {"mean": 1.0, "sd": 1.0}, ks_p_fitted=ks, ad_p_fitted=ad)
    assert marginals.verdict(one) == words


@pytest.mark.parametrize("family", ["lognormal", "weibull"])
def test_the_tests_hold_their_level_on_rounded_values(family):
    """94 values rounded to a quarter of their scatter; samples without ties reject most of them."""
    truth = marginals.fit(0.2 * np.random.default_rng(1).gamma(5.0, 0.25, 500), family, n_sim=0)
    rejected, without = [], []
    for seed in range(80):
        x = np.maximum(np.round(truth.sample(94, np.random.default_rng(seed)) / 0.04), 1) * 0.04
        fitted = marginals.fit(x, family, n_sim=200, seed=seed)
        rejected.append([fitted.ks_p_fitted <= 0.05, fitted.ad_p_fitted <= 0.05])
        if seed < 20:
            smooth = marginals.fit(fitted.sample(94, np.random.default_rng(seed)), family, n_sim=200)
            without.append(fitted.ks > smooth.ks_critical_fitted)
    assert np.all(np.mean(rejected, axis=0) < 0.13)
    assert np.mean(without) > 0.5


def test_simulated_samples_get_the_ties_of_the_sample():
    drawn = np.array([[5.0, 1.0, 2.0, 4.0], [8.0, 6.0, 7.0, 1.0]])
    tied = marginals._with_ties(drawn, np.array([3.0, 1.0, 3.0, 2.0]))
    assert tied.tolist() == [[1.0, 2.0, 4.5, 4.5], [1.0, 6.0, 7.5, 7.5]]


def test_many_tied_values_are_tested_by_a_part_of_them(monkeypatch):
    monkeypatch.setattr(marginals, "LARGEST_SIMULATED", 100)
    rejected = []
    for seed in range(60):
        x = np.maximum(np.round(np.random.default_rng(seed).lognormal(-1.5, 0.4, 500) / 0.05), 1) * 0.05
        rejected.append(marginals.fit(x, "lognormal", n_sim=200, seed=seed).ks_p_fitted <= 0.05)
    assert np.mean(rejected) < 0.15
