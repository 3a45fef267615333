"""The export: numbers that pandas alone recomputes, units of every column, and spreadsheets."""

import importlib.util
import shutil

import numpy as np
import pandas as pd
import pytest
import synthetic_results

from analysis.pdem import weighted
from analysis.results.reader import STATES, ResultsError, read_results
from analysis.tables import export

needs_openpyxl = pytest.mark.skipif(importlib.util.find_spec("openpyxl") is None, reason="openpyxl is not installed")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Ten points of which one failed in shear and one stopped early, so that probabilities and marks matter."""
    folder = tmp_path_factory.mktemp("export")
    made = synthetic_results.make_campaign(
        folder, 10, 0.02, packings=(1, 2), steady=(3,), failed=(2,), densities=(0.04,)
    )
    return read_results(synthetic_results.build.build_results(folder, *made, cells=64, max_lost_probability=0.5))


@pytest.fixture(scope="module")
def folder(results, tmp_path_factory):
    place = tmp_path_factory.mktemp("csv")
    export.write_csv_export(results, place)
    return place


def read(folder, name):
    """A table as a person without this project reads it, with all digits."""
    return pd.read_csv(folder / f"{name}.csv", float_precision="round_trip")


def moments(frame, by):
    """Mean and standard deviation of each group, by pandas alone."""
    known = frame.dropna(subset=["value"])
    mean = (known["value"] * known["probability"]).groupby([known[c] for c in by]).sum()
    centred = known.join(mean.rename("mean"), on=by)
    variance = (
        (centred["probability"] * (centred["value"] - centred["mean"]) ** 2).groupby([known[c] for c in by]).sum()
    )
    return mean, variance**0.5


def test_states_give_mean_and_sd_to_1e_12(results, folder):
    mean, sd = moments(read(folder, "states"), ["mu_iso", "state", "quantity"])
    probability, compared = results.probability(0.04), 0
    for state in STATES:
        for symbol in results.state_symbols(state, 0.04):
            values = results.shown_state(state, symbol, 0.04)
            if np.isfinite(values).any():
                key, compared = (0.04, state, symbol), compared + 1
                assert mean[key] == pytest.approx(weighted.mean(values, probability), rel=1e-12)
                scale = max(abs(mean[key]), 1e-30)
                assert abs(sd[key] - weighted.std(values, probability)) <= 1e-12 * scale
    assert compared == len(mean) > 25


def test_responses_give_mean_and_sd_to_1e_12(results, folder):
    frame = read(folder, "responses")
    mean, sd = moments(frame, ["mu_iso", "quantity", "strain"])
    for symbol in results.symbols(0.04):
        response = results.response(symbol, 0.04)
        np.testing.assert_array_equal(sorted(set(frame["strain"])), response.strain)
        np.testing.assert_allclose(mean[0.04, symbol].to_numpy(), response.mean, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(sd[0.04, symbol].to_numpy(), response.std, rtol=1e-10, atol=1e-14)


def test_probabilities_sum_to_one_over_the_rows_with_a_value(folder):
    for name, by in (("states", ["state", "quantity"]), ("responses", ["quantity", "strain"])):
        frame = read(folder, name).dropna(subset=["value"])
        np.testing.assert_allclose(frame.groupby(by)["probability"].sum(), 1.0, rtol=1e-12)
    assert read(folder, "points")["probability"].sum() == pytest.approx(1.0, abs=1e-12)


def test_pdfs_integrate_to_one_and_are_those_of_the_results(results, folder):
    frame = read(folder, "pdfs")
    pdf = results.response("eta", 0.04).pdf
    of_eta = frame[frame["quantity"] == "eta"]["pdf"].to_numpy().reshape(pdf.p.shape)
    np.testing.assert_allclose(of_eta, pdf.p, rtol=1e-9)
    np.testing.assert_allclose(of_eta.sum(axis=1) * pdf.dx, 1.0, rtol=1e-8)


def test_a_run_that_stopped_early_or_failed_is_marked(results, folder):
    responses, runs = read(folder, "responses"), read(folder, "runs")
    stopped = responses[(responses["point"] == 3) & (responses["quantity"] == "eta")]
    assert stopped[stopped["strain"] > 0.31]["continued"].eq(1).all()
    assert stopped[stopped["strain"] < 0.29]["continued"].eq(0).all()
    assert len(runs) == len(results.runs) and (runs["status"] == "failed").sum() == 1
    assert runs[runs["status"] == "failed"]["reason"].str.contains("servo error").all()
    failed = read(folder, "states").query("point == 2 and state == 'critical' and quantity == 'eta'")
    assert failed["value"].isna().all() and failed["probability"].eq(0).all()


def test_every_column_has_a_unit_or_a_meaning(folder):
    columns = read(folder, "columns").fillna("")
    for name in ("points", "runs", "states", "responses", "pdfs", "pairs"):
        described = columns[columns["file"] == f"{name}.csv"]["column"].tolist()
        assert described == read(folder, name).columns.tolist()
    assert columns["meaning"].ne("").all() and not columns["meaning"].str.contains("README").any()
    units = read(folder, "quantities").set_index("quantity")
    assert units.loc["G_0", ["unit", "shown_unit", "shown_value_over_value"]].tolist() == ["Pa", "MPa", 1e-6]
    assert set(read(folder, "states")["quantity"]) <= set(units.index)


@needs_openpyxl
def test_an_excel_file_holds_the_same_numbers_and_what_is_too_long_becomes_a_csv_file(
    results, folder, tmp_path, monkeypatch
):
    monkeypatch.setattr(export, "SHEET_ROWS", 1000)
    left = export.write_excel_export(results, tmp_path / "deep" / "x.xlsx")
    assert {name: path.name for name, path in left.items()} == {"pdfs": "x_pdfs.csv", "responses": "x_responses.csv"}
    for name, path in left.items():
        assert path.read_bytes() == (folder / f"{name}.csv").read_bytes()
    sheets = pd.read_excel(tmp_path / "deep" / "x.xlsx", sheet_name=None)
    assert set(sheets) == set(export.export_tables(results)) - set(left)
    np.testing.assert_allclose(sheets["states"]["value"], read(folder, "states")["value"], rtol=1e-15)


def test_without_openpyxl_an_excel_file_is_refused_with_what_helps(results, tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ResultsError, match=r"openpyxl.*python3-openpyxl.*`--to FOLDER` writes CSV files"):
        export.write_excel_export(results, tmp_path / "x.xlsx")
    assert not list(tmp_path.iterdir())


def test_a_text_that_a_spreadsheet_takes_for_a_formula_is_made_harmless(results, tmp_path):
    runs = results.runs.assign(reason="=HYPERLINK(1)")
    export.write_csv_export(synthetic_results.dataclasses.replace(results, runs=runs), tmp_path)
    assert set(read(tmp_path, "runs")["reason"]) == {"'=HYPERLINK(1)"}
    shutil.rmtree(tmp_path)
