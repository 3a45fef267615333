"""Figures: every one is drawn from results.h5 alone, small, and shows the numbers that are in the file."""

from __future__ import annotations

import dataclasses
import itertools
import re
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
import synthetic_results as synthetic
from matplotlib import colormaps, rcParams
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from analysis.figures import FIGURES, panels, style, write_figures, write_print_figures
from analysis.inputs.sieve_curve import SieveCurve
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


def test_all_figures_2_to_19_are_there():
    assert [name[:5] for name in FIGURES] == [f"fig{k:02d}" for k in range(2, 20)]


@pytest.mark.parametrize("name", ["fig06_stress_ratio_surfaces", "fig07_peak_critical", "fig13_stiffness_dilatancy",
                                  "fig14_joint_eta_e"])  # fmt: skip
def test_every_flat_axis_has_labels_from_the_registry(results, name):
    figure = FIGURES[name](results, {})
    labels = [axis.get_xlabel() for axis in figure.axes if axis.name != "3d" and axis.get_xlabel()]
    known = {quantity.label for quantity in QUANTITIES.values()}
    assert len(labels) >= 1 and set(labels) <= known


@pytest.mark.parametrize("given", [True, False])
def test_figure_4_shows_the_sieve_curve_beside_the_spheres_where_there_is_one(given):
    curve = SieveCurve((1e-4, 2e-4, 8e-4), (0.0, 0.4, 1.0))
    settings = {"assembly": {"sieve_curve": asdict(curve)} if given else {}}
    spheres = SimpleNamespace(diameters=curve.diameters(500), attrs={"settings": settings})
    (axis,) = FIGURES["fig04_grading"](spheres, {}).axes
    steps, *others = [line for line in axis.lines if len(line.get_xdata()) > 2]
    assert np.interp(0.2, steps.get_xdata(), steps.get_ydata()) == pytest.approx(40.0, abs=0.5)
    assert [(line.get_xdata().tolist(), line.get_ydata().tolist()) for line in others] == (
        [(pytest.approx([0.1, 0.2, 0.8]), pytest.approx([0.0, 40.0, 100.0]))] if given else []
    )
    text = "\n".join(t.get_text() for t in axis.texts)
    assert (f"$C_c$ = {curve.curvature:.2f}" in text) == given and f"$C_u$ = {curve.uniformity:.2f}" in text


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


@pytest.fixture(scope="module")
def eight_points(tmp_path_factory):
    """Eight points in four packings; the noise of a run is 0.8 of the spread of the stress ratio."""
    folder = tmp_path_factory.mktemp("eight")
    made = synthetic.make_campaign(folder, n=8, noise=0.08, packings=(1, 2, 3, 4))
    return read_results(build_results(folder, *made))


def test_a_state_is_shown_as_simulated_too_where_noise_makes_a_visible_difference(eight_points):
    axis = Figure().subplots()
    panels.state_pdfs(axis, eight_points, "critical", "eta")
    shown = [line for line in axis.lines if line.get_marker() == "None" and len(line.get_xdata())]
    thin = [line for line in shown if line.get_linewidth() == panels.THIN]
    both = [(panels.denoised_pdf(eight_points, "critical", "eta", mu_iso),
             panels.state_pdf(eight_points, "critical", "eta", mu_iso)) for mu_iso in synthetic.DENSITIES]  # fmt: skip
    differ = [panels.differ_visibly(*pdfs) for pdfs in both]
    assert len(thin) == sum(differ) > 0 and len(shown) == 3 + sum(differ)
    assert [text.get_text() for text in axis.get_legend().get_texts()] == ["denoised", "as simulated"]
    denoised, simulated = both[differ.index(True)]
    thick = [line.get_ydata() for line in shown if line not in thin]
    assert np.array_equal(thick[differ.index(True)], denoised.p[0])
    assert np.array_equal(thin[0].get_ydata(), simulated.p[0])


def test_pdfs_that_nearly_agree_are_not_shown_twice(eight_points):
    pdf = panels.state_pdf(eight_points, "critical", "eta", 0.1)
    width = weighted.std(pdf.x, pdf.p[0])
    for shift, visible in ((0.02, False), (0.5, True), (20.0, True)):
        assert panels.differ_visibly(pdf, dataclasses.replace(pdf, x=pdf.x + shift * width)) == visible


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


PRINTED = "fig02_data_marginals"


