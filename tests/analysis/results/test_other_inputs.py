"""results.h5 of campaigns with one and three random inputs: versions, columns, checks, and bands."""

from __future__ import annotations

import h5py
import numpy as np
import other_inputs
import pytest
import synthetic_results

from analysis.results import read_results
from analysis.results.collect import ResponsesError, collect
from analysis.results.peaks import _basis

THREE = ("mu_s", "G_p", "nu")


@pytest.mark.parametrize("names", [("mu_s",), ("G_p",), THREE])
def test_a_file_gives_back_points_names_and_constants(names):
    results, points = read_results(other_inputs.example(names)), other_inputs.points_of(names, 8)
    assert results.attrs["format_version"] == 5
    for found in (results.points, results.family_points()):
        assert (found.names, found.constants) == (points.names, points.constants)
        assert np.array_equal(found.x, points.x) and found.probability == pytest.approx(points.probability)
        assert np.array_equal(found["G_p"], points["G_p"])
    assert results.pairs.shape == (0, len(names)) and results.inputs["specified"]["variables"].keys() == {*names}
    eta = results.state("critical", "eta", 0.04)
    assert eta == pytest.approx(synthetic_results.critical_eta(points.mu_s), rel=0.05)


def test_a_file_of_two_inputs_has_the_version_and_the_attributes_of_before():
    with h5py.File(other_inputs.example(("mu_s", "G_p"))) as file:
        assert file.attrs["format_version"] == 4
        assert set(file["inputs"].attrs) - {"specified", "pairs_behind"} == {"source", "marginals", "copulas", "joint"}
        assert list(file["points"].attrs["columns"]) == ["id", "mu_s", "G_p", "probability"]


def test_a_further_variable_of_a_run_must_be_that_of_the_plan(tmp_path):
    points = other_inputs.points_of(THREE, 8)
    plan = synthetic_results.plan_rows(tmp_path, points, densities=(0.04,), packings=(1, 2))
    nu = dict(zip(points.id.tolist(), points["nu"].tolist(), strict=True))
    plan["nu"] = [nu.get(k, np.nan) for k in plan["point"]]
    for row in plan.itertuples():
        synthetic_results.write_run(row)
    assert collect(plan, points).densities[0].family.points.names == THREE
    with pytest.raises(ResponsesError, match="nu = 0.2.*the plan has 0.3"):
        collect(plan.assign(nu=plan["nu"].where(plan["point"] != 3, 0.3)), points)
    with pytest.raises(ResponsesError, match=r"lacks the columns \['nu'\]"):
        collect(plan.drop(columns="nu"), points)


def test_bands_need_a_number_of_measurements(tmp_path):
    results = read_results(other_inputs.example(THREE))
    assert results.bootstrap_probability(0.04) is None
    path = other_inputs.make(tmp_path, THREE, measured=40, input_bootstrap=5)
    drawn = read_results(path).bootstrap_probability(0.04)
    assert drawn.shape == (5, 8) and drawn.sum(axis=1) == pytest.approx(np.ones(5))


def test_peaks_are_pooled_with_the_terms_that_the_runs_allow():
    inputs = {d: np.exp(np.random.default_rng(1).normal(size=(40, d))) for d in (1, 2, 3)}
    terms = {(d, runs): _basis(x, runs).shape[1] for d, x in inputs.items() for runs in (8, 12, 16, 24, 32)}
    assert [terms[2, runs] for runs in (8, 12, 16, 24, 32)] == [3, 4, 4, 6, 6]
    assert [terms[1, runs] for runs in (8, 12, 16, 24, 32)] == [3, 3, 3, 4, 4]
    assert [terms[3, runs] for runs in (8, 12, 16, 24, 32)] == [3, 3, 5, 5, 7]
