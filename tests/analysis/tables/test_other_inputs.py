"""Tables, figures and words of campaigns whose random inputs are not measured pairs of mu_s and G_p."""

from __future__ import annotations

import re

import numpy as np
import other_inputs
import pytest
import synthetic_results

from analysis.figures import FIGURES, UNDRAINED, drawn, style
from analysis.quantities import parameter
from analysis.report import input_words, write_report
from analysis.report.captions import caption
from analysis.results import read_results
from analysis.tables import evaluate, write_tables
from analysis.tables.claims import CLAIMS
from analysis.tables.friction import friction_curves, variable_along
from analysis.tables.run_quality import packing_design

ONE, MODULUS, THREE = ("mu_s",), ("G_p",), ("mu_s", "G_p", "nu")


def results_of(names, **options):
    return read_results(other_inputs.example(names, **options))


def statements(results):
    return {claim.statement for claim in CLAIMS if claim.applies(results)}


@pytest.mark.parametrize("names", [ONE, MODULUS, THREE])
def test_the_table_of_points_has_the_units_of_the_columns(names):
    results = results_of(names)
    frame = evaluate(results, ["points"])["points"]
    further = ["nu"] if "nu" in names else []
    assert frame.columns.tolist() == ["id", "mu_s", "G_p_GPa", *further, "probability"]
    assert frame["G_p_GPa"].to_numpy() == pytest.approx(results.points.G_p * 1e-9)
    marginals = evaluate(results, ["marginals"])["marginals"]
    assert marginals["property"].tolist() == list(names)


def test_a_single_input_has_no_table_of_copulas(tmp_path):
    written = write_tables(evaluate(results_of(ONE), ["points", "copulas"]), tmp_path)
    assert [path.name for path in written] == ["points.csv"]


def test_claims_are_made_only_where_they_have_a_meaning():
    usual = statements(results_of(("mu_s", "G_p")))
    friction, modulus = statements(results_of(ONE)), statements(results_of(MODULUS))
    of_G_p = {"G_p alone hardly changes the stress ratio at large strain", "G_p changes the small-strain stiffness"}
    assert of_G_p <= usual and not of_G_p & friction and of_G_p & modulus == {"G_p changes the small-strain stiffness"}
    assert "A higher critical eta goes with a larger void ratio" in friction - modulus
    assert statements(results_of(THREE)) == usual


def test_values_along_friction_take_the_other_inputs_with_them():
    mu_s, three = np.array([0.15, 0.25, 0.4]), results_of(THREE)
    modulus, nu = variable_along(three, "G_p", mu_s), variable_along(three, "nu", mu_s)
    assert np.all(np.diff(modulus) < 0) and np.all(np.diff(nu) > 0)
    assert np.array_equal(variable_along(results_of(ONE), "G_p", mu_s), np.full(3, 29e9))
    assert not len(evaluate(results_of(MODULUS), ["friction"])["friction"])
    of_drained = [name for name in FIGURES if name not in UNDRAINED]
    assert "fig16_friction" not in drawn(results_of(MODULUS)) and drawn(results_of(ONE)) == of_drained


@pytest.mark.parametrize("names", [ONE, THREE])
def test_figures_of_the_inputs_show_each_two_of_them(names):
    results = results_of(names)
    for name in ("fig02_data_marginals", "fig03_joint_points"):
        figure = FIGURES[name](results, {})
        shown = [axis for axis in figure.axes if axis.get_visible()]
        assert len(shown) == len(names) * (len(names) + 1) / 2
        assert shown[0].get_xlabel() == (style.label if len(names) == 1 else style.short_label)(names[0])
    assert style.varying(ONE) == r"$\mu_s$ varies" and style.varying(THREE).endswith(r"and $\nu$ vary together")


