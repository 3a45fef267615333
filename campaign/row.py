"""One row, one process, one product: what yade-batch and SLURM start in place of `yade`.

    YADE_BATCH=batch/shear.table:17 python3 -m campaign.row [yade's own options] SCRIPT

Runs the row in YADE on one thread with its doors closed (see `doors/`), stops it if it hangs, and tells a run that
failed (a failure file with one line of reason) from a machine that failed (nothing written: the run stays missing).
Standard library only, so that starting it costs next to nothing.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from campaign.files import read_json, write_json, write_text
from campaign.plan import RETRY_STEP
from campaign.products import is_locked, record_sum, write_failure

OK, FAILED, ENVIRONMENT, BUSY = 0, 1, 74, 75
ROOM = 16 << 20
#: Reasons that tell of the machine, not of the run.
MACHINE = r"(?i)no space left|disk quota|read-only file system|cannot allocate memory|input/output error|errno = 28\b"
HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Task:
    """A line of a table: its cells as text, and the CPU seconds predicted for it."""

    table: Path
    line: int
    cells: dict[str, str]
    predicted: float

    def text(self, name: str) -> str:
        return self.cells.get(name, "").strip("'\"")


def run_row(table: Path, line: int, script: str) -> int:
    """Run one line of a table unless its product is there; returns 0, or how it ended."""
    task = read_task(table, line)
    product = Path(task.text("product"))
    run_id = product.stem
    if product.exists():
        return OK
    if (stopped := _wait_for_start(task, product)) is not None:
        return stopped
    lock_path = product.parent / f".{run_id}.lock"
    with _slot(), open(lock_path, "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(f"{run_id}: is running already")
            return BUSY
        if os.environ.get("CAMPAIGN_LOG"):  # nobody else keeps what is printed
            log = os.open(f"logs/{run_id}.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
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
    """The cells of a table's line, by the table's heading.  Raises ValueError for a line that holds no row."""
    lines = table.read_text(encoding="utf-8").splitlines()
    heading = next((k for k, text in enumerate(lines) if text.split("#")[0].strip()), None)
    if heading is None or not heading < line - 1 < len(lines):
        raise ValueError(f"{table}: line {line} holds no run")
    names, (body, _, note) = lines[heading].split(), lines[line - 1].partition("#")
    cells = body.split()
    if len(cells) != len(names):
        raise ValueError(f"{table}: line {line} has {len(cells)} values, the heading {len(names)}")
    found = re.search(r"([\d.]+) CPU-s", note)
    return Task(table, line, dict(zip(names, cells, strict=True)), float(found[1]) if found else 600.0)


def _wait_for_start(task: Task, product: Path) -> int | None:
    """Wait for the product that the run starts from, while a local campaign is still making its stage.

    Returns None when it is there, else how this run ends: with its start's failure, or missing like its start.
    """
    if not task.text("start"):
        return None
    start = Path(task.text("start"))
    while True:
        over = not os.environ.get("CAMPAIGN_JOBS") or Path(f"batch/ended_{start.stem.split('_')[0]}").exists()
        if start.exists():
            return None
        failed = start.with_suffix(".failed.json").exists()
        if failed and not is_locked(start.parent / f".{start.stem}.lock"):
            write_failure(product.parent, product.stem, f"its start {start.stem} failed", blocked=start.stem)
            return FAILED
        if over:
            print(f"{product.stem}: its start {start} is not there")
            return ENVIRONMENT
        _sleep(0.1)


@contextlib.contextmanager
def _slot():
    """One of the places for runs at once.  yade-batch keeps one row more in hand, so that no place stays empty."""
    places = int(os.environ.get("CAMPAIGN_JOBS", "0"))
    with contextlib.ExitStack() as stack:
        files = [stack.enter_context(open(f"batch/slot_{k}.lock", "w")) for k in range(places)]
        while files and not any(_locked_now(file) for file in files):
            _sleep(0.05)
        yield


def _locked_now(file) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _front() -> list[int]:
    """The pipe whose other end the local engine holds: it can be read only once that engine is gone."""
    return [int(fd) for fd in [os.environ.get("CAMPAIGN_FRONT")] if fd]


def _sleep(seconds: float) -> None:
    if select.select(_front(), [], [], seconds)[0]:
        os._exit(128 + signal.SIGTERM)


def _attempts(task: Task, product: Path, script: str) -> int:
    """The run, and once more with a smaller step where that can help."""
    result = _attempt(task, product, script, f"{task.table}:{task.line}")
    if result != FAILED or os.environ.get("CAMPAIGN_RETRY", "1") == "0":
        return result
    told = read_json(product.with_suffix(".failed.json"), {})
    if not told.get("retry", _can_help(told.get("reason", ""))):
        return result
    smaller = float(task.cells["timestep_factor"]) * RETRY_STEP
    print(f"{product.stem}: once more with timestep_factor = {smaller:g}, after: {told['reason']}", flush=True)
    cells = task.cells | {"timestep_factor": repr(smaller)}
    retry = task.table.parent / f"retry_{product.stem}.table"
    write_text(retry, "  ".join(cells) + "\n" + "  ".join(cells.values()) + "\n")
    product.with_suffix(".failed.json").unlink(missing_ok=True)
    result = _attempt(task, product, script, f"{retry}:2")
    if result == FAILED:
        again = read_json(product.with_suffix(".failed.json"), {})
        facts = {k: v for k, v in again.items() if k not in ("run_id", "reason", "time", "log")}
        write_failure(product.parent, product.stem, again.get("reason", ""), log=f"logs/{product.stem}.log",
                      **facts, retried=True, first_reason=told["reason"])  # fmt: skip
    return result


def _note_cost(failure: Path) -> None:
    """Add to the failure file what the run, its second try included, has cost."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    write_json(failure, read_json(failure, {}) | {"cpu_seconds": round(used.ru_utime + used.ru_stime, 2)})


