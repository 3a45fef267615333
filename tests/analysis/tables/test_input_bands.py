"""Uncertainty from the number of pairs: bands against exact moments of the refitted inputs, and where they show."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic
from matplotlib.figure import Figure
from paths import PAIRS_FILE

from analysis.figures import panels
from analysis.inputs.joint import bootstrap_joints, fit_joint
from analysis.inputs.pairs import read_pairs
from analysis.pdem import bands, evolution
from analysis.points.selection import bootstrap_probabilities, select_points
from analysis.results.build import build_results
from analysis.results.reader import read_results

PAIRS = read_pairs(PAIRS_FILE)
JOINT = fit_joint(PAIRS, n_boot=0).joint
DRAWS = 60


@pytest.fixture(scope="module")
def drawn():
    """40 representative points and their probabilities under 60 refitted inputs."""
    x = select_points(JOINT, 40).x
    return x, bootstrap_probabilities(PAIRS, JOINT, x, DRAWS, seed=3)


def refitted():
    return bootstrap_joints(PAIRS, DRAWS, np.random.default_rng(3), JOINT)


def test_reweighted_points_carry_every_refitted_input(drawn):
    x, probabilities = drawn
    assert probabilities.min() > 0 and probabilities.sum(axis=1) == pytest.approx(1, abs=1e-14)
    for other, share in zip(refitted(), probabilities, strict=True):
        assert share @ x[:, 0] == pytest.approx(other.marginals[0].mean, rel=1e-6)
        assert share @ x[:, 1] == pytest.approx(other.marginals[1].mean, rel=1e-6)


def test_the_band_lies_about_the_density_and_closes_on_known_inputs(drawn):
    x, probabilities = drawn
    own = select_points(JOINT, 40).probability
    values = synthetic.critical_eta(x[:, 0])
    values[7] = np.nan
    weight = np.where(np.isfinite(values), own, 0.0)
    pdf = evolution.state_pdf(values, weight / weight.sum())
    shown = bands.with_input_band(pdf, values[None], probabilities)
    inside = (shown.p >= shown.low) & (shown.p <= shown.high)
    assert shown.low.min() >= 0 and np.sum(shown.p[inside]) > 0.9 * np.sum(shown.p)
    assert np.sum(shown.high - shown.low) * shown.dx[0] > 0.05
    fixed = bands.with_input_band(pdf, values[None], np.repeat(own[None], 5, axis=0))
    assert fixed.low == pytest.approx(pdf.p, abs=1e-8 * pdf.p.max())
    assert fixed.high == pytest.approx(fixed.low, abs=1e-9 * pdf.p.max())


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A campaign of six points, one of them failed, with refitted inputs."""
    folder = tmp_path_factory.mktemp("bands")
    plan, points, info = synthetic.make_campaign(folder, n=6, failed=(3,), families=("coupled", "G_p"))
    path = build_results(folder, plan, points, info, max_lost_probability=0.5, input_bootstrap=DRAWS)
    return read_results(path)


def test_results_hold_the_refitted_probabilities(results):
    for family in ("coupled", "G_p"):
        probabilities = results.bootstrap_probability(0.04, family)
        assert probabilities.shape == (DRAWS, 6)
        assert probabilities.sum(axis=1) == pytest.approx(1) and np.all(probabilities[:, 3] == 0)
    assert read_results(synthetic.example()).bootstrap_probability(0.04) is None


def test_figures_show_the_band(results):
    axis = Figure().subplots()
    panels.state_pdfs(axis, results, "critical", "eta")
    assert len(axis.collections) == len(synthetic.DENSITIES)
    for curve, band in zip(axis.lines[0::2], axis.collections, strict=True):
        assert band.get_paths()[0].vertices[:, 1].max() > 0.95 * curve.get_ydata().max()
    plain = Figure().subplots()
    panels.state_pdfs(plain, read_results(synthetic.example()), "critical", "eta")
    assert not plain.collections
