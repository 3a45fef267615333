"""M-PDEM: marginals come back, correlation is the points', conditional means follow the dependence."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import bivariate_normal, golden_normals

from analysis.pdem import evolution, joint_pdf


@pytest.fixture()
def points():
    rng = np.random.default_rng(3)
    one = rng.normal(size=80)
    return one, 0.8 * one + 0.6 * rng.normal(size=80), rng.dirichlet(np.full(80, 4.0))


def test_marginals_are_pdems_own(points):
    one, two, probability = points
    joint = joint_pdf.joint_pdf(one, two, probability)
    width = joint.second.bandwidth[0]
    alone = evolution.state_pdf(two, probability, cells=200, bandwidth=width, keep_spread=True)
    assert np.max(np.abs(joint.marginal(0) - joint.first.p[0])) < 1e-10
    assert np.max(np.abs(joint.marginal(1) - alone.p[0])) < 1e-10
    assert joint.p.sum() * joint.first.dx[0] * joint.second.dx[0] == pytest.approx(1, abs=1e-10)


@pytest.mark.parametrize("keep_spread", [True, False])
def test_shown_correlation_is_diluted_as_predicted(points, keep_spread):
    joint = joint_pdf.joint_pdf(*points, cells=400, keep_spread=keep_spread)
    mass = joint.p * joint.first.dx[0] * joint.second.dx[0]
    m1, m2 = mass.sum(axis=1) @ joint.x1, mass.sum(axis=0) @ joint.x2
    s1 = np.sqrt(mass.sum(axis=1) @ (joint.x1 - m1) ** 2)
    s2 = np.sqrt(mass.sum(axis=0) @ (joint.x2 - m2) ** 2)
    shown = (joint.x1 - m1) @ mass @ (joint.x2 - m2) / (s1 * s2)
    assert shown == pytest.approx(joint.diluted_correlation, abs=1e-3)
    assert (s1 == pytest.approx(joint.first.std[0], rel=0.02)) == keep_spread
    assert abs(joint.correlation) > abs(joint.diluted_correlation)


def test_conditional_mean_of_a_straight_line_is_the_line(points):
    one, _, probability = points
    joint = joint_pdf.joint_pdf(one, 3 - 2 * one, probability)
    assert joint.conditional_mean([-1.0, 0.5]) == pytest.approx([5.0, 2.0], abs=1e-3)
    assert joint.correlation == pytest.approx(-1) and joint.rank_correlation == pytest.approx(-1)


def test_independence_has_no_mutual_information():
    one, two = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 12), np.linspace(0, 5, 9)))
    joint = joint_pdf.joint_pdf(one, two, np.full(108, 1 / 108))
    assert abs(joint.correlation) < 1e-12 and abs(joint.mutual_information) < 1e-10


def test_a_point_missing_in_one_response_is_lost_to_both(points):
    one, two, probability = points
    one = one.copy()
    one[5] = np.nan
    joint = joint_pdf.joint_pdf(one, two, probability)
    assert joint.lost_probability == pytest.approx(probability[5])
    assert joint.second.mean[0] == pytest.approx(np.delete(two, 5) @ np.delete(probability, 5) / (1 - probability[5]))


def test_linear_gaussian_pair_is_the_bivariate_normal():
    rho, z = -0.738, golden_normals(200)
    one, two = z[:, 0], rho * z[:, 0] + np.sqrt(1 - rho**2) * z[:, 1]
    joint = joint_pdf.joint_pdf(one, two, np.full(200, 1 / 200))
    assert joint.correlation == pytest.approx(rho, abs=0.02)
    cell = joint.first.dx[0] * joint.second.dx[0]
    assert np.abs(joint.p - bivariate_normal(joint.x1, joint.x2, rho)).sum() * cell < 0.1
    assert joint.mutual_information == pytest.approx(-0.5 * np.log(1 - rho**2), rel=0.15)
