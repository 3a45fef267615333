"""The input scripts for LAMMPS: law, servo, time step and grains, read back from their text."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import snapshots

from campaign.lammps import packing, scene, stages
from campaign.lammps.__main__ import COMMON

RHO = 2670.0


def parameters(**values):
    return SimpleNamespace(**COMMON | {"run_id": "run", "N": 108, "d_max": 0.25e-3} | values)


def start(**values):
    return stages.Start(**{"N": 108, "mass": 2e-8, "mu": 0.04, "G": 25.7e9, "height": 1e-3, "at_rest": True} | values)


def read_back(text: str) -> np.ndarray:
    """Columns of the grains of a data file: id, type, diameter, density, x, y, z."""
    return np.array([line.split() for line in text.split("Atoms # sphere\n")[1].split("\n") if line], float)


def test_data_file_has_the_packing_with_every_centre_in_the_cell():
    s = snapshots.lattice("fcc", 3, diameter=0.25e-3, p=1e5)
    away = np.random.default_rng(1).integers(-3, 4, (s.N, 3)) * np.diag(s.cell)
    edge, mass = packing.edges(s), packing.masses(s.radius, RHO, False)
    table = read_back(packing.data_file(s.position + away, s.radius, edge, mass))
    assert table[:, 3] == pytest.approx(RHO) and ((table[:, 4:] >= 0.0) & (table[:, 4:] <= edge)).all()
    ids, _ = snapshots.contacts(table[:, 4:], 0.5 * table[:, 2] * (1.0 + 1e-9), np.diag(edge))
    assert len(ids) == 6 * s.N


def test_balanced_masses_keep_their_sum_and_follow_the_stiffness():
    radius = np.array([1.0, 2.0, 4.0]) * 1e-4
    own, balanced = (packing.masses(radius, RHO, b) for b in (False, True))
    assert own == pytest.approx(RHO * 4.0 / 3.0 * np.pi * radius**3)
    assert balanced.sum() == pytest.approx(own.sum())
    assert balanced[1:] / balanced[:-1] == pytest.approx(2.0**1.35)
    density = read_back(packing.data_file(np.zeros((3, 3)), radius, np.ones(3), balanced))[:, 3]
    assert density * 4.0 / 3.0 * np.pi * radius**3 == pytest.approx(balanced)


def test_a_skew_cell_is_refused():
    s = snapshots.lattice("fcc", 2, p=1e5)
    with pytest.raises(ValueError, match="skew"):
        packing.edges(replace(s, cell=s.cell + 1e-6 * np.eye(3, k=1)))


def test_stable_step_of_a_lattice_has_the_closed_form():
    # Twelve contacts along face diagonals: a sphere is held by 4 k_n + 8 k_t on each axis and turned against 8 k_t r2.
    s = snapshots.lattice("fcc", 3, diameter=0.25e-3, p=1e5)
    mass = 4.0 / 3.0 * math.pi * s.radius**3 * RHO
    stiffest = max(4.0 * s.k_n[0] + 8.0 * s.k_t[0], 8.0 * s.k_t[0] / 0.4)
    assert packing.stable_step(s, mass) == pytest.approx(math.sqrt(2.0 * mass[0] / stiffest), rel=1e-9)


def test_shear_script_asks_for_the_law_the_rate_and_the_end():
    p = parameters(mu_s=0.25, inertial_number=2e-3, strain_end=0.3)
    script, dt = stages.shear(p, start(), "start.restart", 7e-8, [0.02])
    assert dt == pytest.approx(stages.STEP * 7e-8)
    laws = re.findall(r"hertz/material (\S+) (\S+) (\S+) tangential mindlin/force NULL \S+ (\S+)", script)
    assert [[float(x) for x in law] for law in laws] == [pytest.approx([2.0 * 25.7e9 * 1.2, 0.0, 0.2, 0.25])]
    rate = float(re.search(r"^variable asked_z equal -(\S+?)\*\(1\+f_servo", script, re.M)[1])
    assert rate * scene.inertial_time(p) == pytest.approx(2e-3)
    assert re.findall(r"halt \d+ v_eps_a >= (\S+)", script) == ["0.02", "0.3"]
    assert re.findall(r"^variable memory_(\w) equal .*-100000\)", script, re.M) == ["x", "y"]
    assert "remap x" not in script and script.count("remap v") == 1 and "pre no" not in script


def test_rate_of_rough_grains_is_limited_as_in_the_plan():
    p = parameters(mu_s=0.6, inertial_number=2.4e-3)
    assert stages.strain_rate(p) * scene.inertial_time(p) == pytest.approx(1.2e-3)


def test_a_run_that_does_not_start_from_its_own_probe_is_brought_to_rest_first():
    p = parameters(mu_s=0.25, G_p=50e9)
    script, _ = stages.shear(p, start(at_rest=False), "start.restart", 7e-8, [])
    assert "label stiffer" in script and script.index("label settled") < script.index("v_eps_a >=")
    friction = re.findall(r"mindlin/force NULL 1.0 (\S+) ", script)
    assert friction[0] == "0.04" and friction[-1] == "0.25"  # mu_iso while G_p is led to its value


@pytest.mark.parametrize(
    ("N", "windows", "rate"), [(400, "default", 2e-3), (23_312, "default", 2e-3), (400, 10_000, 1e-5)]
)
def test_lists_of_contacts_stay_below_a_gigabyte_however_long_the_run_and_fine_its_windows(N, windows, rate):
    p = parameters(mu_s=0.25, inertial_number=rate, strain_end=0.4, windows=windows)
    script, dt = stages.shear(p, replace(start(), N=N), "start.restart", 7e-8, [])
    every = int(re.search(r"^dump contacts all local (\d+)", script, re.M)[1])
    lists = p.strain_end / stages.strain_rate(p) / dt / every
    assert 80 < lists < 5e6 / N  # about 100 bytes a grain


def test_softer_grains_are_sheared_with_the_larger_step_that_they_allow():
    """The step at constant stress ~ G^(-1/3), taken once the modulus is there, with the damping of that modulus."""
    p = parameters(mu_s=0.25, stiffness_scale=1e-3)
    script, dt = stages.shear(p, start(at_rest=False), "start.restart", 7e-8, [])
    assert dt == pytest.approx(stages.STEP * 7e-8 * 10.0)
    steps = [float(step) for step in re.findall(r"^timestep (\S+)", script, re.M)]
    rest, sheared = stages.DAMPED_STEP, stages.STEP
    assert steps == pytest.approx([rest * 7e-8, rest * 7e-7, sheared * 7e-7])
    laws = [float(x) for x in re.findall(r"hertz/material \d\S* (\S+)", script)]
    soft = scene.damping(p, start().mass, p.G_p * 1e-3)
    assert laws[0] > 2.0 * soft and laws[-3:] == pytest.approx([soft, soft, 0.0], rel=1e-4)
    stiffer, dt = stages.shear(parameters(G_p=50e9), start(at_rest=False), "start.restart", 7e-8, [])
    assert dt < stages.STEP * 7e-8 and len(re.findall("^timestep ", stiffer, re.M)) == 2


def test_every_run_after_another_one_makes_its_lists_of_contacts_anew():
    p = parameters()
    for script in (
        stages.shear(p, start(), "s", 7e-8, [0.02, 0.1])[0],
        stages.consolidation(p, "grains.data", np.full(64, 2e-8), 7e-8),
        stages.probe(p, start(), "s", 7e-8)["in"],
    ):
        lines = script.splitlines()
        sampled = [k for k, line in enumerate(lines) if line.startswith("run ") and k > script.count("\n") * 0.3]
        reads_contacts = [k for k in sampled if lines[k - 1] == scene.NEW_LISTS]
        assert len(reads_contacts) >= 3


def test_servo_is_a_damped_oscillator():
    """The commands' own arithmetic on an elastic bar: sigma_3 returns with the period and damping it is tuned for."""
    p, dt = parameters(), 1e-9
    lines = scene.servo(p, p.G_p, dt, axial_rate=1e3)
    commands = dict(re.findall(r"^variable (\S+) equal (.+)$", lines, re.M))

    def value(name, **known):
        text = re.sub(r"(f_servo|c_sigma)\[1\]|v_", lambda m: m[1] or "", commands[name])
        return eval(text, {"abs": abs} | known)

    period, damping = scene.SERVO_PERIOD * scene.inertial_time(p), scene.SERVO_DAMPING
    stress, memory, errors = 110e3, 0.0, []
    for _ in range(round(1.5 * period / dt)):
        rate = value("asked_x", f_servo=memory, c_sigma=stress)
        memory = value("memory_x", f_servo=memory, c_sigma=stress)
        errors.append(stress - p.sigma_3)
        stress -= scene.modulus(p, p.G_p) * rate * dt
    crossings = np.flatnonzero(np.diff(np.sign(errors)))
    assert dt * (crossings[1] - crossings[0]) == pytest.approx(0.5 * period / math.sqrt(1.0 - damping**2), rel=0.01)
    lowest = np.argmin(errors)  # a damped oscillation falls by exp(-pi z / sqrt(1 - z2)) from one extreme to the next
    highest = lowest + np.argmax(errors[lowest:])
    fall = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    assert -errors[highest] / errors[lowest] == pytest.approx(fall, rel=0.02)