def _can_help(reason: str) -> bool:
    """Whether a smaller step may cure what failed: instability, not a rate, a script error or a missing file."""
    return bool(re.search(r"not finite|nan\b|energy|blow|unstable|explod|signal (6|8|11)\b|overlap", reason, re.I))


def _attempt(task: Task, product: Path, script: str, batch: str) -> int:
    failure = product.with_suffix(".failed.json")
    log = f"logs/{product.stem}.log"
    yade = os.environ.get("CAMPAIGN_YADE") or "yade"
    if shutil.which(yade) is None:
        print(f"{yade}: no such program; `make setup` installs it", flush=True)
        return ENVIRONMENT
    if shutil.disk_usage(product.parent).free < ROOM:
        print(f"no space left: under {ROOM >> 20} MiB free for {product.parent}", flush=True)
        return ENVIRONMENT
    sys.stdout.flush()
    child = subprocess.Popen([yade, "-n", "-x", "-j1", script], env=closed_doors() | {"YADE_BATCH": batch},
                             stdin=subprocess.DEVNULL, preexec_fn=die_with_parent)  # fmt: skip
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda n, _: (_end(child), os._exit(128 + n)))
    stopped = _watch(child, task.predicted)
    if product.exists():
        failure.unlink(missing_ok=True)
        record_sum(product)
        return OK
    told = read_json(failure, {}).get("reason", "")
    if not stopped and (re.search(MACHINE, told) or shutil.disk_usage(product.parent).free < ROOM // 4):
        failure.unlink(missing_ok=True)
        print(f"not the run's fault, it stays missing: {told or 'no space left on the disk'}", flush=True)
        return ENVIRONMENT
    if not failure.exists():
        write_failure(product.parent, product.stem, stopped or _reason(child.returncode, Path(log)), log=log)
    return FAILED


def closed_doors() -> dict[str, str]:
    """The environment of a run: one thread, no screen, and no prompt or server on any port."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_"))}
    path = [str(HERE / "doors"), *env.get("PYTHONPATH", "").split(os.pathsep)]
    return env | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "DISPLAY": "",
                  "PYTHONPATH": os.pathsep.join(dict.fromkeys(p for p in path if p))}  # fmt: skip


def die_with_parent() -> None:
    """In a child about to start: be killed when the parent is (Linux)."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def _end(child: subprocess.Popen) -> None:
    child.kill()
    child.wait()


def _watch(child: subprocess.Popen, predicted: float) -> str:
    """Wait for the run; stop it when it has used far too much CPU, or none for long.  Returns why it was stopped."""
    most = float(os.environ.get("CAMPAIGN_CPU_LIMIT", "20")) * predicted
    patience = 60.0 * float(os.environ.get("CAMPAIGN_HANG_MINUTES", "10"))
    used, since = 0.0, time.monotonic()
    front = _front()
    ended = os.pidfd_open(child.pid)
    while True:
        ready, _, _ = select.select([ended, *front], [], [], min(1.0, patience / 4))
        if ended in ready:
            os.close(ended)
            child.wait()
            return ""
        if ready:  # the other end of the pipe is gone, and so is the campaign that asked for this run
            _end(child)
            os._exit(128 + signal.SIGTERM)
        now, waits_for_a_core = _cpu_seconds(child.pid)
        if now > used + 0.01 or waits_for_a_core:
            used, since = now, time.monotonic()
        if now > most:
            _end(child)
            return f"stopped: {now:.0f} CPU-s used, limit {most:.0f} (predicted {predicted:.0f})"
        if time.monotonic() - since > patience:
            _end(child)
            return f"stopped: no CPU used for {patience:.0f} s, after {used:.0f} CPU-s (hangs)"


def _cpu_seconds(pid: int) -> tuple[float, bool]:
    """CPU seconds that a process has used, and whether it could use more right now: a busy machine is no hang."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0, False
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"), fields[0] == "R"


def _reason(code: int, log: Path) -> str:
    """One line for a run that ended without product and without a word of its own."""
    if code < 0:
        return f"YADE ended by signal {-code} ({signal.Signals(-code).name})"
    try:
        lines = log.read_text(errors="replace").splitlines()[-200:]
    except OSError:
        lines = []
    errors = [line.strip() for line in lines if re.match(r"^\w*(\.\w+)*(Error|Exception|Interrupt|Warning)\b.*", line)]
    told = f": {errors[-1]}" if errors else ""
    return f"script error (exit {code}){told}" if code else f"YADE ended without a product{told}"


def main(argv: list[str]) -> int:
    """What yade-batch calls with yade's own arguments: the last one is the script, the row is in YADE_BATCH."""
    table, _, line = os.environ.get("YADE_BATCH", "").rpartition(":")
    try:
        return run_row(Path(table), int(line), argv[-1])
    except (ValueError, OSError, IndexError) as error:
        print(f"campaign.row: {error}", file=sys.stderr)
        return ENVIRONMENT


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
