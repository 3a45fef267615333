"""Friction angles: closed form, known quantiles, bands that hold them."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis.results.build import build_results
from analysis.results.reader import Results, read_results
from analysis.tables.friction_angles import friction_angle, friction_angle_table


def test_friction_angle_of_a_mohr_circle():
    for phi in (10.0, 25.0, 40.0):
        ratio = (1 + np.sin(np.radians(phi))) / (1 - np.sin(np.radians(phi)))
        eta = (ratio - 1) / ((ratio + 2) / 3)
        assert friction_angle(eta) == pytest.approx(phi)
    assert friction_angle([-4.0, 7.0]) == pytest.approx([-90.0, 90.0])


def test_characteristic_angles_of_known_points(tmp_path):
    plan, points, info = synthetic.make_campaign(tmp_path, n=14)
    results = read_results(build_results(tmp_path, plan, points, info))
    frame = friction_angle_table(results, n_boot=15).set_index(["mu_iso", "state"])
    assert len(frame) == 6
    order = np.argsort(points.mu_s)
    middle = np.cumsum(points.probability[order]) - 0.5 * points.probability[order]
    angle = friction_angle(synthetic.critical_eta(points.mu_s[order]))
    row = frame.loc[(0.04, "critical")]
    assert row["q05_points_deg"] == pytest.approx(np.interp(0.05, middle, angle), abs=0.1)
    for name in ("mean_deg", "q05_points_deg"):
        assert row[f"{name}_low"] < row[name] < row[f"{name}_high"]
    exact = friction_angle(synthetic.critical_eta(points.mu_s)) @ points.probability
    assert row["mean_deg"] == pytest.approx(exact, abs=0.05)
    assert frame.loc[(0.001, "peak"), "mean_deg"] > frame.loc[(0.1, "peak"), "mean_deg"] > row["mean_deg"]


def test_bands_hold_the_probabilities_of_refitted_inputs(tmp_path, monkeypatch):
    plan, points, info = synthetic.make_campaign(tmp_path, n=14)
    results, width = read_results(build_results(tmp_path, plan, points, info)), []
    rough = (points.mu_s > np.median(points.mu_s)).astype(float)
    for refitted in (None, np.array([rough, 1 - rough]) / 7):
        monkeypatch.setattr(Results, "bootstrap_probability", lambda *_, w=refitted: w)
        frame = friction_angle_table(results, n_boot=30).set_index(["mu_iso", "state"])
        width.append((frame["mean_deg_high"] - frame["mean_deg_low"])[(0.04, "critical")])
    assert width[1] > 1.5 * width[0]
