"""The status of every run, judged by its product.

A run is done when its product exists, the product's checksum holds, and the parameters in it are those of the plan. The
outcome of a check is kept in products/checked.json with the file's size and times, so that the next check of an
unchanged product costs one `stat`. Without a product a run is done, too, if the folder's archive (runs.h5) holds it and
no run that is still to be made starts from it. A product that cannot be read now, since another process holds a lock on
it or the file system fails, is unknown: nothing is concluded from it, and nothing is done with it.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from analysis.errors_and_files import is_locked_elsewhere, open_without_locks
from campaign.config import ROOT
from campaign.files import read_json, say_once, write_json
from campaign.folder import file_sum, is_locked, record_sum, recorded_sums, recorded_times, write_failure
from campaign.plan import PlannedRun
from campaign.run_one import RETRY_STEP

ARCHIVE = "runs.h5"
CHECKED = "checked.json"
#: Record columns whose values must all be finite; the analysis checks the others when it reads a product.
FINITE = ("sigma", "e", "Z")
#: Facts of a run that are numbers; all others are texts or truth values.
NUMBERS = ("cpu_seconds", "wall_seconds", "steps", "resumed")


@dataclass(frozen=True)
class RunStatus:
    """The status of one run, the reason in one line, and facts such as CPU time.

    done: the product can be used. failed: the run failed, or the run that it starts from did. refused: there is a
    product that cannot be used. unknown: its product cannot be read now. running: a process works on it. queued: it
    waits in SLURM. missing: it is to be run. spared: it is not needed, since the target error was reached without it.
    """

    run_id: str
    status: str
    reason: str = ""
    facts: dict[str, Any] = field(default_factory=dict)


#: Reads everything in an HDF5 file and prints when a run wrote it.
READ_ALL = """
import sys
from analysis.errors_and_files import open_without_locks
with open_without_locks(sys.argv[1]) as file:
    file.visititems(lambda name, item: item[()] is None if hasattr(item, "shape") else None)
    print(file.attrs["created"])
"""
READ_SECONDS = 600.0


class UnreadableError(Exception):
    """A file is there and cannot be read now; the text is the reason. It says nothing about the file's contents."""


def run_statuses(
    folder: Path, rows: Sequence[PlannedRun], *, rehash: bool = False, spared: frozenset[str] = frozenset()
) -> dict[str, RunStatus]:
    """Return the status of every planned run, by run id.

    rehash: read every product again, also those whose size and times are unchanged. spared: ids of runs that are not
    needed; without a product they are "spared" instead of "missing". Raises analysis.runs.archive.ArchiveError if the
    folder's archive is damaged, OSError if the folder cannot be read.
    """
    products = folder / "products"
    names = set(os.listdir(products)) if products.is_dir() else set()
    cache = {} if rehash else _read_cache(products / CHECKED)
    checked, sums = dict(cache), None
    statuses: dict[str, RunStatus] = {}
    archive = archived(folder)
    if archive:
        _remove_needed_starts(archive, rows, names, spared)
    for row in rows:
        name = f"{row.run_id}.h5"
        if name in names:
            try:
                stamp = file_stamp(products / name)
                entry = cache.get(row.run_id)
                if entry is None or entry["stamp"] != stamp:
                    if _is_at_work(products, row.run_id, names):  # its checksum is not recorded yet
                        statuses[row.run_id] = _running(products, row.run_id)
                        continue
                    sums = _sums(products) if sums is None else sums
                    entry = {"stamp": stamp, **_check(products / name, row, sums)}
                    if file_stamp(products / name) != stamp:
                        raise UnreadableError("has changed while it was read")
                    checked[row.run_id] = entry
                reason = entry["reason"]
                status = RunStatus(row.run_id, "refused" if reason else "done", reason, entry["facts"])
            except UnreadableError as error:
                status = _unknown(row, f"{name}: {error}")
            except OSError as error:
                status = _unknown(row, f"{name}: cannot be read now: {error.strerror or error}")
        elif row.run_id in archive:
            status = RunStatus(row.run_id, "done", "", _archived_facts(archive[row.run_id], row))
        elif f"{row.run_id}.failed.json" in names:
            status = _failed(products, row, statuses)
        elif _is_at_work(products, row.run_id, names):
            status = _running(products, row.run_id)
        elif row.start and (start := statuses.get(row.start)) and start.status == "failed":
            status = RunStatus(row.run_id, "failed", f"its start {start.run_id} failed", {"blocked": start.run_id})
        else:
            status = RunStatus(row.run_id, "missing")
        if row.run_id in spared and status.status == "missing":
            status = RunStatus(row.run_id, "spared")
        statuses[row.run_id] = status
    if checked != cache:
        with contextlib.suppress(OSError):  # a folder that cannot be written can still be read
            write_json(products / CHECKED, checked)
    return statuses


