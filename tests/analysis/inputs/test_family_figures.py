"""Parameters from stated figures: every sufficient set gives the distribution back; closed forms; refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special, stats
from stated_cases import EXAMPLES, stated_sets

from analysis.inputs.family import MarginalError
from analysis.inputs.family_figures import from_figures
from analysis.inputs.figures_stated import PARENT, figure

#: Sets that do not determine a distribution, or that two distributions of the family have.
UNDETERMINED = {
    "lognormal": 1, "normal": 1, "gamma": 3, "weibull": 4, "gumbel": 1, "uniform": 1, "truncated_normal": 1,
    "truncated_lognormal": 3,
}  # fmt: skip


@pytest.mark.parametrize("family", UNDETERMINED)
def test_every_sufficient_pair_of_figures_gives_the_distribution_back(family):
    one, refused = EXAMPLES[family], []
    sets = stated_sets(family)
    for figures in sets[:: 2 if family in PARENT else 1]:
        try:
            found = from_figures(family, figures)
        except MarginalError as error:
            assert "determine" in str(error) or "state another figure" in str(error)
            refused.append(figures)
            continue
        for name, value in figures.items():
            assert figure(found, name) == pytest.approx(value, rel=1e-9)
        assert list(found.params.values()) == pytest.approx(list(one.params.values()), rel=1e-6)
    assert len(refused) <= UNDETERMINED[family] < len(sets) / 3


@pytest.mark.parametrize("figures", stated_sets("triangular")[::4], ids=",".join)
def test_three_figures_of_a_triangular_distribution(figures):
    one = EXAMPLES["triangular"]
    try:
        found = from_figures("triangular", figures)
    except MarginalError as error:
        assert "state another figure" in str(error)  # e.g. low, high and sd: the mirror image has them, too
        found = one
    assert list(found.params.values()) == pytest.approx(list(one.params.values()), rel=1e-6)


@pytest.mark.parametrize("family, figures, params", [
    ("lognormal", {"mean": 0.25, "cov": 0.3},
     (0.25 / math.sqrt(1.09), math.sqrt(math.log(1.09)))),
    ("lognormal", {"q05": 0.1, "q95": 0.4}, (0.2, math.log(4) / (2 * special.ndtri(0.95)))),
    ("lognormal", {"mean": 0.25, "median": 0.24}, (0.24, math.sqrt(2 * math.log(0.25 / 0.24)))),
    ("normal", {"q05": 0.1, "q95": 0.4}, (0.25, 0.15 / special.ndtri(0.95))),
    ("normal", {"mean": 0.25, "cov": 0.2}, (0.25, 0.05)),
    ("gamma", {"mean": 0.25, "cov": 0.2}, (25.0, 0.01)),
    ("gumbel", {"mean": 0.25, "sd": 0.05},
     (0.25 - np.euler_gamma * 0.05 * math.sqrt(6) / math.pi, 0.05 * math.sqrt(6) / math.pi)),
    ("weibull", {"median": 0.25, "sigma_ln": 0.4},
     (math.pi / (0.4 * math.sqrt(6)), 0.25 / math.log(2) ** (0.4 * math.sqrt(6) / math.pi))),
    ("uniform", {"mean": 0.25, "sd": 0.05}, (0.25 - 0.05 * math.sqrt(3), 0.25 + 0.05 * math.sqrt(3))),
    ("uniform", {"q05": 0.11, "q95": 0.29}, (0.1, 0.3)),
    ("triangular", {"low": 0.1, "mode": 0.2, "high": 0.4}, (0.1, 0.2, 0.4)),
    ("triangular", {"low": 0.1, "mean": 0.25, "high": 0.4}, (0.1, 0.25, 0.4)),
    ("triangular", {"mode": 0.1, "low": 0.1, "mean": 0.2}, (0.1, 0.1, 0.4)),
    ("truncated_normal", {"parent_mean": -0.1, "parent_sd": 0.2, "low": 0.0, "high": 1.0}, (-0.1, 0.2, 0.0, 1.0)),
    ("truncated_normal", {"mean": 0.25, "sd": 0.1, "low": 0.0, "high": 0.5}, (0.25, None, 0.0, 0.5)),
    ("truncated_lognormal", {"parent_mean": 0.25, "parent_cov": 0.3, "low": 0.1, "high": 0.5},
     (0.25 / math.sqrt(1.09), math.sqrt(math.log(1.09)), 0.1, 0.5)),
])  # fmt: skip
def test_closed_forms(family, figures, params):
    found = list(from_figures(family, figures).params.values())
    for value, exact in zip(found, params, strict=True):
        assert exact is None or value == pytest.approx(exact, rel=1e-9)


def test_a_weibull_cov_is_that_of_scipy():
    found = from_figures("weibull", {"mean": 0.25, "cov": 0.3}).params
    oracle = stats.weibull_min(found["shape"], scale=found["scale"])
    assert (oracle.mean(), oracle.std()) == pytest.approx((0.25, 0.075), rel=1e-9)


def test_own_parameters_are_kept_to_the_last_bit():
    assert from_figures("lognormal", {"sigma_ln": 0.469, "median": 0.214}).params == {
        "median": 0.214,
        "sigma_ln": 0.469,
    }


def test_a_third_figure_that_agrees_is_accepted_and_tells_two_solutions_apart():
    assert from_figures("lognormal", {"mean": 0.25, "sd": 0.075, "cov": 0.3}).mean == pytest.approx(0.25)
    assert from_figures("lognormal", {"mean": 0.239, "median": 0.214, "sigma_ln": 0.469}).params["median"] == 0.214
    two = {"low": 0.1, "high": 0.45, "sd": figure(EXAMPLES["triangular"], "sd")}
    with pytest.raises(MarginalError, match="2 triangular distributions have"):
        from_figures("triangular", two)
    assert from_figures("triangular", two | {"mean": 0.25}).params["mode"] == pytest.approx(0.2)


@pytest.mark.parametrize("family, figures, words", [
    ("lognormal", {"mean": 0.25}, "needs two figures; stated: mean"),
    ("lognormal", {"mean": 0.25, "sd": 0.0}, 'sd = 0 is no scatter; use family = "constant"'),
    ("lognormal", {"mean": 0.25, "sd": -0.1}, "sd = -0.1 must be positive"),
    ("lognormal", {"mean": -0.25, "sd": 0.1}, "mean = -0.25 must be positive"),
    ("normal", {"mean": -0.25, "sd": 0.1}, "mean = -0.25 must be positive"),
    ("lognormal", {"mean": 0.25, "sd": float("inf")}, "sd = inf must be a finite number"),
    ("lognormal", {"mean": "0.25", "sd": 0.1}, "mean = '0.25' must be a finite number"),
    ("lognormal", {"mean": 10**400, "sd": 0.1}, r"mean = 1000.* must be a finite number"),
    ("lognormal", {"mean": True, "sd": 0.1}, "mean = True must be a finite number"),
    ("lognormal", {"q05": 0.4, "q95": 0.3}, "q05 = 0.4 must be below q95 = 0.3"),
    ("lognormal", {"mean": 0.2, "median": 0.3}, r"median / mean = 1.5 is outside \[0.278, 1\]"),
    ("lognormal", {"mean": 0.25, "cov": 3.0}, r"cov = 3 is outside \[0.001, 2\]"),
    ("weibull", {"mean": 0.25, "cov": 1e-4}, r'cov = 0.0001 is outside \[0.001, 2\]; use family = "constant"'),
    ("weibull", {"mean": 0.25, "median": 0.26}, "what a weibull distribution can have"),
    ("weibull", {"mean": 0.25, "median": 0.251}, "2 weibull distributions have"),
    ("lognormal", {"cov": 0.3, "sigma_ln": 0.3}, "do not determine"),
    ("lognormal", {"mean": 0.25, "sd": 0.075, "cov": 0.31}, "cov = 0.31 contradicts mean = 0.25 and sd = 0.075"),
    ("lognormal", {"men": 0.25, "sd": 0.1}, "unknown key 'men'; did you mean 'mean'"),
    ("lognormal", {"mean": 0.25, "low": 0.1}, "a lognormal distribution has no low; the family truncated_lognormal"),
    ("normal", {"mean": 0.25, "sigma_ln": 0.1}, "a normal distribution has no sigma_ln"),
    ("normal", {"mean": 0.25, "q05": 0.3}, "no normal distribution has mean = 0.25 and q05 = 0.3"),
    ("normal", {"q05": -3.0, "q95": 1.0}, "give a mean of -1; it must be positive"),
    ("uniform", {"mean": 0.25, "low": 0.3}, "mean = 0.25 is outside"),
    ("uniform", {"low": 0.5, "high": 0.3}, "low = 0.5 must be below high = 0.3"),
    ("triangular", {"low": 0.1, "high": 0.3}, "needs three figures"),
    ("triangular", {"low": 0.1, "mode": 0.5, "high": 0.3}, "mode = 0.5 is outside"),
    ("triangular", {"low": 0.1, "mean": 0.29, "high": 0.3}, "no triangular distribution has"),
    ("truncated_normal", {"mean": 0.25, "sd": 0.2, "low": 0.0, "high": 0.5}, r"sd = 0.2 is outside \[0.00025, 0.144"),
    ("truncated_normal", {"mean": 0.6, "sd": 0.1, "low": 0.0, "high": 0.5}, "mean = 0.6 is outside"),
    ("truncated_normal", {"mean": 0.25, "parent_sd": 0.1, "low": 0.0, "high": 0.5}, "state two of the same kind"),
    ("truncated_normal", {"low": 0.0, "high": 0.5}, "needs two figures beside low and high; stated: none"),
])  # fmt: skip
def test_what_no_distribution_has_is_refused_in_one_line(family, figures, words):
    with pytest.raises(MarginalError, match=words) as refused:
        from_figures(family, figures)
    assert "\n" not in str(refused.value)
