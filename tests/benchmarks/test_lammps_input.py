"""The packing and the law that go to LAMMPS, without running it."""

import math
import re
from dataclasses import replace

import lammps_input
import numpy as np
import pytest
import snapshots

SHEAR = lammps_input.Shear(0.25, 25.7e9, 0.2, 2670.0, 100e3, 0.248e-3, 2e-3, 0.4)


def read_back(text: str):
    """Positions, radii, densities and cell edges of a data file."""
    box = np.array([line.split()[:2] for line in text.splitlines() if line.endswith("hi")], float)
    rows = np.array([line.split() for line in text.split("Atoms # sphere\n\n")[1].splitlines()], float)
    return rows[:, 4:], rows[:, 2] / 2.0, rows[:, 3], box[:, 1] - box[:, 0]


def pairs(ids, branch, s):
    """Contacts as id pair and overlap, whatever their order."""
    overlap = s.radius[ids].sum(axis=1) - np.linalg.norm(branch, axis=1)
    relative = np.round(overlap / s.radius.mean(), 9)
    return {(*sorted(map(int, pair)), float(o)) for pair, o in zip(ids, relative, strict=True)}


def test_data_file_holds_the_same_contacts_though_grains_lie_outside_the_cell():
    s = snapshots.lattice("fcc", 3, diameter=0.25e-3, p=1e5)
    away = np.random.default_rng(1).integers(-3, 4, (s.N, 3)) * np.diag(s.cell)
    position, radius, density, edge = read_back(lammps_input.data_file(replace(s, position=s.position + away), 2670.0))
    assert ((position >= 0.0) & (position <= edge)).all() and (density == 2670.0).all()
    ids, branch = snapshots.contacts(position, radius * (1.0 + 1e-9), np.diag(edge))
    assert len(ids) == 6 * s.N
    assert pairs(ids, branch, s) == pairs(s.contact_ids, s.branch, s)


def test_a_skew_cell_is_refused():
    s = snapshots.lattice("fcc", 2, p=1e5)
    with pytest.raises(ValueError, match="skew"):
        lammps_input.data_file(replace(s, cell=s.cell + 1e-6 * np.eye(3, k=1)), 2670.0)


def test_stable_step_of_a_lattice_has_the_closed_form():
    # Twelve contacts along face diagonals: a sphere is held by 4 k_n + 8 k_t on each axis and turned against 8 k_t r2.
    s = snapshots.lattice("fcc", 3, diameter=0.25e-3, p=1e5)
    mass = 4.0 / 3.0 * math.pi * s.radius[0] ** 3 * 2670.0
    stiffest = max(4.0 * s.k_n[0] + 8.0 * s.k_t[0], 8.0 * s.k_t[0] / 0.4)
    assert lammps_input.stable_step(s, 2670.0) == pytest.approx(math.sqrt(2.0 * mass / stiffest), rel=1e-9)


def test_script_asks_for_the_same_law_path_and_end():
    s = snapshots.lattice("fcc", 3, diameter=0.25e-3, p=1e5)
    script = lammps_input.shear_script(s, SHEAR, 4e8, 7e-8)
    rest, sheared = re.findall(r"hertz/material (\S+) (\S+) (\S+) tangential mindlin/force NULL \S+ (\S+)", script)
    assert float(rest[1]) > 0.0 and float(sheared[1]) == 0.0  # damping while it comes to rest, none in shear
    for law in (rest, sheared):
        assert [float(law[k]) for k in (0, 2, 3)] == pytest.approx([2.0 * 25.7e9 * 1.2, 0.2, 0.25])
    rates = re.findall(r"^variable rate_z equal -(\S+?)\*\(1\+f_servo", script, re.M)
    assert float(rates[0]) * SHEAR.d50 * math.sqrt(2670.0 / 100e3) == pytest.approx(2e-3) and len(rates) == 1
    assert "v_eps_a >= 0.4 " in script
    held = re.findall(r"^variable error_(\w) equal \(c_sigma\[(\d)\]-(\S+?)\)", script, re.M)
    rest_axes = ["x1100000", "y2100000", "z3100000"]
    assert ["".join(h) for h in held] == [*rest_axes, *rest_axes[:2]]


def test_servo_is_a_damped_oscillator():
    """The commands' own arithmetic on an elastic bar: sigma_3 returns with the period and damping it is tuned for."""
    modulus, dt = 4e8, 1e-9
    lines = lammps_input.servo(SHEAR, modulus, ("x", "y"))
    commands = dict(re.findall(r"^variable (\S+) equal (.+)$", lines, re.M))

    def value(name, **known):
        return eval(re.sub(r"(f_servo|c_sigma)\[1\]|v_", lambda m: m[1] or "", commands[name]), known)

    period, damping = lammps_input.SERVO_PERIOD * SHEAR.inertial_time, lammps_input.SERVO_DAMPING
    stress, memory, errors = 110e3, 0.0, []
    for _ in range(round(1.5 * period / dt)):
        error = value("error_x", c_sigma=stress)
        rate = value("rate_x", f_servo=memory, error_x=error)
        memory = value("memory_x", f_servo=memory, dt=dt, error_x=error)
        stress -= modulus * rate * dt
        errors.append(error)
    crossings = np.flatnonzero(np.diff(np.sign(errors)))
    assert dt * (crossings[1] - crossings[0]) == pytest.approx(0.5 * period / math.sqrt(1.0 - damping**2), rel=0.01)
    lowest = np.argmin(errors)  # a damped oscillation falls by exp(-pi z / sqrt(1 - z2)) from one extreme to the next
    highest = lowest + np.argmax(errors[lowest:])
    fall = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    assert -errors[highest] / errors[lowest] == pytest.approx(fall, rel=0.02)
