"""Array jobs: how rows are packed and chained, and (in `make slurm-test`) a campaign through a real one-node SLURM."""

import os
import re
import shutil
import subprocess
import time

import h5py
import pytest
from campaign_cases import make_real, make_small, same_arrays

from campaign.slurm import job_script, pack

with_slurm = pytest.mark.skipif(
    shutil.which("sinfo") is None or subprocess.run(["sinfo"], capture_output=True).returncode != 0,
    reason="no SLURM answers here; `make slurm-test` sets one up",
)


def test_rows_are_packed_in_order_up_to_the_time_given(tmp_path):
    rows = make_small(tmp_path, n=4).rows
    tasks = pack(rows, 30.0)
    assert [row for task in tasks for row in task] == rows
    assert all(sum(r.cpu_seconds for r in task) <= 30.0 for task in tasks)
    assert 1 < len(tasks) < len(rows)
    assert pack(rows, 0.0) == [[row] for row in rows]
    assert pack(rows, 1e9) == [rows]


def test_script_has_array_throttle_limits_and_dependency(tmp_path):
    more = '[run.slurm]\nthrottle = 3\npartition = "fast"\ntime = "02:00:00"\nmemory = "3G"\noptions = ["--qos=low"]\n'
    small = make_small(tmp_path, more=more)
    text = job_script(small.config, small.folder, "shear", "batch/slurm_0_shear", 8, ["17", "18"])
    for line in ("--array=0-7%3", "--partition=fast", "--time=02:00:00", "--mem=3G", "--qos=low", "--cpus-per-task=1",
                 "--dependency=afterany:17:18"):  # fmt: skip
        assert f"#SBATCH {line}\n" in text
    path = tmp_path / "job.sh"
    path.write_text(text)
    assert subprocess.run(["sh", "-n", str(path)]).returncode == 0


def test_task_runs_the_lines_of_its_own_table(tmp_path):
    """The script as SLURM would run it, one array task after the other."""
    from campaign import slurm

    small = make_small(tmp_path, more="[run.slurm]\npack = 0.2\n")
    submitted = []
    stand_in = tmp_path / "sbatch"
    stand_in.write_text('#!/bin/sh\necho "$2" >> submitted.txt\nwc -l < submitted.txt\n')
    stand_in.chmod(0o755)
    env = small.env(PATH=f"{tmp_path}:{os.environ['PATH']}")
    done = subprocess.run(small.line("run", "--engine", "slurm"), env=env, capture_output=True, text=True,
                          cwd=slurm.ROOT)  # fmt: skip
    assert done.returncode == 0 and "4 shear in" in done.stdout, done.stderr
    submitted = (small.folder / "submitted.txt").read_text().split()
    assert submitted == [f"batch/slurm_{k}_{stage}.sh" for k, stage in enumerate(("consolidate", "probe", "shear"))]
    for script in submitted:
        for task in range(len((small.folder / script).with_suffix(".tasks").read_text().splitlines())):
            env["SLURM_ARRAY_TASK_ID"] = str(task)
            assert subprocess.run(["sh", script], env=env, cwd=small.folder).returncode == 0
    assert small.total("done") == 10
    assert "nothing to submit" in subprocess.run(small.line("run", "--engine", "slurm"), env=env, capture_output=True,
                                                 text=True, cwd=slurm.ROOT).stdout  # fmt: skip


def test_slurm_missing_is_one_line(tmp_path):
    small = make_small(tmp_path)
    done = small.command("run", "--engine", "slurm", PATH="/nowhere")
    assert done.returncode == 2 and "sbatch: no such program" in done.stderr and "Traceback" not in done.stderr


def _queue() -> list[list[str]]:
    done = subprocess.run(["squeue", "-h", "-r", "-o", "%i %T"], capture_output=True, text=True)
    return [line.split() for line in done.stdout.splitlines()]


def _wait(small, condition, limit=120.0):
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < limit, (small.status(), _queue())
        time.sleep(0.5)


@pytest.mark.long
@with_slurm
def test_one_task_cancelled_and_one_killed_then_submitted_again(tmp_path):
    small = make_small(tmp_path, n=4, more="[run.slurm]\npack = 0.0\nthrottle = 2\nmemory = '100M'\n", seconds=4.0)
    done = small.command("run", "--engine", "slurm")
    assert done.returncode == 0 and "8 shear in 8 tasks" in done.stdout, done.stderr
    told = small.status()["counts"]["total"]
    assert told["queued"] + told["running"] + told["done"] == told["total"] == 18
    assert "nothing to submit" in small.command("run", "--engine", "slurm").stdout
    probes = [r for r in small.rows if r.stage == "probe"]
    _wait(small, lambda: probes[0].run_id in small.started())
    _, probe_job, shear_job = re.findall(r"job (\d+)", done.stdout)
    subprocess.run(["scancel", f"{shear_job}_5"], check=True)
    _wait(small, lambda: any(len(q) > 1 and q[1] == "RUNNING" and q[0].startswith(probe_job) for q in _queue()))
    victim = next(q[0] for q in _queue() if q[1] == "RUNNING" and q[0].startswith(probe_job))
    subprocess.run(["scancel", "--signal=KILL", "--full", victim], check=True)
    _wait(small, lambda: not _queue())
    told = small.status()
    assert told["counts"]["total"]["total"] == 18 and told["counts"]["total"]["missing"] >= 2
    assert any("CANCELLED" in reason for reason in told["lost"].values()), told["lost"]
    done_before = small.sums()
    assert small.command("run", "--engine", "slurm").returncode == 0
    _wait(small, lambda: small.total("done") == 18)
    assert done_before.items() <= small.sums().items()


@pytest.mark.long
@pytest.mark.yade
@with_slurm
def test_real_yade_gives_the_same_results_as_locally(tmp_path):
    """A small campaign in YADE, once through SLURM and once on this machine: the records agree to the last bit."""
    here, there = make_real(tmp_path / "here"), make_real(tmp_path / "there")
    assert here.command("run", "--quiet", CAMPAIGN_YADE="yade").returncode == 0
    assert there.command("run", "--engine", "slurm", CAMPAIGN_YADE="yade").returncode == 0
    _wait(there, lambda: not _queue(), 1800.0)
    assert there.total("done") == here.total("done") == len(here.rows)
    for row in here.rows:
        with h5py.File(here.folder / row.product) as a, h5py.File(there.folder / row.product) as b:
            assert same_arrays(a, b), row.run_id
