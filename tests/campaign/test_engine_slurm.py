"""The SLURM engine: packing, dependencies, and (in `make slurm-test`) a campaign through a real one-node SLURM."""

import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest
from campaign_cases import ROOT, SUBMIT, make_real, make_small, plan_real, slurm_of, undisturbed
from kill_runs import compare

from campaign import engine_slurm
from campaign.config import read_config
from campaign.engine_slurm import NOTE, SECONDS, job_script, pack, submit_missing
from campaign.folder import RunError
from campaign.plan import STAGES

with_slurm = pytest.mark.skipif(
    shutil.which("sinfo") is None or subprocess.run(["sinfo"], capture_output=True).returncode != 0,
    reason=os.environ.get("NO_SLURM") or "no SLURM answers here; `make slurm-test` sets one up",
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
    small = make_small(tmp_path, more="[run.slurm]\npack = 0.2\n")
    submitted = []
    env = small.env(PATH=slurm_of(tmp_path, sbatch=SUBMIT, squeue="exit 0"))
    done = subprocess.run(small.line("run", "--engine", "slurm"), env=env, capture_output=True, text=True,
                          cwd=ROOT)  # fmt: skip
    assert done.returncode == 0 and "4 shear in" in done.stdout, done.stderr
    submitted = (small.folder / "submitted.txt").read_text().split()
    assert submitted == [f"batch/slurm_{k}_{stage}.sh" for k, stage in enumerate(("consolidate", "probe", "shear"))]
    for script in submitted:
        for task in range(len((small.folder / script).with_suffix(".tasks").read_text().splitlines())):
            env["SLURM_ARRAY_TASK_ID"] = str(task)
            assert subprocess.run(["sh", script], env=env, cwd=small.folder).returncode == 0
    assert small.total("done") == 10
    assert "nothing to submit" in subprocess.run(small.line("run", "--engine", "slurm"), env=env, capture_output=True,
                                                 text=True, cwd=ROOT).stdout  # fmt: skip


def test_slurm_missing_is_one_line(tmp_path):
    small = make_small(tmp_path)
    done = small.command("run", "--engine", "slurm", PATH="/nowhere")
    assert done.returncode == 2 and "sbatch: no such program" in done.stderr and "Traceback" not in done.stderr


def test_a_queue_that_does_not_answer_is_not_an_empty_one(tmp_path):
    """Nothing is submitted twice, and status says so in a line."""
    small = make_small(tmp_path)
    path = {"PATH": slurm_of(tmp_path, sbatch=SUBMIT, squeue="exit 1")}
    assert small.command("run", "--engine", "slurm", **path).returncode == 0
    again = small.command("run", "--engine", "slurm", **path)
    assert again.returncode == 2 and "squeue: failed; what waits in the queue is not known" in again.stderr
    assert "Traceback" not in again.stderr and len((small.folder / "submitted.txt").read_text().split()) == 3
    status = small.command("status", **path)
    assert status.returncode == 0 and "is not known" in status.stdout and "without a product" not in status.stdout


#: An sbatch that keeps the name of its job for the queue, and one that kills the `run` before that has its answer.
NAMED = SUBMIT.replace(";", "; sed -n 's/^#SBATCH --job-name=//p' \"$2\" >> names.txt;", 1)
KILLED = NAMED.replace("; wc", "; kill -9 $PPID; wc", 1)


def test_a_job_whose_number_was_lost_by_a_kill_is_found_by_its_name(tmp_path):
    """It is not submitted again, status shows its rows, and the other stages wait for it."""
    small = make_small(tmp_path)
    queue = f'while read name; do echo "1 0-7%3 PENDING $name"; done < {small.folder}/names.txt'
    path = {"PATH": slurm_of(tmp_path, sbatch=KILLED, squeue=queue)}
    assert small.command("run", "--engine", "slurm", **path).returncode == -signal.SIGKILL
    consolidations = sum(row.stage == "consolidate" for row in small.rows)
    counts = json.loads(small.command("status", "--json", **path).stdout)["counts"]
    assert counts["consolidate"]["queued"] == counts["total"]["queued"] == consolidations
    slurm_of(tmp_path, sbatch=NAMED)
    again = small.command("run", "--engine", "slurm", **path)
    assert again.returncode == 0 and "consolidate" not in again.stdout, again.stdout + again.stderr
    scripts = (small.folder / "submitted.txt").read_text().split()
    assert scripts == [f"batch/slurm_{k}_{stage}.sh" for k, stage in enumerate(STAGES)]
    assert "--dependency=afterany:1\n" in (small.folder / scripts[1]).read_text()
    assert [job["job"] for job in json.loads((small.folder / NOTE).read_text())] == ["1", "2", "3"]


def test_a_job_that_may_still_come_is_waited_for_and_one_that_never_came_is_submitted(tmp_path):
    small = make_small(tmp_path)
    path = {"PATH": slurm_of(tmp_path, sbatch="kill -9 $PPID", squeue="exit 0")}
    assert small.command("run", "--engine", "slurm", **path).returncode == -signal.SIGKILL
    note = small.folder / NOTE
    jobs = json.loads(note.read_text())
    note.write_text(json.dumps([job | {"time": time.time()} for job in jobs]))
    slurm_of(tmp_path, sbatch=NAMED)
    early = small.command("run", "--engine", "slurm", **path)
    assert early.returncode == 2 and len(early.stderr.splitlines()) == 1
    assert re.search(r"interrupted \d+ s ago .* job small-consolidate-\w{8}, .* run again in \d+ s", early.stderr)
    assert not (small.folder / "submitted.txt").exists()
    note.write_text(json.dumps([job | {"time": time.time() - SECONDS} for job in jobs]))
    later = small.command("run", "--engine", "slurm", **path)
    assert later.returncode == 0 and "2 consolidate" in later.stdout, later.stderr
    first = re.search(r"--dependency=afterany:(\S+)", (small.folder / "batch/slurm_2_probe.sh").read_text())
    assert first and first[1] == "1"  # no empty number of the job that never came


def test_a_refused_job_is_not_noted(tmp_path):
    small = make_small(tmp_path)
    path = {"PATH": slurm_of(tmp_path, sbatch="echo 'sbatch: error: no such partition' >&2; exit 1", squeue="exit 0")}
    assert small.command("run", "--engine", "slurm", **path).returncode == 2
    assert json.loads((small.folder / NOTE).read_text()) == []
    slurm_of(tmp_path, sbatch=SUBMIT)
    assert small.command("run", "--engine", "slurm", **path).returncode == 0


@pytest.mark.parametrize("silent", ["sbatch", "squeue"])
def test_a_command_that_never_answers_is_ended_after_its_time_limit(tmp_path, monkeypatch, silent):
    """With all that it has started, which would hold its output open. It would sleep for ten minutes."""
    small = make_small(tmp_path)
    monkeypatch.setenv("PATH", slurm_of(tmp_path, sbatch=SUBMIT, squeue="exit 0", scancel="exit 0"))
    if silent == "squeue":
        submit_missing(small.config, small.folder, small.rows)
    slurm_of(tmp_path, **{silent: f"sleep 600 & echo $! > {tmp_path}/sleeps; wait"})
    monkeypatch.setattr(engine_slurm, "SECONDS", 1.0)
    began = time.monotonic()
    with pytest.raises(RunError, match=f"{silent}: no answer after 1 s"):
        submit_missing(small.config, small.folder, small.rows)
    assert time.monotonic() - began < 300.0
    pid = int((tmp_path / "sleeps").read_text())
    while _lives(pid):  # a signal takes its time
        assert time.monotonic() - began < 300.0
        time.sleep(0.05)


def _lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_an_array_longer_than_the_cluster_allows_is_split(tmp_path):
    small = make_small(tmp_path, more="[run.slurm]\npack = 0.0\nthrottle = 2\n")
    limit = "echo 'MaxArraySize            = 3'"
    done = small.command("run", "--engine", "slurm", PATH=slurm_of(tmp_path, sbatch=SUBMIT, scontrol=limit))
    assert done.returncode == 0 and "4 shear in 4 tasks (jobs 4, 5)" in done.stdout, done.stderr
    scripts = [(small.folder / name).read_text() for name in (small.folder / "submitted.txt").read_text().split()]
    arrays = [re.search(r"--array=(\S+)", text)[1] for text in scripts]
    after = [re.search(r"--dependency=afterany:(\S+)|$", text)[1] for text in scripts]
    assert arrays == ["0-1%2", "0-2%2", "0-0%2", "0-2%2", "0-0%2"]
    assert after == [None, "1", "1:2", "1:2:3", "1:2:3:4"]  # at most two tasks at once, also over the parts of a stage
    lines = [(small.folder / f"batch/slurm_{k}_{stage}.tasks").read_text() for k, stage in ((1, "probe"), (2, "probe"))]
    assert lines == ["3\n4\n5\n", "3\n"]


def _queue() -> dict[tuple[str, int], str]:
    """(array job, task) -> state of all that waits or runs."""
    done = subprocess.run(["squeue", "-h", "-r", "-o", "%F %K %T"], capture_output=True, text=True)
    return {(job, int(task)): state for job, task, state in (line.split() for line in done.stdout.splitlines())}


def _wait(condition, limit: float) -> None:
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < limit, _queue()
        time.sleep(0.5)


def _processes(job: str, task: int) -> list[int]:
    """Everything that an array task has started on this machine, the batch script first."""
    variables, pids = {f"SLURM_ARRAY_JOB_ID={job}", f"SLURM_ARRAY_TASK_ID={task}"}, []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if variables <= set(path.read_text(errors="replace").split("\0")):
                pids.append(int(path.parent.name))
    assert pids, (job, task)
    return sorted(pids)


def _here_and_there(place):
    """A campaign in YADE twice: done on this machine (in runs/<name>), and planned for SLURM, a task for every run.

    SLURM_TEST_CAMPAIGN names its file; without it a campaign of nine runs of some five CPU seconds does.
    """
    file = os.environ.get("SLURM_TEST_CAMPAIGN")
    if file:
        here = undisturbed(ROOT / file, ROOT / "runs" / read_config(ROOT / file).name)
        (place / "slurm").mkdir()
        there = plan_real(Path(shutil.copy(ROOT / file, place / "slurm")), place / "slurm" / "run", like=here.folder)
    else:
        here, there = make_real(place / "here", n=4), make_real(place / "slurm", n=4)
        assert here.command("run", "--quiet").returncode == 0
    there.toml.write_text(there.toml.read_text() + "\n[run.slurm]\npack = 0.0\nmemory = '500M'\n")
    assert [row.run_id for row in here.rows] == [row.run_id for row in there.rows]
    return here, there


@pytest.mark.long
@pytest.mark.yade
@with_slurm
def test_campaign_in_yade_with_a_task_cancelled_and_one_killed(tmp_path, capsys):
    """The same products as on this machine, to the last bit, though a shear run was cancelled and a probe killed."""
    here, there = _here_and_there(tmp_path)
    total, stages = len(there.rows), {stage: [r for r in there.rows if r.stage == stage] for stage in STAGES}
    done = there.command("run", "--engine", "slurm")
    assert done.returncode == 0, done.stderr
    assert f"{len(stages['shear'])} shear in {len(stages['shear'])} tasks" in done.stdout
    jobs = dict(zip(STAGES, re.findall(r"job (\d+)", done.stdout), strict=True))
    counts = there.status()["counts"]["total"]
    assert counts["queued"] + counts["running"] + counts["done"] == counts["total"] == total
    assert "nothing to submit" in there.command("run", "--engine", "slurm").stdout

    cancelled = stages["shear"][-1]
    subprocess.run(["scancel", f"{jobs['shear']}_{len(stages['shear']) - 1}"], check=True)
    running: list[int] = []

    def a_probe_runs() -> bool:
        running[:] = [task for (job, task), state in _queue().items() if job == jobs["probe"] and state == "RUNNING"
                      and stages["probe"][task].run_id != cancelled.start]  # fmt: skip
        return bool(running) and there.status()["counts"]["probe"]["running"] > 0

    _wait(a_probe_runs, 7200.0)
    killed = stages["probe"][running[0]]
    for pid in _processes(jobs["probe"], running[0]):
        os.kill(pid, signal.SIGKILL)
    _wait(lambda: not _queue(), 12 * 3600.0)
    status, before = there.status(), there.sums()
    assert status["counts"]["total"] | {"done": total - 3, "missing": 3, "total": total} == status["counts"]["total"]
    after_killed = next(r.run_id for r in stages["shear"] if r.start == killed.run_id)
    assert set(status["lost"]) == {cancelled.run_id, killed.run_id, after_killed}
    assert "cancelled while it waited" in status["lost"][cancelled.run_id], status["lost"]
    assert "FAILED" in status["lost"][killed.run_id], status["lost"]

    again = there.command("run", "--engine", "slurm")
    assert "1 probe in 1 tasks" in again.stdout and "2 shear in 2 tasks" in again.stdout, again.stdout + again.stderr
    _wait(lambda: not _queue(), 12 * 3600.0)
    assert there.total("done") == total and there.total("total") == total
    assert before.items() <= there.sums().items()
    alike = compare(here, there, Counter([killed.run_id]))
    with capsys.disabled():
        print(f"\n{there.config.name}: {total} runs through SLURM, 1 cancelled, 1 killed; beside local ones: {alike}")
    assert alike["untouched_identical"] == alike["untouched"] == total - 1
    assert alike["begun_anew_identical"] == alike["begun_anew"] == 1
