"""The local engine: one yade-batch per stage over exactly the missing rows; the products decide what is done.

Each `run` has tables of its own, batch/run_<stage>.table, with exactly the rows that it runs. A later plan cannot
change what they do, and a command line stays short however many rows there are.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from campaign.config import INSTALL_LAMMPS, INSTALL_YADE, ROOT, Config, places
from campaign.estimate import estimate
from campaign.files import say_once, write_text
from campaign.folder import (
    OWNER,
    SCRIPTS,
    RunError,
    clear_scripts,
    folder_lock,
    holder,
    is_locked,
    open_plain,
    write_failure,
)
from campaign.plan import STAGES, PlannedRun, script, yade_table
from campaign.products import RunStatus, clear_the_way, run_statuses, set_aside, write_blocked
from campaign.progress import Progress, progress_line, span
from campaign.run_one import FREE_BYTES, die_with_parent, run_environment

#: Disk space that a product needs per grain, bytes: a snapshot takes about 600, and a product has about six.
BYTES_PER_GRAIN = 4000
#: Shortest time between two looks at the products for the line of progress, seconds.
LOOK_SECONDS = 2.0


def run_missing(
    config: Config,
    folder: Path,
    rows: Sequence[PlannedRun],
    *,
    again: bool = False,
    quiet: bool = False,
    spared: frozenset[str] = frozenset(),
) -> int:
    """Run every row without a product except the spared ones, with `again` also failed ones; return the number added.

    quiet: show no progress. Raises RunError if another `run` works in the folder, if YADE is missing, if yade-batch
    fails, or if the disk is too full for the missing runs.
    """
    with folder_lock(folder, "products", "logs", "batch"):
        statuses, missing = clear_the_way(folder, rows, again=again, spared=spared)
        _remove_leftovers(folder)
        _clear_scripts_of_killed_runs(folder)
        if not missing:
            return 0
        _check_machine(folder, missing, config)
        watch = _Watch(rows, statuses, config, quiet)
        _run_batches(config, folder, rows, missing, watch)
        watch.progress.end()
        statuses = run_statuses(folder, rows)
        write_blocked(folder, statuses)
        return sum(statuses[row.run_id].status == "done" for row in missing)


def fail_refused(folder: Path, statuses: dict[str, RunStatus], stage: str) -> None:
    """Turn the refused products of a stage that has just run into failures, so that they are not repeated for ever."""
    for run_id, status in statuses.items():
        if status.status == "refused" and run_id.startswith(stage):
            set_aside(folder, [run_id])
            write_failure(folder / "products", run_id, f"its product {status.reason}", log=f"logs/{run_id}.log")


def _check_machine(folder: Path, missing: Sequence[PlannedRun], config: Config) -> None:
    """Raise RunError if YADE is missing, the disk is too full, or yade-batch cannot use the paths."""
    batch = os.environ.get("CAMPAIGN_YADE_BATCH", "yade-batch")
    programs = {batch: INSTALL_YADE}
    if config.dem.code == "lammps":
        programs[os.environ.get("CAMPAIGN_LMP", "lmp")] = INSTALL_LAMMPS
        if config.run.ranks > 1:
            programs[os.environ.get("CAMPAIGN_MPIRUN", "mpirun")] = INSTALL_LAMMPS
    else:
        programs[os.environ.get("CAMPAIGN_YADE", "yade")] = INSTALL_YADE
    for program, advice in programs.items():
        if shutil.which(program) is None:
            raise RunError(f"{program}: no such program; {advice}")
    if config.run.ranks > (cores := len(os.sched_getaffinity(0))):
        raise RunError(f"run.ranks = {config.run.ranks} exceeds the {cores} cores of this machine; use fewer ranks")
    need = len(missing) * config.assembly.N * BYTES_PER_GRAIN + FREE_BYTES
    free = shutil.disk_usage(folder).free
    if free < need:
        raise RunError(f"{folder}: {free >> 20} MiB free, the missing runs need about {need >> 20} MiB")
    if re.search(r"[^\w./+-]", script(folder, "shear") + sys.executable):
        raise RunError(f"{folder}: yade-batch needs paths without spaces or special characters")


def _remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of killed runs, except those of runs that are at work (by hand or in SLURM).

    A run of another host that cannot be asked is mentioned: it keeps its lock until the user deletes that.
    """
    for path in (folder / "batch").glob(f"slot_*.lock{OWNER}"):
        path.unlink(missing_ok=True)  # places for runs at once belong to the one `run` that has the folder
    for path in [p for ending in (".part", ".tmp", f".lock{OWNER}", ".lock") for p in _hidden(folder, ending)]:
        run_id = re.split(r"\.(?:h5|checkpoint|failed\.json|lock|tmp)\b", path.name[1:])[0]
        if is_locked(path.with_name(f".{run_id}.lock")):
            if path.name.endswith(OWNER):
                say_once(f"{run_id}: runs in {holder(path)}")
        elif path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _clear_scripts_of_killed_runs(folder: Path) -> None:
    """Remove what killed runs in LAMMPS had written beside their scripts, which may be as large as a gigabyte."""
    for path in sorted((folder / "products").glob(f"[!.]*{SCRIPTS}")):
        if path.is_dir() and not path.is_symlink() and not is_locked(path.with_name(f".{path.stem}.lock")):
            clear_scripts(path)