def _is_at_work(products: Path, run_id: str, names: set[str]) -> bool:
    """Whether a process holds the lock of a run; names: the files in the folder of the products."""
    return f".{run_id}.lock" in names and is_locked(products / f".{run_id}.lock")


def _running(products: Path, run_id: str) -> RunStatus:
    return RunStatus(run_id, "running", "", {"elapsed": _elapsed(products / f".{run_id}.lock")})


def _elapsed(lock: Path) -> float:
    """Seconds since a run wrote its lock, which it does when it begins."""
    with contextlib.suppress(OSError):
        return max(0.0, time.time() - lock.stat().st_mtime)
    return 0.0


def archived(folder: Path) -> dict[str, dict[str, Any]]:
    """Return run id -> facts of each run in the folder's archive; empty without an archive.

    Raises analysis.runs.archive.ArchiveError if the archive is damaged.
    """
    path = folder / ARCHIVE
    if not path.exists():
        return {}
    from analysis.runs.archive import Archive

    return Archive(path).facts()


def _remove_needed_starts(
    archive: dict[str, dict], rows: Sequence[PlannedRun], names: set[str], spared: frozenset[str]
) -> None:
    """Remove from `archive` every run from which a run that is still to be made starts: that run needs its product."""
    for row in reversed(rows):
        has_outcome = (
            not names.isdisjoint((f"{row.run_id}.h5", f"{row.run_id}.failed.json"))
            or row.run_id in archive
            or row.run_id in spared
        )
        if not has_outcome:
            archive.pop(row.start, None)


def _archived_facts(summary: dict[str, Any], row: PlannedRun) -> dict[str, Any]:
    """The facts that `inspect_product` takes from a product, from the archive."""
    facts = {name: summary[name] for name in ("cpu_seconds", "wall_seconds", "steps")}
    facts |= {"exit_reason": summary["reason"], "script_digest": summary["script_digest"][:12], "archived": True}
    if summary["resumed"]:
        facts["resumed"] = summary["resumed"]
    if summary["step_factor"] != row.values["timestep_factor"]:
        facts["retried"] = True
    return facts


def _unknown(row: PlannedRun, reason: str) -> RunStatus:
    return RunStatus(row.run_id, "unknown", f"products/{reason}; nothing is done with it")


def _sums(products: Path) -> dict[str, str]:
    try:
        return recorded_sums(products)
    except OSError as error:
        raise UnreadableError(f"its checksum in SHA256SUMS cannot be read now: {error.strerror or error}") from None


def _read_cache(path: Path) -> dict[str, dict[str, Any]]:
    """The outcomes of earlier checks that are whole; what is damaged is checked anew."""
    try:
        entries = read_json(path, {})
    except OSError:
        return {}
    return {
        run_id: entry | {"facts": _plain_facts(entry["facts"])}
        for run_id, entry in entries.items()
        if isinstance(entry, dict)
        and isinstance(entry.get("stamp"), list)
        and isinstance(entry.get("reason"), str)
        and isinstance(entry.get("facts"), dict)
    }


def _plain_facts(facts: dict[str, Any]) -> dict[str, Any]:
    """Facts of a file that may have been damaged: numbers where numbers are expected, texts for the rest."""
    return {
        name: value if name not in NUMBERS else float(value) if name == "cpu_seconds" else value
        for name, value in facts.items()
        if name in NUMBERS and _is_number(value) or name not in NUMBERS and isinstance(value, (str, bool))
    }


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def clear_the_way(
    folder: Path, rows: Sequence[PlannedRun], *, again: bool, spared: frozenset[str]
) -> tuple[dict[str, RunStatus], list[PlannedRun]]:
    """Return the status of every run, and the rows to run now.

    Refused products are moved aside, with `again` failures are removed, and runs whose start failed get their failure
    file. A run whose start, or the start of that, is unknown is not run now. Raises OSError if the folder cannot be
    written.
    """
    statuses = run_statuses(folder, rows, spared=spared)
    write_blocked(folder, statuses)
    repeated = ("refused", "failed") if again else ("refused",)
    run_ids = [run_id for run_id, status in statuses.items() if status.status in repeated]
    if run_ids:
        set_aside(folder, run_ids)
        statuses = run_statuses(folder, rows, spared=spared)
    missing, waiting = [], {run_id for run_id, status in statuses.items() if status.status == "unknown"}
    for row in rows:
        if statuses[row.run_id].status == "missing":
            if row.start in waiting:
                waiting.add(row.run_id)
            else:
                missing.append(row)
    return statuses, missing


