"""The Cramer-von Mises test of a copula: its statistic by hand, its level, and what it sees."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import copulas
from analysis.copulas import goodness


def by_the_formula(z: np.ndarray) -> float:
    """Eq. 5 with a sum over j, written as it stands."""
    n = len(z)
    single = sum((1 - a * a) * (1 - b * b) for a, b in z)
    double = sum((1 - max(a, c)) * (1 - max(b, d)) for a, b in z for c, d in z)
    return n / 9 - single / 2 + double / n


def test_the_statistic_is_the_formula():
    rng = np.random.default_rng(1)
    samples = rng.random((4, 17, 2))
    samples[0, 3] = samples[0, 5]
    expected = [by_the_formula(z) for z in samples]
    assert goodness.cramer_von_mises(samples) == pytest.approx(expected, abs=1e-12)
    assert goodness.cramer_von_mises(samples[2]) == pytest.approx(expected[2], abs=1e-12)


def test_the_statistic_is_n_times_the_squared_distance_to_independence():
    z = np.random.default_rng(2).random((12, 2))
    s = (np.arange(600) + 0.5) / 600
    below = (z[:, 0, None] <= s).astype(float)
    empirical = below.T @ (z[:, 1, None] <= s) / 12
    assert goodness.cramer_von_mises(z) == pytest.approx(12 * np.mean((empirical - np.outer(s, s)) ** 2), rel=0.02)


def test_the_papers_reference_never_rejects_what_was_fitted():
    rng = np.random.default_rng(3)
    paper = np.quantile(goodness.independent_reference(94, 4000, rng), 0.95)
    fitted = np.quantile(goodness.simulate_statistics("gaussian", np.array([-0.738]), 94, 2000, rng), 0.95)
    assert paper == pytest.approx(0.33, abs=0.04)
    assert fitted == pytest.approx(0.066, abs=0.006)


def test_p_values_are_uniform_under_the_null():
    rng = np.random.default_rng(4)
    p = []
    for _ in range(150):
        x, y = copulas.Copula("gaussian", (-0.7,)).sample(60, rng).T
        pairs = np.stack([copulas.pseudo_observations(x), copulas.pseudo_observations(y)], axis=1)
        parameters = copulas.fit_rows(pairs[None, :, 0], pairs[None, :, 1], "gaussian")[0]
        p.append(goodness.bootstrap_test(pairs, "gaussian", parameters, 99, rng)[1])
    assert np.mean(p) == pytest.approx(0.5, abs=0.08)
    assert np.mean(np.array(p) <= 0.05) < 0.1


def test_a_wrong_family_is_seen_in_many_pairs():
    x, y = copulas.Copula("clayton", (2.0,)).sample(300, np.random.default_rng(5)).T
    table = {fit.family: fit for fit in copulas.select(x, y, ("gaussian", "clayton"), n_boot=200)}
    assert not table["gaussian"].accepted
    assert table["gaussian"].p_paper > table["gaussian"].p_bootstrap
    assert table["clayton"].accepted and not table["clayton180"].accepted


def test_the_same_seed_gives_the_same_p():
    x, y = copulas.Copula("frank", (-5.0,)).sample(50, np.random.default_rng(6)).T
    pairs = np.stack([copulas.pseudo_observations(x), copulas.pseudo_observations(y)], axis=1)
    one, two = (goodness.bootstrap_test(pairs, "frank", (-5.0,), 100, np.random.default_rng(9)) for _ in range(2))
    assert one == two