def test_the_words_name_the_inputs_and_what_is_known_of_them():
    two, three = read_results(synthetic_results.example()), results_of(THREE)
    assert input_words.scatter_of_inputs(two) == (
        "the scatter of two grain properties, interparticle friction and particle shear modulus,"
    )
    assert input_words.scatter_of_inputs(results_of(ONE)) == "the scatter of one property, interparticle friction,"
    assert "three grain properties, interparticle friction, particle shear modulus and particle Poisson's ratio," in (
        input_words.scatter_of_inputs(three)
    )
    facts = {"refitted": 0, "measurements": 0}
    assert "G_p = 29 GPa" in input_words.inputs_source(results_of(ONE), facts)
    assert "not fitted to measurements. How many measurements are behind them is not known." in (
        input_words.inputs_source(three, facts)
    )
    assert "inputs.pairs_behind" in input_words.bands_words(three, facts)
    assert "With 94 pairs" in input_words.bands_words(two, {"refitted": 200, "measurements": 94})
    assert "only one of them adds once the other is known" in input_words.sources_words(two)
    assert "Shapley" in input_words.sources_words(three) and "shared" not in input_words.sources_words(results_of(ONE))
    assert input_words.band_note(three) == ""


@pytest.mark.long
@pytest.mark.parametrize(("names", "n"), [(ONE, 8), (MODULUS, 8), (THREE, 24)])
def test_a_report_has_no_empty_table_and_no_word_of_what_is_not_there(names, n, tmp_path):
    results = results_of(names, n=n, densities=synthetic_results.DENSITIES)
    frames = evaluate(results)
    shares = frames["variance_sources"]
    if n >= 16:
        parts = [name for name in shares if name.startswith(("only_", "shapley_"))]
        assert parts == [f"{kind}_{name}" for kind in ("only", "shapley") for name in names]
        shapley = shares[[f"shapley_{name}" for name in names]].sum(axis=1)
        assert (shapley + shares["noise"]).to_numpy() == pytest.approx(np.ones(len(shares)))
    text = re.sub(r"data:[^\"]*", "", write_report(results, frames, tmp_path).read_text("utf-8"))
    for table in re.findall(r"<table.*?</table>", text, re.DOTALL):
        assert table.count("<tr") > 1, table[:300]
    assert "nan" not in re.sub(r"<[^>]*>", " ", text).split()
    assert ("Effect of interparticle friction" in text) == ("mu_s" in names)


@pytest.mark.parametrize(("symbol", "name", "value", "text"), [
    ("sigma_3", "shape", 33.775, "shape = 33.775"), ("sigma_3", "scale", 3034.1, "scale = 3.0341 kPa"),
    ("d50", "sigma_ln", 0.2, "sigma_ln = 0.2"), ("d50", "median", 2.5e-4, "median = 0.25 mm"),
    ("G_p", "median", 29e9, "median = 29 GPa"), ("nu", "mean", 0.22, "mean = 0.22"),
])  # fmt: skip
def test_parameters_have_the_unit_of_their_quantity_and_shapes_have_none(symbol, name, value, text):
    assert parameter(symbol, name, value) == text


def test_without_a_model_along_friction_neither_the_caption_nor_the_legend_speaks_of_lines():
    few, enough = results_of(THREE), results_of(ONE, n=20)
    for results, has_lines in ((few, False), (enough, True)):
        words = caption(results, "fig16", is_papers_test=False)
        assert ("Lines are the model" in words) == has_lines and ("there are no lines" in words) != has_lines
        figure = FIGURES["fig16_friction"](results, {"friction_curves": friction_curves(results)})
        keys = figure.axes[0].get_legend().get_lines()
        assert all((key.get_linestyle() != "None") == has_lines for key in keys)
    assert "needs 16 points" in caption(few, "fig16", is_papers_test=False)


def test_where_the_critical_state_is_withheld_nothing_is_shown_of_it(tmp_path):
    results = read_results(other_inputs.make(tmp_path, ONE, end=0.25))
    assert {*FIGURES} - {*UNDRAINED} - {*drawn(results)} == {"fig14_joint_eta_e", "fig15_joint_eta_Z"}
    design = packing_design(results).iloc[0]
    assert (design["packings"], design["known"]) == (4, True)
    peak = FIGURES["fig08_void_ratio"](results, {}).axes
    shown = next(axis for axis in peak if "peak" in axis.get_title(loc="left") + axis.get_title())
    assert shown.get_xlim()[0] > 0.4 and shown.get_xlim()[1] < 0.8
