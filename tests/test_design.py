"""Friction angles: closed form, known quantiles, bands that hold them."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis.design import design_table, friction_angle
from analysis.responses import build_results
from analysis.results import Results, read_results


def test_friction_angle_of_a_mohr_circle():
    for phi in (10.0, 25.0, 40.0):
        ratio = (1 + np.sin(np.radians(phi))) / (1 - np.sin(np.radians(phi)))
        eta = (ratio - 1) / ((ratio + 2) / 3)
        assert friction_angle(eta) == pytest.approx(phi)
    assert friction_angle([-4.0, 7.0]) == pytest.approx([-90.0, 90.0])


def test_characteristic_angles_of_known_points(tmp_path):
    plan, points, settings = synthetic.make_campaign(tmp_path, n=14)
    results = read_results(build_results(tmp_path, plan, points, settings))
    frame = design_table(results, n_boot=15).set_index(["mu_iso", "state"])
    assert len(frame) == 6
    order = np.argsort(points["mu_s"].to_numpy())
    middle = np.cumsum(points["probability"].to_numpy()[order]) - 0.5 * points["probability"].to_numpy()[order]
    angle = friction_angle(synthetic.critical_eta(points["mu_s"].to_numpy()[order]))
    row = frame.loc[(0.04, "critical")]
    assert row["characteristic 5 % from the points (deg)"] == pytest.approx(np.interp(0.05, middle, angle), abs=0.1)
    assert row["characteristic 5 % from the density (deg)"] < row["characteristic 5 % from the points (deg)"]
    for name in ("mean (deg)", "characteristic 5 % from the density (deg)"):
        assert row[f"{name}, from"] < row[name] < row[f"{name}, to"]
    exact = friction_angle(synthetic.critical_eta(points["mu_s"])) @ points["probability"]
    assert row["mean (deg)"] == pytest.approx(exact, abs=0.05)
    assert frame.loc[(0.001, "peak"), "mean (deg)"] > frame.loc[(0.1, "peak"), "mean (deg)"] > row["mean (deg)"]


def test_bands_hold_the_probabilities_of_refitted_inputs(tmp_path, monkeypatch):
    plan, points, settings = synthetic.make_campaign(tmp_path, n=14)
    path, width = build_results(tmp_path, plan, points, settings), []
    rough = (points["mu_s"] > points["mu_s"].median()).to_numpy(float)
    for refitted in (None, np.array([rough, 1 - rough]) / 7):
        monkeypatch.setattr(Results, "bootstrap_weights", lambda *_, w=refitted: w)
        frame = design_table(path, n_boot=30).set_index(["mu_iso", "state"])
        width.append((frame["mean (deg), to"] - frame["mean (deg), from"])[(0.04, "critical")])
    assert width[1] > 1.5 * width[0]
