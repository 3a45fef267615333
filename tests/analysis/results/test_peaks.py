"""Pooled peaks: known truth with and without noise, points without a run, few points, and what results.h5 states."""

from __future__ import annotations

import shutil

import bench_peaks as bench
import numpy as np
import pytest
import synthetic_results as synthetic
from hdf5_files import changed_on_purpose

from analysis.results.build import build_results
from analysis.results.peaks import peak_states, pool_peaks
from analysis.results.reader import read_results
from analysis.runs.archive import run_summary, write_archive
from analysis.runs.peak_critical import peak_state
from analysis.runs.run_file import read_run
from analysis.runs.states import run_states
from analysis.tables import evaluate

STRAIN = bench.STRAIN


def estimated(eta, inputs, packing=None):
    """Peak stress ratios (Q,) and the pooled peaks, of points in one packing unless others are given."""
    peaks = pool_peaks(STRAIN, eta, inputs, np.ones(len(inputs)) if packing is None else packing)
    return peak_states(STRAIN, {"eta": eta}, peaks, {})[0]["eta"], peaks


@pytest.mark.parametrize("density", bench.DENSITIES)
@pytest.mark.parametrize("n, limit", [(8, 2.5e-3), (100, 1e-3)])
def test_curves_without_noise_give_the_exact_peak(density, n, limit):
    """Few points have few terms, which do not follow the strain of every peak."""
    made = bench.campaign(density, n, 1000, np.random.default_rng(3))
    exact = bench.truth(density, np.linspace(0.01, 0.36, 3501), made.inputs).max(axis=0)
    eta, peaks = estimated(made.true, made.inputs)
    assert made.probability @ eta == pytest.approx(made.probability @ exact, abs=limit)
    assert eta == pytest.approx(exact, abs=3e-3) and peaks.interior.all()


@pytest.mark.parametrize("mu_iso", [0.001, 0.04])
def test_curves_of_another_form_give_the_exact_peak(mu_iso):
    points = synthetic.representative_points(20)
    fine = np.linspace(0.01, 0.36, 3501)
    true, exact = (np.column_stack([synthetic.eta(s, mu_s, mu_iso) for mu_s in points.mu_s]) for s in (STRAIN, fine))
    assert estimated(true, points.x)[0] == pytest.approx(exact.max(axis=0), abs=1e-3)


@pytest.mark.parametrize(
    "n, packings, density, count",
    [(8, 1, "dense", 80), (8, 1, "loose", 80), (8, 4, "medium", 80),
     (100, 1, "medium", 25), (100, 1, "loose", 25), (100, 20, "medium", 25)],
)  # fmt: skip
def test_noise_does_not_bias_the_mean_peak_as_it_biases_that_of_single_runs(n, packings, density, count):
    row = bench.case("measured", n, packings, 1000, density, count, seed=11)
    assert abs(row["pooled"]) <= 0.005 < row["single"] and row["single"] > 3 * abs(row["pooled"])


def test_a_flat_curve_is_lifted_by_less_than_half_as_much():
    rng = np.random.default_rng(5)
    flat = 0.65 * -np.expm1(-STRAIN / 0.003)[:, None] * np.ones(40)
    errors = []
    for _ in range(10):
        inputs, _, true, noisy, _ = bench.campaign("loose", 40, 1000, rng)
        noisy = flat * np.divide(noisy, true, out=np.ones_like(true), where=true > 0)
        single = np.mean([peak_state(STRAIN, eta).eta for eta in noisy.T])
        errors.append((single - 0.65, estimated(noisy, inputs)[0].mean() - 0.65))
    single, pooled = np.mean(errors, axis=0)
    assert single > 0.04 and abs(pooled) < 0.5 * single
    eta, _ = estimated(flat, inputs)
    assert eta == pytest.approx(np.full(40, 0.65), abs=1e-3)


def test_a_curve_that_still_rises_has_no_interior_peak():
    inputs = bench.campaign("loose", 12, 1000, np.random.default_rng(1)).inputs
    rising = np.sqrt(STRAIN)[:, None] * inputs[:, 0] ** 0.2
    _, peaks = estimated(rising, inputs)
    assert not peaks.interior.any() and len(set(peaks.row)) == 1
    falling = np.where(STRAIN > 0, np.exp(-STRAIN), 0.0)[:, None] * inputs[:, 0] ** 0.2
    assert not estimated(falling, inputs)[1].interior.any()


@pytest.mark.parametrize("packings", [1, 5])
def test_points_without_a_run_have_no_value_and_do_not_disturb_the_others(packings):
    inputs, packing, _, noisy, _ = bench.campaign("dense", 20, 1000, np.random.default_rng(2), packings=packings)
    holes = noisy.copy()
    holes[:, [3, 11]] = np.nan
    eta, peaks = estimated(holes, inputs, packing)
    kept = np.delete(np.arange(20), [3, 11])
    assert np.isnan(eta[[3, 11]]).all() and np.isnan(peaks.bias[[3, 11]]).all()
    alone, alone_peaks = estimated(noisy[:, kept], inputs[kept], packing[kept])
    assert eta[kept] == pytest.approx(alone, abs=1e-12) and (peaks.row[kept] == alone_peaks.row).all()


