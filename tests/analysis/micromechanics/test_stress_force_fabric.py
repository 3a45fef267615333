"""The decomposition gives back anisotropies that were put in, and predicts the stress ratio they make."""

from dataclasses import replace

import numpy as np
import pytest
import snapshots

from analysis.micromechanics import stress_force_fabric as sff
from analysis.micromechanics.metrics import love_stress, mean_and_deviator
from analysis.micromechanics.snapshot import Snapshot

C = 40000


def contacts_with(a_c, a_n, a_t, a_b=0.0, turn=None):
    """Contacts whose directions, forces and branches follow the expansions exactly, axis z turned by `turn`.

    A scalar a belongs to the tensor a diag(-1, -1, 2) / 3, major minus minor value.
    """
    a_c, a_n, a_t, a_b = (a / 1.5 for a in (a_c, a_n, a_t, a_b))
    turn = np.eye(3) if turn is None else turn
    n = snapshots.directed_contacts(C, a_c)
    along = 0.5 * (3.0 * n[:, 2] ** 2 - 1.0)
    axis = np.diag([-0.5, -0.5, 1.0])
    f_n = (1.0 + a_n * along)[:, None] * n
    f_t = a_t * (n @ axis - along[:, None] * n)
    branch = (1.0 + a_b * along)[:, None] * n
    one, ids = np.ones(C), np.tile([[0, 1]], (C, 1))
    n, f_n, f_t, branch = (v @ turn.T for v in (n, f_n, f_t, branch))
    return Snapshot(np.zeros((2, 3)), np.ones(2), 10 * np.eye(3), ids, n, branch, 0 * one, f_n, f_t, one, one)


@pytest.mark.parametrize("values", [(0.3, 0.5, 0.2, 0.05), (0.0, 0.4, 0.0, 0.0), (0.6, -0.2, 0.3, -0.1)])
def test_anisotropies_come_back(values):
    split = sff.stress_force_fabric(contacts_with(*values))
    assert (split.a_c, split.a_n, split.a_t, split.a_b) == pytest.approx(values, abs=2e-3)
    assert split.eta_predicted == pytest.approx(split.eta, rel=1e-3)
    assert split.eta_linear == pytest.approx(0.4 * (values[0] + values[1] + 1.5 * values[2]), abs=2e-3)


def test_prediction_is_exact_for_any_contact_directions():
    rng = np.random.default_rng(1)
    n = rng.normal(size=(500, 3)) * [1.0, 0.5, 2.0] + [0.3, 0.0, 0.0]
    n /= np.linalg.norm(n, axis=1)[:, None]
    A, T = (sff.deviator(rng.normal(scale=0.2, size=(3, 3))) for _ in range(2))
    f_n = (1.0 + np.einsum("ci,ij,cj->c", n, A, n))[:, None] * n
    f_t = n @ T - np.einsum("ci,ij,cj->c", n, T, n)[:, None] * n
    one = np.ones(500)
    s = Snapshot(np.zeros((2, 3)), one[:2], np.eye(3), np.tile([[0, 1]], (500, 1)), n, n, one, f_n, f_t, one, one)
    split = sff.stress_force_fabric(s)
    assert split.eta_predicted == pytest.approx(split.eta, rel=1e-10)
    assert abs(split.eta_linear / split.eta - 1.0) > 0.01


def test_linear_formula_is_the_limit_of_small_anisotropy():
    split = sff.stress_force_fabric(contacts_with(0.01, 0.02, 0.01))
    assert split.eta == pytest.approx(0.4 * (0.01 + 0.02 + 0.015), rel=0.02)


def test_axis_of_loading_may_point_anywhere():
    Q, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    Q *= np.sign(np.linalg.det(Q))
    one, other = contacts_with(0.3, 0.5, 0.2), contacts_with(0.3, 0.5, 0.2, turn=Q)
    a, b = sff.stress_force_fabric(one), sff.stress_force_fabric(other, Q[:, 2])
    assert (a.a_c, a.a_n, a.a_t, a.eta_predicted) == pytest.approx((b.a_c, b.a_n, b.a_t, b.eta_predicted), rel=1e-9)


def test_extension_counts_against_the_axis_but_for_its_own_stress():
    split = sff.stress_force_fabric(contacts_with(-0.3, -0.3, -0.1))
    assert min(split.a_c, split.a_n, split.a_t) > 0.0 > split.eta
    assert split.eta_predicted == pytest.approx(split.eta, rel=2e-3)


def test_directions_average_polynomials_exactly():
    n, w = sff.directions()
    assert np.sum(w) == pytest.approx(1.0, abs=1e-14)
    assert np.einsum("k,ki,kj->ij", w, n, n) == pytest.approx(np.eye(3) / 3, abs=1e-14)
    assert np.sum(w * n[:, 0] ** 4 * n[:, 1] ** 2) == pytest.approx(1 / 35, abs=1e-14)
    assert np.sum(w * n[:, 2] ** 8) == pytest.approx(1 / 9, abs=1e-14)


def test_tangential_force_alone_carries_six_tenths_of_its_anisotropy():
    s = contacts_with(0.0, 0.0, 0.3)
    p, q = mean_and_deviator(love_stress(s.branch, s.force, s.volume))
    assert q / p == pytest.approx(0.6 * 0.3, rel=1e-3)
    bare = sff.stress_force_fabric(replace(s, f_t=0.0 * s.f_t))
    assert bare.eta == pytest.approx(0.0, abs=1e-3) and abs(bare.a_t) < 1e-12
