"""The SLURM engine: submits the missing rows as array jobs, each stage after the one before.

Each submission keeps its own table of rows in batch/, so that a later plan cannot change what a waiting task will do.
Several short rows are packed into one task, and an array longer than the cluster allows is split. Submitting again is
safe: rows that have a product or are in the queue are left out, and nothing is submitted while the queue, or the note
of what was submitted (batch/slurm.json), cannot be read. A job is noted under a name of its own before it is submitted:
if this process is killed before it knows the number, the queue shows by that name whether the job is there. No command
of SLURM may take longer than SECONDS.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from campaign.config import ROOT, Config
from campaign.files import read_json, write_json, write_text
from campaign.folder import RunError, folder_lock
from campaign.plan import STAGES, PlannedRun, script, table_line, yade_table
from campaign.products import clear_the_way
from campaign.run_one import die_with_parent

NOTE = "batch/slurm.json"
#: States of a task that has ended.
ENDED = ("COMPLETED", "CANCELLED", "FAILED", "TIMEOUT", "NODE_FAIL", "OUT_OF_MEMORY", "PREEMPTED", "BOOT_FAIL",
         "DEADLINE", "REVOKED")  # fmt: skip
#: Time after which a command of SLURM counts as failed, s.
SECONDS = 60.0
#: Longest array where the cluster does not state its own limit: SLURM's default.
MAX_ARRAY = 1001
#: Words on stderr of a command that answers with exit status 0 although it has failed.
ERROR = r"(?i)\b(errors?|unable|fail\w*|refused|time[ds]?.?out|cannot|can't|denied|invalid|not found)\b"


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
    with folder_lock(folder, "products", "logs", "batch"):
        noted = _noted(folder)
        queue, numbers = _queue(noted)
        jobs = [job | {"job": _number(job, numbers)} for job in noted]
        if jobs != noted:
            _write_note(folder, jobs)
        _check_submitted(jobs)
        _, missing = clear_the_way(folder, rows, again=again, spared=spared)
        to_submit = [row for row in missing if row.run_id not in queue]
        busy = [job for job in jobs if set(queue) & {run_id for task in job["tasks"] for run_id in task}]
        waiting = {job["job"] for job in busy if job["job"]}
        submitted: list[str] = []
        ids: list[str] = []
        longest = _longest_array() if to_submit else MAX_ARRAY
        for stage in STAGES:
            stage_rows = [row for row in to_submit if row.stage == stage]
            if not stage_rows:
                continue
            tasks = pack(stage_rows, config.run.slurm.pack * 60.0)
            after, of_stage = sorted(waiting), list[str]()
            for part in (tasks[k : k + longest] for k in range(0, len(tasks), longest)):
                # the limit on tasks at once is that of an array: with one, parts follow each other
                job_after = [*after, *of_stage[-1:]] if config.run.slurm.throttle else after
                try:
                    job = _submit(config, folder, stage, part, jobs, job_after)
                    of_stage.append(job)
                    ids.append(job)
                    jobs[-1]["job"] = job
                    _write_note(folder, jobs)
                except RunError as error:
                    raise RunError(f"{error}{_cancel(ids)}") from None
            waiting |= set(of_stage)
            word = "job" if len(of_stage) == 1 else "jobs"
            submitted.append(f"{len(stage_rows)} {stage} in {len(tasks)} tasks ({word} {', '.join(of_stage)})")
    return f"{config.name}: " + ("submitted " + ", ".join(submitted) if submitted else "nothing to submit")


def _noted(folder: Path) -> list[dict[str, Any]]:
    """The array jobs that were submitted: job id ("" if sbatch's answer is not known), stage, run ids of each task.

    Raises RunError if the note of them is damaged or cannot be read, since their runs would then be submitted twice.
    """
    path = folder / NOTE
    try:
        jobs = read_json(path)
    except OSError as error:
        raise RunError(
            f"{path}: cannot be read now: {error.strerror or error}; what was submitted is not known"
        ) from None
    if jobs is None and not path.exists():
        return []
    if not (isinstance(jobs, list) and all(map(_is_job, jobs))):
        raise RunError(f"{path}: is damaged; what was submitted is not known: once `squeue --me` shows nothing of this "
                       "campaign, delete the file")  # fmt: skip
    return jobs


def _is_job(job: Any) -> bool:
    return (
        isinstance(job, dict)
        and isinstance(job.get("job"), str)
        and (bool(job["job"]) or isinstance(job.get("name"), str))
        and isinstance(job.get("time", 0.0), float)
        and isinstance(job.get("tasks"), list)
        and all(isinstance(task, list) and all(isinstance(run_id, str) for run_id in task) for task in job["tasks"])
    )


def _write_note(folder: Path, jobs: Sequence[dict[str, Any]]) -> None:
    try:
        write_json(folder / NOTE, jobs)
    except OSError as error:
        raise RunError(f"{folder / NOTE}: cannot be written: {error.strerror or error}") from None


def _check_submitted(jobs: Sequence[dict[str, Any]]) -> None:
    """Raise RunError while it is not known whether SLURM has taken a job of an earlier `run` that was interrupted.

    After SECONDS such a job is in the queue, where its name shows it, or it never comes.
    """
    for job in jobs:
        age = time.time() - job.get("time", 0.0)
        if not job["job"] and 0.0 <= age < SECONDS:
            raise RunError(
                f"sbatch: was interrupted {age:.0f} s ago while it submitted job {job['name']}, which is not in the "
                f"queue; run again in {SECONDS - age:.0f} s, when that is certain"
            )


def _longest_array() -> int:
    """The largest number of tasks in one array that the cluster allows: MaxArraySize is one above the last index."""
    _, output, _ = _ask_slurm("scontrol", "show", "config")
    found = re.search(r"(?m)^\s*MaxArraySize\s*=\s*([0-9]{1,9})\s*$", output)
    return max(int(found[1]), 1) if found else MAX_ARRAY


def _cancel(ids: Sequence[str]) -> str:
    """Cancel the jobs that were submitted before one was refused; returns what became of them, to end a line with."""
    if not ids:
        return ""
    failed, _, _ = _ask_slurm("scancel", *ids)
    names = f"job{'s' * (len(ids) > 1)} {', '.join(ids)}"
    if failed:
        return (
            f"; {names}, submitted before it, could not be cancelled and {'stay' if len(ids) > 1 else 'stays'} queued"
        )
    return f"; {names}, submitted before it, {'were' if len(ids) > 1 else 'was'} cancelled"


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
    tasks: Sequence[Sequence[PlannedRun]],
    jobs: list[dict[str, Any]],
    after: Sequence[str],
) -> str:
    """Write table, tasks and script of one array job, note it in `jobs`, submit it after the jobs `after`.

    Returns its number. Raises RunError if sbatch refuses it or answers with something else than a number; whatever it
    may have submitted then is cancelled by its name, which no other job has. The job stays noted if it may still come.
    """
    serial = len(jobs)
    base, rows = f"batch/slurm_{serial}_{stage}", [row for task in tasks for row in task]
    write_text(folder / f"{base}.table", yade_table(rows, f"submission {serial} to SLURM"))
    line_of = {row.run_id: table_line(k) for k, row in enumerate(rows)}
    lines = "".join(" ".join(str(line_of[row.run_id]) for row in task) + "\n" for task in tasks)
    write_text(folder / f"{base}.tasks", lines)
    name = f"{config.name}-{stage}-{os.urandom(4).hex()}"
    write_text(folder / f"{base}.sh", job_script(config, folder, stage, base, len(tasks), after, name))
    run_ids = [[row.run_id for row in task] for task in tasks]
    jobs.append({"job": "", "name": name, "time": time.time(), "stage": stage, "tasks": run_ids})
    _write_note(folder, jobs)
    exit_status, output, error = _ask_slurm("sbatch", "--parsable", f"{base}.sh", cwd=folder)
    if exit_status:
        refused = f"sbatch: {error or 'failed'}"
        if exit_status > 0:
            _write_note(folder, jobs[:-1])
            raise RunError(refused)
    else:
        ids = [line for line in output.splitlines() if re.fullmatch(r"[0-9]+(;[\w.-]+)?", line.strip())]
        if len(ids) == 1:
            return ids[0].strip().split(";")[0]
        refused = f"sbatch: answered {_shown(output) or 'nothing'}, which is no job number"
    failed, _, _ = _ask_slurm("scancel", f"--name={name}")
    if not (failed or exit_status):
        _write_note(folder, jobs[:-1])
    left = f"look for a job named {name}" if failed else f"a job named {name}, if there is one, was cancelled"
    raise RunError(f"{refused}; {left}")


def _shown(output: str) -> str:
    """The beginning of an answer in one line, in quotes; "" for an empty one."""
    text = " ".join(output.split())
    return repr(text[:80]) if text else ""


def job_script(
    config: Config, folder: Path, stage: str, base: str, tasks: int, after: Sequence[str], name: str = ""
) -> str:
    """Return the script of an array job; task k runs the table lines in line k (from 0) of the file <base>.tasks.

    name: that of the job (default: campaign and stage).
    """
    slurm = config.run.slurm
    throttle = f"%{slurm.throttle}" if slurm.throttle else ""
    head = [f"--job-name={name or f'{config.name}-{stage}'}",
            f"--array=0-{tasks - 1}{throttle}", f"--ntasks={config.run.ranks}", "--cpus-per-task=1",
            f"--time={slurm.time}", f"--mem={slurm.memory}", f"--output=logs/slurm_%A_%a_{stage}.log",
            *([f"--partition={slurm.partition}"] if slurm.partition else []),
            *([f"--dependency=afterany:{':'.join(after)}"] if after else []), *slurm.options]  # fmt: skip
    env = {
        "PYTHONPATH": str(ROOT), "CAMPAIGN_LOG": "1", "CAMPAIGN_CPU_LIMIT": repr(config.run.cpu_limit),
        "CAMPAIGN_HANG_MINUTES": repr(config.run.hang_minutes), "CAMPAIGN_RETRY": str(int(config.failures.retry)),
        **({"CAMPAIGN_RANKS": str(config.run.ranks)} if config.run.ranks > 1 else {}),
        **{k: os.environ[k] for k in ("CAMPAIGN_YADE", "CAMPAIGN_LMP", "CAMPAIGN_MPIRUN") if k in os.environ},
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

    Raises RunError if SLURM does not answer, or with something else than a queue, since an unknown queue is not an
    empty one; also if the note of what was submitted is damaged.
    """
    return _queue(_noted(folder))[0]


def _queue(jobs: Sequence[dict[str, Any]]) -> tuple[dict[str, str], dict[str, str]]:
    """What waits or runs of these jobs: run id -> "queued", and the name of a job -> its number. Raises RunError."""
    if not jobs:
        return {}, {}
    unknown = "what waits in the queue is not known"
    exit_status, output, error = _ask_slurm("squeue", "--me", "-h", "-r", "-o", "%F %K %T %j")
    if exit_status or re.search(ERROR, error):
        raise RunError(f"squeue: {error or 'failed'}; {unknown}")
    entries = []
    for line in filter(str.strip, output.splitlines()):
        entry = re.fullmatch(r"\s*([0-9]+)\s+(\S+)\s+([A-Z_]+)\s+(\S.*)", line)
        if not entry:
            raise RunError(f"squeue: answered {_shown(line)}, which is no task; {unknown}")
        if entry[3] not in ENDED:
            entries.append(entry)
    numbers = {entry[4].strip(): entry[1] for entry in entries}
    tasks = {(_number(job, numbers), k): task for job in jobs for k, task in enumerate(job["tasks"])}
    queued: dict[str, str] = {}
    for job, index in ((entry[1], entry[2]) for entry in entries):
        # an index such as 0-7%3 stands for tasks that SLURM has not listed one by one
        waiting = [k for j, k in tasks if j == job] if not re.fullmatch("[0-9]+", index) else [int(index)]
        queued |= {run_id: "queued" for k in waiting for run_id in tasks.get((job, k), [])}
    return queued, numbers


def _number(job: dict[str, Any], numbers: dict[str, str]) -> str:
    """The number of a noted job, from the queue where its note has none; "" if it is not there either."""
    return job["job"] or numbers.get(job["name"], "")


def _ask_slurm(*command: str, cwd: Path | None = None) -> tuple[int, str, str]:
    """Exit status, output and error (one line) of a SLURM command, which ends with this process.

    One that is missing has status 1; one that is not done after SECONDS is killed and has status -1, since what it did
    is not known. Bytes that are no UTF-8 stay visible as replacement characters.
    """
    try:
        process = subprocess.Popen(command, cwd=cwd, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, start_new_session=True,
                                   preexec_fn=die_with_parent)  # fmt: skip
    except OSError as failure:
        return 1, "", f"{command[0]}: {failure.strerror or failure}"
    with process:
        try:
            output, error = process.communicate(timeout=SECONDS)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            return -1, "", f"no answer after {SECONDS:g} s"
        except BaseException:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            raise
    texts = [text.decode("utf-8", errors="replace") for text in (output, error)]
    return process.returncode, texts[0], " ".join(texts[1].split())[:200]


def ended_without_product(folder: Path, missing: Sequence[str]) -> dict[str, str]:
    """Return run id -> one line on the last SLURM task of each run among `missing` that was submitted.

    Raises RunError if the note of what was submitted is damaged.
    """
    jobs = [job for job in _noted(folder) if job["job"]]
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
