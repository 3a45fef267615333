"""Bootstrap samples that choose their families again, against fits of each sample alone."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from paths import PAIRS_FILE

from analysis import copulas
from analysis.copulas.multivariate import fit_gaussian
from analysis.inputs import kernel_marginal, marginals
from analysis.inputs.joint import Joint, bootstrap_joints, fit_joint
from analysis.inputs.pairs import read_pairs
from analysis.inputs.refits import Candidates, possible_copulas, refitted_copulas, refitted_marginals
from analysis.points.selection import bootstrap_probabilities, select_points

PAIRS = read_pairs(PAIRS_FILE)
FIT = fit_joint(PAIRS, copula_families=copulas.PAPER_FAMILIES, n_boot=0)


def tried(fit):
    return Candidates.tried(dict(zip(("mu_s", "G_p"), fit.marginals, strict=True)), fit.copulas)


def test_the_families_tried_are_those_of_the_tables():
    found = tried(FIT)
    assert set(found.copulas) == set(copulas.PAPER_FAMILIES)
    assert all(set(families) == set(marginals.FAMILIES) for families in found.marginals)
    as_dicts = FIT.to_dict()
    assert Candidates.tried(dict(enumerate(as_dicts["marginals"])), as_dicts["copulas"]) == found
    assert Candidates.tried({}, ()) is None
    assert Candidates.tried({"mu_s": [], "G_p": FIT.marginals[1]}, FIT.copulas) is None


def test_each_sample_has_the_families_that_it_has_alone():
    drawn = PAIRS[np.random.default_rng(2).integers(0, 94, (12, 94))]
    found = refitted_marginals(drawn[..., 1], tuple(marginals.FAMILIES), FIT.joint.marginals[1])
    for row, one in zip(drawn[..., 1], found, strict=True):
        alone = marginals.fit_all(row, n_sim=0)[0]
        assert one.family == alone.family and one.params == pytest.approx(alone.params, rel=1e-9)
    u, v = (copulas.pseudo_observations(drawn[..., k]) for k in (0, 1))
    chosen = refitted_copulas(u, v, copulas.PAPER_FAMILIES)
    for x, y, one in zip(u, v, chosen, strict=True):
        alone = copulas.select(x, y, copulas.PAPER_FAMILIES, n_boot=0)[0]
        assert one.family == alone.family and one.parameters[0] == pytest.approx(alone.parameters[0], rel=0.01)
    assert len({one.family for one in found}) > 1 and len({one.family for one in chosen}) > 1


def test_the_same_samples_keep_or_choose_their_families():
    kept = bootstrap_joints(PAIRS, 60, np.random.default_rng(3), FIT.joint)
    chosen = bootstrap_joints(PAIRS, 60, np.random.default_rng(3), FIT.joint, tried(FIT))
    assert {joint.copula.family for joint in kept} == {"gaussian"}
    counts = Counter(joint.copula.family for joint in chosen)
    assert len(counts) > 1 and counts["gaussian"] > 20
    same = [(a, b) for a, b in zip(kept, chosen, strict=True) if b.copula.family == "gaussian"]
    assert all(a.copula == b.copula for a, b in same)
    assert {joint.marginals[1].family for joint in chosen} > {"lognormal"}


def test_probabilities_of_points_with_other_families_carry_their_means():
    x = select_points(FIT.joint, 30).x
    shares = bootstrap_probabilities(PAIRS, FIT.joint, x, 12, seed=3, candidates=tried(FIT))
    joints = bootstrap_joints(PAIRS, 12, np.random.default_rng(3), FIT.joint, tried(FIT))
    assert len({joint.marginals[1].family for joint in joints}) > 1
    assert shares.min() > 0 and shares.sum(axis=1) == pytest.approx(1.0)
    for share, joint in zip(shares, joints, strict=True):
        assert share @ x == pytest.approx([m.mean for m in joint.marginals], rel=1e-6)


def test_only_families_that_may_win_are_refitted():
    u, v = copulas.pseudo_observations(copulas.Copula("clayton", (3.0,)).sample(1500, np.random.default_rng(1)).T)
    families = ("gaussian", "clayton", "frank", "gumbel")
    assert possible_copulas(u, v, families) == ("clayton",)
    assert set(possible_copulas(u[:15], v[:15], families)) == set(families)
    drawn = np.random.default_rng(2).integers(0, 1500, (20, 1500))
    ranks = (copulas.pseudo_observations(w[drawn]) for w in (u, v))
    assert {one.family for one in refitted_copulas(*ranks, families)} == {"clayton"}


def test_a_kernel_density_keeps_its_bandwidth_and_gets_the_values_of_each_sample():
    joint = fit_joint(PAIRS, ("kernel",), ("gaussian",), n_boot=0).joint
    many = bootstrap_joints(PAIRS, 25, np.random.default_rng(3), joint, tried(FIT))
    drawn = PAIRS[np.random.default_rng(3).integers(0, 94, (25, 94))]
    for row, one in zip(drawn, many, strict=True):
        assert one.marginals[0].params == joint.marginals[0].params
        assert one.marginals[0].values == pytest.approx(
            kernel_marginal.centres(row[:, 0], joint.marginals[0].params["bandwidth_ln"])
        )
    mean = np.array([one.marginals[0].mean for one in many])
    assert mean.std() == pytest.approx(PAIRS[:, 0].std() / np.sqrt(94), rel=0.5)


def test_a_kernel_density_is_not_offered_to_bootstrap_samples():
    kernel = marginals.fit(PAIRS[:, 0], "kernel")
    tables = {"mu_s": [*FIT.marginals[0][:2], kernel], "G_p": [kernel, FIT.marginals[1][0]]}
    assert Candidates.tried(tables, FIT.copulas).marginals == (("lognormal", "gumbel"), ("kernel",))


def test_three_variables_choose_their_marginals_again():
    x = np.column_stack([PAIRS, PAIRS[:, 0] ** 0.5])
    joint = Joint((*FIT.joint.marginals, FIT.joint.marginals[0]), fit_gaussian(x))
    candidates = Candidates(tuple(tuple(marginals.FAMILIES) for _ in range(3)), ("gaussian",))
    many = bootstrap_joints(x, 15, np.random.default_rng(1), joint, candidates)
    assert all(isinstance(one, Joint) and one.dimension == 3 for one in many)
    assert len({one.marginals[1].family for one in many}) > 1
