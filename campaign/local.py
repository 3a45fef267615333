"""This machine's cores: yade-batch over exactly the missing rows of every stage, judged by the products."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from campaign.config import ROOT, Config
from campaign.plan import STAGES, Row, script, table_line, table_path
from campaign.products import State, clear_the_way, is_locked, look, set_aside, write_blocked, write_failure
from campaign.row import closed_doors, die_with_parent
from campaign.status import Progress, bar, jobs, span

#: Bytes that a product needs on disk, roughly: a snapshot keeps about 600 bytes a grain, a product a handful.
BYTES_PER_GRAIN = 4000


class RunError(RuntimeError):
    """Runs that cannot be started; one line."""


def run_missing(
    config: Config, folder: Path, rows: list[Row], *, again: bool = False, quiet: bool = False,
    spared: frozenset[str] = frozenset(),
) -> int:  # fmt: skip
    """Run every row without a product but the spared; failed ones too if `again`.  Returns how many were added.

    Raises RunError when another `run` works in the folder, when YADE is not there or when the disk is full.
    """
    with folder_lock(folder):
        states, missing = clear_the_way(folder, rows, again=again, spared=spared)
        if not missing:
            return 0
        _check_machine(folder, missing, config)
        _sweep(folder)
        watch = _Watch(rows, states, config, quiet)
        _run_batches(config, folder, rows, missing, watch)
        watch.progress.end()
        after = look(folder, rows)
        write_blocked(folder, after)
        return sum(after[row.run_id].state == "done" for row in missing)


@contextlib.contextmanager
def folder_lock(folder: Path):
    """One `run` at a time in a campaign's folder; the lock goes with the process, whatever ends it."""
    try:
        (folder / "products").mkdir(parents=True, exist_ok=True)
        (folder / "logs").mkdir(exist_ok=True)
        file = open(folder / ".lock", "a+")  # noqa: SIM115  closed below
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            raise RunError(f"{folder}: another `run` is at work here (process {file.read().strip()})") from None
        file.truncate(0)
        file.write(f"{os.getpid()}\n")
        file.flush()
        yield


def fail_refused(folder: Path, states: dict[str, State], stage: str) -> None:
    """A product just made that can't be used is a failed run, not one to repeat for ever."""
    for run_id, state in states.items():
        if state.state == "refused" and run_id.startswith(stage):
            set_aside(folder, [run_id])
            write_failure(folder / "products", run_id, f"its product {state.reason}", log=f"logs/{run_id}.log")


def _check_machine(folder: Path, missing: list[Row], config: Config) -> None:
    batch = os.environ.get("CAMPAIGN_YADE_BATCH", "yade-batch")
    for program in (batch, os.environ.get("CAMPAIGN_YADE", "yade")):
        if shutil.which(program) is None:
            raise RunError(f"{program}: no such program; `make setup` installs YADE")
    need = len(missing) * config.assembly.N * BYTES_PER_GRAIN + (16 << 20)
    free = shutil.disk_usage(folder).free
    if free < need:
        raise RunError(f"{folder}: {free >> 20} MiB free, the missing runs need about {need >> 20} MiB")
    if re.search(r"[^\w./+-]", script(folder, "shear") + sys.executable):
        raise RunError(f"{folder}: yade-batch needs paths without spaces or special characters")


def _sweep(folder: Path) -> None:
    """Remove what killed runs left half-written, but not what a run outside (by hand, in SLURM) is writing."""
    for path in [*(folder / "products").glob(".*.part"), *(folder / "products").glob(".*.lock")]:
        run_id = path.name[1:].split(".h5")[0].removesuffix(".lock")
        if not is_locked(path.with_name(f".{run_id}.lock")):
            path.unlink(missing_ok=True)