def test_a_held_axis_is_no_faster_than_its_limit():
    p = parameters()
    memory = re.search(r"^variable memory_x equal (.+)$", scene.servo(p, p.G_p, 1e-7), re.M)[1]
    text = memory.replace("f_servo[1]", "1e9").replace("c_sigma[1]", "1e9")
    assert eval(text) == pytest.approx(scene.MAX_RATE_I / scene.inertial_time(p))


def test_large_specimens_write_fewer_lists_of_contacts():
    assert [stages.contact_samples(N, 1600) for N in (64, 5000, 23312)] == [5, 5, 10]


def test_output_windows_are_those_of_the_scripts_of_yade():
    edges = stages.window_edges(0.4)
    assert edges[[0, 8, 9, 24, 25, -1]] == pytest.approx([0.001, 0.009, 0.01, 0.0475, 0.05, 0.4])
    assert len(edges) == 96 and stages.window_edges(0.2, 4) == pytest.approx([0.05, 0.1, 0.15, 0.2])


def test_no_damping_acts_in_the_snapshot_that_ends_a_consolidation():
    """A grain that still moves would have a tensile force of damping in a contact, and no mean stress of its own."""
    text = stages.consolidation(parameters(), "grains.data", np.full(64, 2e-8), 7e-8)
    law = text.split("dump grains_end")[0].rsplit("pair_coeff", 1)[1].split()
    assert law[:3] == ["*", "*", "hertz/material"] and float(law[4]) == 0.0
