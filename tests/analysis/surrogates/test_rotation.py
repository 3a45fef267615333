"""Order of the points and the packings that they take."""

import numpy as np
import pytest

from analysis.surrogates.rotation import deal, nested_order


def cloud(n, seed=1):
    rng = np.random.default_rng(seed)
    u = rng.multivariate_normal([0, 0], [[1, -0.7], [-0.7, 1]], n)
    return np.exp(u * [0.47, 0.35] + np.log([0.21, 25.7e9]))


def test_every_beginning_of_the_nested_order_covers_the_range():
    inputs = cloud(100)
    order, logs = nested_order(inputs), np.log(inputs)
    assert sorted(order) == list(range(100))
    assert np.ptp(logs[order[:12]], axis=0) == pytest.approx(np.ptp(logs, axis=0), rel=0.2)


@pytest.mark.parametrize(("n", "packings"), [(100, 20), (100, 7), (8, 4), (24, 24), (30, 50), (12, 1), (1, 3)])
def test_every_beginning_of_the_order_uses_the_packings_evenly(n, packings):
    inputs = cloud(n)
    dealt, order = deal(inputs, packings), nested_order(inputs)
    count = min(n, packings)
    for k in range(1, n + 1):
        used = np.bincount(dealt[order[:k]], minlength=count)
        assert len(used) == count and np.ptp(used) <= 1


@pytest.mark.parametrize("packings", [4, 5, 10, 20])
def test_points_of_a_packing_represent_the_whole_distribution(packings):
    """The packings' means of the standardised logarithms scatter by less than half of what random dealing gives."""
    inputs = cloud(100)
    z = np.log(inputs)
    z = (z - z.mean(axis=0)) / z.std(axis=0)
    rng = np.random.default_rng(2)

    def imbalance(dealt):
        return np.sqrt(np.mean([z[dealt == r].mean(axis=0) ** 2 for r in range(packings)]))

    random = np.mean([imbalance(rng.permutation(np.arange(100) % packings)) for _ in range(50)])
    assert imbalance(deal(inputs, packings)) < 0.5 * random


def test_dealing_does_not_depend_on_units_and_repeats():
    inputs = cloud(40)
    assert np.array_equal(deal(inputs, 10), deal(inputs * [1.0, 1e-9], 10))


def test_points_that_all_have_the_same_property_are_dealt_over_the_other():
    inputs = cloud(20)
    inputs[:, 0] = 0.25
    dealt = deal(inputs, 4)
    assert np.bincount(dealt).tolist() == [5, 5, 5, 5]
