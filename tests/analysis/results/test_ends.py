"""Results of undrained campaigns: points that ended early keep their probability, everything else is conditional."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import synthetic_paths
import synthetic_results as synthetic
from hdf5_files import changed_on_purpose

from analysis.pdem import weighted
from analysis.pdem.evolution import evolve
from analysis.quantities import DRAINED, Loading
from analysis.results import quote as quoting
from analysis.results.build import build_results
from analysis.results.collect import ResponsesError, collect
from analysis.results.quote import OF_NONE, WITHHELD
from analysis.results.reader import ResultsError, read_results
from analysis.results.standing import NOT_REACHED

STIFF, LIQUEFIED = [0, 1, 2], [0, 1, 2, 9]


@pytest.fixture(scope="module")
def results():
    return read_results(synthetic_paths.example())


def test_ends_are_stored_with_their_probability_and_their_points(results):
    probability, ids = results.probability(0.1), results.family_points().id
    assert probability.sum() == pytest.approx(1.0)
    assert probability == pytest.approx(results.points.probability)  # nothing moved to other points
    liquefied, stiff = results.ended("liquefied", "loose"), results.ended("stiff", "dense")
    assert liquefied.point.tolist() == LIQUEFIED and stiff.point.tolist() == STIFF
    assert liquefied.at == pytest.approx(synthetic_paths.LIQUEFIED_AT)
    gone = results.strain >= synthetic_paths.LIQUEFIED_AT
    assert liquefied.probability == pytest.approx(gone * probability[np.isin(ids, LIQUEFIED)].sum())
    assert np.all(liquefied.low <= liquefied.probability) and np.all(liquefied.probability <= liquefied.high)
    assert results.ended("stiff", "loose").probability.max() == 0.0 < results.ended("stiff", "loose").high[-1] < 1.0
    assert results.going_on("loose").value == pytest.approx(1 - liquefied.probability[-1])
    with pytest.raises(ResultsError, match="no test ends as 'asleep', only as liquefied or stiff"):
        results.ended("asleep", "loose")


@pytest.mark.parametrize("mu_iso, gone", [(0.001, STIFF), (0.1, LIQUEFIED)])
def test_pdfs_and_moments_are_those_of_the_tests_that_go_on(results, mu_iso, gone):
    ids, probability = results.family_points().id, results.probability(mu_iso)
    left = ~np.isin(ids, gone)
    for symbol in ("eta", "p", "Z_m"):
        response = results.response(symbol, mu_iso)
        rest = weighted.normalised(probability[left])
        alone = evolve(response.values[:, left], rest, results.strain, cells=128)
        late = results.strain > 0.15
        assert response.mean[late] == pytest.approx(alone.mean[late])
        assert response.pdf.mean[late] == pytest.approx(alone.mean[late])
        assert response.pdf.lost_probability[late] == pytest.approx(probability[~left].sum())
        assert (response.pdf.p.sum(axis=1) * response.pdf.dx) == pytest.approx(1.0)
        assert np.isnan(response.values[late][:, ~left]).all() and np.isfinite(response.values[:, left]).all()


def test_states_say_for_which_probability_they_hold(results):
    probability = results.probability(0.1)
    reached = ~np.isin(results.family_points().id, LIQUEFIED)
    for state, symbol in (("critical", "eta"), ("strength", "s_u"), ("strength", "u")):
        assert np.array_equal(np.isfinite(results.state(state, symbol, 0.1)), reached)
        assert results.holds_for(state, symbol, 0.1) == pytest.approx(probability[reached].sum())
    assert results.holds_for("initial", "p", 0.1) == 1.0 == results.holds_for("probe", "G_0", 0.1)


def test_the_denoised_moments_of_a_state_are_those_of_the_points_that_reached_it(results, monkeypatch):
    """The noise of eta is small: they are nearly the sums over these points."""
    monkeypatch.setattr(quoting, "QUOTED_UNDRAINED", (("critical", "eta"), ("strength", "s_u")))
    reached = ~np.isin(results.family_points().id, LIQUEFIED)
    probability = results.probability(0.1)[reached]
    eta = synthetic.critical_eta(results.points.mu_s[reached])
    quote = quoting.quote(results).set_index(["density", "state", "quantity"]).sort_index()
    row = quote.loc[("loose", "critical", "eta")]
    assert row["holds_for"] == pytest.approx(probability.sum(), abs=1e-4)
    assert row["mean"] == pytest.approx(weighted.mean(eta, probability), abs=0.005) and row["mean_pm"] > 0
    assert row["sd"] == pytest.approx(weighted.std(eta, probability), abs=0.005)
    assert quote.loc[("loose", "strength", "s_u"), "basis"] == quoting.OF_POINTS  # it spans more than a factor of 5


def build(folder, **options):
    made = synthetic_paths.make_campaign(folder, n=6, densities=(0.1,), packings=(1, 2, 3), **options)
    return read_results(build_results(folder, *made, cells=64))


def test_a_density_of_which_no_test_goes_on_is_a_result(tmp_path):
    results = build(tmp_path, liquefied={0.1: range(6)})
    assert results.strain[-1] == pytest.approx(0.4)  # the strain that was planned
    ended = results.ended("liquefied", 0.1)
    assert ended.probability[-1] == pytest.approx(1.0) and ended.high[-1] == 1.0 and 0.0 < ended.low[-1] < 1.0
    assert results.going_on(0.1).value == 0.0
    response = results.response("eta", 0.1)
    assert not response.going[-1] and response.going[0] and np.all(response.pdf.p[-1] == 0)
    assert results.standing("critical", 0.1).status == NOT_REACHED
    quote = results.quote().set_index(["state", "quantity"])
    assert set(quote.loc["strength", "basis"]) == {OF_NONE} and set(quote.loc["critical", "basis"]) == {WITHHELD}
    assert results.counts(0.1)["lost_probability"] == 0.0


def test_a_failed_run_still_gives_its_probability_to_its_neighbour_and_a_liquefied_one_keeps_it(tmp_path):
    plan, points, info = synthetic_paths.make_campaign(tmp_path, n=6, densities=(0.1,), liquefied={0.1: (2,)})
    synthetic.fail_run(next(row for row in plan.itertuples() if row.stage == "shear" and row.point == 4))
    results = read_results(build_results(tmp_path, plan, points, info, max_lost_probability=0.9, cells=64))
    probability = results.probability(0.1)
    assert probability[4] == 0.0 and probability[2] >= points.probability[2] and probability.sum() == pytest.approx(1)
    assert results.counts(0.1)["lost_probability"] == pytest.approx(points.probability[4])
    assert results.ended("liquefied", 0.1).probability[-1] == pytest.approx(probability[2])


def test_points_that_were_spared_are_not_filled_where_tests_ended_early(tmp_path):
    plan, points, info = synthetic_paths.make_campaign(tmp_path, n=9, densities=(0.1,), liquefied={0.1: (2,)})
    plan["status"] = np.where((plan["stage"] == "shear") & plan["point"].isin([5, 6]), "spared", "")
    for row in plan[plan["status"] == "spared"].itertuples():
        (tmp_path / "products" / f"{row.run_id}.h5").unlink()
    results = read_results(build_results(tmp_path, plan, points, info, cells=64))
    assert not results.filled(0.1).any() and results.probability(0.1)[[5, 6]].tolist() == [0.0, 0.0]
    assert results.counts(0.1)["lost_probability"] == 0.0


def test_tests_of_different_kinds_are_refused(tmp_path):
    plan, points, _ = synthetic_paths.make_campaign(tmp_path, n=3, densities=(0.1,))
    last = [row for row in plan.itertuples() if row.stage == "shear"][-1]
    synthetic_paths.write_shear(last, Loading("drained", "extension"))
    with pytest.raises(ResponsesError, match=f"run {last.run_id}: is drained triaxial extension, run .* is undrained"):
        collect(plan, points)


@pytest.mark.parametrize("path, direction, version", [("drained", "compression", 4), ("constant_p", "compression", 6),
                                                      ("drained", "extension", 6)])  # fmt: skip
def test_only_other_tests_have_the_new_version(tmp_path, path, direction, version):
    made = synthetic_paths.make_campaign(tmp_path, path, direction, n=3, densities=(0.1,), strain_end=0.1)
    results = read_results(build_results(tmp_path, *made, cells=64))
    assert results.attrs["format_version"] == version and results.loading == Loading(path, direction)
    assert ("path" in results.attrs) == (results.loading != DRAINED) == ("path" in results.runs)
    with h5py.File(results.path) as file:
        assert "ends" not in file["families/coupled/0.1"]
    assert results.ended("liquefied", 0.1).high.max() == 0.0
    assert "transformation" not in results.states
    with pytest.raises(ResultsError, match="there is no state 'strength', only initial, peak, critical, probe"):
        results.standing("strength", 0.1)


def test_a_file_of_an_unknown_test_is_refused(results, tmp_path):
    path = tmp_path / "results.h5"
    path.write_bytes(results.path.read_bytes())
    with changed_on_purpose(path) as file:
        file.attrs["path"] = "sideways"
    with pytest.raises(ResultsError, match="the test .'sideways'.* is none that is known"):
        read_results(path)


def test_friction_angles_are_positive_in_both_directions():
    """phi = 30 degrees: eta = 6 sin / (3 - sin) = 1.2 and -6 sin / (3 + sin) = -0.857."""
    from analysis.results.friction_angle import friction_angle

    assert friction_angle([1.2, 0.0]) == pytest.approx([30.0, 0.0])
    assert friction_angle([-6 / 7, 0.0], "extension") == pytest.approx([30.0, 0.0])
    results = read_results(synthetic_paths.example("drained", "extension"))
    angles = results.friction_angle("critical", "dense")
    assert np.all(angles > 0)
    other = np.degrees(np.arcsin(3 * (e := synthetic.critical_eta(results.points.mu_s)) / (6 + e)))
    assert angles == pytest.approx(other, rel=0.02)  # Matsuoka and Nakai: the same angle as in compression


def test_peaks_in_extension_are_pooled_as_those_in_compression(tmp_path):
    """The same noise in eta of the other sign gives the same peaks of the other sign, to the last bit but rounding."""
    from analysis.results.peaks import peak_states, pool_peaks

    strain, rng = np.linspace(0, 0.4, 81), np.random.default_rng(5)
    points = synthetic.representative_points(8)
    eta = np.column_stack([synthetic.eta(strain, mu_s, 0.001) for mu_s in points.mu_s])
    eta *= 1 + 0.02 * rng.normal(size=eta.shape)
    pooled = pool_peaks(strain, eta, points.x, np.ones(8))
    single = {"p": np.full(8, 1e5), "q": np.full(8, 5e4)}
    for path in ("constant_p", "drained"):
        up, error = peak_states(strain, {"eta": eta}, pooled, single, Loading(path))
        turned = {"p": single["p"], "q": -single["q"]}
        down, same = peak_states(strain, {"eta": -eta}, pooled, turned, Loading(path, "extension"))
        assert down["eta"] == pytest.approx(-up["eta"]) and same == pytest.approx(error)
        assert np.all(down["q"] < 0) and down["q"] == pytest.approx(down["eta"] * down["p"])
