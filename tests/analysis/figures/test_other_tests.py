"""Figures of undrained tests, and labels in extension."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_paths
from matplotlib.figure import Figure

from analysis.figures import FIGURES, NOT_UNDRAINED, UNDRAINED, drawn, panels, style
from analysis.quantities import DRAINED, Loading
from analysis.results.build import build_results
from analysis.results.reader import read_results
from analysis.tables.critical_line import lines_of_one, of_one


@pytest.fixture(scope="module")
def undrained():
    return read_results(synthetic_paths.example())


def test_every_test_has_its_figures(undrained):
    extension = read_results(synthetic_paths.example("drained", "extension"))
    assert set(UNDRAINED) < set(drawn(undrained)) and not {*NOT_UNDRAINED} & set(drawn(undrained))
    assert not {*UNDRAINED} & set(drawn(extension)) and set(NOT_UNDRAINED) < set(drawn(extension))


@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("name", UNDRAINED)
def test_the_figures_of_undrained_tests_are_drawn_in_both_widths(undrained, name, narrow, tmp_path):
    frames = {"critical_points": of_one(undrained), "critical_lines": lines_of_one(undrained)}
    with style.one_column(narrow):
        figure = FIGURES[name](undrained, frames)
    assert style.save(figure, tmp_path / "a.png").stat().st_size > 10_000


def test_the_stress_path_shows_every_point_its_m_line_and_its_end(undrained):
    figure = FIGURES["fig17_stress_path"](undrained, {})
    dense, loose = figure.axes
    line = next(line for line in loose.lines if line.get_linewidth() == 1.1 and line.get_linestyle() == "-")
    eta = np.nansum(undrained.probability(0.1) * undrained.state("critical", "eta", 0.1))
    slope = line.get_ydata()[1] / line.get_xdata()[1]
    assert slope == pytest.approx(eta / undrained.holds_for("critical", "eta", 0.1), rel=1e-6)
    for axis, marker, count in ((dense, "s", 3), (loose, "x", 4), (dense, "x", 0)):
        assert sum(line.get_marker() == marker for line in axis.lines) == count


def test_the_probability_of_an_end_is_drawn_along_strain(undrained):
    figure = FIGURES["fig18_pore_pressure"](undrained, {})
    last = [axis for axis in figure.axes if axis.get_ylabel() == "Probability"][0]
    for line, kind, mu_iso in zip(last.lines, ("stiff", "liquefied"), (0.001, 0.1), strict=True):
        assert line.get_ydata() == pytest.approx(undrained.ended(kind, mu_iso).probability)


def test_in_extension_strains_are_shown_positive_and_named_so():
    results = read_results(synthetic_paths.example("drained", "extension"))
    axis = Figure().subplots()
    panels.mean_band(axis, results, "eta")
    assert axis.get_xlabel() == Loading("drained", "extension").strain_label != DRAINED.strain_label
    line = axis.lines[0]
    assert line.get_xdata()[-1] == pytest.approx(40.0) and line.get_ydata()[-1] < 0


def test_a_density_without_any_test_left_has_its_panels(tmp_path, monkeypatch):
    monkeypatch.setattr(synthetic_paths, "LIQUEFIED_AT", 0.0013)
    monkeypatch.setattr(synthetic_paths, "LIQUEFIED_END", 0.02)
    made = synthetic_paths.make_campaign(tmp_path, n=4, densities=(0.1,), liquefied={0.1: range(4)})
    results = read_results(build_results(tmp_path, *made, cells=64))
    frames = {"critical_points": of_one(results), "critical_lines": lines_of_one(results)}
    for name in ("fig05_stress_ratio", "fig07_peak_critical", "fig12_fabric", "fig14_joint_eta_e", *UNDRAINED):
        FIGURES[name](results, frames)
