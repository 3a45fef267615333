"""The status of every run, judged by its product.

A run is done when its product exists, the product's checksum holds, and the parameters in it are those of the plan. The
outcome of a check is kept in products/checked.json with the file's size and times, so that the next check of an
unchanged product costs one `stat`. Without a product a run is done, too, if the folder's archive (runs.h5) holds it and
no run that is still to be made starts from it.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from campaign.files import read_json, write_json
from campaign.folder import file_sum, is_locked, record_sum, recorded_sums, write_failure
from campaign.plan import PlannedRun
from campaign.run_one import RETRY_STEP

ARCHIVE = "runs.h5"
CHECKED = "checked.json"
#: Record columns whose values must all be finite; the analysis checks the others when it reads a product.
FINITE = ("sigma", "e", "Z")


@dataclass(frozen=True)
class RunStatus:
    """The status of one run, the reason in one line, and facts such as CPU time.

    done: the product can be used. failed: the run failed, or the run that it starts from did. refused: there is a
    product that cannot be used. running: a process works on it. queued: it waits in SLURM. missing: it is to be run.
    spared: it is not needed, since the target error was reached without it.
    """

    run_id: str
    status: str
    reason: str = ""
    facts: dict[str, Any] = field(default_factory=dict)


def run_statuses(
    folder: Path, rows: Sequence[PlannedRun], *, rehash: bool = False, spared: frozenset[str] = frozenset()
) -> dict[str, RunStatus]:
    """Return the status of every planned run, by run id.

    rehash: read every product again, also those whose size and times are unchanged. spared: ids of runs that are not
    needed; without a product they are "spared" instead of "missing". Raises analysis.runs.archive.ArchiveError if the
    folder's archive is damaged.
    """
    products = folder / "products"
    names = set(os.listdir(products)) if products.is_dir() else set()
    cache = {} if rehash else read_json(products / CHECKED, {})
    checked, sums = dict(cache), None
    statuses: dict[str, RunStatus] = {}
    archive = archived(folder)
    if archive:
        _remove_needed_starts(archive, rows, names, spared)
    for row in rows:
        name = f"{row.run_id}.h5"
        if name in names:
            stamp = file_stamp(products / name)
            entry = cache.get(row.run_id)
            if entry is None or entry["stamp"] != stamp:
                sums = recorded_sums(products) if sums is None else sums
                entry = {"stamp": stamp, **_check(products / name, row, sums)}
                checked[row.run_id] = entry
            reason = entry["reason"]
            status = RunStatus(row.run_id, "refused" if reason else "done", reason, entry["facts"])
        elif row.run_id in archive:
            status = RunStatus(row.run_id, "done", "", _archived_facts(archive[row.run_id], row))
        elif f"{row.run_id}.failed.json" in names:
            status = _failed(products, row, statuses)
        elif f".{row.run_id}.lock" in names and is_locked(products / f".{row.run_id}.lock"):
            status = RunStatus(row.run_id, "running")
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


def clear_the_way(
    folder: Path, rows: Sequence[PlannedRun], *, again: bool, spared: frozenset[str]
) -> tuple[dict[str, RunStatus], list[PlannedRun]]:
    """Return the status of every run, and the rows to run now.

    Refused products are moved aside, with `again` failures are removed, and runs whose start failed get their failure
    file. Raises OSError if the folder cannot be written.
    """
    statuses = run_statuses(folder, rows, spared=spared)
    write_blocked(folder, statuses)
    repeated = ("refused", "failed") if again else ("refused",)
    run_ids = [run_id for run_id, status in statuses.items() if status.status in repeated]
    if run_ids:
        set_aside(folder, run_ids)
        statuses = run_statuses(folder, rows, spared=spared)
    return statuses, [row for row in rows if statuses[row.run_id].status == "missing"]


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
    failure = read_json(products / f"{row.run_id}.failed.json")
    if not isinstance(failure, dict):
        return RunStatus(row.run_id, "failed", "its failure file is damaged", {})
    start = statuses.get(row.start)
    if failure.get("blocked") and not (start and start.status == "failed"):
        return RunStatus(row.run_id, "missing")
    facts = {k: v for k, v in failure.items() if k not in ("run_id", "reason")}
    return RunStatus(row.run_id, "failed", str(failure.get("reason", "no reason given")), facts)


def _check(path: Path, row: PlannedRun, sums: dict[str, str]) -> dict[str, Any]:
    """The outcome of reading a product: {"reason": "" or one line, "facts": ...}."""
    recorded = sums.get(path.name)
    if recorded and file_sum(path) != recorded:
        return {"reason": "its bytes have changed since it was written (checksum)", "facts": {}}
    try:
        reason, facts = inspect_product(path, row)
    except (OSError, KeyError, ValueError, RuntimeError, TypeError) as error:  # what h5py raises for damaged files
        return {"reason": f"cannot be read as a run file: {' '.join(str(error).split())[:120]}", "facts": {}}
    if not reason and not recorded:
        with contextlib.suppress(OSError):  # in a read-only folder the product can still be used
            record_sum(path)
    return {"reason": reason, "facts": facts}


def inspect_product(path: Path, row: PlannedRun) -> tuple[str, dict[str, Any]]:
    """Return why a product is not that of the planned run ("" if it is), and its facts.

    Reads the attributes and the record, not the snapshots. Raises OSError, KeyError, ValueError, RuntimeError or
    TypeError for a file that is damaged or no HDF5 file.
    """
    import h5py
    import numpy as np

    with h5py.File(path, "r") as file:
        head = dict(file.attrs)
        if head.get("format") != "dem-run":
            return f"is no run file: format = {head.get('format')!r}", {}
        if not head.get("complete", False):
            return "is not complete", {}
        for name, planned in (("run_id", row.run_id), ("stage", row.stage)):
            if head.get(name) != planned:
                return f"belongs to another plan: {name} = {head.get(name)!r}, planned {planned!r}", {}
        parameters = dict(file["parameters"].attrs)
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
