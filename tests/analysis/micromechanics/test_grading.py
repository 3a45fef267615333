"""Grading indices and curves against closed forms."""

import numpy as np
import pytest

from analysis.assembly import diameters
from analysis.micromechanics import grading


@pytest.mark.parametrize("share", [0.1, 0.5, 0.83])
def test_two_sizes_have_the_closed_form(share):
    # ln I_G = sqrt(w (1 - w)) ln(d2 / d1) for mass shares w and 1 - w.
    d = np.repeat([1.0, 2.5], [160, 40])
    weight = np.repeat([share / 160, (1 - share) / 40], [160, 40])
    expected = np.exp(np.sqrt(share * (1 - share)) * np.log(2.5))
    assert grading.grading_index(d, weight) == pytest.approx(expected, rel=1e-12)


def test_mass_is_the_default_weight_and_units_cancel():
    d = np.repeat([1.0, 2.5], [160, 40])
    w = 160 / (160 + 40 * 2.5**3)
    expected = np.exp(np.sqrt(w * (1 - w)) * np.log(2.5))
    assert grading.grading_index(d) == pytest.approx(expected, rel=1e-12)
    assert grading.grading_index(1e-4 * d) == pytest.approx(expected, rel=1e-12)
    assert grading.grading_index(np.full(7, 0.3)) == pytest.approx(1.0, abs=1e-12)


def test_active_index_leaves_out_rattlers_and_stress_index_follows_stress():
    d, count = np.array([1.0, 1.0, 2.0, 2.0, 9.0, 0.01]), np.array([2, 5, 3, 12, 1, 0])
    w = 2 / (2 + 16)
    expected = np.exp(np.sqrt(w * (1 - w)) * np.log(2.0))
    assert grading.active_grading_index(d, count) == pytest.approx(expected, rel=1e-12)
    carried = np.array([1.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    expected = np.exp(np.sqrt(3 / 16) * np.log(2.0))
    assert grading.stress_grading_index(d, carried) == pytest.approx(expected, rel=1e-12)


def test_lognormal_grading_gives_its_width_back():
    d = diameters(20000, 0.248e-3, 0.1, "lognormal")
    cut = 1 - 6 * np.exp(-4.5) / np.sqrt(2 * np.pi) / 0.9973002  # variance of a normal cut at three deviations
    assert np.log(grading.grading_index(d)) == pytest.approx(0.1 * np.sqrt(cut), rel=2e-4)


def test_curve_rises_to_one_and_gives_sizes():
    d = np.array([3.0, 1.0, 2.0])
    sizes, finer = grading.grading_curve(d)
    assert sizes.tolist() == [1.0, 2.0, 3.0]
    assert finer == pytest.approx([1 / 36, 9 / 36, 1.0])
    _, finer = grading.grading_curve(d, weight=np.array([0.0, 1.0, 1.0]))
    assert finer == pytest.approx([0.5, 1.0, 1.0])
    d = diameters(20000, 0.248e-3, 0.174, "loguniform")
    span = 2 * np.sqrt(3) * 0.174
    assert grading.size_at(d, 0.5) == pytest.approx(0.248e-3, rel=1e-9)
    assert grading.uniformity(d) == pytest.approx(np.exp(0.5 * span), rel=1e-3)


@pytest.mark.parametrize(
    ("d", "w", "words"),
    [
        ([1.0, -2.0], None, r"diameter\[1\] is not positive"),
        ([1.0, np.nan], None, r"diameter\[1\] is not positive"),
        ([1.0, 2.0], [1.0, -1.0], "weights run from -1 to 1"),
        ([1.0, 2.0], [0.0, 0.0], "all zero"),
        ([1.0, 2.0], [1.0], "not two lists of the same length"),
    ],
)
def test_no_grading_without_sizes_and_weights(d, w, words):
    with pytest.raises(grading.GradingError, match=words):
        grading.grading_index(np.array(d), None if w is None else np.array(w))
