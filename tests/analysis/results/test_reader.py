"""The reader of results.h5 and the weighted statistics behind its numbers."""

from __future__ import annotations

import shutil
import subprocess
import sys

import h5py
import numpy as np
import pytest
import synthetic_results as synthetic
from paths import DATA

from analysis.pdem import tails, weighted
from analysis.results.reader import ResultsError, read_results


@pytest.fixture(scope="module")
def campaign():
    """Five noise-free points, families coupled and G_p: (points, info, results)."""
    return synthetic.representative_points(5), synthetic.campaign_info(), read_results(synthetic.example())


def test_reader_gives_back_what_was_written(campaign):
    points, info, results = campaign
    assert results.points.mu_s == pytest.approx(points.mu_s)
    assert results.points.probability.sum() == pytest.approx(1)
    assert results.pairs == pytest.approx(info.pairs)
    assert results.densities == (0.001, 0.04, 0.1) == results.family_densities("G_p")
    assert results.attrs["campaign"] == "synthetic" and "numpy" in results.attrs["versions"]
    assert results.inputs["copulas"][0]["family"] == "gaussian"
    assert [fit["family"] for fit in results.inputs["marginals"]["G_p"]] == ["lognormal", "gamma"]
    assert set(results.runs["stage"]) == {"consolidate", "shear", "probe"} and len(results.runs) == 63
    assert results.runs["cpu_seconds"].sum() == pytest.approx(2.0 * 63)


def test_moments_are_sums_over_the_points(campaign):
    points, _, results = campaign
    eta, weight = results.response("eta", 0.001), points.probability
    exact = np.array([synthetic.eta(results.strain, mu_s, 0.001) for mu_s in points.mu_s]).T
    assert eta.mean == pytest.approx(exact @ weight, abs=1e-12)
    assert eta.std == pytest.approx(np.sqrt(exact**2 @ weight - (exact @ weight) ** 2), abs=1e-7)
    assert eta.quantile(0.5)[-1] == pytest.approx(weighted.quantile(exact[-1], weight, 0.5))


def test_tails_of_a_response_are_those_of_its_points(campaign):
    points, _, results = campaign
    pdf, weight = results.response("eta", 0.001).pdf, points.probability
    exact = synthetic.eta(results.strain[-1:], points.mu_s[:, None], 0.001)[:, 0]
    threshold = [exact.min(), np.median(exact), exact.max() + 0.01]
    assert pdf.exceedance(threshold)[-1] == pytest.approx(tails.exceedance(exact, weight, threshold))
    assert np.all(np.diff(pdf.quantile_interval([0.05, 0.95]), axis=0) >= 0)


def test_the_family_with_fixed_friction_has_its_own_points(campaign):
    points, _, results = campaign
    own = results.family_points("G_p")
    assert set(own.mu_s) == {0.25}
    assert own.G_p == pytest.approx(points.G_p)
    assert results.response("eta", 0.04, "G_p").std.max() < 1e-12
    assert results.response("eta", 0.04).std[-1] > 0.05


@pytest.mark.parametrize(
    ("method", "ask", "words"),
    [
        ("response", ("nothing", 0.04), "no 'nothing' in /families/coupled/0.04/responses, only .*eta"),
        ("response", ("eta", 0.5), "coupled has no density mu_iso = 0.5, only .*0.04"),
        ("response", ("eta", 0.04, "none"), "no family 'none', only .*coupled"),
        ("state", ("critical", "G_0", 0.04), "no 'G_0' in .*critical, only .*eta"),
        ("state_error", ("critical", "nothing", 0.04), "no 'nothing' in .*critical, only .*eta"),
        ("filled", (0.04, "coupled", "end"), "no state 'end', only initial, peak, critical, probe"),
        ("probability", (0.5,), "has no density"),
        ("family_densities", ("none",), "no family"),
        ("family_points", ("none",), "no family"),
        ("consolidated", ("eta", 0.04), "consolidations have no 'eta', only e, e_m, Z, Z_m"),
        ("consolidated", ("e", 0.5), "has no density"),
    ],
)
def test_a_name_that_is_not_there_is_one_line_with_those_that_are(campaign, method, ask, words):
    with pytest.raises(ResultsError, match=words) as told:
        getattr(campaign[-1], method)(*ask)
    assert "\n" not in str(told.value)


