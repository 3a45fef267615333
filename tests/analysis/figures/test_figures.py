"""Figures: every one is drawn from results.h5 alone, small, and shows the numbers that are in the file."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic
from matplotlib import colormaps, rcParams
from matplotlib.figure import Figure
from PIL import Image

from analysis.figures import FIGURES, panels, style, write_figures
from analysis.pdem import weighted
from analysis.quantities import QUANTITIES
from analysis.results.build import build_results
from analysis.results.reader import read_results


@pytest.fixture(scope="module")
def results():
    return read_results(synthetic.example(noise=0.02))


@pytest.mark.parametrize("name", ["fig02_data_marginals", "fig03_joint_points", "fig04_grading", "fig05_stress_ratio",
                                  "fig10_coordination", "fig15_joint_eta_Z"])  # fmt: skip
def test_a_figure_is_a_small_png_named_after_the_papers(results, tmp_path, name):
    before = dict(rcParams)
    (path,) = write_figures(results, {}, tmp_path, [name])
    assert path.name == f"{name}.png" and path.read_bytes().startswith(b"\x89PNG")
    assert 10_000 < path.stat().st_size <= style.LIMIT_BYTES
    assert dict(rcParams) == before
    source = f"{results.attrs['campaign']}: results.h5 of {results.attrs['created']}, {len(results.runs)} runs"
    assert Image.open(path).text["Source"] == source


def test_all_figures_2_to_16_are_there():
    assert [name[:5] for name in FIGURES] == [f"fig{k:02d}" for k in range(2, 17)]


@pytest.mark.parametrize("name", ["fig06_stress_ratio_surfaces", "fig07_peak_critical", "fig13_stiffness_dilatancy",
                                  "fig14_joint_eta_e"])  # fmt: skip
def test_every_flat_axis_has_labels_from_the_registry(results, name):
    figure = FIGURES[name](results, {})
    labels = [axis.get_xlabel() for axis in figure.axes if axis.name != "3d" and axis.get_xlabel()]
    known = {quantity.label for quantity in QUANTITIES.values()}
    assert len(labels) >= 1 and set(labels) <= known


def test_the_mean_band_is_mean_and_two_standard_deviations(results):
    axis = Figure().subplots()
    panels.mean_band(axis, results, "eta")
    for line, band, mu_iso in zip(axis.lines, axis.collections, synthetic.DENSITIES, strict=True):
        values, weight = results.response("eta", mu_iso).values, results.probability(mu_iso)
        mean, spread = weighted.mean(values, weight), weighted.std(values, weight)
        assert line.get_xdata() == pytest.approx(100 * results.strain)
        assert line.get_ydata() == pytest.approx(mean)
        heights = band.get_paths()[0].vertices[:, 1]
        assert heights.max() == pytest.approx((mean + 2 * spread).max())


def test_state_pdfs_enclose_one_in_shown_units_with_every_point_below(results):
    axis = Figure().subplots()
    panels.state_pdfs(axis, results, "probe", "G_0")
    curves, rugs = axis.lines[0::2], axis.lines[1::2]
    for curve, rug, mu_iso in zip(curves, rugs, synthetic.DENSITIES, strict=True):
        x, y = curve.get_data()
        assert np.sum(y) * (x[1] - x[0]) == pytest.approx(1, abs=1e-6)
        assert np.sum(x * y) * (x[1] - x[0]) == pytest.approx(
            1e-6 * results.state("probe", "G_0", mu_iso) @ results.probability(mu_iso), rel=1e-3
        )
        assert rug.get_xdata() == pytest.approx(1e-6 * results.state("probe", "G_0", mu_iso))


def test_contours_lie_where_the_density_is(results):
    axis = Figure().subplots()
    response = results.response("e", 0.1)
    filled = panels.contours(axis, response)
    path = np.concatenate([p.vertices for c in filled.get_paths() for p in [c]]) if hasattr(filled, "get_paths") else \
        np.concatenate([p.vertices for c in filled.collections for p in c.get_paths()])  # fmt: skip
    reach = 5 * response.pdf.shown_width.max()
    assert path[:, 0].max() == pytest.approx(100 * results.strain[-1])
    assert response.values.min() - reach < path[:, 1].min() < path[:, 1].max() < response.values.max() + reach


def test_the_maps_stay_even_in_grey():
    colours = panels.CONTOUR_MAP(np.linspace(0, 1, 64))[:, :3]
    grey = colours @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(grey) < 0.005) and grey[0] > 0.98 and grey[-1] < 0.2
    shades = [
        look["color"][:3] @ np.array([0.2126, 0.7152, 0.0722]) for look in style.density_style((1, 2, 3)).values()
    ]
    assert np.all(np.diff(shades) > 0.15)
    assert style.COLOURS in colormaps


def test_a_png_that_would_be_too_big_loses_resolution(tmp_path, monkeypatch):
    figure = Figure(figsize=(2, 2))
    figure.figimage(np.random.default_rng(1).random((200, 200)), resize=False)
    sizes = [style.save(figure, tmp_path / "noise.png", dpi=dpi).stat().st_size for dpi in (80, 100)]
    assert sizes[0] < sizes[1]
    monkeypatch.setattr(style, "LIMIT_BYTES", (sizes[0] + sizes[1]) // 2)
    assert style.save(figure, tmp_path / "noise.png", dpi=100).stat().st_size < style.LIMIT_BYTES


def small_campaign(folder, densities, stages):
    """Results of three points at some densities, 30 windows a run."""
    points = synthetic.representative_points(3)
    plan = synthetic.plan_rows(folder, points, densities=densities)
    plan = plan[plan["stage"].isin(stages)]
    for row in plan.itertuples():
        synthetic.write_run(row, windows=30)
    return read_results(build_results(folder, plan, points, synthetic.campaign_info()))


def test_four_densities_are_all_in_the_figures(tmp_path):
    four = small_campaign(tmp_path, (0.001, 0.04, 0.1, 0.2), ("consolidate", "probe", "shear"))
    solid = [axis for axis in FIGURES["fig06_stress_ratio_surfaces"](four, {}).axes if axis.name == "3d"]
    assert [axis.get_title(loc="left")[:3] for axis in solid] == ["(b)", "(c)", "(d)", "(e)"]
    right = FIGURES["fig13_stiffness_dilatancy"](four, {}).axes[1]
    assert [line.get_marker() for line in right.lines] == list("^soD")
    legend = FIGURES["fig14_joint_eta_e"](four, {}).axes[0].get_legend()
    assert [text.get_text()[-3:] for text in legend.get_texts()] == ["001", ".04", "0.1", "0.2"]


def test_a_campaign_of_one_density_has_its_figures_too(tmp_path):
    single = small_campaign(tmp_path, (0.04,), ("consolidate", "shear"))
    for name in ("fig06_stress_ratio_surfaces", "fig08_void_ratio", "fig13_stiffness_dilatancy", "fig14_joint_eta_e"):
        assert FIGURES[name](single, {}).axes
