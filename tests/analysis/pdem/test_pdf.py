"""The PDF: distribution function, quantiles, exceedance, distances and its file form."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest
from pdf_checks import l1_distance
from scipy import stats

from analysis.pdem import evolution
from analysis.pdem.pdf import PDF, PdemError, wasserstein

STRAIN = np.linspace(0.0, 0.3, 5)


def one_kernel(width=0.1, at=2.0):
    """A single point: the PDF is its kernel, a normal distribution."""
    return evolution.evolve(np.full((5, 1), at), [1.0], STRAIN, bandwidth=width)


def test_cdf_quantile_and_exceedance_of_a_normal_kernel_without_its_point():
    pdf, exact = replace(one_kernel(), values=None, probability=None), stats.norm(2.0, 0.1)
    levels = np.array([0.05, 0.5, 0.95])
    assert pdf.quantile(levels)[2] == pytest.approx(exact.ppf(levels), abs=1e-4)
    assert pdf.cdf([1.9, 2.2])[0] == pytest.approx(exact.cdf([1.9, 2.2]), abs=1e-4)
    assert pdf.exceedance(2.1)[0] == pytest.approx(exact.sf(2.1), abs=1e-4)
    assert pdf.quantile(0.5).shape == (5,)
    with pytest.raises(ValueError, match="level 1.2"):
        pdf.quantile(1.2)
    with pytest.raises(PdemError, match="an interval needs the points"):
        pdf.exceedance_interval(2.1)


def test_exceedance_and_quantiles_come_from_the_points_if_there_are_any():
    h = np.linspace(1.0, 2.0, 5)[:, None] + np.linspace(-0.1, 0.1, 21)
    pdf = evolution.evolve(h, np.full(21, 1 / 21), STRAIN)
    assert pdf.exceedance(1.5) == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0], abs=0.02)
    assert pdf.exceedance([1.5, 1.75]).shape == (5, 2) and pdf.quantile(0.5) == pytest.approx(np.linspace(1.0, 2.0, 5))
    low, high = pdf.exceedance_interval([1.5, 1.75], noise=0.01)
    assert low.shape == (5, 2) and np.all(low <= pdf.exceedance([1.5, 1.75])) and np.all(low < high)
    assert pdf.quantile_interval(0.5)[1].shape == (5,)
    assert pdf.at(2).exceedance(1.5) == pytest.approx([0.5])
    shown = replace(pdf, values=None, probability=None)
    again = shown.with_points(h, np.full(21, 1 / 21))
    assert np.array_equal(again.quantile([0.05, 0.9]), pdf.quantile([0.05, 0.9]))
    assert shown.quantile(0.05)[2] < pdf.quantile(0.05)[2]


def test_hdf5_round_trip_keeps_everything(tmp_path):
    pdf = one_kernel()
    with h5py.File(tmp_path / "r.h5", "w") as file:
        group = file.create_group("eta")
        pdf.to_hdf5(group)
        pdf.to_hdf5(group)
        again = PDF.from_hdf5(group)
        with pytest.raises(ValueError, match="no PDF here"):
            PDF.from_hdf5(file)
    for name in ("strain", "x", "p", "mean", "std", "bandwidth", "lost_probability", "spacing"):
        assert np.array_equal(getattr(pdf, name), getattr(again, name)), name
    assert again.method == "pdem-exact"


def test_l1_distance_of_two_normals_is_the_known_one():
    apart = 0.1
    expected = 2 * (2 * stats.norm.cdf(0.5 * apart / 0.1) - 1)
    assert l1_distance(one_kernel(), one_kernel(at=2.0 + apart)) == pytest.approx(np.full(5, expected), abs=1e-3)
    assert np.all(l1_distance(one_kernel(), one_kernel()) < 1e-12)


def test_wasserstein_distance_of_a_shift_is_the_shift():
    assert wasserstein(one_kernel(), one_kernel(at=2.03)) == pytest.approx(np.full(5, 0.03), rel=1e-3)


def test_a_single_strain_can_be_picked():
    pdf = one_kernel()
    assert pdf.at(-1).strain == pytest.approx([0.3]) and pdf.at(2).p.shape == (1, 400)
