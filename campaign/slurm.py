"""A cluster: the missing rows as SLURM array jobs, a stage waiting for the one before; status from SLURM and products.

Each submission keeps its own table of rows in batch/, so that a later plan cannot change what a waiting task will do.
Short rows are packed several to a task.  Submitting again is safe: what has a product or waits in the queue is left.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from campaign.config import ROOT, Config
from campaign.files import read_json, write_json, write_text
from campaign.local import RunError, folder_lock
from campaign.plan import STAGES, Row, script, table_line, yade_table
from campaign.products import clear_the_way

NOTE = "batch/slurm.json"
GONE = ("COMPLETED", "CANCELLED", "FAILED", "TIMEOUT", "NODE_FAIL", "OUT_OF_MEMORY", "PREEMPTED")


def submit_missing(
    config: Config, folder: Path, rows: list[Row], *, again: bool = False, spared: frozenset[str] = frozenset()
) -> str:
    """Submit every row without a product, not spared, not queued yet; returns a line that tells what was submitted.

    Raises RunError when SLURM is not there, refuses, or does not tell its queue: what waits would be submitted twice.
    """
    if shutil.which("sbatch") is None:
        raise RunError("sbatch: no such program; is SLURM installed here?")
    with folder_lock(folder):
        queue = queued_rows(folder)
        _, missing = clear_the_way(folder, rows, again=again, spared=spared)
        todo = [row for row in missing if row.run_id not in queue]
        noted = read_json(folder / NOTE, [])
        waiting = {job["job"] for job in noted if set(queue) & {r for task in job["tasks"] for r in task}}
        said = []
        for stage in STAGES:
            some = [row for row in todo if row.stage == stage]
            if not some:
                continue
            tasks = pack(some, config.run.slurm.pack * 60.0)
            job = _submit(config, folder, stage, some, tasks, len(noted), sorted(waiting))
            waiting.add(job)
            noted.append({"job": job, "stage": stage, "tasks": [[row.run_id for row in task] for task in tasks]})
            write_json(folder / NOTE, noted)
            said.append(f"{len(some)} {stage} in {len(tasks)} tasks (job {job})")
    return f"{config.name}: " + ("submitted " + ", ".join(said) if said else "nothing to submit")


def pack(rows: list[Row], seconds: float) -> list[list[Row]]:
    """Rows in order, several to a task up to `seconds` of predicted work; at least one each."""
    tasks, room = [], 0.0
    for row in rows:
        if row.cpu_seconds > room:
            tasks.append([])
            room = max(seconds, row.cpu_seconds)
        tasks[-1].append(row)
        room -= row.cpu_seconds
    return tasks


def _submit(config: Config, folder: Path, stage: str, rows, tasks, serial: int, after: list[str]) -> str:
    base = f"batch/slurm_{serial}_{stage}"
    write_text(folder / f"{base}.table", yade_table(rows, f"submission {serial} to SLURM"))
    place = {row.run_id: table_line(k) for k, row in enumerate(rows)}
    lines = "".join(" ".join(str(place[row.run_id]) for row in task) + "\n" for task in tasks)
    write_text(folder / f"{base}.tasks", lines)
    write_text(folder / f"{base}.sh", job_script(config, folder, stage, base, len(tasks), after))
    done = subprocess.run(["sbatch", "--parsable", f"{base}.sh"], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise RunError(f"sbatch: {' '.join(done.stderr.split())[:200]}")
    return done.stdout.strip().split(";")[0]


def job_script(config: Config, folder: Path, stage: str, base: str, tasks: int, after: list[str]) -> str:
    """The batch script of one array job: each task runs the table lines that its line of the .tasks file names."""
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
        f"  YADE_BATCH={base}.table:$line {shlex.quote(sys.executable)} -m campaign.row "
        f"{shlex.quote(script(folder, stage))} || status=$?",
        "done", "exit $status", "",
    ])  # fmt: skip


def queued_rows(folder: Path) -> dict[str, str]:
    """Run id -> "queued" for every row whose task waits or runs in SLURM now ({} where nothing was submitted).

    Raises RunError when SLURM does not answer: no queue known is not an empty queue.
    """
    noted = read_json(folder / NOTE, [])
    if not noted:
        return {}
    status, listed, said = _asked("squeue", "--me", "-h", "-r", "-o", "%F %K %T")
    if status:
        raise RunError(f"squeue: {said or 'failed'}; what waits in the queue is not known")
    tasks = {(job["job"], k): task for job in noted for k, task in enumerate(job["tasks"])}
    found = {}
    for line in listed.splitlines():
        job, index, word = (line.split() + ["", ""])[:3]
        if index.isdigit() and word not in GONE:
            for run_id in tasks.get((job, int(index)), []):
                found[run_id] = "queued"
    return found


def _asked(*command: str) -> tuple[int, str, str]:
    """Exit status, output and one line of error of a SLURM command; one that is missing or hangs has failed, too."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired) as error:
        return 1, "", " ".join(str(error).split())[:200]
    return done.returncode, done.stdout, " ".join(done.stderr.split())[:200]


def ended_without_product(folder: Path, missing: list[str]) -> dict[str, str]:
    """Run id -> what SLURM says of the last task that should have made it, for rows that are missing all the same."""
    noted = read_json(folder / NOTE, [])
    last = {run_id: (job["job"], k) for job in noted for k, task in enumerate(job["tasks"]) for run_id in task}
    wanted = {run_id: last[run_id] for run_id in missing if run_id in last}
    told = {}
    for job in {job for job, _ in wanted.values()}:
        for line in _asked("scontrol", "-o", "show", "job", job)[1].splitlines():
            facts = dict(part.split("=", 1) for part in line.split() if "=" in part)
            if facts.get("ArrayTaskId", "").isdigit():
                told[job, int(facts["ArrayTaskId"])] = facts.get("JobState", "")
    unknown = "SLURM knows it no more (cancelled while it waited, or ended long ago)"
    return {
        run_id: f"SLURM task {job}_{k} ended without a product: {told.get((job, k), unknown)}"
        for run_id, (job, k) in wanted.items()
    }