def _hidden(folder: Path, ending: str) -> list[Path]:
    return sorted((folder / "products").glob(f".*{ending}"))


def _run_batches(
    config: Config, folder: Path, rows: Sequence[PlannedRun], missing: Sequence[PlannedRun], watch: _Watch
) -> None:
    """Start one yade-batch per stage over the stage's missing rows, all stages at once, and wait for them.

    A run waits until the product that it starts from is there and until one of the places for runs at once is free (see
    `campaign.run_one`). So no core waits for the last run of a stage.
    """
    read_end, write_end = os.pipe()  # every run watches the read end: it becomes readable when this process ends
    with contextlib.ExitStack() as stack:
        for end in (read_end, write_end):
            stack.callback(os.close, end)
        batches, missing_ids = {}, {row.run_id for row in missing}
        for stage in STAGES:
            _ended(folder, stage).unlink(missing_ok=True)
            stage_rows = [row for row in rows if row.stage == stage and row.run_id in missing_ids]
            if not stage_rows:
                _ended(folder, stage).touch()
                continue
            batches[stage] = _start_batch(config, folder, stage, stage_rows, read_end)
            stack.callback(batches[stage].terminate)
        while batches:
            watch.show_progress(folder)
            with contextlib.suppress(subprocess.TimeoutExpired):
                next(iter(batches.values())).wait(timeout=0.5)
            for stage in [s for s, batch in batches.items() if batch.poll() is not None]:
                code = batches.pop(stage).returncode
                if code:
                    raise RunError(f"{folder}: yade-batch ended with status {code}; see logs/batch_{stage}.log")
                fail_refused(folder, run_statuses(folder, rows), stage)
                _ended(folder, stage).touch()
        watch.show_progress(folder)


def _ended(folder: Path, stage: str) -> Path:
    """The file whose existence shows to waiting runs that no further product will come from this stage."""
    return folder / "batch" / f"ended_{stage}"


def _start_batch(config: Config, folder: Path, stage: str, rows: Sequence[PlannedRun], pipe: int) -> subprocess.Popen:
    """Write these rows of a stage into a table of this `run` and start yade-batch over it."""
    limits, at_once = config.run, places(config)
    table = f"batch/run_{stage}.table"
    write_text(folder / table, yade_table(rows, f"yade-batch {table} {script(folder, stage)}"))
    for name in (f"batch_{stage}", *(row.run_id for row in rows)):
        if (path := folder / "logs" / f"{name}.log").is_symlink():
            path.unlink()  # the output would go where it leads
    env = run_environment() | {
        "CAMPAIGN_CPU_LIMIT": repr(limits.cpu_limit), "CAMPAIGN_HANG_MINUTES": repr(limits.hang_minutes),
        "CAMPAIGN_RETRY": str(int(config.failures.retry)), "CAMPAIGN_JOBS": str(at_once), "CAMPAIGN_FRONT": str(pipe),
        "CAMPAIGN_RANKS": str(limits.ranks),
    }  # fmt: skip
    env["PYTHONPATH"] = os.pathsep.join([env["PYTHONPATH"], os.path.relpath(ROOT, folder)])
    env.pop("OMP_NUM_THREADS")  # yade-batch takes it for the number of jobs
    command = [
        os.environ.get("CAMPAIGN_YADE_BATCH", "yade-batch"), "--jobs", str(at_once + 1), "--job-threads", "1",
        "--log", "logs/@.log", "--plot-update", "0", "--disable-pynotify",
        "--executable", f"{sys.executable} -m campaign.run_one", table, script(folder, stage),
    ]  # fmt: skip
    log_flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
    with open(open_plain(folder / "logs" / f"batch_{stage}.log", log_flags), "w") as log:
        return subprocess.Popen(command, cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                                preexec_fn=_in_child, pass_fds=[pipe])  # fmt: skip


def _in_child() -> None:
    """In yade-batch before it starts: end with this process, and go on when the terminal is closed."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    die_with_parent()


class _Watch:
    """Shows how many runs are done, and the time to go as `status` estimates it."""

    def __init__(self, rows: Sequence[PlannedRun], statuses: dict[str, RunStatus], config: Config, quiet: bool):
        self.rows = [row for row in rows if statuses[row.run_id].status != "spared"]
        self.places, self.progress = places(config), Progress(quiet)
        self.began, self.next_look = time.monotonic(), 0.0

    def show_progress(self, folder: Path) -> None:
        """Show the runs that are done, running and failed, the time so far and the time to go."""
        now = time.monotonic()
        if self.progress.quiet or now < self.next_look:
            return
        self.progress.show(self.line(run_statuses(folder, self.rows), now - self.began))
        self.next_look = time.monotonic() + max(LOOK_SECONDS, 50 * (time.monotonic() - now))

    def line(self, statuses: dict[str, RunStatus], seconds: float) -> str:
        """Return the line of progress after so many seconds."""
        count = {word: sum(s.status == word for s in statuses.values()) for word in ("done", "running", "failed")}
        words = [f"{count['running']} running"] + [f"{count['failed']} failed"] * bool(count["failed"])
        to_go = estimate(self.rows, statuses, self.places).seconds
        words += [f"{span(seconds)} so far", f"about {span(to_go)} to go"]
        return progress_line(count["done"], len(self.rows), words, self.progress.width)
