"""The Cramer-von Mises test of a copula: its statistic by hand, its level, and what it sees."""

from __future__ import annotations

import tracemalloc

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
    table = goodness.without_ties(94)
    fitted = np.quantile(goodness.simulate_statistics("gaussian", np.array([-0.738]), table, 2000, rng), 0.95)
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
    x, y = copulas.Copula("clayton", (2.0,)).sample(300, np.random.default_rng(6)).T
    table = {fit.family: fit for fit in copulas.select(x, y, ("gaussian", "clayton"), n_boot=200)}
    assert not table["gaussian"].accepted
    assert table["gaussian"].p_paper > table["gaussian"].p_bootstrap
    assert table["clayton"].accepted and not table["clayton180"].accepted


def test_the_same_seed_gives_the_same_p():
    x, y = copulas.Copula("frank", (-5.0,)).sample(50, np.random.default_rng(6)).T
    pairs = np.stack([copulas.pseudo_observations(x), copulas.pseudo_observations(y)], axis=1)
    one, two = (goodness.bootstrap_test(pairs, "frank", (-5.0,), 100, np.random.default_rng(9)) for _ in range(2))
    assert one == two


def in_one_block(samples: np.ndarray) -> np.ndarray:
    """The statistic as it was summed before the blocks, with arrays of n x n."""
    n = samples.shape[1]
    single = ((1.0 - samples[..., 0] ** 2) * (1.0 - samples[..., 1] ** 2)).sum(axis=1)
    order = np.argsort(samples[..., 0], axis=1)
    a, b = (np.take_along_axis(1.0 - samples[..., k], order, axis=1) for k in (0, 1))
    smaller = np.minimum(b[:, :, None], b[:, None, :])
    inner = np.einsum("rij,ij->ri", smaller, np.triu(np.ones((n, n)), 1).T)
    return n / 9.0 - 0.5 * single + (a * (2.0 * inner + b)).sum(axis=1) / n


@pytest.mark.parametrize("n", [1, 2, 3, 17, 94, 251, 499, 501, 502, 751, 1251])
def test_blocks_change_no_bit(n):
    samples = np.random.default_rng(n).random((5, n, 2))
    samples[0] = np.round(samples[0], 1)
    assert np.array_equal(goodness.cramer_von_mises(samples), in_one_block(samples))
    assert np.array_equal(goodness.cramer_von_mises(samples[:1]), in_one_block(samples[:1]))


@pytest.mark.parametrize("n", [1, 2, 3, 94, 1023, 1024, 1025])
def test_many_pairs_have_the_same_statistic_by_halves(n, monkeypatch):
    samples = np.random.default_rng(n).random((2, n, 2))
    samples[1] = np.round(samples[1], 2)
    expected = goodness.cramer_von_mises(samples)
    monkeypatch.setattr(goodness, "LARGEST_SQUARE", 0)
    assert goodness.cramer_von_mises(samples) == pytest.approx(expected, abs=1e-11)


def test_memory_of_the_test_grows_at_most_linearly():
    """20,000 pairs took 7 GB; now 40 MB, of which the simulated samples of 5,000 pairs take the most."""
    x = copulas.Copula("gaussian", (-0.7,)).sample(20_000, np.random.default_rng(1))
    pairs = copulas.pseudo_observations(x.T).T
    tracemalloc.start()
    goodness.bootstrap_test(pairs, "gaussian", (-0.7,), 19, np.random.default_rng(2))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6


def test_smaller_replicates_give_the_same_p(monkeypatch):
    x = copulas.Copula("frank", (-5.0,)).sample(400, np.random.default_rng(2))
    pairs = copulas.pseudo_observations(x.T).T
    parameters = copulas.fit(*pairs.T, "gaussian").parameters
    S, p = goodness.bootstrap_test(pairs, "gaussian", parameters, 999, np.random.default_rng(2))
    monkeypatch.setattr(goodness, "LARGEST_SIMULATED", 100)
    other = goodness.bootstrap_test(pairs, "gaussian", parameters, 999, np.random.default_rng(2))
    assert other == (pytest.approx(S), pytest.approx(p, abs=0.03))
    assert 0.02 < p < 0.98