@pytest.mark.parametrize("columns, points", [(1, 88 / 25.4 * 72), (2, 180 / 25.4 * 72)])
def test_a_pdf_for_print_has_the_width_of_its_columns_and_contains_its_fonts(results, tmp_path, columns, points):
    (path,) = write_print_figures(results, {}, tmp_path, "pdf", columns, names=[PRINTED])
    data = path.read_bytes()
    box = re.search(rb"/MediaBox \[ *0 0 ([\d.]+) ([\d.]+) *\]", data)
    assert path.name == f"{PRINTED}.pdf" and data.startswith(b"%PDF")
    assert float(box[1]) == pytest.approx(points, abs=0.01)
    fonts = data.count(b"/Type /FontDescriptor")
    assert fonts == data.count(b"/FontFile2") > 0 and b"/Type3" not in data and b"/CIDFontType2" in data


def test_an_svg_for_print_has_the_width_of_its_columns_and_needs_no_font(results, tmp_path):
    (path,) = write_print_figures(results, {}, tmp_path, "svg", 1, names=[PRINTED])
    text = path.read_text()
    assert float(re.search(r'<svg [^>]*width="([\d.]+)pt"', text)[1]) == pytest.approx(88 / 25.4 * 72, abs=0.01)
    assert "<text" not in text and "font-family" not in text


@pytest.mark.parametrize("dpi", [100, 300])
def test_a_png_for_print_has_the_pixels_of_its_resolution(results, tmp_path, dpi):
    (path,) = write_print_figures(results, {}, tmp_path, "png", 1, dpi, [PRINTED])
    image = Image.open(path)
    assert image.width == pytest.approx(88 / 25.4 * dpi, abs=1) and image.info["dpi"][0] == pytest.approx(dpi, abs=0.1)


@pytest.mark.parametrize("file_format", ["pdf", "svg", "png"])
def test_a_figure_for_print_names_its_source_and_has_the_same_bytes_again(results, tmp_path, file_format):
    both = [
        write_print_figures(results, {}, tmp_path / k, file_format, 1, 100, [PRINTED])[0].read_bytes() for k in "ab"
    ]
    assert both[0] == both[1] and results.attrs["created"].encode() in both[0]
    assert b"CreationDate" not in both[0] and b"<dc:date>" not in both[0]


@pytest.mark.parametrize("columns", [1, 2])
@pytest.mark.parametrize("name", ["fig03_joint_points", "fig05_stress_ratio", "fig11_mechanical_coordination",
                                  "fig15_joint_eta_Z"])  # fmt: skip
def test_text_in_print_has_7_pt_and_lies_in_the_figure_beside_other_text(results, tmp_path, monkeypatch, name, columns):
    drawn, draw_figure, draw_text = [], Figure.draw, Text.draw

    def figure_begins(figure, *args):
        drawn.clear()  # a figure that is laid out by constraint is drawn twice
        return draw_figure(figure, *args)

    def text_is_drawn(text, renderer, *args, **options):
        if text.get_visible() and text.get_text():
            drawn.append((text, text.get_window_extent(renderer).padded(-1)))
        return draw_text(text, renderer, *args, **options)

    monkeypatch.setattr(Figure, "draw", figure_begins)
    monkeypatch.setattr(Text, "draw", text_is_drawn)
    (path,) = write_print_figures(results, {}, tmp_path, "png", columns, 150, [name])
    width, height = Image.open(path).size
    assert height <= 240 / 25.4 * 150  # a page
    assert len(drawn) > 30 and min(text.get_fontsize() for text, _ in drawn) >= 7
    outside = [text.get_text() for text, box in drawn
               if min(box.x0, box.y0) < 0 or box.x1 > width or box.y1 > height]  # fmt: skip
    straight = [(text.get_text(), box) for text, box in drawn if text.get_rotation() % 90 == 0]
    overlaps = [(a, b) for (a, one), (b, two) in itertools.combinations(straight, 2) if one.overlaps(two)]
    assert outside == [] and overlaps == []


def test_figures_after_a_print_are_as_before(results, tmp_path):
    (before,) = write_figures(results, {}, tmp_path / "before", [PRINTED])
    write_print_figures(results, {}, tmp_path, "png", 1, 72, [PRINTED])
    (after,) = write_figures(results, {}, tmp_path / "after", [PRINTED])
    assert before.read_bytes() == after.read_bytes()
