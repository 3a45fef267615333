"""Pooled points: shares of variance and Monte Carlo moments of responses that are known."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis.inputs.joint import Joint
from analysis.results.build import build_results
from analysis.results.reader import read_results
from analysis.tables.moments import AS_SIMULATED, DENOISED, moments
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
    assert row["q05_mc"] == pytest.approx(np.quantile(exact, 0.05), rel=0.04)  # continued beyond the sixteen points
    assert row["q95_mc"] == pytest.approx(np.quantile(exact, 0.95), rel=0.04)
    points = results.family_points()
    stiffness = 1e-6 * synthetic.stiffness(points.G_p, 0.04)
    assert row["mean"] == pytest.approx(stiffness @ points.probability)


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    """Forty points in ten packings at one density, 6 % noise."""
    folder = tmp_path_factory.mktemp("noisy")
    points = synthetic.representative_points(40)
    plan = synthetic.plan_rows(folder, points, densities=(0.04,), packings=tuple(range(1, 11)))
    plan = plan[plan["stage"] == "shear"]
    for row in plan.itertuples():
        synthetic.write_run(row, noise=0.06, windows=20)
    return read_results(build_results(folder, plan, points, synthetic.campaign_info()))


def test_noise_is_found(noisy):
    frame = variance_sources(noisy).set_index(["state", "quantity"])
    exact = synthetic.critical_eta(noisy.family_points().mu_s)
    scatter = noisy.state("critical", "eta", 0.04) - exact
    row = frame.loc[("critical", "eta")]
    share = scatter.var() / (scatter.var() + exact.var())
    assert row["noise"] == pytest.approx(share, rel=0.5) and row["noise"] > 0.05
    assert row["own_low"] < share < row["own_high"] and row["packing_low"] < 0.02  # packings differ in nothing here


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


def test_intervals_hold_the_value_and_the_pairs_make_most_of_them_without_noise(results):
    frame = moments(results).set_index(["kind", "state", "quantity"])
    for name in ("mean", "sd", "q05", "q50", "q95"):
        assert ((frame[f"{name}_low"] < frame[name]) & (frame[name] < frame[f"{name}_high"])).all()
    row = frame.loc[(DENOISED, "critical", "e")]
    assert row["runs_share"] < 0.05 and row["packings"] == 1
    exact = synthetic.void_ratio(0.4, Joint.from_dict(results.inputs["joint"]).sample(
        100_000, np.random.default_rng(3))[:, 0], 0.04)  # fmt: skip
    for name, value in (("mean", exact.mean()), ("sd", exact.std()), ("q05", np.quantile(exact, 0.05))):
        assert row[f"{name}_low"] < value < row[f"{name}_high"]
    half = 0.5 * (row["mean_high"] - row["mean_low"])
    assert half == pytest.approx(1.96 * row["sd"] / np.sqrt(94), rel=0.3)


def test_what_is_simulated_has_the_noise_that_the_denoised_does_not(noisy):
    """40 points in 10 packings with 6 % noise within a run and 3 % between runs."""
    frame = moments(noisy).set_index(["kind", "state", "quantity"])
    joint = Joint.from_dict(noisy.inputs["joint"])
    exact = synthetic.critical_eta(joint.sample(100_000, np.random.default_rng(3))[:, 0])
    denoised, simulated = (frame.loc[(kind, "critical", "eta")] for kind in (DENOISED, AS_SIMULATED))
    assert denoised["packings"] == 10 and denoised["mean"] == simulated["mean"]
    assert denoised["sd_low"] < exact.std() < denoised["sd_high"] and denoised["sd"] < simulated["sd"]
    scatter = noisy.state("critical", "eta", 0.04) - synthetic.critical_eta(noisy.family_points().mu_s)
    assert simulated["sd_low"] < np.hypot(exact.std(), scatter.std()) < simulated["sd_high"]