def test_consolidations_weigh_alike_or_as_the_points_do(campaign):
    points, _, results = campaign
    assert [list(both) for both in results.consolidated("e", 0.04)] == [[synthetic.E_0[0.04]], [1.0]]
    alone = synthetic.consolidated_per_point(results)
    found, share = alone.consolidated("e", 0.04)
    assert found == pytest.approx(0.6 + 0.01 * points.id)
    assert share == pytest.approx(points.probability)
    twice = synthetic.consolidated_per_point(results, packings=(1, 2))
    found, share = twice.consolidated("e", 0.04)
    assert found[-1] == pytest.approx(0.7) and len(found) == 6 and share.sum() == pytest.approx(1)
    assert share[[0, -1]] == pytest.approx(0.5 * points.probability[0])
    assert share[1:-1] == pytest.approx(points.probability[1:])


def test_files_that_are_no_results_are_refused(tmp_path):
    for content, words in ((b"text", "truncated or not an HDF5 file"), (None, "no such results file")):
        path = tmp_path / "results.h5"
        if content:
            path.write_bytes(content)
        with pytest.raises(ResultsError, match=words):
            read_results(path if content else tmp_path / "none.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs.update(format="campaign-results", format_version=99)
    with pytest.raises(ResultsError, match="version 99"):
        read_results(tmp_path / "other.h5")


def test_weighted_statistics_against_plain_ones_of_repeated_values():
    values, count = np.array([3.0, 1.0, 2.0, 5.0]), np.array([2, 1, 4, 3])
    plain, weight = np.repeat(values, count), count / count.sum()
    assert weighted.mean(values, weight) == pytest.approx(plain.mean())
    assert weighted.std(values, weight) == pytest.approx(plain.std())
    assert weighted.cov(values, weight) == pytest.approx(plain.std() / plain.mean())
    other = np.array([1.0, 4.0, 2.0, 2.5])
    assert weighted.correlation(values, other, weight) == pytest.approx(
        np.corrcoef(plain, np.repeat(other, count))[0, 1]
    )
    with_gap = np.append(values, np.nan)
    assert weighted.mean(with_gap, np.append(weight, 0.7)) == pytest.approx(plain.mean())


def test_wasserstein_of_a_shift_is_the_shift_and_agrees_with_scipy():
    from scipy.stats import wasserstein_distance

    rng = np.random.default_rng(3)
    a, p, b, q = rng.normal(size=20), rng.random(20), rng.normal(1, 2, size=15), rng.random(15)
    assert weighted.wasserstein(a, a + 0.3, p, p) == pytest.approx(0.3)
    assert weighted.wasserstein(a, b, p, q) == pytest.approx(wasserstein_distance(a, b, p, q))


def test_quantiles_of_points_are_exact_for_a_uniform_grid():
    values = (np.arange(200) + 0.5) / 200
    assert weighted.quantile(values, np.full(200, 1 / 200), [0.05, 0.5, 0.95]) == pytest.approx([0.05, 0.5, 0.95])


def test_the_example_for_colleagues_runs_on_the_results_alone(tmp_path):
    script = DATA / "example_results.py"
    path = shutil.copy(synthetic.example(), tmp_path / "results.h5")
    done = subprocess.run(
        [sys.executable, script, path, tmp_path / "x.png"], capture_output=True, text=True, check=True
    )
    points = synthetic.representative_points(5)
    mean = synthetic.critical_eta(points.mu_s) @ points.probability
    assert f"loose (mu_iso = 0.1): critical eta {mean:.2f}" in done.stdout
    assert (tmp_path / "x.png").stat().st_size > 5000
