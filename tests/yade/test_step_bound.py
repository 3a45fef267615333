"""The time step in use beside the largest stable one, 2 / omega_max of the contact network, rotations included."""

from __future__ import annotations

import numpy as np
import pytest
import snapshots
import yade_runs
from step_bound import SHEAR, STEPPER_FACTOR, balanced_inertia, largest_step, own_inertia, stepper_step

from analysis.runs.run_file import read_run, read_snapshot

LEAST_MARGIN = 1.1
RHO = 2670.0


def test_a_lattice_has_the_closed_forms():
    """Equal spheres, face-centred cubic: every grain meets 4 k_n + 8 k_t along an axis and 8 k_t r^2 about it.

    With their own inertia the rotation decides, and the motion in which all grains turn the same way reaches the bound
    of a single grain: omega^2 = 2 K / I, up to the overlap.  Balanced, the stepper is 1.22 times too careful.
    """
    s = snapshots.lattice("fcc", 3, 0.248e-3, p=100e3)
    k_n, k_t, r = s.k_n[0], s.k_t[0], s.radius[0]
    mass, moment = own_inertia(s.radius, RHO)
    arm = r - 0.5 * s.overlap[0]
    turning = 2.0 / np.sqrt(2.0 * 8.0 * k_t * arm**2 / moment[0])
    assert largest_step(s, mass, moment) == pytest.approx(turning, rel=1e-9)
    assert stepper_step(s, mass, moment) == pytest.approx(STEPPER_FACTOR * np.sqrt(moment[0] / (8 * k_t)) / r, rel=1e-9)
    assert largest_step(s, mass, moment) / stepper_step(s, mass, moment) == pytest.approx(1.0028, abs=1e-4)
    mass, moment = balanced_inertia(s.radius, RHO)
    held = STEPPER_FACTOR * np.sqrt(mass[0] / (4 * k_n + 8 * k_t))
    assert stepper_step(s, mass, moment) == pytest.approx(held, rel=1e-9)
    assert largest_step(s, mass, moment) / stepper_step(s, mass, moment) == pytest.approx(1.216, abs=1e-3)


def test_largest_step_is_that_of_all_eigenvalues():
    """A small random network, by its dense matrix: a column of the stiffness is the force that a unit motion causes."""
    s = snapshots.random_network(N=40, seed=2)
    mass, moment = balanced_inertia(s.radius, RHO)
    i, j = s.contact_ids.T
    K = np.zeros((6 * s.N, 6 * s.N))
    for motion in range(6 * s.N):
        u, turn = np.eye(6 * s.N)[motion].reshape(2, s.N, 3)
        arms = [(s.radius[k] - 0.5 * s.overlap)[:, None] * s.normal for k in (i, j)]
        relative = u[j] - u[i] - np.cross(turn[i], arms[0]) - np.cross(turn[j], arms[1])
        along = np.sum(relative * s.normal, axis=1)[:, None] * s.normal
        force = s.k_n[:, None] * along + s.k_t[:, None] * (relative - along)  # pulls the second grain back
        back, torque = np.zeros((s.N, 3)), np.zeros((s.N, 3))
        for grain, sign, arm in ((i, -1.0, arms[0]), (j, 1.0, arms[1])):
            np.add.at(back, grain, sign * force)
            np.add.at(torque, grain, -np.cross(arm, force))
        K[:, motion] = np.concatenate([back.ravel(), torque.ravel()])
    assert np.abs(K - K.T).max() < 1e-9 * np.abs(K).max()
    root = np.concatenate([np.repeat(mass, 3), np.repeat(moment, 3)]) ** -0.5
    omega = np.sqrt(np.linalg.eigvalsh(root[:, None] * K * root).max())
    assert largest_step(s, mass, moment) == pytest.approx(2.0 / omega, rel=1e-9)


def test_the_step_in_use_is_well_below_the_bound_in_a_sheared_packing():
    """The snapshots of the example run of the laptop campaign, 1,000 spheres to 40 % strain: 1.18 to 1.29."""
    run = read_run(SHEAR)
    assert run.parameters["density_scaling"] == 1 and run.parameters["timestep_factor"] == 1.0
    margins = []
    for k in range(1, 9):
        s = read_snapshot(run, k)
        inertia = balanced_inertia(s.radius, run.parameters["rho"])
        margins.append(largest_step(s, *inertia) / stepper_step(s, *inertia))
    assert min(margins) > LEAST_MARGIN and max(margins) < 1.4


@pytest.mark.yade
def test_yade_takes_the_step_that_is_compared_with_the_bound():
    """The step that a shear run is integrated with is `stepper_step`, to the last digits, and its inertia is known."""
    rows = yade_runs.scene("step_bound")
    assert len(rows) == 2
    for row in rows:
        assert row["inertia_error"] < 1e-12
        assert row["dt"] == pytest.approx(row["stepper"], rel=1e-12)
        assert row["largest"] / row["dt"] > LEAST_MARGIN
