"""Packings brought to one level: exact where the model is, better than one packing where it has noise."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.results import replicates


def drawn(rng, between, own, R=4, served=5, Q=30):
    """Truth (Q,) and sets (R, Q): the first packing serves all points, the others `served` of them."""
    truth = rng.normal(size=Q)
    sets = truth + between * rng.normal(size=(R, 1)) + own * rng.normal(size=(R, Q))
    sets[1:, served:] = np.nan
    return truth, sets


def test_an_offset_of_a_packing_is_found_and_taken_off_every_point():
    truth = np.linspace(1.0, 2.0, 8)
    sets = truth + np.array([[0.3], [-0.1], [-0.2]])
    sets[1:, 4:] = np.nan
    assert replicates.offsets(sets) == pytest.approx([0.3, -0.1, -0.2])
    assert replicates.average(sets) == pytest.approx(truth)


def test_along_strain_each_strain_has_its_own_offset():
    truth = np.arange(24.0).reshape(3, 8)
    sets = np.stack([truth + np.array([[0.1], [0.2], [0.3]]), truth - np.array([[0.1], [0.2], [0.3]])])
    sets[1, :, 5:] = np.nan
    assert replicates.average(sets) == pytest.approx(truth)


def test_what_single_runs_scatter_by_is_no_offset():
    """Four packings that do not differ: half of all offsets are not trusted at all, none of the others wholly."""
    rng = np.random.default_rng(6)
    shares = np.array([replicates.offset_reliability(drawn(rng, 0.0, 1.0)[1]) for _ in range(400)])
    assert 0.4 < np.mean(shares == 0) < 0.75 and shares.mean() < 0.25 and shares.max() < 1
    assert np.mean([replicates.offset_reliability(drawn(rng, 5.0, 0.5)[1]) for _ in range(50)]) > 0.97


def test_one_packing_and_too_few_shared_points_are_left_as_they_are():
    sets = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, np.nan]])
    assert replicates.average(sets) == pytest.approx([1.5, 3.0, 3.0])
    assert replicates.average(sets[:1]) == pytest.approx([1.0, 2.0, 3.0])
    assert np.isnan(replicates.average(np.full((2, 3), np.nan))).all()


def test_a_failed_run_takes_its_point_out_of_the_offset_and_no_more():
    truth = np.arange(6.0)
    sets = truth + np.array([[1.0], [-1.0]])
    sets[1, 4:] = np.nan
    sets[0, 0] = np.nan
    assert replicates.average(sets) == pytest.approx(truth)


@pytest.mark.parametrize(("between", "own"), [(1.0, 0.2), (1.0, 1.0), (0.0, 1.0)])
def test_levelling_does_not_harm_and_helps_where_packings_differ(between, own):
    """Mean over thirty points against the first packing alone, 1,000 campaigns."""
    rng = np.random.default_rng(8)
    levelled, first = [], []
    for _ in range(1000):
        truth, sets = drawn(rng, between, own)
        levelled.append(np.mean(replicates.average(sets) - truth))
        first.append(np.mean(sets[0] - truth))
    assert np.std(levelled) < {1.0: 0.8, 0.0: 1.3}[between] * np.std(first)


def test_the_variances_are_those_of_a_balanced_layout():
    rng = np.random.default_rng(7)
    found = np.mean([replicates.variances(drawn(rng, 1.0, 0.5)[1]) for _ in range(3000)], axis=0)
    assert found == pytest.approx([1.0 + 0.25 / 5, 0.25], rel=0.05)


def test_failed_packings_and_runs_do_not_keep_the_rest_from_being_levelled():
    rng = np.random.default_rng(9)
    truth, sets = drawn(rng, 0.0, 0.01, R=5)
    sets[0] += 1.0
    whole = replicates.average(sets)
    lost = sets.copy()
    lost[3] = np.nan
    assert np.abs(replicates.average(lost) - whole).max() < 0.1
    scattered = sets.copy()
    scattered[[1, 2, 3], [0, 1, 2]] = np.nan
    assert np.abs(replicates.average(scattered) - truth)[5:].max() < 0.55  # the level of the three packings compared
    assert replicates.shared(scattered)[0].sum() >= 3


def test_a_density_whose_packings_cannot_be_compared_has_the_whole_variance_of_packings():
    sets = np.full((3, 6), np.nan)
    sets[0] = np.arange(6.0)
    assert replicates.level_variance(sets, np.full(6, 1 / 6), 0.04, 0.01) == 0.04