def _run_batches(config: Config, folder: Path, rows: list[Row], missing: list[Row], watch: _Watch) -> None:
    """One yade-batch a stage over the stage's missing rows, all stages at once.

    A row waits until the run that it starts from is there and until one of the places for runs at once is free (see
    `campaign.row`), so no core waits for the last run of a stage.
    """
    alive, mine = os.pipe()  # its other end closes when this process ends, however it ends; every run watches it
    with contextlib.ExitStack() as stack:
        for end in (alive, mine):
            stack.callback(os.close, end)
        batches, wanted = {}, {row.run_id for row in missing}
        for stage in STAGES:
            _ended(folder, stage).unlink(missing_ok=True)
            lines = [k for k, row in enumerate(r for r in rows if r.stage == stage) if row.run_id in wanted]
            if not lines:
                _ended(folder, stage).touch()
                continue
            batches[stage] = _start_batch(config, folder, stage, lines, alive)
            stack.callback(batches[stage].terminate)
        while batches:
            watch.look(folder)
            with contextlib.suppress(subprocess.TimeoutExpired):
                next(iter(batches.values())).wait(timeout=0.5)
            for stage in [s for s, batch in batches.items() if batch.poll() is not None]:
                code = batches.pop(stage).returncode
                if code:
                    raise RunError(f"{folder}: yade-batch ended with status {code}; see logs/batch_{stage}.log")
                fail_refused(folder, look(folder, rows), stage)
                _ended(folder, stage).touch()
        watch.look(folder)


def _ended(folder: Path, stage: str) -> Path:
    """A file that tells the rows which wait that nothing more comes from this stage."""
    return folder / "batch" / f"ended_{stage}"


def _start_batch(config: Config, folder: Path, stage: str, rows: list[int], alive: int) -> subprocess.Popen:
    limits, places = config.run, jobs(config)
    env = closed_doors() | {
        "CAMPAIGN_CPU_LIMIT": repr(limits.cpu_limit), "CAMPAIGN_HANG_MINUTES": repr(limits.hang_minutes),
        "CAMPAIGN_RETRY": str(int(config.failures.retry)), "CAMPAIGN_JOBS": str(places), "CAMPAIGN_FRONT": str(alive),
    }  # fmt: skip
    env["PYTHONPATH"] = os.pathsep.join([env["PYTHONPATH"], os.path.relpath(ROOT, folder)])
    env.pop("OMP_NUM_THREADS")  # yade-batch takes it for the number of jobs
    command = [
        os.environ.get("CAMPAIGN_YADE_BATCH", "yade-batch"), "--jobs", str(places + 1), "--job-threads", "1",
        "--lines", ",".join(str(table_line(k)) for k in rows), "--log", "logs/@.log", "--plot-update", "0",
        "--disable-pynotify", "--executable", f"{sys.executable} -m campaign.row", str(table_path(Path(), stage)),
        script(folder, stage),
    ]  # fmt: skip
    with open(folder / "logs" / f"batch_{stage}.log", "w") as log:
        return subprocess.Popen(command, cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                                preexec_fn=_quiet_child, pass_fds=[alive])  # fmt: skip


def _quiet_child() -> None:
    """yade-batch dies with this process and outlives a closed terminal."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    die_with_parent()


class _Watch:
    """Counts products as they appear and tells how long it will take, from the pace of the runs so far."""

    def __init__(self, rows: list[Row], states: dict, config: Config, quiet: bool):
        rows = [row for row in rows if states[row.run_id].state != "spared"]
        self.total, self.jobs = len(rows), jobs(config)
        self.before = sum(s.state == "done" for s in states.values())
        self.cost = {row.run_id: row.cpu_seconds for row in rows if states[row.run_id].state != "done"}
        self.began, self.progress = time.monotonic(), Progress(quiet)

    def look(self, folder: Path) -> None:
        names = os.listdir(folder / "products")
        done = [n[:-3] for n in names if n.endswith(".h5") and n[:-3] in self.cost]
        failed = [n for n in names if n.endswith(".failed.json") and n.removesuffix(".failed.json") in self.cost]
        running = sum(n.endswith(".lock") for n in names)
        spent = time.monotonic() - self.began
        share = sum(self.cost[r] for r in done) / sum(self.cost.values())
        text = f"{bar(self.before + len(done), self.total)} · {running} running"
        text += f" · {len(failed)} failed" if failed else ""
        text += f" · {span(spent)} so far"
        if done:
            text += f" · about {span(spent * (1 - share) / share)} to go"
        self.progress.show(text)
