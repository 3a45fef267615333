"""Packings brought to one level: exact where the model is, better than one packing where it has noise."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import packings

ALONE = 25 / 30


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
    assert packings.offsets(sets) == pytest.approx([0.3, -0.1, -0.2])
    assert packings.average(sets) == pytest.approx(truth)


def test_along_strain_each_strain_has_its_own_offset():
    truth = np.arange(24.0).reshape(3, 8)
    sets = np.stack([truth + np.array([[0.1], [0.2], [0.3]]), truth - np.array([[0.1], [0.2], [0.3]])])
    sets[1, :, 5:] = np.nan
    assert packings.average(sets) == pytest.approx(truth)


def test_one_packing_and_too_few_shared_points_are_left_as_they_are():
    sets = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, np.nan]])
    assert packings.average(sets) == pytest.approx([1.5, 3.0, 3.0])
    assert packings.average(sets[:1]) == pytest.approx([1.0, 2.0, 3.0])
    assert np.isnan(packings.average(np.full((2, 3), np.nan))).all()


def test_a_failed_run_takes_its_point_out_of_the_offset_and_no_more():
    truth = np.arange(6.0)
    sets = truth + np.array([[1.0], [-1.0]])
    sets[1, 4:] = np.nan
    sets[0, 0] = np.nan
    assert packings.average(sets) == pytest.approx(truth)


@pytest.mark.parametrize(("between", "own"), [(1.0, 0.2), (1.0, 1.0), (0.1, 1.0)])
def test_the_error_all_points_share_is_the_one_stated(between, own):
    """Mean over thirty points, five of them in four packings, 3,000 campaigns."""
    rng = np.random.default_rng(7)
    errors, stated = [], []
    for _ in range(3000):
        truth, sets = drawn(rng, between, own)
        errors.append(np.mean(packings.average(sets) - truth))
        stated.append(packings.level_variance(sets, ALONE))
    single = own**2 * (25 + 5 / 4) / 30**2  # what the points' own scatter adds to the mean
    assert np.mean(np.square(errors)) == pytest.approx(np.mean(stated) + single, rel=0.2)


def test_levelling_beats_the_first_packing_alone_where_packings_differ():
    rng = np.random.default_rng(8)
    levelled, first = [], []
    for _ in range(500):
        truth, sets = drawn(rng, 1.0, 1.0)
        levelled.append(np.mean(packings.average(sets) - truth))
        first.append(np.mean(sets[0] - truth))
    assert np.std(levelled) < 0.75 * np.std(first)