def stale(folder: Path, rows: Sequence[PlannedRun]) -> list[str]:
    """Return the ids of runs with a product, or in the archive, that are not in the plan; they are kept, never used."""
    names = os.listdir(folder / "products") if (folder / "products").is_dir() else []
    run_ids = {name[:-3] for name in names if name.endswith(".h5") and not name.startswith(".")}
    return sorted((run_ids | archived(folder).keys()) - {row.run_id for row in rows})


def write_blocked(folder: Path, statuses: dict[str, RunStatus]) -> None:
    """Give every run whose start failed a failure file of its own, so that a reader of the folder can count it."""
    for status in statuses.values():
        if "blocked" in status.facts and not (folder / "products" / f"{status.run_id}.failed.json").exists():
            write_failure(folder / "products", status.run_id, status.reason, **status.facts)


def set_aside(folder: Path, run_ids: Sequence[str]) -> None:
    """Prepare runs for another attempt: move their products to products/refused, remove failure files and checkpoints.

    Raises OSError if the folder cannot be written.
    """
    for run_id in run_ids:
        product = folder / "products" / f"{run_id}.h5"
        if product.exists():
            k = 1
            while (target := folder / "products" / "refused" / f"{run_id}.{k}.h5").exists():
                k += 1
            target.parent.mkdir(exist_ok=True)
            os.replace(product, target)
        for ending in (".failed.json", ".checkpoint"):
            (folder / "products" / f"{run_id}{ending}").unlink(missing_ok=True)


def file_stamp(path: Path) -> list[int]:
    """Return the size and times of a file, which change when the file does. Raises OSError if it is missing."""
    stat = path.stat()
    return [stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns]


def _failed(products: Path, row: PlannedRun, statuses: dict[str, RunStatus]) -> RunStatus:
    """The status of a run with a failure file; "missing" if it failed for its start only, and the start is repeated."""
    try:
        failure = read_json(products / f"{row.run_id}.failed.json")
    except OSError as error:
        return _unknown(row, f"{row.run_id}.failed.json: cannot be read now: {error.strerror or error}")
    if not isinstance(failure, dict):
        return RunStatus(row.run_id, "failed", "its failure file is damaged", {})
    start = statuses.get(row.start)
    if failure.get("blocked") and not (start and start.status == "failed"):
        return RunStatus(row.run_id, "missing")
    facts = _plain_facts({k: v for k, v in failure.items() if k not in ("run_id", "reason")})
    reason = " ".join(str(failure.get("reason", "no reason given")).split())[:400]
    return RunStatus(row.run_id, "failed", reason, facts)


def _check(path: Path, row: PlannedRun, sums: dict[str, str]) -> dict[str, Any]:
    """The outcome of reading a product: {"reason": "" or one line, "facts": ...}.

    Raises UnreadableError or OSError if it cannot be read now.
    """
    if is_locked(path):
        raise UnreadableError("another process holds a lock on it")
    recorded = sums.get(path.name)
    remade = bool(recorded) and file_sum(path) != recorded
    if remade and not _is_made_again(path):
        return {"reason": "its bytes have changed since it was written (checksum)", "facts": {}}
    try:
        reason, facts = inspect_product(path, row)
    except (OSError, KeyError, ValueError, RuntimeError, TypeError) as error:  # what h5py raises for damaged files
        if isinstance(error, OSError):
            _raise_if_unreadable(error)
        return {"reason": f"cannot be read as a run file: {' '.join(str(error).split())[:120]}", "facts": {}}
    if not reason and (remade or not recorded):
        with contextlib.suppress(OSError):  # in a read-only folder the product can still be used
            record_sum(path)
        if remade:
            say_once(
                f"products/{path.name} was made again by hand, with the plan's parameters; its checksum is updated"
            )
    return {"reason": reason, "facts": facts}


