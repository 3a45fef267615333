"""The SLURM engine: submits the missing rows as array jobs, each stage after the one before.

Each submission keeps its own table of rows in batch/, so that a later plan cannot change what a waiting task will do.
Several short rows are packed into one task. Submitting again is safe: rows that have a product or are in the queue are
left out.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from campaign.config import ROOT, Config
from campaign.files import read_json, write_json, write_text
from campaign.folder import RunError, folder_lock
from campaign.plan import STAGES, PlannedRun, script, table_line, yade_table
from campaign.products import clear_the_way

NOTE = "batch/slurm.json"
#: States of a task that has ended.
ENDED = ("COMPLETED", "CANCELLED", "FAILED", "TIMEOUT", "NODE_FAIL", "OUT_OF_MEMORY", "PREEMPTED")


def submit_missing(
    config: Config,
    folder: Path,
    rows: Sequence[PlannedRun],
    *,
    again: bool = False,
    spared: frozenset[str] = frozenset(),
) -> str:
    """Submit every row without a product that is neither spared nor in the queue, with `again` also failed ones.

    Returns one line on what was submitted. Raises RunError if another `run` works in the folder, if SLURM is missing or
    refuses the job, or if its queue is not known, since waiting rows would then be submitted twice.
    """
    if shutil.which("sbatch") is None:
        raise RunError("sbatch: no such program; is SLURM installed here?")
    with folder_lock(folder):
        queue = queued_rows(folder)
        _, missing = clear_the_way(folder, rows, again=again, spared=spared)
        to_submit = [row for row in missing if row.run_id not in queue]
        jobs = read_json(folder / NOTE, [])
        waiting = {job["job"] for job in jobs if set(queue) & {run_id for task in job["tasks"] for run_id in task}}
        submitted = []
        for stage in STAGES:
            stage_rows = [row for row in to_submit if row.stage == stage]
            if not stage_rows:
                continue
            tasks = pack(stage_rows, config.run.slurm.pack * 60.0)
            job = _submit(config, folder, stage, stage_rows, tasks, len(jobs), sorted(waiting))
            waiting.add(job)
            jobs.append({"job": job, "stage": stage, "tasks": [[row.run_id for row in task] for task in tasks]})
            write_json(folder / NOTE, jobs)
            submitted.append(f"{len(stage_rows)} {stage} in {len(tasks)} tasks (job {job})")
    return f"{config.name}: " + ("submitted " + ", ".join(submitted) if submitted else "nothing to submit")


def pack(rows: Sequence[PlannedRun], seconds: float) -> list[list[PlannedRun]]:
    """Return the rows in order, packed into tasks of up to `seconds` of predicted work, at least one row per task."""
    tasks: list[list[PlannedRun]] = []
    room = 0.0
    for row in rows:
        if row.cpu_seconds > room:
            tasks.append([])
            room = max(seconds, row.cpu_seconds)
        tasks[-1].append(row)
        room -= row.cpu_seconds
    return tasks


def _submit(
    config: Config,
    folder: Path,
    stage: str,
    rows: Sequence[PlannedRun],
    tasks: Sequence[Sequence[PlannedRun]],
    serial: int,
    after: Sequence[str],
) -> str:
    """Write table, tasks and script of one array job, submit it after the jobs `after`, and return its number."""
    base = f"batch/slurm_{serial}_{stage}"
    write_text(folder / f"{base}.table", yade_table(rows, f"submission {serial} to SLURM"))
    line_of = {row.run_id: table_line(k) for k, row in enumerate(rows)}
    lines = "".join(" ".join(str(line_of[row.run_id]) for row in task) + "\n" for task in tasks)
    write_text(folder / f"{base}.tasks", lines)
    write_text(folder / f"{base}.sh", job_script(config, folder, stage, base, len(tasks), after))
    done = subprocess.run(["sbatch", "--parsable", f"{base}.sh"], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise RunError(f"sbatch: {' '.join(done.stderr.split())[:200]}")
    return done.stdout.strip().split(";")[0]


def job_script(config: Config, folder: Path, stage: str, base: str, tasks: int, after: Sequence[str]) -> str:
    """Return the script of an array job; task k runs the table lines in line k (from 0) of the file <base>.tasks."""
    slurm = config.run.slurm
    throttle = f"%{slurm.throttle}" if slurm.throttle else ""
    head = [f"--job-name={config.name}-{stage}", f"--array=0-{tasks - 1}{throttle}", "--ntasks=1", "--cpus-per-task=1",
            f"--time={slurm.time}", f"--mem={slurm.memory}", f"--output=logs/slurm_%A_%a_{stage}.log",
            *([f"--partition={slurm.partition}"] if slurm.partition else []),
            *([f"--dependency=afterany:{':'.join(after)}"] if after else []), *slurm.options]  # fmt: skip
    env = {
        "PYTHONPATH": str(ROOT), "CAMPAIGN_LOG": "1", "CAMPAIGN_CPU_LIMIT": repr(config.run.cpu_limit),
        "CAMPAIGN_HANG_MINUTES": repr(config.run.hang_minutes), "CAMPAIGN_RETRY": str(int(config.failures.retry)),
        **{k: os.environ[k] for k in ("CAMPAIGN_YADE",) if k in os.environ},
    }  # fmt: skip
    return "\n".join([
        "#!/bin/sh", *(f"#SBATCH {line}" for line in head), f"cd {shlex.quote(str(folder.resolve()))} || exit 74",
        *(f"export {k}={shlex.quote(v)}" for k, v in env.items()), "status=0",
        f'for line in $(sed -n "$((SLURM_ARRAY_TASK_ID + 1))p" {base}.tasks); do',
        f"  YADE_BATCH={base}.table:$line {shlex.quote(sys.executable)} -m campaign.run_one "
        f"{shlex.quote(script(folder, stage))} || status=$?",
        "done", "exit $status", "",
    ])  # fmt: skip


def queued_rows(folder: Path) -> dict[str, str]:
    """Return run id -> "queued" for every row whose task waits or runs in SLURM; {} if nothing was submitted.

    Raises RunError if SLURM does not answer, since an unknown queue is not an empty one.
    """
    jobs = read_json(folder / NOTE, [])
    if not jobs:
        return {}
    exit_status, output, error = _ask_slurm("squeue", "--me", "-h", "-r", "-o", "%F %K %T")
    if exit_status:
        raise RunError(f"squeue: {error or 'failed'}; what waits in the queue is not known")
    tasks = {(job["job"], k): task for job in jobs for k, task in enumerate(job["tasks"])}
    queued = {}
    for line in output.splitlines():
        job, index, state = (line.split() + ["", ""])[:3]
        if index.isdigit() and state not in ENDED:
            for run_id in tasks.get((job, int(index)), []):
                queued[run_id] = "queued"
    return queued


def _ask_slurm(*command: str) -> tuple[int, str, str]:
    """Exit status, output and error (one line) of a SLURM command; one that is missing or hangs counts as failed."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired) as error:
        return 1, "", " ".join(str(error).split())[:200]
    return done.returncode, done.stdout, " ".join(done.stderr.split())[:200]


def ended_without_product(folder: Path, missing: Sequence[str]) -> dict[str, str]:
    """Return run id -> one line on the last SLURM task of each run among `missing` that was submitted."""
    jobs = read_json(folder / NOTE, [])
    last_task = {run_id: (job["job"], k) for job in jobs for k, task in enumerate(job["tasks"]) for run_id in task}
    tasks = {run_id: last_task[run_id] for run_id in missing if run_id in last_task}
    states = {}
    for job in {job for job, _ in tasks.values()}:
        for line in _ask_slurm("scontrol", "-o", "show", "job", job)[1].splitlines():
            facts = dict(part.split("=", 1) for part in line.split() if "=" in part)
            if facts.get("ArrayTaskId", "").isdigit():
                states[job, int(facts["ArrayTaskId"])] = facts.get("JobState", "")
    unknown = "SLURM knows it no more (cancelled while it waited, or ended long ago)"
    return {
        run_id: f"SLURM task {job}_{k} ended without a product: {states.get((job, k), unknown)}"
        for run_id, (job, k) in tasks.items()
    }
