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
from analysis.report import page, sections
from analysis.results.build import build_results
from analysis.results.reader import read_results
from analysis.tables import evaluate
from analysis.tables.moment_bands import input_bands

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


def test_bands_of_a_smooth_response_are_those_of_exact_moments(drawn):
    x, probabilities = drawn
    eta = synthetic.critical_eta(x[:, 0])
    squares = [
        joint.expectation(lambda y: np.stack([(f := synthetic.critical_eta(y[:, 0])), f**2], axis=1), nodes=60)
        for joint in refitted()
    ]
    mean, square = np.array(squares).T
    std = np.sqrt(square - mean**2)
    found = bands.reweighted_moment_bands(eta, probabilities)
    for (low, high), exact in zip((found[0], found[1]), (mean, std), strict=True):
        ends = np.quantile(exact, [0.025, 0.975])
        assert [low, high] == pytest.approx(ends, abs=0.08 * (ends[1] - ends[0]))
    assert found[0][1] - found[0][0] == pytest.approx(2 * 1.96 * mean.std(), rel=0.25)


def test_four_times_the_pairs_halve_the_band(drawn):
    x, probabilities = drawn
    many = bootstrap_probabilities(np.tile(PAIRS, (4, 1)), JOINT, x, DRAWS, seed=4)
    width, narrow = (np.diff(bands.reweighted_moment_bands(x[:, 0], p)[0])[0] for p in (probabilities, many))
    assert narrow == pytest.approx(0.5 * width, rel=0.3)


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


def test_the_table_has_the_moments_within_their_bands(results):
    frame = input_bands(results).set_index(["mu_iso", "state", "quantity"])
    assert len(frame) == 3 * 7
    for name in ("mean", "sd"):
        assert np.all(frame[f"{name}_low"] < frame[f"{name}_high"])
        assert np.all((frame[f"{name}_low"] < frame[name]) & (frame[name] < frame[f"{name}_high"]))
    values, probabilities = results.state("probe", "G_0", 0.1), results.bootstrap_probability(0.1)
    known = np.isfinite(values)
    share = probabilities[:, known] / probabilities[:, known].sum(axis=1, keepdims=True)
    ends = np.quantile(1e-6 * share @ values[known], [0.025, 0.975])
    row = frame.loc[(0.1, "probe", "G_0")]
    assert [row["mean_low"], row["mean_high"]] == pytest.approx(ends, rel=1e-9)
    assert len(input_bands(read_results(synthetic.example()))) == 0


def test_figures_and_report_show_the_band(results):
    axis = Figure().subplots()
    panels.state_pdfs(axis, results, "critical", "eta")
    assert len(axis.collections) == len(synthetic.DENSITIES)
    for curve, band in zip(axis.lines[0::2], axis.collections, strict=True):
        assert band.get_paths()[0].vertices[:, 1].max() > 0.95 * curve.get_ydata().max()
    plain = Figure().subplots()
    panels.state_pdfs(plain, read_results(synthetic.example()), "critical", "eta")
    assert not plain.collections
    text = sections.input_bands_html(results, evaluate(results, ["input_bands", "report_facts"]))
    assert "With 94 pairs" in text and f"resampled {DRAWS} times" in text
    row = input_bands(results).iloc[0]
    for end in ("mean_low", "mean_high", "sd_low", "sd_high"):
        assert page.number(row[end]) in text
    plain = read_results(synthetic.example())
    assert "there are no bands" in sections.input_bands_html(plain, evaluate(plain, ["input_bands"]))
