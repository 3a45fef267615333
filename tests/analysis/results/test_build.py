"""Products to results.h5: the numbers that went into the files come out, and nothing wrong gets through."""

from __future__ import annotations

import re
import shutil

import h5py
import numpy as np
import pandas as pd
import pytest
import synthetic_results as synthetic
from hdf5_files import changed_on_purpose

from analysis.points import RepresentativePoints
from analysis.results.build import build_results
from analysis.results.collect import ResponsesError, collect
from analysis.results.reader import ResultsError, read_results
from analysis.runs.run_file import RunFileError
from analysis.surrogates.rotation import deal


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Four points, three densities, two packings, no noise; point 1 stops early as steady."""
    folder = tmp_path_factory.mktemp("campaign")
    plan, points, info = synthetic.make_campaign(folder, n=4, packings=(1, 2), steady=(1,))
    return folder, plan, points, read_results(build_results(folder, plan, points, info))


@pytest.fixture
def small(tmp_path):
    """Two points at one density: (folder, plan, points)."""
    points = synthetic.representative_points(2)
    plan = synthetic.plan_rows(tmp_path, points, densities=(0.04,))
    for row in plan.itertuples():
        synthetic.write_run(row, windows=20)
    return tmp_path, plan, points


@pytest.mark.parametrize("mu_iso", synthetic.DENSITIES)
def test_responses_are_the_closed_forms(campaign, mu_iso):
    _, _, points, results = campaign
    forms = {"eta": synthetic.eta, "e": synthetic.void_ratio, "Z": synthetic.coordination, "Phi_dev": synthetic.fabric}
    for symbol, form in forms.items():
        response = results.response(symbol, mu_iso)
        for q, mu_s in enumerate(points.mu_s):
            kept = ~response.extended[:, q]
            exact = form(results.strain, mu_s, mu_iso)
            assert response.values[kept, q] == pytest.approx(exact[kept], abs=1e-9)
        assert response.mean == pytest.approx(response.values @ points.probability)


def test_states_are_those_of_the_closed_forms(campaign):
    _, _, points, results = campaign
    fine = np.linspace(0, 0.4, 40001)
    for mu_iso in synthetic.DENSITIES:
        for q, mu_s in enumerate(points.mu_s):
            curve = synthetic.eta(fine, mu_s, mu_iso)
            assert results.state("peak", "eta", mu_iso)[q] == pytest.approx(curve.max(), rel=0.01)
            assert results.state("critical", "eta", mu_iso)[q] == pytest.approx(synthetic.critical_eta(mu_s), rel=0.01)
            assert results.state("probe", "G_0", mu_iso)[q] == pytest.approx(synthetic.stiffness(points.G_p[q], mu_iso))
        assert results.state("initial", "e", mu_iso) == pytest.approx(synthetic.E_0[mu_iso])
        assert np.all(abs(results.state("peak", "eps_peak", mu_iso) - 0.035) < 0.02)


def test_grading_indices_come_from_the_snapshots(campaign):
    diameter = 2 * synthetic.snapshot(synthetic.SIGMA_3)["radius"]
    log, mass = np.log(diameter), diameter**3 / np.sum(diameter**3)
    exact = np.exp(np.sqrt(mass @ (log - mass @ log) ** 2))
    results = campaign[-1]
    assert results.state("critical", "I_G", 0.04) == pytest.approx(exact)
    assert results.state("critical", "I_G_active", 0.04) == pytest.approx(exact)
    assert results.diameters == pytest.approx(diameter)


def test_every_density_integrates_to_one(campaign):
    results = campaign[-1]
    for mu_iso in synthetic.DENSITIES:
        for symbol in results.symbols(mu_iso):
            response = results.response(symbol, mu_iso)
            pdf = response.pdf
            middle = (pdf.p * pdf.x).sum(axis=1) * pdf.dx
            assert np.abs(middle - response.mean).max() < 0.01 * pdf.dx.max()
            assert np.abs(pdf.p.sum(axis=1) * pdf.dx - 1).max() < 1e-8
            assert pdf.p.min() >= 0


def test_a_steady_run_is_continued_by_its_critical_average_and_counted(campaign):
    _, _, points, results = campaign
    response = results.response("eta", 0.1)
    early = int(np.flatnonzero(points.id == 1)[0])
    beyond = results.strain > 0.31
    assert response.extended[beyond, early].all() and not response.extended[:, 0].any()
    assert response.values[beyond, early] == pytest.approx(results.state("critical", "eta", 0.1)[early])
    assert results.counts(0.1)["extended"] == 1


def test_every_point_has_one_packing_the_same_at_every_density(campaign):
    _, plan, points, results = campaign
    dealt = deal(points.x, 2) + 1
    assert sorted(dealt.tolist()) == [1, 1, 2, 2]
    for mu_iso in synthetic.DENSITIES:
        assert np.array_equal(results.packing(mu_iso), dealt)
        assert np.array_equal(results.response("eta", mu_iso).packing, dealt)
    twice = pd.concat([plan, plan[plan["stage"] == "shear"].assign(packing=3)], ignore_index=True)
    with pytest.raises(ResponsesError, match="has packings . and 3; a point can have one packing only"):
        collect(twice, points)


def test_results_of_version_3_have_one_packing(campaign, tmp_path):
    path = shutil.copy(campaign[-1].path, tmp_path / "results.h5")
    with changed_on_purpose(path) as file:
        file.attrs["format_version"] = 3
        for mu_iso in synthetic.DENSITIES:
            del file[f"families/coupled/{mu_iso:g}/packing"]
    results = read_results(path)
    assert results.packing(0.04).tolist() == [1, 1, 1, 1]
    assert np.array_equal(results.response("e", 0.1).values, campaign[-1].response("e", 0.1).values)


def test_replicates_of_version_3_are_single_runs(campaign, tmp_path):
    """Two packings at all points, a third one at the last point only."""
    path = shutil.copy(campaign[-1].path, tmp_path / "results.h5")
    values = np.array([[0.6, 0.7, 0.8, 0.9], [0.62, 0.72, 0.82, 0.92], [np.nan, np.nan, np.nan, 1.0]])
    with changed_on_purpose(path) as file:
        file.attrs["format_version"] = 3
        group = file["families/coupled/0.04"]
        strains = group["responses/eta/values"].shape[0]
        group["state_replicates/critical/eta"] = values
        group["replicates/eta"] = np.repeat(values[:, None], strains, axis=1)
    results = read_results(path)
    for runs in (results.runs_at("critical", "eta", 0.04), results.runs_along("eta", 0.04)):
        assert runs.values.shape[-1] == 9 and np.ravel(runs.values)[-9:] == pytest.approx(values[np.isfinite(values)])
        assert runs.packing.tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 2]
        assert runs.place.tolist() == [0, 1, 2, 3, 0, 1, 2, 3, 3]


def test_results_of_an_older_version_are_refused_and_the_message_says_what_to_do(campaign, tmp_path):
    path = shutil.copy(campaign[-1].path, tmp_path / "results.h5")
    with changed_on_purpose(path) as file:
        file.attrs["format_version"] = 2
    with pytest.raises(ResultsError, match="version 2, want 'campaign-results' version 6; `analyse` on the campaign's"):
        read_results(path)


def test_a_failed_run_stays_as_nan_and_its_probability_goes_to_the_others(small):
    folder, plan, points = small
    failed = next(row for row in plan.itertuples() if row.stage == "shear" and row.point == 0)
    synthetic.fail_run(failed)
    lost = float(points.probability[0])
    with pytest.raises(ResponsesError, match=f"lose {lost:.3f} of the probability, limit 0.05"):
        build_results(folder, plan, points)
    assert not (folder / "results.h5").exists()
    results = read_results(build_results(folder, plan, points, max_lost_probability=0.9))
    assert results.probability(0.04) == pytest.approx([0.0, 1.0])
    assert np.isnan(results.response("eta", 0.04).values[:, 0]).all()
    assert results.counts(0.04)["lost_probability"] == pytest.approx(lost)
    assert results.counts(0.04)["failed"] == 1
    line = results.runs.set_index("run_id").loc[failed.run_id]
    assert line["status"] == "failed" and "servo error" in line["reason"]


def test_the_probability_of_a_failed_run_goes_to_the_nearest_point(tmp_path):
    plan, points, info = synthetic.make_campaign(tmp_path, n=8, failed=(3,))
    path = build_results(tmp_path, plan, points, info, input_bootstrap=4, max_lost_probability=0.9)
    results = read_results(path)
    inputs = np.log(points.x)
    away = np.linalg.norm((inputs - inputs[3]) / inputs.std(axis=0), axis=1)
    nearest = np.argsort(away)[1]
    exact = points.probability.copy()
    exact[[nearest, 3]] = exact[nearest] + exact[3], 0.0
    assert results.probability(0.04) == pytest.approx(exact)
    drawn = results.bootstrap_probability(0.04)
    assert drawn.shape == (4, 8) and (drawn[:, 3] == 0).all() and drawn.sum(axis=1) == pytest.approx(1)


def test_a_density_whose_shear_runs_all_failed_loses_all_its_probability(tmp_path):
    """It was written with a lost probability of zero, and the analysis then died on a missing group."""
    points = synthetic.representative_points(2)
    plan = synthetic.plan_rows(tmp_path, points, densities=(0.04, 0.1))
    for row in plan.itertuples():
        synthetic.write_run(row, windows=20)
        if row.stage == "shear" and row.mu_iso == 0.1:
            synthetic.fail_run(row)
    with pytest.raises(ResponsesError, match="mu_iso = 0.1: failed runs lose 1.000 of the probability, limit 0.5"):
        build_results(tmp_path, plan, points, max_lost_probability=0.5)
    assert not (tmp_path / "results.h5").exists()


def test_a_missing_product_is_refused_by_name(small):
    folder, plan, points = small
    gone = folder / "products" / f"{plan['run_id'].iloc[-1]}.h5"
    gone.unlink()
    with pytest.raises(ResponsesError, match=plan["run_id"].iloc[-1]):
        build_results(folder, plan, points)
    assert not list(folder.glob("*results*"))


def test_a_truncated_product_is_refused_by_name(small):
    folder, plan, points = small
    path = folder / "products" / f"{plan['run_id'].iloc[-1]}.h5"
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(RunFileError, match=path.name):
        build_results(folder, plan, points)


@pytest.mark.parametrize("name, value", [("mu_s", 0.5), ("G_p", 2e9), ("mu_iso", 0.1)])
def test_a_run_with_other_parameters_is_refused(small, name, value):
    folder, plan, points = small
    row = plan[plan["stage"] == "shear"].iloc[0]
    with h5py.File(row["product"], "r+") as file:
        file["parameters"].attrs[name] = value
    with pytest.raises(ResponsesError, match=re.escape(f"run {row['run_id']}: {name} = {value:g} in")):
        build_results(folder, plan, points)


def test_a_run_that_ends_early_without_being_steady_is_refused(small):
    folder, plan, points = small
    row = next(row for row in plan.itertuples() if row.stage == "shear")
    synthetic.write_run(row, end=0.3, windows=15)
    with pytest.raises(ResponsesError, match="ends at eps_a = 0.3 .* not steady"):
        build_results(folder, plan, points)


def test_windows_that_differ_are_interpolated(small):
    folder, plan, points = small
    row = next(row for row in plan.itertuples() if row.stage == "shear" and row.point == 1)
    synthetic.write_run(row, windows=400)
    results = read_results(build_results(folder, plan, points))
    assert len(results.strain) == 401
    assert results.response("e", 0.04).values[:, 1] == pytest.approx(
        synthetic.void_ratio(results.strain, row.mu_s, 0.04), abs=1e-6
    )


def test_points_the_plan_does_not_name_give_their_probability_to_the_nearest(small):
    folder, plan, points = small
    x = synthetic.representative_points(2).x
    more = RepresentativePoints(np.vstack([x[0] * [1.01, 1.0], x]), [0.5, 0.3, 0.2], id=[7, 0, 1])
    results = read_results(build_results(folder, plan, more))
    assert results.probability(0.04) == pytest.approx([0.8, 0.2])
    with h5py.File(results.path) as file:
        assert file["families/coupled/points"].attrs["planned_share"] == pytest.approx(0.5)
