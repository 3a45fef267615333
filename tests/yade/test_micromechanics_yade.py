"""Metrics and stiffness against YADE's own answers on the same packing; closed forms against a YADE probe."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import snapshots
from paths import SCENES

from analysis.assembly import make_assembly
from analysis.micromechanics import metrics as mm
from analysis.micromechanics.snapshot import Snapshot, check_snapshot
from analysis.micromechanics.stiffness import BULK, SHEAR, bulk_modulus, network_moduli, shear_modulus

pytestmark = pytest.mark.yade
G_P = 2e9


def run_scene(name: str, folder: Path, result: str, **arrays) -> Path:
    """Run one scene on the given arrays and return the path of what it wrote."""
    np.savez(folder / "given.npz", **arrays)
    files = [str(SCENES / name), str(folder / "given.npz"), str(folder / result)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "DISPLAY": ""}
    done = subprocess.run(
        ["/usr/bin/yade", "-n", "-x", "-j1", *files],
        cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (folder / result).is_file(), done.stdout[-2000:] + done.stderr[-2000:]
    return folder / result


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    a = make_assembly(250, 0.248e-3, 0.174, seed=1)
    given = {"position": a.position, "radius": a.radius, "edge": a.cell[0], "G_p": G_P, "d_eps": [SHEAR, BULK]}
    written = np.load(run_scene("random_packing.py", tmp_path_factory.mktemp("random"), "packing.npz", **given))
    s = Snapshot(**{name: written[name] for name in snapshots.SNAPSHOT_ARRAYS})
    return check_snapshot(s), written


def test_stress_is_yades(real):
    s, written = real
    sigma = mm.love_stress(s.branch, s.force, s.volume)
    assert np.abs(sigma + written["stress"]).max() < 1e-10 * np.abs(sigma).max()
    assert 5e4 < sigma[0, 0] < 0.9 * sigma[2, 2]


def test_fabric_and_coordination_are_yades(real):
    s, written = real
    assert np.abs(mm.fabric(s.normal) - written["fabric"]).max() < 1e-10
    c = mm.coordination(mm.contact_count(s.N, s.contact_ids))
    assert c.N_0 > 0 and pytest.approx(float(written["Z"]), rel=1e-10) == c.Z
    assert c.Z_m == pytest.approx(float(written["Z_m"]), rel=1e-10)


def test_particle_stresses_and_their_sum_are_yades(real):
    s, written = real
    particle = mm.particle_stress(s)
    assert np.abs(particle + written["particle_stress"]).max() < 1e-10 * np.abs(particle).max()
    summed = np.einsum("n,nij->ij", mm.sphere_volume(s.radius), particle) / s.volume
    assert np.abs(summed + written["stress"]).max() < 1e-10 * np.abs(summed).max()


def test_forces_are_consistent_with_the_contact_law(real):
    s, _ = real
    again = snapshots.hertzian(s.position, s.radius, s.cell, s.contact_ids, s.branch, G_p=G_P, nu=0.2, f_t=s.f_t)
    assert np.allclose(again.overlap, s.overlap, rtol=1e-6, atol=1e-12 * s.radius.max())
    assert np.allclose(again.f_n, s.f_n, rtol=1e-6, atol=1e-9 * np.abs(s.f_n).max())
    assert np.allclose(again.k_n, s.k_n, rtol=1e-6) and np.allclose(again.k_t, s.k_t, rtol=1e-6)


def test_network_solve_is_the_probe_of_the_running_packing(real):
    s, written = real
    network, affine = network_moduli(s), network_moduli(s, affine=True)
    # These soft grains have p' / G_0 = 0.01, the order of what the solve leaves out; bench_stiffness.py has stiff ones.
    assert pytest.approx(shear_modulus(written["responses"][0], SHEAR), rel=0.02) == network.G_0
    assert pytest.approx(bulk_modulus(written["responses"][1], BULK), rel=0.02) == network.K_0
    assert network.G_0 < 0.9 * affine.G_0


def probe(folder, p, G_p, nu=0.2):
    s = snapshots.lattice("fcc", 3, diameter=1e-3, p=p, G_p=G_p, nu=nu)
    given = {"position": s.position, "radius": s.radius[0], "edge": s.cell[0, 0], "G_p": G_p, "nu": nu, "strain": 1e-6}
    found = json.loads(run_scene("fcc_probe.py", folder, "fcc.json", **given).read_text())
    return s, found


def test_fcc_probe_has_the_closed_form(tmp_path):
    s, found = probe(tmp_path, 100e3, 25.7e9)
    expected = snapshots.closed_form_fcc(s.k_n[0], s.k_t[0], 1e-3)
    assert found["p"] == pytest.approx(100e3, rel=1e-6)
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=0.005), name


def test_fixed_network_stiffens_by_two_thirds_and_one_third(tmp_path):
    _, base = probe(tmp_path, 100e3, 25.7e9)
    _, stiff = probe(tmp_path, 100e3, 4 * 25.7e9)
    _, pressed = probe(tmp_path, 400e3, 25.7e9)
    for name in ("C44", "C_prime"):
        assert np.log(stiff[name] / base[name]) / np.log(4.0) == pytest.approx(2 / 3, abs=0.01)
        assert np.log(pressed[name] / base[name]) / np.log(4.0) == pytest.approx(1 / 3, abs=0.01)
