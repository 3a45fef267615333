"""The three stages in a real YADE, on a packing small enough for a test: what they prove, repeat and refuse."""

import json
import pickle
import re
import shutil

import h5py
import numpy as np
import pytest
import start_of_shear
import yade_runs

from analysis.assembly import SHORTEST_EDGE, make_assembly, write_assembly
from analysis.micromechanics import metrics
from analysis.runs.peak_critical import deviator_stress, stress_ratio
from analysis.runs.run_file import ENDING, read_run, read_snapshot

pytestmark = pytest.mark.yade
MU_S, G_P = 0.3, 20e9
SHEAR = {
    "start": "probe.h5",
    "mu_s": MU_S,
    "G_p": G_P,
    "inertial_number": 2.4e-3,
    "timestep_factor": 1.0,
    "strain_end": 0.02,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the chain consolidate, probe, shear has run, 100 spheres, to 2 % strain."""
    path = tmp_path_factory.mktemp("stages")
    write_assembly(path / "assembly.h5", make_assembly(100, 0.248e-3, 0.174, seed=3))
    for name, row in (
        ("consolidate", {"assembly": "assembly.h5", "mu_iso": 0.04, "G_p": 25.7e9}),
        ("probe", {"start": "consolidate.h5", "mu_s": MU_S, "G_p": G_P}),
        ("shear", SHEAR | {"snapshots": "0.01"}),
    ):
        done = yade_runs.stage(name, path, description=name, **row)
        assert done.returncode == 0, done.stdout + done.stderr
    return path


def test_consolidation_is_in_equilibrium_at_the_stress_asked_for(folder):
    run = read_run(folder / "consolidate.h5")
    assert run.proofs["stress_error"] < 0.005 and run.proofs["F_unb"] < 1e-3 and run.proofs["overshoot"] < 0.02
    np.testing.assert_allclose(np.diag(run.record["sigma"][-1]), 100e3, rtol=0.005)
    assert run.parameters["mu_iso"] == 0.04 and run.parameters["N"] == 100


def test_swap_reached_material_and_contacts(folder):
    """The shear run's contacts carry the friction and stiffness of its own point, not of the consolidation."""
    snapshot = read_snapshot(folder / "shear.h5", -1)
    radius, ids = snapshot.radius, snapshot.contact_ids
    R = radius[ids].prod(axis=1) / radius[ids].sum(axis=1)
    mindlin = 8.0 * G_P / (2.0 * (2.0 - 0.2)) * np.sqrt(R * snapshot.overlap)
    np.testing.assert_allclose(snapshot.k_t, mindlin, rtol=1e-9)
    mobilised = np.linalg.norm(snapshot.f_t, axis=1) / np.linalg.norm(snapshot.f_n, axis=1)
    assert mobilised.max() == pytest.approx(MU_S, rel=1e-9)


def test_record_agrees_with_the_snapshots(folder):
    """What the run recorded in YADE is what `analysis` computes from the particles alone."""
    run = read_run(folder / "shear.h5")
    start = metrics.snapshot_metrics(read_snapshot(run, 0))
    for symbol in ("e", "e_m", "Z", "Z_m"):
        assert run.record[symbol][0] == pytest.approx(start[symbol], rel=1e-10), symbol
    np.testing.assert_allclose(run.record["Phi"][0], start["Phi"], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run.record["sigma"][0], 0.5 * (start["sigma"] + start["sigma"].T), rtol=1e-9, atol=1e-3)


def test_balanced_inertia_takes_larger_steps_to_the_same_stiffness(folder):
    """The static answer does not know the grains' inertia; the step does."""
    row = {"start": "consolidate.h5", "mu_s": MU_S, "G_p": G_P, "density_scaling": 0}
    done = yade_runs.stage("probe", folder, description="own_inertia", **row)
    assert done.returncode == 0, done.stderr
    balanced, own = read_run(folder / "probe.h5"), read_run(folder / "own_inertia.h5")
    for name in ("G_0", "K_0"):
        assert balanced.probe[name] == pytest.approx(own.probe[name], rel=0.01), name
    assert balanced.timing["dt_mean"] > 1.5 * own.timing["dt_mean"]


def test_high_friction_is_sheared_slower(folder):
    rough = {"mu_s": 2 * MU_S, "G_p": G_P}
    for stage, name, row in (
        ("probe", "rough_rest", {"start": "consolidate.h5"} | rough),
        ("shear", "rough", SHEAR | rough | {"start": "rough_rest.h5", "strain_end": 0.005}),
    ):
        done = yade_runs.stage(stage, folder, description=name, **row)
        assert done.returncode == 0, done.stderr
    rough, usual = (read_run(folder / name).record["I"][1:4] for name in ("rough.h5", "shear.h5"))
    assert rough / SHEAR["inertial_number"] == pytest.approx(0.3 / (2 * MU_S), rel=0.1)
    assert usual / SHEAR["inertial_number"] == pytest.approx(1.0, rel=0.1)


def test_shear_proves_servo_rate_and_energy(folder):
    run = read_run(folder / "shear.h5")
    late = run.record["eps_a"] > 0.01
    assert np.abs(run.record["servo_mean"][late]).max() < 0.01
    assert run.record["servo_max"][late].max() < 0.05
    assert run.record["I"].max() < 2.5e-3
    assert run.proofs["energy_error"] < 0.01
    eta = stress_ratio(run.record["sigma"])
    assert abs(eta[0]) < 0.01 and 0.4 < eta[-1] < 1.4
    np.testing.assert_allclose(run.record["eps_a"][-1], 0.02, atol=0.002)


def test_the_deviatoric_stress_does_not_fall_when_the_servo_takes_over(folder):
    """Sampled every tenth step from the first one on, where the record of a campaign has means over 0.1 % strain."""
    fine = SHEAR | {"strain_end": 2e-3, "windows": 16}
    done = yade_runs.stage("shear", folder, description="fine", **fine)
    assert done.returncode == 0, done.stderr
    run = read_run(folder / "fine.h5")
    eps_a, q = run.record["eps_a"], deviator_stress(run.record["sigma"]) / 100e3
    lowest, scatter = start_of_shear.lowest_and_scatter(eps_a, q)
    print(
        f"first sample at a strain of {eps_a[1]:.2g}: lowest q - q at rest {lowest:.3f} sigma_3, scatter {scatter:.3f}"
    )
    assert eps_a[1] < 2.5e-4 and not start_of_shear.falls(eps_a, q)


def test_energies_are_summed_only_as_far_as_asked(folder):
    """They cost time and change nothing: all else of the record stays as it is, to the last bit."""
    done = yade_runs.stage("shear", folder, description="spared", **SHEAR | {"energy_strain": 0.01})
    assert done.returncode == 0, done.stderr
    whole, spared = read_run(folder / "shear.h5"), read_run(folder / "spared.h5")
    summed = whole.record["eps_a"] < 0.0102
    for symbol, values in whole.record.items():
        if symbol in ENDING:
            assert np.array_equal(values[summed], spared.record[symbol][summed]), symbol
            assert np.isnan(spared.record[symbol][~summed]).all() and not summed.all(), symbol
        else:
            assert np.array_equal(values, spared.record[symbol]), symbol
    assert 0.0 < spared.proofs["energy_error"] < 0.01 and np.isfinite(whole.record["E_friction"]).all()


def test_probe_is_linear_and_stiffer_than_the_shear_record(folder):
    probe = read_run(folder / "probe.h5").probe
    assert probe["G_0"] == pytest.approx(probe["G_0_minus"], rel=0.05)
    assert 80e6 < probe["G_0"] < 250e6 and 100e6 < probe["K_0"] < 250e6


def test_the_same_run_twice_is_bit_identical(folder):
    assert yade_runs.stage("shear", folder, description="again", **SHEAR | {"snapshots": "0.01"}).returncode == 0
    first, second = read_run(folder / "shear.h5"), read_run(folder / "again.h5")
    for symbol, values in first.record.items():
        assert np.array_equal(values, second.record[symbol]), symbol
    assert np.array_equal(read_snapshot(first, -1).position, read_snapshot(second, -1).position)


def test_response_depends_on_stiffness_over_stress_alone(folder):
    """(4 G_p, 4 sigma_3) repeats (G_p, sigma_3) in its own units; a factor of four keeps every rounding."""
    row = {"mu_s": 0.2, "G_p": 25.7e9, "start": "consolidate.h5", "inertial_number": 2.4e-3, "strain_end": 0.004}
    grown = row | {"start": "grown.h5", "G_p": 4 * 25.7e9, "sigma_3": 400e3}
    first = {"assembly": "assembly.h5", "mu_iso": 0.04, "G_p": 4 * 25.7e9, "sigma_3": 400e3}
    assert yade_runs.stage("consolidate", folder, description="grown", **first).returncode == 0
    for name, values in (("one", row), ("four", grown)):
        done = yade_runs.stage("shear", folder, description=name, **values)
        assert done.returncode == 0, done.stderr
    one, four = read_run(folder / "one.h5").record, read_run(folder / "four.h5").record
    np.testing.assert_allclose(four["sigma"], 4.0 * one["sigma"], rtol=1e-6, atol=1.0)
    for symbol in ("e", "Z", "Z_m", "e_m", "I"):
        np.testing.assert_allclose(four[symbol], one[symbol], rtol=1e-6, err_msg=symbol)


@pytest.mark.parametrize("energy_strain", [0.05, 0.001])
def test_a_killed_run_goes_on_from_its_checkpoint(folder, energy_strain):
    """SIGKILL after the first checkpoint; the second start ends it with a gapless record and says so.

    Energies are still summed when it is killed, or no longer.
    """
    name = f"killed_{energy_strain:g}"
    row = SHEAR | {"description": name, "checkpoint_seconds": 0.2, "strain_end": 0.1, "energy_strain": energy_strain}
    yade_runs.stage_killed_when("shear", folder, folder / f"{name}.checkpoint", **row)
    assert not (folder / f"{name}.h5").exists() and (folder / f"{name}.checkpoint").exists()
    done = yade_runs.stage("shear", folder, **row)
    assert done.returncode == 0, done.stderr
    run = read_run(folder / f"{name}.h5")
    assert run.attrs["resumed"] == 1 and not (folder / f"{name}.checkpoint").exists()
    assert np.all(np.diff(run.record["eps_a"]) > 0) and run.proofs["energy_error"] < 0.01
    beyond = run.record["eps_a"] > energy_strain
    assert np.array_equal(np.isnan(run.record["E_friction"]), beyond) and beyond.any()


def test_a_checkpoint_is_read_to_the_last_bit_and_only_where_it_fits():
    """Old and foreign files are told in one line, and nothing in them is executed."""
    said = yade_runs.scene("checkpoint_files")
    assert said["same"] and said["ran"] == 0
    for name, words in {
        "pickle": "another format", "pickle inside": "damaged", "nested": "another format", "empty": "another format",
        "other run": "run_id = 'r', not 's'", "other scripts": "scripts 0000000000, not 1111111111",
        "other value": "mu_s = 0.1, not 0.2", "flipped": "damaged", "cut": "damaged", "newer": "format_version = 2",
    }.items():  # fmt: skip
        assert words in said[name] and "\n" not in said[name], name


def test_a_run_beside_an_old_checkpoint_starts_anew_and_executes_nothing_of_it(folder):
    class Bomb:
        def __reduce__(self):
            return (open, ("executed", "w"))

    (folder / "old.checkpoint").write_bytes(pickle.dumps({"identity": Bomb(), "scene": b""}))
    done = yade_runs.stage("shear", folder, description="old", **SHEAR | {"strain_end": 0.002})
    assert done.returncode == 0, done.stderr
    assert not (folder / "executed").exists() and not (folder / "old.checkpoint").exists()
    lines = [line for line in done.stdout.splitlines() if "checkpoint" in line]
    assert lines == ["old: old.checkpoint is not used, the run starts anew: it is of another format"]
    assert read_run(folder / "old.h5").attrs["resumed"] == 0


def test_a_start_whose_scene_is_damaged_is_refused(folder):
    shutil.copy(folder / "probe.h5", folder / "flipped.h5")
    with h5py.File(folder / "flipped.h5", "r+") as file:
        file["state"][1000] ^= 1
    done = yade_runs.stage("shear", folder, description="from_flipped", **SHEAR | {"start": "flipped.h5"})
    assert done.returncode == 1 and "flipped.h5: its state is damaged" in done.stderr


def test_the_controller_stops_an_edge_at_2_1_boxes_of_the_largest_grain_and_the_checks_say_so():
    said = yade_runs.scene("thin_cell")
    assert said["stopped"] == pytest.approx(SHORTEST_EDGE, rel=1e-3)
    assert said["span"] == pytest.approx(said["box"], rel=1e-9) == pytest.approx(said["before"], rel=1e-9)
    for name, words in {
        "refused at once": "strain_end = 1 cannot be reached, YADE stops the cell at strain 0.6",
        "at the limit": "stands still at 0.3 of 1, edge 0.5", "no growth": "stands still at 0.1 of 1: 0 in 60 steps",
    }.items():  # fmt: skip
        assert words in said[name] and "limit" in said[name] and "\n" not in said[name], name
    assert not (said["short enough"] or said["early"] or said["growth"])


@pytest.fixture(scope="module")
def thin(tmp_path_factory):
    """A folder with a consolidated packing of 64 spheres, whose cell stops at a strain of about 0.2."""
    path = tmp_path_factory.mktemp("thin")
    write_assembly(path / "assembly.h5", make_assembly(64, 0.248e-3, 0.174, seed=1))
    row = {"assembly": "assembly.h5", "mu_iso": 0.04, "G_p": 25.7e9}
    assert yade_runs.stage("consolidate", path, description="consolidate", **row).returncode == 0
    return path


@pytest.mark.parametrize("stop_when_steady", [0, 1])
def test_a_cell_too_thin_for_its_strain_fails_with_strain_edge_and_limit(thin, stop_when_steady):
    """At once, and where a run may end earlier than at strain_end, when its strain stands still."""
    row = SHEAR | {"start": "consolidate.h5", "strain_end": 0.4, "stop_when_steady": stop_when_steady}
    name = f"thin_{stop_when_steady}"
    assert yade_runs.stage("shear", thin, description=name, **row).returncode == 1
    reason = json.loads((thin / f"{name}.failed.json").read_text())["reason"]
    strain, edge, limit = (float(re.search(rf"{word} ([\d.e-]+)", reason)[1])
                           for word in ("at(?: strain)?", "edge", "largest grain ="))  # fmt: skip
    assert 0.17 < strain < 0.23 and 1.0 < edge / limit < 1.03, reason
    assert reason.startswith("thin cell: ") and ("cannot be reached" in reason) == (not stop_when_steady)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"timestep_factor": 3.0}, "blow-up|energy|servo|equilibrium"),
        ({"inertial_number": 0.05}, "inertial_number = 0.05 is outside"),
        ({"mu_s": -0.1}, r"mu_s = -0\.1 is outside"),
        ({"mu_s": float("nan")}, "mu_s = nan is outside"),
        ({"start": "nowhere.h5"}, "nowhere.h5"),
    ],
)
def test_a_run_that_cannot_be_right_says_why(folder, change, words):
    name = "refused_" + "_".join(change)
    row = SHEAR | change
    done = yade_runs.stage("shear", folder, description=name, **row)
    assert done.returncode == 1
    assert not (folder / f"{name}.h5").exists()
    reason = json.loads((folder / f"{name}.failed.json").read_text())["reason"]
    assert re.search(words, reason), reason
    assert "\n" not in reason


