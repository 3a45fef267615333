"""Supervises one run in YADE or LAMMPS: yade-batch and SLURM start this in place of `yade`, once per row of a table.

    YADE_BATCH=batch/shear.table:17 python3 -m campaign.run_one [options of yade] SCRIPT

Runs the row in YADE on one thread and without network servers (see `no_servers/`), or, if its column `code` says so, in
LAMMPS (`campaign.lammps`). Stops the run if it hangs, and repeats it once with a smaller time step where that can help.
If the run failed, it writes a failure file with the reason in one line; if the machine failed (no YADE, disk full, YADE
killed from outside), it writes nothing, so that the run stays missing and keeps its checkpoint. Each run has a folder
of its own for temporary files, which ends with it.

Exit codes: 0 the product is there, 1 the run failed, 74 the machine failed, 75 another process works on this run.
Standard library only, so that the start takes little time.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from campaign.files import read_json, write_json, write_text
from campaign.folder import HeldError, exclusive, is_locked, open_plain, record_sum, write_failure

OK, FAILED, ENVIRONMENT, BUSY = 0, 1, 74, 75
#: Factor on the time step in the second attempt of a run.
RETRY_STEP = 0.5
#: Free disk space that a run needs to start, bytes.
FREE_BYTES = 16 << 20
#: CPU seconds that are assumed for a row without a prediction.
UNKNOWN_CPU_SECONDS = 600.0
#: Failure reasons that the machine causes, not the run.
MACHINE = (
    r"(?i)no space left|disk quota|read-only file system|cannot allocate memory|input/output error|errno = 28\b"
    r"|unable to lock file|no locks available|stale file handle|^KeyboardInterrupt"
)
#: Signals by which a process ends through its own fault; any other one comes from outside, from a user or the kernel.
CRASHES = (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGTRAP, signal.SIGSYS)
#: The program of each code.
PROGRAMS = {"yade": "yade", "lammps": "lmp"}
HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Task:
    """One line of a table: its cells as text by column name, and the predicted CPU seconds."""

    table: Path
    line: int
    cells: dict[str, str]
    predicted: float

    def text(self, name: str) -> str:
        """A cell without its quotes; "" if the table has no such column."""
        return self.cells.get(name, "").strip("'\"")


def run_row(table: Path, line: int, script: str) -> int:
    """Run one line (from 1) of a table unless its product is there. Returns OK, FAILED, ENVIRONMENT or BUSY.

    Raises ValueError for a line that holds no run, OSError if the table or the folder cannot be used.
    """
    task = read_task(table, line)
    product = Path(task.text("product"))
    run_id = product.stem
    if product.exists():
        return OK
    if (outcome := _wait_for_start(task, product)) is not None:
        return outcome
    lock_path = product.parent / f".{run_id}.lock"
    with contextlib.ExitStack() as stack:
        stack.enter_context(_slot())
        try:
            stack.enter_context(exclusive(lock_path))
        except HeldError as held:
            print(f"{run_id}: is running already ({held})")
            return BUSY
        if os.environ.get("CAMPAIGN_LOG"):  # in SLURM, where nothing else writes the output to the log
            log = open_plain(Path(f"logs/{run_id}.log"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(log, 1)
            os.dup2(log, 2)
        try:
            result = _attempts(task, product, script)
            if result == FAILED:
                _note_cost(product.with_suffix(".failed.json"))
            return result
        finally:
            lock_path.unlink(missing_ok=True)


def read_task(table: Path, line: int) -> Task:
    """Return the cells of a table's line (from 1) by the names in the heading.

    Raises ValueError for a line that holds no run, OSError if the table cannot be read.
    """
    lines = table.read_text(encoding="utf-8").splitlines()
    heading = next((k for k, text in enumerate(lines) if text.split("#")[0].strip()), None)
    if heading is None or not heading < line - 1 < len(lines):
        raise ValueError(f"{table}: line {line} holds no run")
    names, (body, _, note) = lines[heading].split(), lines[line - 1].partition("#")
    cells = body.split()
    if len(cells) != len(names):
        raise ValueError(f"{table}: line {line} has {len(cells)} values, the heading {len(names)}")
    predicted = re.search(r"([\d.]+) CPU-s", note)
    cpu_seconds = float(predicted[1]) if predicted else UNKNOWN_CPU_SECONDS
    return Task(table, line, dict(zip(names, cells, strict=True)), cpu_seconds)


def _wait_for_start(task: Task, product: Path) -> int | None:
    """Wait for the product that the run starts from, as long as the local engine works on that product's stage.

    Returns None once the product is there, FAILED if the start failed, ENVIRONMENT if the start is missing.
    """
    if not task.text("start"):
        return None
    start = Path(task.text("start"))
    while True:
        stage_ended = not os.environ.get("CAMPAIGN_JOBS") or Path(f"batch/ended_{start.stem.split('_')[0]}").exists()
        if start.exists():
            return None
        start_failed = start.with_suffix(".failed.json").exists()
        if start_failed and not is_locked(start.parent / f".{start.stem}.lock"):
            write_failure(product.parent, product.stem, f"its start {start.stem} failed", blocked=start.stem)
            return FAILED
        if stage_ended:
            print(f"{product.stem}: its start {start} is not there")
            return ENVIRONMENT
        _sleep(0.1)


@contextlib.contextmanager
def _slot() -> Iterator[None]:
    """Take one of the CAMPAIGN_JOBS places for runs at once, and wait until one is free.

    yade-batch starts one process more than there are places, so that no place stays empty between two runs.
    """
    places = int(os.environ.get("CAMPAIGN_JOBS", "0"))
    with contextlib.ExitStack() as stack:
        while places and not any(_taken(stack, Path(f"batch/slot_{k}.lock")) for k in range(places)):
            _sleep(0.05)
        yield


def _taken(stack: contextlib.ExitStack, place: Path) -> bool:
    try:
        stack.enter_context(exclusive(place))
    except HeldError:
        return False
    return True


def _engine_pipe() -> list[int]:
    """The pipe whose other end the local engine holds: it becomes readable once the engine has ended."""
    return [int(fd) for fd in [os.environ.get("CAMPAIGN_FRONT")] if fd]


def _sleep(seconds: float) -> None:
    """Sleep; end this process if the local engine ends in the meantime."""
    if select.select(_engine_pipe(), [], [], seconds)[0]:
        os._exit(128 + signal.SIGTERM)


def _attempts(task: Task, product: Path, script: str) -> int:
    """Run the task, and once more with a smaller time step if it failed in a way that this can help."""
    result = _attempt(task, product, script, f"{task.table}:{task.line}")
    if result != FAILED or os.environ.get("CAMPAIGN_RETRY", "1") == "0":
        return result
    failure = read_json(product.with_suffix(".failed.json"), {})
    first_reason = str(failure.get("reason", ""))
    if not failure.get("retry", _smaller_step_can_help(first_reason)):
        return result
    smaller = float(task.cells["timestep_factor"]) * RETRY_STEP
    print(f"{product.stem}: once more with timestep_factor = {smaller:g}, after: {first_reason}", flush=True)
    cells = task.cells | {"timestep_factor": repr(smaller)}
    retry = task.table.parent / f"retry_{product.stem}.table"
    write_text(retry, "  ".join(cells) + "\n" + "  ".join(cells.values()) + "\n")
    product.with_suffix(".failed.json").unlink(missing_ok=True)
    result = _attempt(task, product, script, f"{retry}:2")
    if result == FAILED:
        second = read_json(product.with_suffix(".failed.json"), {})
        facts = {k: v for k, v in second.items() if k not in ("run_id", "reason", "time", "log")}
        write_failure(product.parent, product.stem, second.get("reason", ""), log=f"logs/{product.stem}.log",
                      **facts, retried=True, first_reason=first_reason)  # fmt: skip
    return result


def _note_cost(failure: Path) -> None:
    """Add the CPU time of the run, all attempts together, to its failure file."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    write_json(failure, read_json(failure, {}) | {"cpu_seconds": round(used.ru_utime + used.ru_stime, 2)})


