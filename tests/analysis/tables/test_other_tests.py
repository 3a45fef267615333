"""Tables of other tests than drained compression: ends, strength in extension, critical state lines, proofs."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import synthetic_paths
import synthetic_results as synthetic

from analysis.quantities import Loading
from analysis.results.reader import read_results
from analysis.tables import critical_line, ends, export, run_quality, strength
from analysis.tables.claims import claims_table
from analysis.tables.published import SURFACES


@pytest.fixture(scope="module")
def undrained():
    return read_results(synthetic_paths.example())


def mohr_coulomb(angle):
    """Stress ratios in compression and extension of a friction angle in degrees."""
    sine = np.sin(np.radians(angle))
    return 6 * sine / (3 - sine), -6 * sine / (3 + sine)


@pytest.mark.parametrize("angle", [5.0, 20.0, 30.0, 45.0])
def test_matsuoka_and_nakai_have_the_same_angle_in_both_directions(angle):
    compression, extension = mohr_coulomb(angle)
    assert strength.matsuoka_nakai_extension(compression) == pytest.approx(extension)
    assert strength.matsuoka_nakai_compression(extension) == pytest.approx(compression)


def test_known_pairs_of_stress_ratios():
    """30 degrees: 1.2 and -6/7.  Lade and Duncan, stresses 4:1:1: I1^3/I3 = 54, which x:x:1 has, too, at x = 5.10."""
    assert mohr_coulomb(30.0) == pytest.approx((1.2, -6 / 7))
    assert strength.matsuoka_nakai_extension(1.2) == pytest.approx(-6 / 7)
    eta = 3 * (4 - 1) / (4 + 2)
    x = max(np.roots([8, 12 - 54, 6, 1]).real)  # (2 x + 1)^3 = 54 x^2
    assert strength.lade_duncan_extension(eta) == pytest.approx(3 * (1 - x) / (1 + 2 * x))


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("eta", [1e-3, 0.3, 0.7, 1.2, 2.0, 2.9])
def test_both_states_lie_on_the_surface_and_the_inverse_leads_back(surface, eta):
    other = float(strength.EXTENSION[surface](eta))
    assert -1.5 < other < 0 and float(strength.COMPRESSION[surface](other)) == pytest.approx(eta)
    level = [SURFACES[surface](1 + 2 * e / 3, 1 - e / 3, 1 - e / 3) for e in (eta, other)]
    assert level[0] == pytest.approx(level[1], rel=1e-9)


def test_extension_stands_beside_what_compression_predicts():
    """The synthetic extension is that of Matsuoka and Nakai."""
    up, down = (read_results(synthetic_paths.example("drained", d)) for d in ("compression", "extension"))
    frame = strength.directions([("up", up), ("down", down)])
    assert frame[["compression", "extension"]].drop_duplicates().to_numpy().tolist() == [["up", "down"]]
    assert len(frame) == 4 and (frame["eta_extension"] < 0).all()
    critical = frame[frame["state"] == "critical"]
    assert critical["Matsuoka-Nakai_difference_pct"].abs().max() < 0.5
    assert (critical["Lade-Duncan"] < critical["Matsuoka-Nakai"]).all()
    assert len(strength.directions([("up", up), ("again", up)])) == 0
    own = strength.extension_strength(down)
    assert own["Matsuoka-Nakai_compression"].to_numpy() == pytest.approx(frame["eta_compression"].to_numpy(), rel=0.02)
    assert len(strength.extension_strength(up).columns) == 0


def test_the_table_of_ends_adds_up_to_one(undrained):
    frame = ends.ends(undrained)
    assert frame.groupby("mu_iso")["probability"].sum().to_numpy() == pytest.approx(1.0)
    loose = frame[frame["mu_iso"] == 0.1].set_index("end")
    assert loose.loc["liquefied", ["points", "which"]].tolist() == [4, "0, 1, 2, 9"]
    assert loose.loc["liquefied", "median_strain_pct"] == pytest.approx(10.25)
    assert (loose["probability_low"] <= loose["probability"]).all() and set(loose["packings"]) == {3}
    along = ends.ends_along(undrained)
    last = along[along["eps_a_pct"] == along["eps_a_pct"].max()].set_index(["mu_iso", "end"])["probability"]
    assert last[0.1, "liquefied"] == pytest.approx(loose.loc["liquefied", "probability"])
    drained = read_results(synthetic_paths.example("drained", "extension"))
    assert len(ends.ends(drained).columns) == len(ends.ends_along(drained).columns) == 0


def test_the_export_names_the_end_of_every_point(undrained):
    frame = pd.concat(export._ends(undrained))
    assert frame.groupby(["mu_iso", "end"]).size().to_dict() == {
        (0.001, ""): 9, (0.001, "stiff"): 3, (0.1, ""): 8, (0.1, "liquefied"): 4}  # fmt: skip
    assert frame.loc[frame["end"] == "", "strain"].isna().all()
    described = export._columns(export.export_tables(undrained))
    assert not described[described["file"] == "ends.csv"].empty and (described["meaning"] != "").all()


def points_on_a_line(e_100=0.7, slope=0.03, of_friction=0.1, scatter=0.0, path="drained"):
    """Critical states at three stresses, with friction that moves the line."""
    rng, rows = np.random.default_rng(2), []
    for p in (50.0, 100.0, 200.0):
        mu_s = synthetic.representative_points(10, seed=int(p)).mu_s
        e = e_100 - slope * np.log(p / 100) + of_friction * np.log(mu_s / 0.2) + scatter * rng.normal(size=10)
        rows.append(pd.DataFrame({"campaign": f"{p:g} kPa", "path": path, "direction": "compression", "mu_iso": 0.04,
                                  "packing": np.arange(10) % 3, "p_kPa": p, "e": e, "eta": 0.6, "probability": 0.1,
                                  "mu_s": mu_s}))  # fmt: skip
    return pd.concat(rows, ignore_index=True)


def test_the_critical_line_is_found_and_its_scatter_is_that_of_the_points():
    exact = critical_line.critical_lines(points_on_a_line(of_friction=0.0)).iloc[0]
    assert (exact["e_100"], exact["slope"], exact["scatter"]) == pytest.approx((0.7, 0.03, 0.0), abs=1e-9)
    moved = critical_line.critical_lines(points_on_a_line(scatter=0.002)).iloc[0]
    assert moved["slope_given_inputs"] == pytest.approx(0.03, abs=0.003)
    assert moved["scatter_given_inputs"] == pytest.approx(0.002, rel=0.4) and moved["scatter"] > 0.02
    assert abs(moved["slope"] - 0.03) < 3 * moved["slope_error"]
    narrow = points_on_a_line().query("p_kPa < 150")
    assert len(critical_line.critical_lines(narrow)) == len(critical_line.critical_offsets(narrow)) == 0


def test_undrained_points_are_measured_from_the_drained_line():
    both = pd.concat([points_on_a_line(), points_on_a_line(e_100=0.69, path="undrained").assign(campaign="U")])
    offsets = critical_line.critical_offsets(both).set_index("campaign")
    assert offsets.loc["U", "offset"] == pytest.approx(-0.01, abs=1e-6) and offsets.loc["U", "points"] == 30
    assert offsets.drop("U")["offset"].abs().max() < 1e-6
    assert set(critical_line.critical_lines(both)["fitted_to"]) == {"drained", "undrained", critical_line.ALL}


def test_the_line_of_undrained_tests_is_theirs(undrained):
    line = critical_line.lines_of_one(undrained).iloc[0]
    assert line["slope_given_inputs"] == pytest.approx(synthetic_paths.SLOPE, rel=0.02)
    assert line["points"] == 17 and len(critical_line.of_one(undrained)) == 17


def test_the_stress_is_no_input_of_the_line():
    """Random sigma_3 would take the place of p'."""
    frame = points_on_a_line(of_friction=0.0).assign(sigma_3=lambda f: 1e3 * f["p_kPa"])
    assert critical_line.critical_lines(frame).iloc[0]["slope_given_inputs"] == pytest.approx(0.03)


def test_statements_of_the_paper_are_not_judged_by_another_test(undrained):
    assert len(claims_table(undrained)) == 0
    words = {name: text for name, (text, _) in run_quality.proofs_of(Loading("undrained")).items()}
    assert words["servo_mean_error"] == "mean error of the volume"
    assert len(run_quality.rowe(read_results(synthetic_paths.example("drained", "extension")))) == 0
