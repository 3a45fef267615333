"""Doubts about pairs and fits: what is asked, and that ordinary samples raise no question."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from paths import PAIRS_FILE
from scipy import stats

from analysis.copulas import CopulaFit
from analysis.inputs.joint import fit_joint
from analysis.inputs.marginals import Marginal, fit_all
from analysis.inputs.pairs import read_pairs
from analysis.inputs.plausibility import input_warnings, outliers

PAIRS = read_pairs(PAIRS_FILE)


def warnings_of(pairs, lines=None, **fitted):
    """Warnings of pairs (n, 2), with no fits unless they are given."""
    tables = {"mu_s": fitted.get("mu_s", ()), "G_p": fitted.get("G_p", ())}
    return input_warnings(pairs, tables, fitted.get("copulas", ()), lines)


def ordinary(n=40, seed=1):
    """Pairs of lognormal properties that depend on each other."""
    z = np.random.default_rng(seed).multivariate_normal([0, 0], [[1, -0.7], [-0.7, 1]], n)
    return np.exp(np.log([0.214, 25.7e9]) + z * [0.469, 0.354])


def copula(family, parameters, names, accepted=None, p=None):
    return CopulaFit(family, parameters, names, (), (), 40, 0.0, 0.0, 0.0, 0.0, 0.1, p, p, accepted, 99)


def marginal(family, aic, p):
    params = {"lognormal": {"median": 1.0, "sigma_ln": 1.0}, "normal": {"mean": 1.0, "sd": 1.0}}[family]
    return Marginal(family, params, aic=aic, ks_p_fitted=p, ad_p_fitted=p)


def test_the_reconstructed_pairs_are_plausible():
    assert warnings_of(PAIRS) == []


def test_ordinary_samples_raise_no_question():
    asked = [text for seed in range(60) for text in warnings_of(ordinary(40, seed))]
    assert len(asked) <= 2


@pytest.mark.parametrize("draw", ["lognormal", "gamma", "gumbel"])
def test_ordinary_distributions_have_few_outliers(draw):
    rng = np.random.default_rng(2)
    samples = {"lognormal": rng.lognormal(0.0, 0.47, (500, 94)), "gamma": rng.gamma(4.0, size=(500, 94)),
               "gumbel": np.abs(1.0 + 0.3 * rng.gumbel(size=(500, 94)))}[draw]  # fmt: skip
    assert np.mean([outliers(x).size > 0 for x in samples]) < 0.02


def test_gross_outliers_are_named_by_line_and_value():
    pairs = ordinary()
    pairs[20, 0], pairs[24, 1] = 3.1, 410e9
    friction, modulus = warnings_of(pairs, lines=range(3, 43))
    without = np.delete(pairs[:, 0], 20)
    assert f"without it the standard deviation is {np.std(without, ddof=1):.4g} instead of 0.4" in friction
    assert friction.startswith("mu_s: 1 of 40 values lies far from all others: 3.1 (line 23); the median is 0.")
    assert "G_p: 1 of 40 values lies far from all others: 410 GPa (line 27)" in modulus
    assert "(pair 21)" in warnings_of(pairs)[0]


def test_several_outliers_do_not_hide_each_other():
    pairs = ordinary()
    pairs[3:10, 0] = [3.0, 3.1, 3.2, 3.3, 3.4, 3.5, 3.6]
    (text,) = warnings_of(pairs)
    assert "7 of 40 values lie far" in text and "and 2 more" in text


def test_a_factor_of_a_thousand_is_asked_for():
    pairs = ordinary()
    pairs[5, 1] *= 1e-3
    assert "another unit (a factor of 1,000)?" in warnings_of(pairs)[0]


@pytest.mark.parametrize(("column", "factor", "words"), [
    (1, 1e-3, r"G_p: the median 0.0\d+ GPa is outside 0.5 to 200 GPa; is it in TPa, or divided by 1,000"),
    (1, 30.0, r"G_p: the median \d+(\.\d)? GPa is outside 0.5 to 200 GPa; is it 1,000 times too large"),
    (0, 0.01, "mu_s: the median 0.002.* is outside 0.01 to 1.5; is it divided by 100"),
    (0, 10.0, "mu_s: the median 2.* is outside 0.01 to 1.5; is it an angle"),
])  # fmt: skip
def test_another_unit_is_asked_for(column, factor, words):
    pairs = ordinary()
    pairs[:, column] *= factor
    (text,) = warnings_of(pairs)
    assert re.search(words, text)


def test_heavy_ties_are_said():
    pairs = ordinary()
    pairs[:, 0] = np.resize([0.1, 0.2, 0.3, 0.4, 0.5], 40)
    (text,) = warnings_of(pairs)
    assert text.startswith("mu_s: 40 pairs have only 5 distinct values, and 18% of all comparisons are ties (limit 5%)")
    pairs[:, 0] = ordinary()[:, 0].round(2)
    assert warnings_of(pairs) == []


def test_copied_pairs_are_said_and_rounded_ones_are_not():
    pairs = ordinary()
    (text,) = warnings_of(np.concatenate([pairs, pairs[:10]]), lines=range(2, 52))
    assert text.startswith("10 of 50 pairs repeat an earlier pair (that of line ")
    many = ordinary(3000)
    assert warnings_of(np.stack([many[:, 0].round(2), many[:, 1].round(-9)], axis=1)) == []


def test_rejected_families_are_said():
    bad = [marginal("lognormal", 10.0, 0.001), marginal("normal", 12.0, 0.02)]
    (text,) = warnings_of(ordinary(), mu_s=bad)
    assert text == ("mu_s: the tests reject all 2 families of marginals (largest p = 0.02, level 0.05); lognormal has "
                    "the smallest AIC and is taken nevertheless; inputs.marginals = [\"kernel\"] takes a kernel "
                    "density, which needs no family")  # fmt: skip
    (text,) = warnings_of(ordinary(), G_p=[bad[0], marginal("normal", 12.0, 0.4)])
    assert text == "G_p: lognormal has the smallest AIC but is rejected; normal is accepted, with an AIC larger by 2.0"
    rejected = [copula("frank", (-5.0,), ("theta",), False, 0.01), copula("gaussian", (-0.7,), ("rho",), False, 0.004)]
    (text,) = warnings_of(ordinary(), copulas=rejected)
    assert text.startswith("copula: the bootstrap rejects all 2 families (largest p = 0.01, level 0.05); frank")
    assert warnings_of(ordinary(), copulas=[copula("frank", (-5.0,), ("theta",))]) == []


def test_a_parameter_at_its_bound_is_said():
    x = np.random.default_rng(1).lognormal(-1.4, 0.3, 40)
    fit = fit_joint(np.stack([x, 5e9 / x], axis=1), copula_families=("student", "frank", "plackett"), n_boot=0)
    (text,) = warnings_of(np.stack([x, 5e9 / x], axis=1), copulas=fit.copulas)
    for words in ("nu = 1, limit 1", "frank theta = -60, limit -60", "one property is nearly a function of the other",
                  "plackett (chosen) theta = 1.0002e-05, limit 1e-05"):  # fmt: skip
        assert words in text


def test_a_student_copula_that_is_gaussian_is_said_only_where_it_is_chosen():
    wide, other = copula("student", (-0.7, 200.0), ("rho", "nu")), copula("frank", (-5.0,), ("theta",))
    assert warnings_of(ordinary(), copulas=[other, wide]) == []
    (text,) = warnings_of(ordinary(), copulas=[wide, other])
    assert "nu = 200, limit 200, where it is practically the gaussian copula" in text and "function" not in text


def test_two_humps_that_no_family_fits_are_said_with_figures():
    pairs = ordinary(94)
    pairs[:, 0] = np.exp(np.where(np.arange(94) % 2, -2.3, -1.0) + 0.1 * np.random.default_rng(1).normal(size=94))
    (text,) = warnings_of(pairs, mu_s=fit_all(pairs[:, 0], n_sim=200))
    assert re.search(r"reject all 5 families of marginals \(largest p = 0.0025, level 0.05\); \w+ has the smallest AIC "
                     r"\(KS D = 0.\d\d\d, AD = \d+.\d\d\) and is taken", text)  # fmt: skip
    assert warnings_of(pairs, mu_s=[fit_all(pairs[:, 0], ("kernel",))[0]]) == []


@pytest.mark.parametrize(
    ("rho", "n", "asked"), [(0.0, 94, True), (0.15, 30, True), (0.6, 94, False), (-0.5, 94, False)]
)
def test_independence_that_is_not_rejected_is_said(rho, n, asked):
    z = np.random.default_rng(3).multivariate_normal([0, 0], [[1, rho], [rho, 1]], max(n, 40))[:n]
    pairs = np.exp(np.log([0.214, 25.7e9]) + z * [0.469, 0.354])
    fits = [CopulaFit("gaussian", (rho,), ("rho",), (), (), n, 0.0, 0.0, 0.0, 0.0)]
    found = [text for text in warnings_of(pairs, copulas=fits) if "independence" in text]
    assert len(found) == asked
    if asked:
        tau, p = stats.kendalltau(*pairs.T)
        assert f"independence cannot be rejected: Kendall's tau = {tau:.2f} (95 %: " in found[0]
        assert f"p = {p:.2g}, level 0.05; gaussian is taken" in found[0]


def test_independence_that_is_taken_against_the_test_is_said():
    fits = [CopulaFit("independence", (), (), (), (), 40, 0.0, 0.0, 0.0, 0.0)]
    (text,) = warnings_of(ordinary(), copulas=fits)
    assert text.startswith("copula: independence is taken, but rejected: Kendall's tau = -0.") and "p < 0.001" in text


@pytest.mark.parametrize("n", [10, 12, 30, 94])
def test_few_pairs_cannot_tell_families_apart(n):
    pairs = ordinary(n)
    fits = [copula("gaussian", (-0.7,), ("rho",)), replace(copula("frank", (-5.0,), ("theta",)), aic=1.9),
            replace(copula("plackett", (0.1,), ("theta",)), aic=2.1)]  # fmt: skip
    tables = {"mu_s": [marginal("lognormal", 10.0, 0.5), marginal("normal", 11.0, 0.4)],
              "G_p": [marginal("lognormal", 10.0, 0.5), marginal("normal", 15.0, 0.4)]}  # fmt: skip
    found = [text for text in warnings_of(pairs, copulas=fits, **tables) if "cannot distinguish" in text]
    if n < 40:
        assert found[0].startswith(
            f"{n} pairs cannot distinguish these families: AIC within 2 of the smallest: lognormal, normal of mu_s; "
            "gaussian, frank of the copula; every bootstrap"
        )
    assert len(found) == (n < 40)
