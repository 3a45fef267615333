"""The test of a copula on rounded pairs, and on pairs whose columns are exchanged."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import copulas
from analysis.copulas import fitting, goodness
from analysis.copulas.model import transposed
from analysis.copulas.selection import candidates

FAMILIES = ("gaussian", "student", "plackett", "clayton", "joe")
GAUSSIAN = copulas.Copula("gaussian", (-0.7,))


def ranked(x):
    return copulas.pseudo_observations(np.asarray(x).T).T


def rounded(n, seed, steps):
    """Pairs of the Gaussian copula with lognormal marginals, rounded to two steps."""
    z = GAUSSIAN.sample(n, np.random.default_rng(seed))
    x = np.exp(np.array([0.47, 0.35]) * fitting.elliptical.normal_score(z, 1.0 - z))
    return np.round(x / steps) * steps


def test_every_replicate_has_the_ties_of_the_sample(monkeypatch):
    pairs = ranked(rounded(40, 1, (0.25, 0.2)))
    seen = []
    monkeypatch.setattr(goodness, "statistic", lambda drawn, *_: seen.append(drawn) or np.zeros(len(drawn)))
    goodness.bootstrap_test(pairs, "gaussian", (-0.7,), 30, np.random.default_rng(1))
    of_sample, replicates = seen
    assert len(np.unique(pairs[:, 0])) < 12
    assert np.array_equal(np.sort(replicates, axis=1), np.repeat(np.sort(of_sample, axis=1), 30, axis=0))
    tau = [fitting.stats.kendalltau(*one.T)[0] for one in replicates]
    assert np.mean(tau) == pytest.approx(GAUSSIAN.tau, abs=0.06)


def test_without_ties_replicates_have_ranks():
    assert goodness.without_ties(4) == pytest.approx(np.array([[0.2, 0.2], [0.4, 0.4], [0.6, 0.6], [0.8, 0.8]]))
    assert np.sort(ranked(GAUSSIAN.sample(31, np.random.default_rng(1))), axis=0) == pytest.approx(
        goodness.without_ties(31), abs=1e-15
    )


def test_the_level_holds_on_rounded_pairs():
    """At 5 % with 19 replicates; replicates without ties reject nearly every sample."""
    rng = np.random.default_rng(2)
    ours, without = [], []
    for seed in range(150):
        pairs = ranked(rounded(60, seed, (0.25, 0.2)))
        estimate = copulas.fit_rows(pairs[None, :, 0], pairs[None, :, 1], "gaussian")[0]
        ours.append(goodness.bootstrap_test(pairs, "gaussian", estimate, 19, rng)[1] <= 0.05)
        S = goodness.statistic(pairs[None], "gaussian", estimate[None])[0]
        simulated = goodness.simulate_statistics("gaussian", estimate, goodness.without_ties(60), 19, rng)
        without.append(np.all(simulated < S))
    assert np.mean(ours) < 0.11
    assert np.mean(without) > 0.8


def test_rounding_hardly_biases_the_estimate():
    """By less than a tenth of its standard deviation, 0.065."""
    means = []
    for steps in ((0.25, 0.2), (1e-6, 1e-6)):
        u, v = np.moveaxis([ranked(rounded(94, seed, steps)) for seed in range(200)], -1, 0)
        means.append(copulas.fit_rows(u, v, "gaussian").mean())
    assert means[0] == pytest.approx(means[1], abs=0.0065)


@pytest.mark.parametrize("steps", [(1e-9, 1e-9), (0.1, 0.05), (0.25, 0.2)])
def test_both_orders_of_the_columns_have_the_same_verdict(steps):
    """The order of the rows makes no difference either."""
    x = rounded(50, 3, steps)
    shuffled = np.random.default_rng(1).permutation(x)[:, ::-1]
    ours, theirs = (
        {fit.family: fit for fit in copulas.select(*one.T, FAMILIES, n_boot=39, rng=np.random.default_rng(5))}
        for one in (x, shuffled)
    )
    assert set(ours) == set(candidates(*x.T, FAMILIES))
    for name, fit in ours.items():
        other = theirs[transposed(name)]
        assert other.p_bootstrap == fit.p_bootstrap and other.accepted == fit.accepted, name
        assert abs(other.S - fit.S) < 1e-6
    assert len({fit.p_bootstrap for fit in ours.values()}) > 3


def test_the_statistic_is_the_mean_of_both_orders():
    pairs = ranked(GAUSSIAN.sample(30, np.random.default_rng(1)))
    parameters = np.array([[2.0]])
    first = goodness.statistic_of_one_order(pairs[None], "clayton90", parameters)
    second = goodness.statistic_of_one_order(pairs[None, :, ::-1], "clayton270", parameters)
    assert first != pytest.approx(second, rel=0.01)
    assert goodness.statistic(pairs[None], "clayton90", parameters) == pytest.approx(0.5 * (first + second))
    z = np.stack([pairs[:, 1], copulas.Copula("clayton270", (2.0,)).conditional(pairs[:, 1], pairs[:, 0])], axis=1)
    assert second[0] == pytest.approx(goodness.cramer_von_mises(z))


def test_exchanged_variables_have_the_transposed_family():
    u, v = np.random.default_rng(1).random((2, 20))
    for name in copulas.FAMILIES:
        parameters = {"student": (-0.4, 4.0), "independence": ()}.get(name, (0.5,) if name == "gaussian" else (2.0,))
        one, other = copulas.Copula(name, parameters), copulas.Copula(transposed(name), parameters)
        assert one.logpdf(u, v) == pytest.approx(other.logpdf(v, u), rel=1e-9)


def test_many_tied_pairs_are_tested_by_a_part_of_them(monkeypatch):
    monkeypatch.setattr(goodness, "LARGEST_SIMULATED", 100)
    p = []
    for seed in range(40):
        pairs = ranked(rounded(400, seed, (0.25, 0.2)))
        estimate = copulas.fit_rows(pairs[None, :, 0], pairs[None, :, 1], "gaussian")[0]
        S, value = goodness.bootstrap_test(pairs, "gaussian", estimate, 19, np.random.default_rng(seed))
        assert (S, value) == goodness.bootstrap_test(pairs, "gaussian", estimate, 19, np.random.default_rng(seed))
        p.append(value)
    assert np.mean(np.array(p) <= 0.05) < 0.15 and np.mean(p) == pytest.approx(0.5, abs=0.15)