def test_a_truncated_start_is_refused_in_one_line(folder):
    shutil.copy(folder / "probe.h5", folder / "cut.h5")
    with open(folder / "cut.h5", "r+b") as file:
        file.truncate(20_000)
    done = yade_runs.stage("shear", folder, description="from_cut", **SHEAR | {"start": "cut.h5"})
    assert done.returncode == 1 and "cut.h5" in json.loads((folder / "from_cut.failed.json").read_text())["reason"]


def test_product_carries_the_parameters_as_used(folder):
    with h5py.File(folder / "shear.h5") as file:
        used = dict(file["parameters"].attrs)
        assert file.attrs["complete"] and file.attrs["exit_reason"] == "strain_end"
        assert len(file.attrs["script_digest"]) == 64
    assert (used["mu_s"], used["G_p"], used["start"]) == (MU_S, G_P, "probe.h5")
    assert used["mu_iso"] == 0.04 and used["strain_end"] == 0.02


def test_a_run_is_steady_only_where_that_is_known():
    """A drift of eta that hides in scatter is accepted while it is known to 5 %, not where nothing is known of it."""
    steady = {name for name, answer in yade_runs.scene("steady_rows").items() if answer}
    assert steady == {"still", "scatter"}


def test_a_run_returns_only_when_its_last_step_has_ended():
    """Else what a stage changes next reaches half of that step, now and then, and a run does not repeat."""
    where = yade_runs.scene("stops")
    assert 0 < where["returned"] < 100 and where["later"] == where["returned"]