def _raise_if_unreadable(error: OSError) -> None:
    """Raise UnreadableError if the system could not read a file: that says nothing about what is in it."""
    if is_locked_elsewhere(error):
        raise UnreadableError("another process holds a lock on it") from None
    errno = error.errno or int((re.search(r"errno = (\d+)", str(error)) or [0, 0])[1])
    if errno > 0:
        raise UnreadableError(f"cannot be read now: {os.strerror(errno)}") from None


def _is_made_again(path: Path) -> bool:
    """Whether a product whose checksum is not the recorded one was made after that was recorded, and is whole.

    A run states when it wrote its product, and damage changes bytes of an older one. Everything in it is read, which
    compares the checksums of what HDF5 keeps packed: in a process of its own, since damage can end that by a signal.
    """
    try:
        recorded = datetime.fromisoformat(recorded_times(path.parent).get(path.name, ""))
        if path.stat().st_mtime < recorded.timestamp():
            return False
        command = [sys.executable, "-c", READ_ALL, str(path)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=READ_SECONDS)
        return not done.returncode and recorded <= datetime.fromisoformat(done.stdout.strip()) <= datetime.now(UTC)
    except (TypeError, ValueError, subprocess.TimeoutExpired):  # no time was noted, or it has no zone
        return False


def inspect_product(path: Path, row: PlannedRun) -> tuple[str, dict[str, Any]]:
    """Return why a product is not that of the planned run ("" if it is), and its facts.

    Reads the attributes and the record, not the snapshots. Raises OSError, KeyError, ValueError, RuntimeError or
    TypeError for a file that is damaged or no HDF5 file.
    """
    import numpy as np

    with open_without_locks(path) as file:
        head = dict(file.attrs)
        if head.get("format") != "dem-run":
            return f"is no run file: format = {head.get('format')!r}", {}
        if not head.get("complete", False):
            return "is not complete", {}
        for name, planned in (("run_id", row.run_id), ("stage", row.stage)):
            if head.get(name) != planned:
                return f"belongs to another plan: {name} = {head.get(name)!r}, planned {planned!r}", {}
        parameters = dict(file["parameters"].attrs)
        code, planned_code = str(head.get("code", "yade")), row.values.get("code", "yade")
        if code != planned_code:
            return f"belongs to another plan: code = {code!r}, planned {planned_code!r}", {}
        if reason := _mismatch(parameters, row):
            return reason, {}
        record = file.get("record", {})
        for symbol in (symbol for symbol in FINITE if symbol in record):
            values = record[symbol]
            # a consolidation begins without contacts, where ratios over the contacts have no value
            if not np.all(np.isfinite(values[-1] if row.stage == "consolidate" else values[...])):
                return f"has values of {symbol} that are not finite", {}
        timing = {k: float(v) for k, v in file["timing"].attrs.items()} if "timing" in file else {}
        facts: dict[str, Any] = {k: timing[k] for k in ("cpu_seconds", "wall_seconds", "steps") if k in timing}
        facts["exit_reason"] = str(head.get("exit_reason", ""))
        facts["script_digest"] = str(head.get("script_digest", ""))[:12]
        if int(head.get("resumed", 0)):
            facts["resumed"] = int(head["resumed"])
        if parameters.get("timestep_factor") != row.values["timestep_factor"]:
            facts["retried"] = True
        return "", facts


def _mismatch(parameters: dict[str, Any], row: PlannedRun) -> str:
    """The first parameter of a product that differs from the plan, as one line; "" if none does."""
    for name, planned in row.values.items():
        if name not in parameters or name in ("assembly", "start"):
            continue
        value = parameters[name]
        value = value.item() if hasattr(value, "item") else value
        allowed = [planned, planned * RETRY_STEP] if name == "timestep_factor" else [planned]
        if not any(_same(value, a) for a in allowed):
            return f"belongs to another plan: {name} = {_show(value)}, planned {_show(planned)}"
    return ""


def _same(value: Any, planned: Any) -> bool:
    if isinstance(planned, (int, float)) and isinstance(value, (int, float)):
        return abs(value - planned) <= 1e-12 * abs(planned)
    return str(value) == str(planned)


def _show(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else json.dumps(value, default=str)