def _smaller_step_can_help(reason: str) -> bool:
    """Whether the reason is an instability, and not a rate, an error in a script or a missing file."""
    return bool(re.search(r"not finite|nan\b|energy|blow|unstable|explod|signal (6|8|11)\b|overlap", reason, re.I))


def _attempt(task: Task, product: Path, script: str, batch: str) -> int:
    """Run the code once and judge the outcome; `batch` is the value of YADE_BATCH."""
    failure = product.with_suffix(".failed.json")
    log = f"logs/{product.stem}.log"
    code = task.text("code") or "yade"
    name, variable = ("YADE", "CAMPAIGN_YADE") if code == "yade" else ("LAMMPS", "CAMPAIGN_LMP")
    program = os.environ.get(variable) or PROGRAMS[code]
    if shutil.which(program) is None:
        print(f"{program}: no such program on this machine; {variable} can name another one", flush=True)
        return ENVIRONMENT
    command = [program, "-n", "-x", "-j1", script] if code == "yade" else _lammps_command(script)
    if shutil.disk_usage(product.parent).free < FREE_BYTES:
        print(f"no space left: under {FREE_BYTES >> 20} MiB free for {product.parent}", flush=True)
        return ENVIRONMENT
    sys.stdout.flush()
    place = product.parent.resolve() / f".{product.stem}.tmp"
    child: subprocess.Popen | None = None

    def end_with_child(number: int, frame: object) -> None:
        if child is not None:  # else it ends with this process
            _end(child)
        failure.unlink(missing_ok=True)  # what YADE states when it is interrupted, too, is no failure of the run
        _remove_folder(place)
        os._exit(128 + number)

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, end_with_child)
    with _temporary_folder(place):
        env = run_environment() | {"YADE_BATCH": batch, "TMPDIR": str(place)}
        child = subprocess.Popen(command, env=env, stdin=subprocess.DEVNULL,
                                 preexec_fn=die_with_parent)  # fmt: skip
        stopped = _watch(child, task.predicted, place)
    if product.exists():
        failure.unlink(missing_ok=True)
        record_sum(product)
        return OK
    reason = str(read_json(failure, {}).get("reason", "")) or _killed(child.returncode, name)
    if code != "yade" and child.returncode == ENVIRONMENT and not stopped:
        failure.unlink(missing_ok=True)
        return ENVIRONMENT  # the code has stated why
    if not stopped and (re.search(MACHINE, reason) or shutil.disk_usage(product.parent).free < FREE_BYTES // 4):
        failure.unlink(missing_ok=True)
        print(f"not the run's fault, it stays missing: {reason or 'no space left on the disk'}", flush=True)
        return ENVIRONMENT
    if not stopped and not failure.exists() and _killed(child.returncode, name):
        print(f"not the run's fault, it stays missing: {reason}", flush=True)
        return ENVIRONMENT
    if not failure.exists():
        write_failure(product.parent, product.stem, stopped or _reason(child.returncode, Path(log), name), log=log)
    return FAILED


def _lammps_command(script: str) -> list[str]:
    """The command that runs a row in LAMMPS; the stage is that of the script which YADE would run."""
    return [sys.executable, "-m", "campaign.lammps", Path(script).stem]


def run_environment() -> dict[str, str]:
    """Return the environment variables of a run: one thread, no display, and no server on any network port."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_"))}
    path = [str(HERE / "no_servers"), *env.get("PYTHONPATH", "").split(os.pathsep)]
    return env | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "DISPLAY": "",
                  "HDF5_USE_FILE_LOCKING": "FALSE",  # some file systems have no locks, and a run shares no open file
                  "PYTHONPATH": os.pathsep.join(dict.fromkeys(p for p in path if p))}  # fmt: skip


@contextlib.contextmanager
def _temporary_folder(place: Path) -> Iterator[None]:
    """Make the folder for the temporary files of a run; what a killed run left in it is removed before."""
    _remove_folder(place)
    place.mkdir()
    try:
        yield
    finally:
        _remove_folder(place)


def _remove_folder(place: Path) -> None:
    if place.is_symlink():
        place.unlink()
    shutil.rmtree(place, ignore_errors=True)


def die_with_parent(number: int = signal.SIGKILL) -> None:
    """In a child process before it starts: ask Linux to send it this signal, which kills it, when its parent ends."""
    ctypes.CDLL(None).prctl(1, number)


def _end(child: subprocess.Popen) -> None:
    child.kill()
    child.wait()


def _watch(child: subprocess.Popen, predicted: float, place: Path) -> str:
    """Wait for the run; stop it once it has used far too much CPU time, or none for a long time.

    place: the run's temporary files. Returns why it was stopped, "" if it ended by itself. Ends this process if the
    local engine ends.
    """
    cpu_limit = float(os.environ.get("CAMPAIGN_CPU_LIMIT", "20")) * predicted
    patience = 60.0 * float(os.environ.get("CAMPAIGN_HANG_MINUTES", "10"))
    used, since = 0.0, time.monotonic()
    engine = _engine_pipe()
    ended = os.pidfd_open(child.pid)
    while True:
        ready, _, _ = select.select([ended, *engine], [], [], min(1.0, patience / 4))
        if ended in ready:
            os.close(ended)
            child.wait()
            return ""
        if ready:  # the local engine has ended
            _end(child)
            _remove_folder(place)
            os._exit(128 + signal.SIGTERM)
        now, waits_for_a_core = _cpu_seconds(child.pid)
        if now > used + 0.01 or waits_for_a_core:
            used, since = now, time.monotonic()
        if now > cpu_limit:
            _end(child)
            return f"stopped: {now:.0f} CPU-s used, limit {cpu_limit:.0f} (predicted {predicted:.0f})"
        if time.monotonic() - since > patience:
            _end(child)
            return f"stopped: no CPU used for {patience:.0f} s, after {used:.0f} CPU-s (hangs)"


def _cpu_seconds(pid: int) -> tuple[float, bool]:
    """CPU seconds that a process and those it started have used, and whether one of them waits for a core.

    On a busy machine a process that waits is no hang. What an ended child has used counts for its parent.
    """
    try:
        fields = _stat(pid)
    except OSError:
        return 0.0, False
    used, waits = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK"), fields[0] == "R"
    for child in _children(pid):
        of_child, child_waits = _cpu_seconds(child)
        used, waits = used + of_child, waits or child_waits
    return used, waits


def _stat(pid: int) -> list[str]:
    """What Linux states of a process from its state on. Raises OSError if there is no such process."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def _children(pid: int) -> list[int]:
    """The processes that a process has started; not every Linux kernel lists them, and then all are asked."""
    with contextlib.suppress(OSError):
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if int(_stat(int(path.name))[1]) == pid:
                found.append(int(path.name))
    return found


def _signal(code: int) -> int:
    """The signal that ended a code by its exit code, 0 if none did; a shell around it adds 128."""
    number = -code if code < 0 else code - 128 if code > 128 else 0
    return number if number in {*signal.Signals} or code < 0 else 0


def _killed(code: int, name: str = "YADE") -> str:
    """By which signal a code of that name was killed from outside, in one line; "" if it was not."""
    number = _signal(code)
    return f"{name} was killed by signal {number} ({_signal_name(number)})" if number and number not in CRASHES else ""


def _signal_name(number: int) -> str:
    return signal.Signals(number).name if number in {*signal.Signals} else "real-time"


def _reason(code: int, log: Path, name: str = "YADE") -> str:
    """The reason, in one line, of a run that ended without a product and without a failure file."""
    if number := _signal(code):
        return f"{name} ended by signal {number} ({_signal_name(number)})"
    try:
        lines = log.read_text(errors="replace").splitlines()[-200:]
    except OSError:
        lines = []
    errors = [line.strip() for line in lines if re.match(r"^\w*(\.\w+)*(Error|Exception|Interrupt|Warning)\b.*", line)]
    last_error = f": {errors[-1]}" if errors else ""
    return f"script error (exit {code}){last_error}" if code else f"{name} ended without a product{last_error}"


def main(argv: list[str]) -> int:
    """Run the row that YADE_BATCH names (TABLE:LINE); the last argument is the script. Returns the exit code."""
    table, _, line = os.environ.get("YADE_BATCH", "").rpartition(":")
    try:
        return run_row(Path(table), int(line), argv[-1])
    except (ValueError, OSError, IndexError) as error:
        print(f"campaign.run_one: {error}", file=sys.stderr)
        return ENVIRONMENT


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
