"""Uniform, triangular and truncated distributions against scipy, quadrature and the equations of the likelihood."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import integrate, stats
from stated_cases import EXAMPLES

from analysis.inputs import marginals
from analysis.inputs.bounded_families import BOUNDED, refit_rows
from analysis.inputs.marginal_families import FAMILIES, MarginalError
from analysis.inputs.marginals import Marginal
from analysis.inputs.truncated_normal import most_likely

SCIPY = {
    "uniform": lambda p: stats.uniform(p["low"], p["high"] - p["low"]),
    "triangular": lambda p: stats.triang(
        (p["mode"] - p["low"]) / (p["high"] - p["low"]), p["low"], p["high"] - p["low"]
    ),
    "truncated_normal": lambda p: stats.truncnorm(
        *((p[b] - p["parent_mean"]) / p["parent_sd"] for b in ("low", "high")), p["parent_mean"], p["parent_sd"]
    ),
}
#: Edges of the families: modes at a bound, tails, nearly uniform, nearly untruncated.
EDGES = [
    *(EXAMPLES[family] for family in BOUNDED),
    Marginal("triangular", {"low": 0.1, "mode": 0.1, "high": 0.4}),
    Marginal("triangular", {"low": 0.1, "mode": 0.4, "high": 0.4}),
    Marginal("truncated_normal", {"parent_mean": -2.0, "parent_sd": 0.1, "low": 0.3, "high": 0.5}),
    Marginal("truncated_normal", {"parent_mean": 2.0, "parent_sd": 10.0, "low": 0.3, "high": 0.5}),
    Marginal("truncated_normal", {"parent_mean": 0.25, "parent_sd": 0.05, "low": 0.0, "high": 5.0}),
    Marginal("truncated_lognormal", {"parent_median": 3.0, "parent_sigma_ln": 0.4, "low": 0.0, "high": 0.5}),
]


@pytest.mark.parametrize("one", EDGES, ids=lambda one: f"{one.family} {[*one.params.values()]}")
def test_pdf_distribution_quantiles_and_moments_belong_together(one):
    low, high = one.params["low"], one.params["high"]
    u = np.array([1e-6, 0.05, 0.3, 0.5, 0.9, 0.95, 1 - 1e-6])
    x = one.ppf(u)
    assert one.cdf(x) == pytest.approx(u, rel=1e-7) and one.sf(x) == pytest.approx(1 - u, rel=1e-7)
    nodes = np.linspace(0, 1, 9)
    edges = one.ppf(nodes) if "mode" not in one.params else np.sort([*one.ppf(nodes), one.params["mode"]])
    for power, moment in ((0, 1.0), (1, one.mean), (2, one.mean**2 + one.std**2)):
        parts = [integrate.quad(lambda v, k=power: v**k * one.pdf(v), a, b, epsrel=1e-11, epsabs=1e-300)[0]
                 for a, b in zip(edges, edges[1:], strict=False) if b - a > 1e-9]  # fmt: skip
        assert sum(parts) == pytest.approx(moment, rel=1e-9)
    assert one.ppf([0.0, 1.0]) == pytest.approx([low, high], rel=1e-12)
    assert np.all(one.pdf([low - 1e-3, high + 1e-3]) == 0.0)
    assert one.cdf([low - 1, high + 1]).tolist() == [0.0, 1.0] and one.sf([low - 1, high + 1]).tolist() == [1.0, 0.0]
    assert Marginal.from_dict(json.loads(json.dumps(one.to_dict()))) == one


@pytest.mark.parametrize("family", SCIPY)
def test_functions_agree_with_scipy(family):
    one, oracle = EXAMPLES[family], SCIPY[family](EXAMPLES[family].params)
    x = oracle.ppf(np.linspace(0.01, 0.99, 23))
    assert one.logpdf(x) == pytest.approx(oracle.logpdf(x), rel=1e-9, abs=1e-9)
    assert one.cdf(x) == pytest.approx(oracle.cdf(x), rel=1e-9)
    assert (one.mean, one.std) == pytest.approx((oracle.mean(), oracle.std()), rel=1e-9)


def test_a_truncated_lognormal_is_a_truncated_normal_in_logarithms():
    one = EXAMPLES["truncated_lognormal"]
    p = one.params
    logs = Marginal("truncated_normal", {"parent_mean": np.log(p["parent_median"]), "parent_sd": p["parent_sigma_ln"],
                                         "low": np.log(p["low"]), "high": np.log(p["high"])})  # fmt: skip
    x = np.array([0.11, 0.2, 0.35, 0.49])
    assert one.cdf(x) == pytest.approx(logs.cdf(np.log(x)), rel=1e-13)
    assert one.pdf(x) == pytest.approx(logs.pdf(np.log(x)) / x, rel=1e-13)


@pytest.mark.parametrize("mean, sd", [(0.2, 0.1), (0.5, 0.2), (0.0, 0.1)])
def test_the_refit_of_a_truncated_normal_is_a_maximum_of_the_likelihood(mean, sd):
    one = Marginal("truncated_normal", {"parent_mean": mean, "parent_sd": sd, "low": 0.1, "high": 0.6})
    rows = one.ppf(np.random.default_rng(1).random((20, 500)))
    found = most_likely(rows, 0.1, 0.6)
    for row, (m, s) in zip(rows, found.tolist(), strict=True):
        fit = Marginal("truncated_normal", {"parent_mean": m, "parent_sd": s, "low": 0.1, "high": 0.6})
        assert fit.mean == pytest.approx(
            row.mean(), rel=1e-9
        )  # an exponential family: the moments are those of the row
        if s < 4.99:
            assert fit.std == pytest.approx(row.std(), rel=1e-9)


def test_evenly_spread_values_get_the_widest_parent():
    row = np.linspace(0.1, 0.6, 50)[None]
    [[m, s]] = most_likely(row, 0.1, 0.6).tolist()
    assert s == pytest.approx(5.0)
    fit = Marginal("truncated_normal", {"parent_mean": m, "parent_sd": s, "low": 0.1, "high": 0.6})
    assert fit.mean == pytest.approx(row.mean(), rel=1e-9)


@pytest.mark.parametrize("family", BOUNDED)
def test_refits_scatter_about_the_distribution(family):
    one = EXAMPLES[family]
    rows = one.ppf(np.random.default_rng(3).random((400, 200)))
    fits = [
        Marginal(family, dict(zip(one.params, p, strict=True))) for p in refit_rows(family, one.params, rows).tolist()
    ]
    means = np.array([fit.mean for fit in fits])
    assert means.mean() == pytest.approx(one.mean, rel=0.005)
    assert means.std() == pytest.approx(one.std / np.sqrt(200), rel=0.15)
    assert np.mean([fit.std for fit in fits]) == pytest.approx(one.std, rel=0.02)


def test_stated_families_are_no_candidates_of_a_fit():
    assert not set(BOUNDED) & set(FAMILIES)
    with pytest.raises(MarginalError, match="not fitted to measured values"):
        marginals.fit([0.1, 0.2, 0.3], "uniform")


@pytest.mark.parametrize("family, params, words", [
    ("uniform", {"low": 0.3, "high": 0.3}, "low = 0.3 must be below high = 0.3"),
    ("triangular", {"low": 0.1, "mode": 0.5, "high": 0.4}, "mode = 0.5 is outside"),
    ("truncated_normal", {"parent_mean": 0.1, "parent_sd": 0.0, "low": 0.0, "high": 1.0}, "parent_sd = 0.0"),
    ("truncated_lognormal", {"parent_median": 0.1, "parent_sigma_ln": 1.0, "low": -1.0, "high": 1.0}, "low = -1"),
])  # fmt: skip
def test_parameters_that_do_not_fit_together_are_refused(family, params, words):
    with pytest.raises(MarginalError, match=words):
        Marginal(family, params)
