"""Kendall's tau with its interval and test, and the lines on the fit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from analysis.inputs.independence import kendall
from analysis.inputs.summary import fit_lines


def by_counting(x, y):
    """Kendall's tau-b from all pairs of pairs."""
    a, b = (np.sign(np.subtract.outer(c, c))[np.triu_indices(len(c), 1)] for c in (x, y))
    return (a * b).sum() / np.sqrt((a != 0).sum() * (b != 0).sum())


def test_tau_allows_for_ties():
    x = np.random.default_rng(1).normal(size=(30, 2)).round(0)
    assert kendall(*x.T).tau == pytest.approx(by_counting(*x.T))


def test_the_interval_covers_and_the_test_holds_its_level():
    rng = np.random.default_rng(2)
    true = 2 / np.pi * np.arcsin(0.5)
    inside, rejected = [], []
    for _ in range(600):
        x, y = rng.multivariate_normal([0, 0], [[1, 0.5], [0.5, 1]], 30).T
        found = kendall(x, y)
        inside.append(found.low <= true <= found.high)
        rejected.append(kendall(x.round(0), rng.permutation(y.round(0))).p <= 0.05)
    assert 0.92 < np.mean(inside) < 0.98
    assert 0.025 < np.mean(rejected) < 0.075


def test_the_p_value_of_few_pairs_is_exact():
    """10 pairs in the same order: 2 of 10! orders are as extreme."""
    assert kendall(np.arange(10), np.arange(10)).p == pytest.approx(2 / 3628800)
    assert kendall(np.arange(10.0), np.arange(10.0)).text == "Kendall's tau = 1.00 (95 %: 1.00 to 1.00)"


def test_no_dependence_is_not_minus_zero():
    x, y = [1, 2, 3, 4, 5, 6, 7], [4, 1, 7, 3, 6, 2, 5]
    assert "-0.00" not in kendall(x, y).text


def test_the_lines_state_the_test():
    pairs = np.random.default_rng(3).normal(size=(20, 2))
    fit = {"family": "gaussian", "names": ["rho"], "parameters": [0.1], "tau": 0.06, "aic": 1.0}
    tau, p = stats.kendalltau(*pairs.T)
    line = fit_lines({"copulas": [fit], "pairs": pairs.tolist()})[-1]
    assert line.startswith(f"dependence: Kendall's tau = {tau:.2f} (95 %: ")
    assert line.endswith(f"of the pairs; independence {'rejected' if p <= 0.05 else 'not rejected'}, p = {p:.2g}")
    kernel = {"family": "kernel", "params": {"bandwidth_ln": 0.1}, "values": [0.1] * 7}
    assert fit_lines({"marginals": {"mu_s": [kernel]}}) == [
        "mu_s: kernel (bandwidth_ln = 0.1, 7 centres); the only family tried; not tested"
    ]
