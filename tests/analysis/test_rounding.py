"""A value and its uncertainty are rounded together, and once more changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.quantities import QUANTITIES, parameter, rounded, with_error


@pytest.mark.parametrize("value, error, texts", [
    (6.5091, 13.0, ("7", "13")), (0.8803, 0.0369, ("0.88", "0.04")), (0.637603, 0.0175, ("0.638", "0.018")),
    (0.214, 0.0102, ("0.214", "0.010")), (1234.0, 355.0, ("1200", "400")), (1234.0, 354.0, ("1230", "350")),
    (0.5, 0.0949, ("0.50", "0.09")), (0.5, 0.0951, ("0.50", "0.10")), (3.0, 9.6, ("3", "10")),
    (-0.0004, 0.02, ("0.000", "0.020")), (198.3, 8.6, ("198", "9")),
])  # fmt: skip
def test_the_uncertainty_sets_the_digits(value, error, texts):
    assert rounded(value, error) == texts


@pytest.mark.parametrize("value, error, texts", [
    (0.63949, np.nan, ("0.639", "")), (198.3, 0.0, ("198", "")), (12345.6, np.inf, ("12300", "")),
    (0.0, np.nan, ("0", "")),
    (np.nan, 0.1, ("–", "")), (np.inf, 0.1, ("–", "")), (2.5e9, np.nan, ("2.50e+09", "")), (-0.5, -1.0, ("-0.500", "")),
])  # fmt: skip
def test_without_an_uncertainty_there_are_three_digits(value, error, texts):
    assert rounded(value, error) == texts


def test_rounding_twice_is_rounding_once_and_close():
    rng = np.random.default_rng(1)
    for error, ratio in zip(10 ** rng.uniform(-6, 6, 3000), rng.uniform(-200, 200, 3000), strict=True):
        value, half = (float(text) for text in rounded(ratio * error, error))
        assert rounded(value, half) == rounded(ratio * error, error)
        assert abs(value - ratio * error) <= 0.5 * half and abs(half / error - 1) < 0.15


def test_parameters_and_texts_use_it():
    assert with_error(6.5091, 13.0) == "7 ± 13" and with_error(0.25, np.nan) == "0.250"
    assert parameter("G_p", "median", 25.7e9, 0.94e9) == "median = 25.7 ± 0.9 GPa"
    assert parameter("mu_s", "sigma_ln", 0.469, 0.034) == "sigma_ln = 0.469 ± 0.034"
    assert QUANTITIES["phi"].unit == "deg"
