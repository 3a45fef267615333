"""Friction angles: closed form, known quantiles, bands that hold them."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis.inputs.joint import Joint
from analysis.results.build import build_results
from analysis.results.friction_angle import friction_angle
from analysis.results.reader import read_results
from analysis.tables.friction_angles import friction_angle_table


def test_friction_angle_of_a_mohr_circle():
    for phi in (10.0, 25.0, 40.0):
        ratio = (1 + np.sin(np.radians(phi))) / (1 - np.sin(np.radians(phi)))
        eta = (ratio - 1) / ((ratio + 2) / 3)
        assert friction_angle(eta) == pytest.approx(phi)
    assert friction_angle([-4.0, 7.0]) == pytest.approx([-90.0, 90.0])


def test_angles_of_known_points(tmp_path):
    plan, points, info = synthetic.make_campaign(tmp_path, n=14)
    results = read_results(build_results(tmp_path, plan, points, info))
    frame = friction_angle_table(results).set_index(["mu_iso", "state", "kind"])
    assert len(frame) == 12
    row = frame.loc[(0.04, "critical", "denoised")]
    joint = Joint.from_dict(results.inputs["joint"])
    exact = friction_angle(synthetic.critical_eta(joint.sample(100_000, np.random.default_rng(1))[:, 0]))
    assert row["q05_deg"] == pytest.approx(np.quantile(exact, 0.05), abs=0.15)
    for name, value in (("mean_deg", exact.mean()), ("sd_deg", exact.std()), ("q95_deg", np.quantile(exact, 0.95))):
        assert row[f"{name}_low"] < row[name] < row[f"{name}_high"]
        assert row[f"{name}_low"] < value < row[f"{name}_high"]
    mean = frame["mean_deg"].xs("denoised", level="kind")
    assert mean[(0.001, "peak")] > mean[(0.1, "peak")] > row["mean_deg"]


def test_few_runs_have_no_angles():
    frame = friction_angle_table(read_results(synthetic.example()))
    assert len(frame) == 12 and frame["mean_deg"].isna().all() and (frame["points"] == 5).all()
