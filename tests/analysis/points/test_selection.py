"""Representative points: probabilities, discrepancy, moments, nesting, and what is gained on the published ones."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from analysis.copulas import Copula
from analysis.copulas.multivariate import GaussianCopula
from analysis.inputs.joint import Joint
from analysis.inputs.marginals import Marginal
from analysis.points import selection
from analysis.points.discrepancy import gf_discrepancy, moment_errors
from analysis.points.moment_matching import gauss_rearranged
from analysis.points.unit_cube import kernel_discrepancy, uniform_set

FRICTION = Marginal("lognormal", {"median": 0.214, "sigma_ln": 0.469})
MODULUS = Marginal("lognormal", {"median": 25.7e9, "sigma_ln": 0.354})
JOINT = Joint((FRICTION, MODULUS), Copula("gaussian", (-0.738,)))


def errors(chosen, joint=JOINT):
    return moment_errors(chosen.x, chosen.probability, joint)


@pytest.mark.parametrize("method", selection.METHODS)
@pytest.mark.parametrize("n", [8, 9, 37, 100])
def test_probabilities_are_positive_and_sum_to_one(method, n):
    chosen = selection.select_points(JOINT, n, method, seed=3)
    assert chosen.n == n and chosen.x.shape == (n, 2)
    assert abs(math.fsum(chosen.probability) - 1.0) <= 1e-15
    assert chosen.probability.min() > 0.0
    assert np.all(np.isfinite(chosen.x)) and chosen.x.min() > 0.0
    assert chosen.discrepancy == pytest.approx(tuple(gf_discrepancy(chosen.x, chosen.probability, JOINT)))


def test_a_hundred_points_carry_marginals_moments_and_correlation():
    sobol = np.median([selection.select_points(JOINT, 100, "sobol", s).discrepancy for s in range(20)], axis=0)
    for seed in range(20):
        chosen = selection.select_points(JOINT, 100, seed=seed)
        assert max(chosen.discrepancy) <= 0.02
        assert np.all(np.array(chosen.discrepancy) <= 0.5 * sobol)
        found = errors(chosen)
        assert np.abs(found["mean"]).max() < 1e-6
        assert np.abs(found["std"]).max() < 1e-6
        assert np.abs(found["correlation"]).max() < 1e-6


def test_the_published_algorithm_leaves_what_it_is_known_to_leave():
    chosen = [selection.select_points(JOINT, 100, "gf-published", seed) for seed in range(10)]
    first, second = np.median([c.discrepancy for c in chosen], axis=0)
    assert first == pytest.approx(0.015, abs=0.004)
    assert second == pytest.approx(0.035, abs=0.008)
    assert -0.06 < np.mean([errors(c)["std"].mean() for c in chosen]) < -0.02


@pytest.mark.parametrize(
    "copula",
    [Copula("frank", (-6.0,)), Copula("student", (-0.7, 5.0)), Copula("clayton90", (2.0,)), Copula("joe", (2.5,))],
    ids=lambda copula: copula.family,
)
def test_other_dependence_and_other_marginals_are_carried_too(copula):
    friction = Marginal("weibull", {"shape": 2.3, "scale": 0.28})
    joint = Joint((friction, Marginal("gumbel", {"location": 2e10, "scale": 6e9})), copula)
    chosen = selection.select_points(joint, 100)
    assert max(chosen.discrepancy) <= 0.02
    assert max(np.abs(value).max() for value in errors(chosen, joint).values()) < 1e-6


def test_the_same_seed_gives_the_same_points():
    one, two, three = (selection.select_points(JOINT, 30, seed=s) for s in (5, 5, 6))
    assert np.array_equal(one.x, two.x) and np.array_equal(one.probability, two.probability)
    assert not np.array_equal(one.x, three.x)


def test_nested_points_keep_the_runs_already_paid_for():
    first, second = (selection.select_points(JOINT, n, seed=2, nested=True) for n in (100, 200))
    assert np.array_equal(second.x[:100], first.x)
    for chosen, limit in ((first, 0.02), (second, 0.015)):
        assert max(chosen.discrepancy) <= limit
        assert max(np.abs(value).max() for value in errors(chosen).values()) < 1e-6


def test_every_beginning_is_a_fair_set():
    chosen = selection.select_points(JOINT, 100)
    w = JOINT.rosenblatt(chosen.x)
    shuffled = [np.random.default_rng(s).permutation(w) for s in range(10)]
    for size in (10, 20, 50):
        chance = np.median([kernel_discrepancy(other[:size]) for other in shuffled])
        assert kernel_discrepancy(w[:size]) < 0.5 * chance


def test_two_point_rules_keep_the_mean_and_variance_of_a_marginal():
    equal = np.full(40, 1 / 40)
    x = gauss_rearranged(JOINT, JOINT.inverse_rosenblatt(uniform_set("lattice", 40, 2, 1)), equal)
    for i, marginal in enumerate(JOINT.marginals):
        assert equal @ x[:, i] == pytest.approx(marginal.mean, rel=1e-6)
        assert np.sqrt(equal @ (x[:, i] - marginal.mean) ** 2) == pytest.approx(marginal.std, rel=1e-4)


def test_reweighting_moves_the_probabilities_to_another_distribution():
    chosen = selection.select_points(JOINT, 100)
    same = selection.reweight(chosen, JOINT)
    assert np.abs(same.probability - chosen.probability).sum() < 0.1
    other = Joint(
        (
            Marginal("lognormal", {"median": 0.224, "sigma_ln": 0.44}),
            Marginal("lognormal", {"median": 25.0e9, "sigma_ln": 0.37}),
        ),
        Copula("gaussian", (-0.70,)),
    )
    moved = selection.reweight(chosen, other)
    assert np.array_equal(moved.x, chosen.x)
    assert max(np.abs(value).max() for value in errors(moved, other).values()) < 1e-6
    assert max(moved.discrepancy) < 0.04
    assert moved.probability.min() > 0.0


def test_three_variables():
    joint = Joint(
        (FRICTION, MODULUS, Marginal("normal", {"mean": 0.2, "sd": 0.02})),
        GaussianCopula(((1.0, -0.738, 0.3), (-0.738, 1.0, -0.1), (0.3, -0.1, 1.0))),
    )
    chosen = selection.select_points(joint, 60)
    assert max(chosen.discrepancy) < 0.03
    assert max(np.abs(value).max() for value in errors(chosen, joint).values()) < 1e-6


def test_points_survive_json():
    chosen = selection.select_points(JOINT, 20, seed=4)
    back = selection.RepresentativePoints.from_dict(json.loads(json.dumps(chosen.to_dict())))
    assert np.array_equal(back.x, chosen.x) and np.array_equal(back.probability, chosen.probability)
    assert (back.method, back.seed, back.discrepancy) == (chosen.method, chosen.seed, chosen.discrepancy)
    assert back.moment_errors == chosen.moment_errors
    earlier = {name: value for name, value in chosen.to_dict().items() if name != "moment_errors"}
    assert selection.RepresentativePoints.from_dict(earlier).moment_errors == ()


def test_points_that_cannot_carry_the_moments_say_which_and_by_how_much():
    heavy = Joint((Marginal("lognormal", {"median": 0.2, "sigma_ln": 1.5}), MODULUS), Copula("gaussian", (0.6,)))
    for method, n, lost in (("gf", 8, True), ("gf", 100, False), ("mc", 100, True)):
        chosen = selection.select_points(heavy, n, method)
        found = errors(chosen, heavy)
        assert chosen.moment_errors == pytest.approx(np.concatenate(list(found.values())))
        assert len(chosen.moment_warnings()) == lost
    [line] = selection.select_points(heavy, 8).moment_warnings()
    mean = 100 * errors(selection.select_points(heavy, 8), heavy)["mean"][0]
    assert (
        abs(mean) > 1
        and f"the 8 points do not carry all moments of the inputs; errors: mean of mu_s {mean:+.1f}%" in line
    )
    assert selection.RepresentativePoints(chosen.x, chosen.probability).moment_warnings() == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"n": 5}, "need at least 8"),
        ({"n": 20, "method": "halton"}, "unknown method 'halton'"),
        ({"n": 20, "method": "mc", "nested": True}, "not by mc"),
    ],
)
def test_what_cannot_be_made_is_refused(arguments, words):
    with pytest.raises(selection.PointsError, match=words):
        selection.select_points(JOINT, **arguments)
