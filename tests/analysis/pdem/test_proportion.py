"""The probability of an event over weighted points in packings: known intervals, and their coverage."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtr

from analysis.pdem.proportion import proportion


@pytest.mark.parametrize("hits, points", [(0, 20), (3, 20), (10, 21), (20, 20)])
def test_equal_points_of_one_packing_have_the_interval_of_clopper_and_pearson(hits, points):
    found = proportion(np.arange(points) < hits, np.full(points, 1 / points))
    exact = stats.binomtest(hits, points).proportion_ci(0.95, "exact")
    assert found == pytest.approx((hits / points, exact.low, exact.high), abs=1e-9)


def test_unequal_points_count_as_fewer():
    """Kish's number of points of probability 1/2 and ten of 1/20 is 1 / (1/4 + 10/400) = 3.636."""
    probability, event = np.array([0.5, *[0.05] * 10]), np.array([False, *[True] * 10])
    found, n = proportion(event, probability), 1 / (0.25 + 10 / 400)
    low, high = stats.beta.ppf(0.025, n / 2, n / 2 + 1), stats.beta.ppf(0.975, n / 2 + 1, n / 2)
    assert found == pytest.approx((0.5, low, high))


def test_packings_that_differ_widen_the_interval_and_points_without_probability_do_not_count():
    packing, event = np.repeat(range(5), 8), np.tile([True, False], 20)
    alike = proportion(event, np.ones(40), packing)
    apart = proportion(packing < 2, np.ones(40), packing)
    alone = proportion(packing < 2, np.ones(40))
    assert apart.high - apart.low > 1.5 * (alike.high - alike.low) > alone.high - alone.low
    more = proportion(np.append(event, True), np.append(np.ones(40), 0.0), np.append(packing, 9))
    assert list(map(float, more)) == pytest.approx(list(map(float, alike)))


def test_rows_are_judged_by_themselves_and_no_point_gives_nan():
    rows = np.array([[True, False, False], [True, True, True], [False, False, False]])
    found = proportion(rows, [0.2, 0.3, 0.5])
    assert found.value == pytest.approx([0.2, 1.0, 0.0])
    for k, row in enumerate(rows):
        assert [part[k] for part in found] == pytest.approx(list(map(float, proportion(row, [0.2, 0.3, 0.5]))))
    assert found.high[1] == 1.0 and found.low[2] == 0.0 and 0.0 < found.high[2] < 1.0
    assert all(np.isnan(part) for part in proportion([True], [0.0]))


@pytest.mark.parametrize("packings, shared", [(3, 1.0), (5, 0.0), (5, 1.0), (10, 0.5)])
def test_the_interval_holds_the_truth_in_19_of_20_campaigns(packings, shared):
    """60 points of unequal probability; a normal score with a part that the points of a packing share."""
    rng, campaigns = np.random.default_rng(3), 400
    truth, inside = ndtr(-0.8 / np.hypot(1.0, shared)), 0
    for _ in range(campaigns):
        packing, probability = rng.permutation(60) % packings, 0.5 + rng.random(60)
        score = rng.normal(size=60) + shared * rng.normal(size=packings)[packing]
        _, low, high = proportion(score > 0.8, probability, packing)
        inside += low <= truth <= high
    assert inside / campaigns > 0.95 - 2 * np.sqrt(0.05 * 0.95 / campaigns)
