"""Responses along friction: closed forms found again, densities told apart only where they are."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis import friction_effect
from analysis.figures import friction
from analysis.report_text import density_at_a_friction
from analysis.responses import build_results
from analysis.results import read_results


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Twenty points, replicate packings at all of them, 2 % noise."""
    folder = tmp_path_factory.mktemp("friction")
    plan, points, settings = synthetic.make_campaign(folder, n=20, noise=0.02, packings=(1, 2, 3))
    return read_results(build_results(folder, plan, points, settings))


def test_the_critical_stress_ratio_is_its_closed_form_within_the_interval(campaign):
    frame = friction_effect.friction_table(campaign)
    frame = frame[(frame["state"] == "critical") & (frame["quantity"] == "eta")]
    assert len(frame) >= 9 and set(frame["mu_iso"]) == set(synthetic.DENSITIES)
    off = (frame["value"] - synthetic.critical_eta(frame["mu_s"])).abs()
    assert np.all(off < 1.5 * frame["half width"]) and np.all(frame["half width"] < 0.05 * frame["value"])


def test_densities_differ_at_the_peak_and_not_at_the_critical_state(campaign):
    """The mean over the densities is the same at every friction, and so is the sum of what they differ by: zero."""
    frame = friction_effect.friction_table(campaign)
    eta = frame[frame["quantity"] == "eta"].set_index(["state", "mu_s", "mu_iso"])
    assert eta["difference"].groupby(["state", "mu_s"]).sum().to_numpy() == pytest.approx(0, abs=1e-12)
    extreme = eta.loc["peak"].query("mu_iso in (0.001, 0.1)")
    assert set(extreme["differs"]) == {"yes"}
    assert (eta.loc["critical"]["differs"] == "yes").mean() < 0.2
    assert "of " in density_at_a_friction(eta.loc["critical"].reset_index())


def test_the_modulus_is_that_of_the_points_of_that_friction(campaign):
    points = campaign.family_points()
    modulus = friction_effect.ridge(campaign, points["mu_s"].to_numpy())
    assert np.log(modulus / points["G_p"]) @ points["probability"] == pytest.approx(0, abs=1e-9)


def test_few_points_and_one_density_make_no_false_table(tmp_path):
    assert not len(friction_effect.friction_table(synthetic.example()))
    plan, points, settings = synthetic.make_campaign(tmp_path, n=12)
    plan = plan[plan["mu_iso"] == 0.04]
    alone = read_results(build_results(tmp_path, plan, points, settings))
    frame = friction_effect.friction_table(alone)
    assert len(frame) and set(frame["differs"]) == {""}
    assert "cannot be told" in density_at_a_friction(frame)
    assert len(friction.along(alone).axes) == 4
