"""Statistics of points with probabilities: one normalisation, missing values, the names of the version before."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from paths import ROOT

from analysis import pdem
from analysis.pdem import evolution, joint_pdf, weighted


@pytest.fixture
def points():
    """Values (4, 30) with gaps, and probabilities (30,) whose sum is not 1."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=(4, 30))
    values[1, ::7] = np.nan
    return values, 3.0 * rng.dirichlet(np.ones(30))


def test_probabilities_are_normalised_over_the_points_that_have_a_value(points):
    values, probability = points
    known = np.isfinite(values)
    rows = weighted.normalised(probability, known)
    assert rows.sum(axis=1) == pytest.approx(np.ones(4)) and np.all(rows[~known] == 0)
    assert rows[1, 1] / rows[1, 2] == pytest.approx(probability[1] / probability[2])
    assert weighted.normalised(probability) == pytest.approx(probability / 3.0)
    assert len(weighted.normalised(np.empty(0))) == 0


def test_statistics_by_row_are_those_of_the_points_with_a_value(points):
    values, probability = points
    rows = weighted.normalised(probability, np.isfinite(values))
    mean, std = weighted.moments(values, rows)
    assert mean == pytest.approx(weighted.mean(values, probability), rel=1e-13)
    assert std == pytest.approx(weighted.std(values, probability), rel=1e-13)
    levels = np.array([0.05, 0.4, 0.95])
    for row, of_row in zip(values, weighted.quantiles(values, rows, levels), strict=True):
        assert of_row == pytest.approx(weighted.quantile(row, probability, levels), rel=1e-12)


def test_the_correlation_of_a_joint_pdf_is_the_weighted_one(points):
    values, probability = points
    joint = joint_pdf.joint_pdf(values[0], values[1], probability / 3.0)
    assert joint.correlation == pytest.approx(weighted.correlation(values[0], values[1], probability), rel=1e-12)


def test_the_former_name_warns():
    with pytest.warns(DeprecationWarning, match="analysis.pdem.state_density is now analysis.pdem"):
        assert pdem.state_density is evolution.state_pdf
    with pytest.raises(AttributeError, match="no attribute 'density'"):
        _ = pdem.density


def test_the_statistics_and_the_pdf_load_no_scipy():
    code = "import sys; from analysis.pdem import PDF, weighted; print('scipy' in sys.modules, 'h5py' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["False", "False"]
