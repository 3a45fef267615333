"""Faults of LAMMPS, of MPI and of the machine: one line each, and a product only from a run that ended well."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from lammps_stages import grains, stage
from paths import ROOT

from campaign.lammps.__main__ import main
from campaign.run_one import ENVIRONMENT, FAILED

FAKE = str(ROOT / "tests" / "support" / "fake_lmp.py")
ROW = {"description": "consolidate_1", "mu_iso": 0.04, "seed": 1, "assembly": "assembly.h5"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("faults")
    grains(place, 100)
    return place


def faulty(folder: Path, fault: str, row: dict | None = None, **env: str):
    for path in (folder / "products").glob("*.failed.json"):
        path.unlink()
    return stage(
        "consolidate",
        folder,
        ROW | (row or {}),
        supervised=True,
        **{"CAMPAIGN_LMP": FAKE, "FAKE_LMP": fault, "CAMPAIGN_RETRY": "0"} | env,
    )


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("lost", "blow-up: LAMMPS lost 42 of 100 grains at step 5000"),
        ("blown", "blow-up: the mean stress exceeds 100 times sigma_3 at step 5000"),
        ("restless", "no equilibrium in the windows allowed; the last one: stress_error 3e-4 F_unb 8e-3 Z_change 5e-4"),
        ("SIGSEGV", "LAMMPS ended by signal 11 (SIGSEGV)"),
        ("silent", "LAMMPS stopped without end.contacts"),
    ],
)  # fmt: skip
def test_a_fault_of_the_run_is_stated_in_its_failure_file(folder, fault, reason):
    done = faulty(folder, fault)
    assert done.returncode == FAILED
    failure = json.loads((folder / "products" / "consolidate_1.failed.json").read_text())
    assert failure["reason"] == reason and failure["cpu_seconds"] >= 0.0
    assert "Traceback" not in done.stdout + done.stderr
    assert not list((folder / "products").glob("*.h5"))


@pytest.mark.parametrize(
    ("fault", "ranks", "words"),
    [
        ("SIGKILL", "1", "LAMMPS was killed by signal 9 (SIGKILL)"),
        ("SIGTERM", "1", "LAMMPS was killed by signal 15 (SIGTERM)"),
        ("mpirun says SIGKILL", "2", "LAMMPS was killed by signal 9 (SIGKILL)"),
        ("slots", "4", "mpirun: not enough slots for run.ranks = 4 on this machine; use fewer ranks"),
    ],
)
def test_a_fault_of_the_machine_leaves_the_run_missing(folder, fault, ranks, words):
    done = faulty(folder, fault, CAMPAIGN_RANKS=ranks, CAMPAIGN_MPIRUN=FAKE)
    assert done.returncode == ENVIRONMENT and words in done.stdout
    assert not list((folder / "products").glob("*.failed.json"))


def test_a_crash_of_one_rank_is_the_runs_own_and_is_repeated(folder):
    """What mpirun says of it comes with exit status 139, which is no signal of LAMMPS itself."""
    done = faulty(folder, "mpirun says SIGSEGV", CAMPAIGN_RANKS="2", CAMPAIGN_MPIRUN=FAKE, CAMPAIGN_RETRY="1")
    assert done.returncode == FAILED and "once more with timestep_factor = 0.5" in done.stdout
    failure = json.loads((folder / "products" / "consolidate_1.failed.json").read_text())
    assert failure["reason"] == "LAMMPS ended by signal 11 (SIGSEGV)"


def test_no_equilibrium_is_repeated_since_a_large_step_causes_it_too(folder):
    done = faulty(folder, "restless", CAMPAIGN_RETRY="1")
    assert done.returncode == FAILED and "once more with timestep_factor = 0.5" in done.stdout


def test_a_full_disk_is_the_machines_although_lammps_does_not_notice_it(folder, monkeypatch, capsys):
    """LAMMPS ends as if all were well, and files are cut off; what it wrote is there when the space is asked for."""
    row = (folder / "consolidate_1.table").read_text()
    (folder / "full.table").write_text(row)
    monkeypatch.chdir(folder)
    for name, value in {"YADE_BATCH": "full.table:2", "CAMPAIGN_LMP": FAKE, "FAKE_LMP": "silent"}.items():
        monkeypatch.setenv(name, value)
    seen = []

    def full(place):
        seen.extend(path.name for path in Path(place).iterdir())
        return SimpleNamespace(free=0)

    monkeypatch.setattr(shutil, "disk_usage", full)
    for path in (folder / "products").glob("*.failed.json"):
        path.unlink()
    assert main("consolidate") == ENVIRONMENT and "in.log" in seen and "grains.data" in seen
    assert capsys.readouterr().out == (
        "consolidate_1: no space left on the disk; then: LAMMPS stopped without end.contacts\n"
    )
    assert not list((folder / "products").glob("*.failed.json"))


@pytest.mark.parametrize(
    ("stage_name", "batch", "words"),
    [
        ("shear", "", "YADE_BATCH = '' names no TABLE:LINE"),
        ("", "a.table:2", "stage '' is none of consolidate, probe, shear"),
        ("shear", "none.table:2", "none.table"),
        ("shear", "yade.table:2", "line 2 has code = 'yade', so that its product is not for LAMMPS to make"),
    ],
)
def test_a_mistake_by_hand_is_one_line(tmp_path, monkeypatch, capsys, stage_name, batch, words):
    """Above all, a row of YADE must not get a product of LAMMPS under its own id."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "yade.table").write_text("description  mu_s\nshear_1  0.3\n")
    monkeypatch.setenv("YADE_BATCH", batch)
    assert main(stage_name) == ENVIRONMENT
    said = capsys.readouterr().err
    assert said.startswith("campaign.lammps: ") and words in said and said.count("\n") == 1
    assert not list(tmp_path.glob("*.json"))


def test_without_lammps_one_line_says_what_to_install(folder):
    done = stage("consolidate", folder, ROW, CAMPAIGN_LMP="/no/such/lmp")
    assert done.returncode == ENVIRONMENT
    assert done.stdout == (
        "consolidate_1: /no/such/lmp: no such program on this machine; on Debian and Ubuntu `apt-get install lammps` "
        "(or `make lammps`) installs LAMMPS\n"
    )


def test_a_blow_up_is_repeated_once_with_half_the_step(folder):
    done = faulty(folder, "lost", CAMPAIGN_RETRY="1")
    assert done.returncode == FAILED and "once more with timestep_factor = 0.5" in done.stdout
    assert json.loads((folder / "products" / "consolidate_1.failed.json").read_text())["retried"]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"path": "undrained"}, "path = 'undrained': code = 'lammps' has 'drained' only"),
        ({"damping": 0.2}, "damping = 0.2: code = 'lammps' has 0.0 only"),
        ({"heterogeneity": "grain"}, "heterogeneity = 'grain': code = 'lammps' has 'specimen' only"),
        ({"mu_iso": "rough"}, "mu_iso = 'rough' is outside [0, 5]"),
        ({"sigma_3": float("inf")}, "sigma_3 = inf is outside [1, 1e+09]"),
        ({"assembly": "none.h5"}, "none.h5"),
    ],
)
def test_bad_input_is_one_line(folder, row, words):
    done = stage("consolidate", folder, ROW | {"description": "bad_1"} | row, CAMPAIGN_LMP=FAKE, FAKE_LMP="silent")
    assert done.returncode == FAILED and words in done.stderr
    assert len(done.stderr.splitlines()) == 1
