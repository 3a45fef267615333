"""Pooled points: shares of variance and Monte Carlo moments of responses that are known."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis.inputs.joint import Joint
from analysis.results.build import build_results
from analysis.results.reader import read_results
from analysis.tables.moment_bands import moment_bands
from analysis.tables.monte_carlo import monte_carlo_along, monte_carlo_check
from analysis.tables.variance_sources import variance_sources


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Sixteen noise-free points at one density."""
    folder = tmp_path_factory.mktemp("pooling")
    points = synthetic.representative_points(16)
    plan = synthetic.plan_rows(folder, points, densities=(0.04,))
    for row in plan.itertuples():
        synthetic.write_run(row, windows=40)
    return read_results(build_results(folder, plan, points, synthetic.campaign_info()))


def test_each_response_follows_its_own_property(results):
    frame = variance_sources(results).set_index(["state", "quantity"])
    for state, symbol in (("critical", "e"), ("critical", "eta"), ("probe", "G_0")):
        row = frame.loc[(state, symbol)]
        mine, other = ("only_G_p", "only_mu_s") if symbol == "G_0" else ("only_mu_s", "only_G_p")
        assert row[other] < 0.02 < 0.25 < row[mine] < 0.6
        assert row["shared"] == pytest.approx(1 - row[mine] - row[other] - row["noise"], abs=1e-9)
        assert row["noise"] < 0.01


def test_monte_carlo_gives_the_moments_of_the_closed_form(results):
    row = monte_carlo_check(results, power=14).set_index(["state", "quantity"]).loc[("probe", "G_0")]
    joint = Joint.from_dict(results.inputs["joint"])
    exact = 1e-6 * synthetic.stiffness(joint.sample(200_000, np.random.default_rng(1))[:, 1], 0.04)
    assert row["mean_mc"] == pytest.approx(exact.mean(), rel=0.02)
    assert row["q05_mc"] == pytest.approx(np.quantile(exact, 0.05), rel=0.02)
    assert row["q95_mc"] == pytest.approx(np.quantile(exact, 0.95), rel=0.02)
    points = results.family_points()
    stiffness = 1e-6 * synthetic.stiffness(points.G_p, 0.04)
    assert row["mean"] == pytest.approx(stiffness @ points.probability)


def test_noise_is_found(tmp_path):
    points = synthetic.representative_points(40)
    plan = synthetic.plan_rows(tmp_path, points, densities=(0.04,))
    plan = plan[plan["stage"] == "shear"]
    for row in plan.itertuples():
        synthetic.write_run(row, noise=0.1, windows=20)
    results = read_results(build_results(tmp_path, plan, points, synthetic.campaign_info()))
    frame = variance_sources(results).set_index(["state", "quantity"])
    exact = synthetic.critical_eta(points.mu_s)
    scatter = results.state("critical", "eta", 0.04) - exact
    assert frame.loc[("critical", "eta"), "noise"] == pytest.approx(
        scatter.var() / (scatter.var() + exact.var()), rel=0.5
    )
    assert frame.loc[("critical", "eta"), "noise"] > 0.1


def test_differences_are_those_of_the_moments_over_the_spread(results):
    row = monte_carlo_check(results, power=12).set_index(["state", "quantity"]).loc[("critical", "eta")]
    noisy = row["sd_mc_noise"]
    assert noisy >= row["sd_mc"]
    assert row["mean_diff"] == pytest.approx((row["mean"] - row["mean_mc"]) / noisy)
    assert row["sd_diff"] == pytest.approx(row["sd"] / noisy - 1)
    assert row["q95_diff"] == pytest.approx((row["q95"] - row["q95_mc"]) / noisy)


def test_densities_along_strain_come_close_to_monte_carlo(results):
    frame = monte_carlo_along(results, power=12).set_index("quantity")
    assert set(frame.index) == {"eta", "e", "e_m", "Z", "Z_m", "Phi_dev"}
    joint = Joint.from_dict(results.inputs["joint"])
    drawn = synthetic.critical_eta(joint.sample(100_000, np.random.default_rng(2))[:, 0])
    end = results.response("eta", 0.04)
    off = abs(end.mean[-1] - drawn.mean()) / drawn.std()
    assert frame.loc["eta", "mean"] > 0.8 * off  # the largest over strain is no less than that at the end
    assert (frame["W1_average"] <= frame["W1"]).all() and (frame["W1"] < 0.5).all()


def test_bands_hold_the_value_and_the_pairs_make_most_of_them_without_noise(results):
    frame = moment_bands(results, n_boot=60).set_index(["state", "quantity"])
    for name in ("mean", "sd"):
        assert ((frame[f"{name}_low"] < frame[name]) & (frame[name] < frame[f"{name}_high"])).all()
    row = frame.loc[("critical", "e")]
    assert row["runs_share"] < 0.05
    mean = synthetic.void_ratio(0.4, Joint.from_dict(results.inputs["joint"]).sample(
        100_000, np.random.default_rng(3))[:, 0], 0.04).mean()  # fmt: skip
    assert row["mean_low"] < mean < row["mean_high"]
    half = 0.5 * (row["mean_high"] - row["mean_low"])
    assert half == pytest.approx(1.96 * row["sd"] / np.sqrt(94), rel=0.3)
