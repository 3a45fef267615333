"""One chain of stages in LAMMPS, on a small packing: proofs, what the products hold, and what is refused."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import time
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import yade_runs
from lammps_stages import grains, needs_lmp, stage, started
from step_bound import largest_step

from analysis.errors_and_files import RunFileError
from analysis.micromechanics.metrics import snapshot_metrics
from analysis.micromechanics.stiffness import network_moduli
from analysis.runs.archive import run_summary
from analysis.runs.gate import check_product
from analysis.runs.run_file import Run, read_run, read_snapshot
from campaign.lammps import outputs, packing, protocol, stages
from campaign.lammps.__main__ import COMMON
from campaign.run_one import ENVIRONMENT

pytestmark = needs_lmp
N, MU_S, G_P = 120, 0.3, 35e9
FIRST = {"description": "consolidate_1", "assembly": "assembly.h5", "mu_iso": 0.04, "seed": 1}
PROBE = {"description": "probe_1", "start": "products/consolidate_1.h5", "mu_s": MU_S, "G_p": G_P}
SHEAR = PROBE | {"description": "shear_1", "start": "products/probe_1.h5", "inertial_number": 2.4e-3,
                 "strain_end": 0.03, "snapshots": "0.01"}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("chain")
    grains(place, N)
    for name, row in (("consolidate", FIRST), ("probe", PROBE), ("shear", SHEAR)):
        done = stage(name, place, row)
        assert done.returncode == 0, done.stdout + done.stderr
    return place


def run(folder: Path, name: str) -> Run:
    return read_run(folder / "products" / f"{name}_1.h5")


@pytest.mark.parametrize("name", ["consolidate", "probe", "shear"])
def test_products_pass_the_gate_and_say_who_made_them(folder, name):
    product = run(folder, name)
    check_product(product)
    assert product.attrs["code"] == "lammps" and product.attrs["yade_version"].startswith("LAMMPS ")
    assert product.timing["steps"] > 0 and product.timing["cpu_seconds"] > 0.0 and product.parameters["N"] == N


@pytest.mark.parametrize("name", ["consolidate", "probe", "shear"])
def test_the_script_stays_beside_the_product_and_runs_by_hand(folder, name):
    kept = folder / "products" / f"{name}_1.lammps"
    assert not {p.suffix for p in kept.iterdir()} - {".lammps", ".log", ".data", ".restart"}
    with h5py.File(folder / "products" / f"{name}_1.h5") as file:
        assert file["script"][()].decode().startswith((kept / "in.lammps").read_text())


def test_a_run_by_hand_ends_in_the_same_state(folder):
    kept = folder / "products" / "shear_1.lammps"
    log = (kept / "in.log").read_text()
    subprocess.run(["lmp", "-in", "in.lammps", "-screen", "none"], cwd=kept, check=True)
    by_hand = (kept / "log.lammps").read_text()
    assert [line for line in by_hand.splitlines() if line.startswith("STRESS end")] == [
        line for line in log.splitlines() if line.startswith("STRESS end")
    ]


def test_consolidation_ends_at_rest_under_sigma_3(folder):
    product, s = run(folder, "consolidate"), read_snapshot(run(folder, "consolidate"), "end")
    assert snapshot_metrics(s)["sigma"].diagonal() == pytest.approx(1e5, rel=0.005)
    assert product.proofs["F_unb"] < 1e-3 and product.record["Z"][-1] == pytest.approx(2.0 * len(s.normal) / N, abs=0.1)


def test_tangential_forces_and_grains_pass_from_the_probe_to_the_shear_run(folder):
    """A restart keeps the springs: what the shear run begins with is what the probe left, contact by contact."""
    left, found = (read_snapshot(run(folder, name), "start") for name in ("probe", "shear"))
    assert (left.contact_ids == found.contact_ids).all()
    assert np.abs(found.f_t - left.f_t).max() < 1e-9 * np.abs(left.f_n).max() < np.abs(left.f_t).max()
    assert found.overlap == pytest.approx(left.overlap, rel=1e-6)
    assert (np.linalg.norm(left.f_t, axis=1) <= MU_S * np.linalg.norm(left.f_n, axis=1) * (1 + 1e-9)).all()


@pytest.mark.parametrize("name, label", [("consolidate", "end"), ("probe", "start"), ("shear", "end")])
def test_contacts_are_hertz_with_the_moduli_of_the_run_and_without_forces_of_damping(folder, name, label):
    s = read_snapshot(run(folder, name), label)
    assert np.linalg.norm(s.f_n, axis=1) == pytest.approx(s.k_n * s.overlap / 1.5, rel=1e-6)
    assert s.k_t / s.k_n == pytest.approx(2.0 * (1.0 - 0.2) / (2.0 - 0.2))


def test_moduli_of_the_probe_are_those_of_its_contact_network(folder):
    product = run(folder, "probe")
    network = network_moduli(read_snapshot(product, "start"))
    assert product.probe["G_0"] == pytest.approx(network.G_0, rel=0.003)
    assert product.probe["K_0"] == pytest.approx(network.K_0, rel=0.003)
    assert product.proofs["G_0_asymmetry"] < 0.01


@pytest.mark.yade
def test_yade_finds_the_state_of_a_probe_at_rest_and_with_the_same_moduli(folder):
    """The law is the same to the last term: forces of all contacts, taken over by YADE, hold each other as they are."""
    row = {key: PROBE[key] for key in ("mu_s", "G_p")} | {"start": str(folder / "products" / "probe_1.h5")}
    done = yade_runs.scene_of_a_row("probe_taken_over", folder, description="taken_over", **row)
    assert done.returncode == 0, done.stdout + done.stderr
    here, there = run(folder, "probe"), read_run(folder / "taken_over.h5")
    assert there.proofs["stress_error"] < 1e-8
    for name in ("G_0", "G_0_minus", "K_0"):
        assert here.probe[name] == pytest.approx(there.probe[name], rel=1e-3)


@pytest.mark.parametrize("name", ["probe", "shear"])
def test_the_step_is_below_the_largest_stable_one(folder, name):
    product = run(folder, name)
    s = read_snapshot(product, "start" if name == "probe" else "end")
    mass = packing.masses(s.radius, product.parameters["rho"], balanced=True)
    largest = largest_step(s, mass, 0.4 * mass * s.radius**2)
    assert product.timing["dt_mean"] < (0.85 if name == "probe" else 0.95) * largest


def test_record_and_snapshots_of_a_shear_run_agree(folder):
    product = run(folder, "shear")
    first, last = read_snapshot(product, "start"), read_snapshot(product, "end")
    at_start = snapshot_metrics(first, MU_S)
    for symbol in ("e", "e_m", "Z", "Z_m", "Phi"):
        assert product.record[symbol][0] == pytest.approx(at_start[symbol], rel=1e-5), symbol
    assert [label for _, _, label in product.snapshots] == ["start", "strain", "end"]
    assert product.snapshots[1][1] == pytest.approx(0.01, abs=1e-3) and last.eps_a == pytest.approx(0.03, abs=1e-3)
    assert snapshot_metrics(last)["e"] == pytest.approx(product.record["e"][-1], rel=0.01)
    assert np.abs(product.record["servo_mean"][product.strain > 0.01]).max() < 0.002  # averaged over all steps


def test_what_lammps_cannot_give_is_marked_and_no_residual_passes_for_a_balance(folder, tmp_path):
    product = run(folder, "shear")
    assert np.isnan(product.record["E_friction"]).all() and np.isnan(product.proofs["energy_error"])
    assert product.attrs["not_given"] == "E_friction,energy_error" and product.record["E_residual"][-1] > 0.0
    assert np.isnan(run_summary(product).facts["energy_error"])
    for change, words in (
        (lambda file: file["proofs"].attrs.update(energy_error=0.01), "claims an energy balance"),
        (lambda file: file["proofs"].attrs.update(friction_residual=-0.2), "friction_residual = -0.2 is not within"),
        (lambda file: file.attrs.update(not_given="E_friction"), "claims an energy balance"),
        (lambda file: file.attrs.update(code="yade"), "energy_error"),
    ):
        path = tmp_path / "shear.h5"
        path.write_bytes(product.path.read_bytes())
        with h5py.File(path, "r+") as file:
            change(file)
        with pytest.raises(RunFileError, match=words):
            check_product(read_run(path))


def test_a_product_of_yade_is_no_start(folder):
    path = folder / "products" / "consolidate_2.h5"
    path.write_bytes((folder / "products" / "consolidate_1.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        del file.attrs["code"]
    done = stage("probe", folder, PROBE | {"description": "probe_2", "start": "products/consolidate_2.h5"})
    assert done.returncode == 1
    failure = json.loads((folder / "products" / "probe_2.failed.json").read_text())
    assert failure["reason"] == (
        "start products/consolidate_2.h5: was made by code = 'yade', and this run has code = 'lammps'"
    )


def test_another_poisson_ratio_is_led_to_at_constant_stress_and_is_no_state_at_rest(folder, tmp_path):
    """Contacts of G / (1 - nu) carry the same force, so that nothing jumps when a run takes on its own nu."""
    row = COMMON | PROBE | {"start": str(folder / "products" / "probe_1.h5"), "nu": 0.4}
    start, _, _ = protocol._begin(SimpleNamespace(**row), tmp_path)
    as_stiff = G_P * (1.0 - 0.4) / (1.0 - 0.2)
    assert math.isclose(start.G, as_stiff, rel_tol=1e-9) and not start.at_rest
    assert protocol._begin(SimpleNamespace(**row | {"nu": 0.2}), tmp_path)[0].at_rest


def test_a_grain_thrown_out_of_the_packing_is_a_blow_up(folder):
    """A real fault of LAMMPS: a time step far beyond the stable one."""
    done = stage("consolidate", folder, FIRST | {"description": "consolidate_3", "timestep_factor": 8.0})
    assert done.returncode == 1 and "failed: blow-up" in done.stderr


def test_a_killed_lmp_leaves_the_run_missing_and_it_starts_anew(folder):
    """Killed from outside in its work: no product, no failure file, and the next attempt runs it whole."""
    row = SHEAR | {"description": "shear_2", "strain_end": 0.4, "snapshots": ""}
    run = started("shear", folder, row)
    while not (children := lmp_of(run.pid)) and run.poll() is None:
        time.sleep(0.01)
    os.kill(children[0], signal.SIGKILL)
    said = run.communicate(timeout=60)[0]
    assert run.returncode == ENVIRONMENT and "LAMMPS was killed by signal 9 (SIGKILL)" in said
    assert not any((folder / "products" / f"shear_2.{ending}").exists() for ending in ("h5", "failed.json"))
    assert stage("shear", folder, row | {"strain_end": 0.02}, supervised=True).returncode == 0


def test_a_killed_run_over_mpi_leaves_no_process_and_no_shared_memory(folder):
    """The supervisor kills a run that hangs, and Linux then ends mpirun, which must end in order."""
    shared = set(Path("/dev/shm").glob("vader_segment*"))
    row = SHEAR | {"description": "shear_4", "strain_end": 0.4, "snapshots": ""}
    run = started("shear", folder, row, supervised=False, CAMPAIGN_RANKS="2")
    while len(ranks := lmp_of(run.pid)) < 2 and run.poll() is None:
        time.sleep(0.01)
    made = set()
    while not made and run.poll() is None:
        time.sleep(0.01)
        made = set(Path("/dev/shm").glob("vader_segment*")) - shared
    run.kill()
    run.wait()
    assert made and len(ranks) == 2
    for _ in range(3000):
        left = [pid for pid in ranks if Path(f"/proc/{pid}").exists()] + [path for path in made if path.exists()]
        if not left:
            break
        time.sleep(0.02)
    assert not left


def lmp_of(pid: int) -> list[int]:
    """Processes of LAMMPS below a process."""
    below = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    found = [int(child) for child in below if Path(f"/proc/{child}/comm").read_text().strip() == "lmp"]
    return found or [lmp for child in below for lmp in lmp_of(int(child))]


def test_a_cell_that_would_become_too_thin_is_refused_before_the_run(folder):
    done = stage("shear", folder, SHEAR | {"description": "shear_3", "strain_end": 1.5, "snapshots": ""})
    assert done.returncode == 1 and "thin cell: its height at strain_end = 1.5 is 0.000" in done.stderr


def test_probe_needs_its_increments(folder):
    with pytest.raises(outputs.LammpsError, match="no response shear in the log"):
        protocol._response("RESPONSE none 1 2 3 4 5 6", next(iter(stages.DIRECTIONS)))