@pytest.mark.parametrize("packings", [1, 5])
def test_the_order_of_the_points_does_not_matter(packings):
    inputs, packing, _, noisy, _ = bench.campaign("medium", 25, 400, np.random.default_rng(4), packings=packings)
    order = np.random.default_rng(1).permutation(25)
    eta, peaks = estimated(noisy, inputs, packing)
    turned, turned_peaks = estimated(noisy[:, order], inputs[order], packing[order])
    assert turned == pytest.approx(eta[order], abs=1e-12) and (turned_peaks.row == peaks.row[order]).all()


def test_more_packings_leave_less_to_subtract():
    biases = []
    for packings in (1, 5, 20):
        rng = np.random.default_rng(6)
        made = [bench.campaign("medium", 50, 400, rng, packings=packings) for _ in range(5)]
        biases.append(np.mean([estimated(one.noisy, one.inputs, one.packing)[1].bias for one in made]))
    assert biases[0] > 3 * biases[1] and biases[1] > 1.2 * biases[2] > 0, biases


def test_four_points_are_too_few():
    inputs, packing, true, _, _ = bench.campaign("dense", 4, 1000, np.random.default_rng(1))
    assert pool_peaks(STRAIN, true, inputs, packing) is None


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Folder, plan, points and info of a noisy campaign of three packings."""
    folder = tmp_path_factory.mktemp("peaks")
    return folder, *synthetic.make_campaign(folder, n=8, noise=0.03, packings=(1, 2, 3))


@pytest.fixture(scope="module")
def results(campaign):
    return read_results(build_results(*campaign))


def test_results_state_the_peaks_and_take_every_quantity_at_the_same_strain(results):
    for mu_iso in results.family_densities():
        peaks = results.peak_estimate(mu_iso)
        at = np.array([np.argmin(abs(results.strain - s)) for s in results.state("peak", "eps_peak", mu_iso)])
        assert np.isfinite(peaks.bias).all() and peaks.interior.dtype == bool
        e = results.response("e", mu_iso).values[at, np.arange(8)]
        assert results.state("peak", "e", mu_iso) == pytest.approx(e, abs=2e-3)
        eta, p, q = (results.state("peak", symbol, mu_iso) for symbol in ("eta", "p", "q"))
        assert q / p == pytest.approx(eta, rel=1e-12) and p - q / 3 == pytest.approx(np.full(p.shape, 1e5), rel=1e-6)
        assert np.isfinite(results.state_error("peak", "eta", mu_iso)).all()
    table = evaluate(results, only=["peak_estimates"])["peak_estimates"]
    assert set(table["estimate"]) == {"pooled over the points"} and table["mean_bias"].notna().all()


def test_neither_the_order_of_the_runs_nor_the_archive_changes_the_peaks(campaign, results, tmp_path):
    _, plan, points, info = campaign
    shuffled = plan.sample(frac=1.0, random_state=1).reset_index(drop=True)
    runs = {row.run_id: run_summary(read_run(row.product)) for row in plan.itertuples()}
    write_archive(tmp_path / "runs.h5", runs)
    shuffled["product"] = [str(tmp_path / "products" / f"{run_id}.h5") for run_id in shuffled["run_id"]]
    second = read_results(build_results(tmp_path, shuffled, points, info))
    for mu_iso in results.family_densities():
        for symbol in results.state_symbols("peak", mu_iso):
            one, other = (built.state("peak", symbol, mu_iso) for built in (results, second))
            assert np.array_equal(one, other, equal_nan=True), symbol


def test_with_three_points_every_run_has_the_peak_of_its_own_curve_and_the_file_says_so(tmp_path):
    plan, points, info = synthetic.make_campaign(tmp_path, n=3, noise=0.03)
    results = read_results(build_results(tmp_path, plan, points, info))
    assert results.peak_estimate(0.04) is None
    assert set(evaluate(results, only=["peak_estimates"])["peak_estimates"]["estimate"]) == {"single runs"}
    shear = plan[(plan["stage"] == "shear") & (plan["mu_iso"] == 0.04)]
    own = [run_states(read_run(product)).states["peak"]["eta"] for product in shear["product"]]
    assert results.state("peak", "eta", 0.04) == pytest.approx(own, rel=1e-12)


def test_results_of_earlier_versions_are_read(results, tmp_path):
    path = shutil.copy(results.path, tmp_path / "results.h5")
    with changed_on_purpose(path) as file:
        for group in file["families/coupled"].values():
            if "peak_estimate" in group:
                del group["peak_estimate"], group["states/peak"].attrs["estimate"]
    results = read_results(path)
    assert results.peak_estimate(0.04) is None and np.isfinite(results.state("peak", "eta", 0.04)).all()
