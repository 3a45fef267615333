"""A run's product: there? whole? whose?

A run is done when its product is there, its checksum holds and the parameters in it are the plan's.  The outcome of a
check is kept in products/checked.json beside the file's size and times, so that looking again costs one `stat`.
Without a product a run is done, too, if the folder's archive (runs.h5) has it and no run still to be made starts
from it.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import time
from dataclasses import dataclass, field
from pathlib import Path

from campaign.files import read_json, write_json
from campaign.plan import RETRY_STEP, Row

ARCHIVE = "runs.h5"
SUMS = "SHA256SUMS"
CHECKED = "checked.json"
#: What must be finite in every record; the analysis checks the rest when it reads.
FINITE = ("sigma", "e", "Z")


@dataclass(frozen=True)
class State:
    """What became of one run: done, failed, refused (a product that can't be used), running, missing or spared."""

    run_id: str
    state: str
    reason: str = ""
    facts: dict = field(default_factory=dict)


def look(
    folder: Path, rows: list[Row], *, rehash: bool = False, spared: frozenset[str] = frozenset()
) -> dict[str, State]:
    """The state of every row, by run id.  rehash: read every product again, however unchanged it looks.

    spared: ids of runs that the answer does not need; they are "spared", not "missing", where there is no product.
    """
    products = folder / "products"
    names = set(os.listdir(products)) if products.is_dir() else set()
    cache = {} if rehash else read_json(products / CHECKED, {})
    fresh, states, sums, kept = dict(cache), {}, None, archived(folder)
    if kept:
        _forget_needed_starts(kept, rows, names, spared)
    for row in rows:
        name = f"{row.run_id}.h5"
        if name in names:
            stamp = _stamp(products / name)
            entry = cache.get(row.run_id)
            if entry is None or entry["stamp"] != stamp:
                sums = recorded_sums(products) if sums is None else sums
                entry = {"stamp": stamp, **_check(products / name, row, sums)}
                fresh[row.run_id] = entry
            bad = entry["reason"]
            states[row.run_id] = State(row.run_id, "refused" if bad else "done", bad, entry["facts"])
        elif row.run_id in kept:
            states[row.run_id] = State(row.run_id, "done", "", _facts(kept[row.run_id], row))
        elif f"{row.run_id}.failed.json" in names:
            states[row.run_id] = _failed(products, row, states)
        elif f".{row.run_id}.lock" in names and is_locked(products / f".{row.run_id}.lock"):
            states[row.run_id] = State(row.run_id, "running")
        elif row.start and (first := states.get(row.start)) and first.state == "failed":
            states[row.run_id] = State(row.run_id, "failed", _blocked(first), {"blocked": first.run_id})
        else:
            states[row.run_id] = State(row.run_id, "missing")
        if row.run_id in spared and states[row.run_id].state == "missing":
            states[row.run_id] = State(row.run_id, "spared")
    if fresh != cache:
        _keep(products / CHECKED, fresh)
    return states


def archived(folder: Path) -> dict[str, dict]:
    """Run id -> what the folder's archive tells of the run (`analysis.archive`); empty without an archive."""
    path = folder / ARCHIVE
    if not path.exists():
        return {}
    from analysis.archive import Archive

    return Archive(path).facts()


def _forget_needed_starts(kept: dict, rows: list[Row], names: set[str], spared: frozenset[str]) -> None:
    """Take from the archive's runs those that a run still to be made starts from: it needs their product."""
    for row in reversed(rows):
        outcome = {f"{row.run_id}.h5", f"{row.run_id}.failed.json"} & names or {row.run_id} & (kept.keys() | spared)
        if not outcome:
            kept.pop(row.start, None)


def _facts(told: dict, row: Row) -> dict:
    """What status tells of an archived run, as `inspect` does of a product."""
    facts = {name: told[name] for name in ("cpu_seconds", "wall_seconds", "steps")}
    facts |= {"exit_reason": told["reason"], "script_digest": told["script_digest"][:12], "archived": True}
    if told["resumed"]:
        facts["resumed"] = told["resumed"]
    if told["step_factor"] != row.values["timestep_factor"]:
        facts["retried"] = True
    return facts


def clear_the_way(
    folder: Path, rows: list[Row], *, again: bool, spared: frozenset[str]
) -> tuple[dict[str, State], list[Row]]:
    """The states of all rows and the rows to run now; refused products are set aside, failures forgotten if `again`."""
    states = look(folder, rows, spared=spared)
    write_blocked(folder, states)
    redo = [r for r, s in states.items() if s.state in ({"refused", "failed"} if again else {"refused"})]
    if redo:
        set_aside(folder, redo)
        states = look(folder, rows, spared=spared)
    return states, [row for row in rows if states[row.run_id].state == "missing"]


def stale(folder: Path, rows: list[Row]) -> list[str]:
    """Run ids with a product, or in the archive, that the plan no longer names: kept, never used."""
    names = os.listdir(folder / "products") if (folder / "products").is_dir() else []
    found = {n[:-3] for n in names if n.endswith(".h5") and not n.startswith(".")} | archived(folder).keys()
    return sorted(found - {row.run_id for row in rows})


def write_failure(products: Path, run_id: str, reason: str, log: str = "", **facts) -> None:
    """products/<run_id>.failed.json, with the reason in one line."""
    reason = " ".join(str(reason).split())[:400]
    now = time.strftime("%Y-%m-%dT%H:%M:%S")
    write_json(
        products / f"{run_id}.failed.json", {"run_id": run_id, "reason": reason, "time": now, "log": log, **facts}
    )


def write_blocked(folder: Path, states: dict[str, State]) -> None:
    """Give every run whose start failed its own failure file, so that a reader of the folder can count it."""
    for state in states.values():
        if "blocked" in state.facts and not (folder / "products" / f"{state.run_id}.failed.json").exists():
            write_failure(folder / "products", state.run_id, state.reason, **state.facts)


def set_aside(folder: Path, run_ids: list[str]) -> None:
    """Clear the way for another try: refused products are moved, failure files and checkpoints removed."""
    for run_id in run_ids:
        path = folder / "products" / f"{run_id}.h5"
        if path.exists():
            k = 1
            while (kept := folder / "products" / "refused" / f"{run_id}.{k}.h5").exists():
                k += 1
            kept.parent.mkdir(exist_ok=True)
            os.replace(path, kept)
        for rest in (".failed.json", ".checkpoint"):
            (folder / "products" / f"{run_id}{rest}").unlink(missing_ok=True)


def record_sum(path: Path) -> None:
    """Append the product's checksum to SHA256SUMS, in the form `sha256sum --check` reads."""
    line = f"{file_sum(path)}  {path.name}\n"
    with open(path.parent / SUMS, "a", encoding="ascii") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.write(line)


def recorded_sums(products: Path) -> dict[str, str]:
    """Product name -> checksum; the last line of a name counts, a damaged line does not."""
    try:
        lines = (products / SUMS).read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return {}
    parts = [line.split() for line in lines]
    return {p[1]: p[0] for p in parts if len(p) == 2 and len(p[0]) == 64}


def file_sum(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def is_locked(path: Path) -> bool:
    """Whether a living process holds the lock file."""
    try:
        with open(path, "rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _stamp(path: Path) -> list[int]:
    s = path.stat()
    return [s.st_size, s.st_mtime_ns, s.st_ctime_ns]


def _keep(path: Path, fresh: dict) -> None:
    with contextlib.suppress(OSError):  # a folder that can't be written is still worth looking at
        write_json(path, fresh)


def _failed(products: Path, row: Row, states: dict[str, State]) -> State:
    told = read_json(products / f"{row.run_id}.failed.json")
    if not isinstance(told, dict):
        return State(row.run_id, "failed", "its failure file is damaged", {})
    start = states.get(row.start)
    if told.get("blocked") and not (start and start.state == "failed"):
        return State(row.run_id, "missing")
    facts = {k: v for k, v in told.items() if k not in ("run_id", "reason")}
    return State(row.run_id, "failed", str(told.get("reason", "no reason given")), facts)


def _blocked(first: State) -> str:
    return f"its start {first.run_id} failed"


def _check(path: Path, row: Row, sums: dict[str, str]) -> dict:
    """The outcome of one look into a product: {"reason": "" or one line, "facts": timing}."""
    recorded = sums.get(path.name)
    if recorded and file_sum(path) != recorded:
        return {"reason": "its bytes have changed since it was written (checksum)", "facts": {}}
    try:
        reason, facts = inspect(path, row)
    except (OSError, KeyError, ValueError, RuntimeError, TypeError) as error:
        return {"reason": f"cannot be read as a run file: {' '.join(str(error).split())[:120]}", "facts": {}}
    if not reason and not recorded:
        with contextlib.suppress(OSError):  # in a read-only folder the product is still good
            record_sum(path)
    return {"reason": reason, "facts": facts}


def inspect(path: Path, row: Row) -> tuple[str, dict]:
    """("" or why the product is not this row's, timing facts).  Reads attributes and the small record only."""
    import h5py
    import numpy as np

    with h5py.File(path, "r") as file:
        head = dict(file.attrs)
        if head.get("format") != "dem-run":
            return f"is no run file: format = {head.get('format')!r}", {}
        if not head.get("complete", False):
            return "is not complete", {}
        for name, wanted in (("run_id", row.run_id), ("stage", row.stage)):
            if head.get(name) != wanted:
                return f"belongs to another plan: {name} = {head.get(name)!r}, planned {wanted!r}", {}
        used = dict(file["parameters"].attrs)
        if (reason := _mismatch(used, row)) is not None:
            return reason, {}
        record = file.get("record", {})
        for symbol in (s for s in FINITE if s in record):
            values = record[symbol]
            # a consolidation begins without contacts, so ratios over them have no value yet
            if not np.all(np.isfinite(values[-1] if row.stage == "consolidate" else values[...])):
                return f"has values of {symbol} that are not finite", {}
        timing = {k: float(v) for k, v in file["timing"].attrs.items()} if "timing" in file else {}
        facts = {k: timing[k] for k in ("cpu_seconds", "wall_seconds", "steps") if k in timing}
        facts["exit_reason"] = str(head.get("exit_reason", ""))
        facts["script_digest"] = str(head.get("script_digest", ""))[:12]
        if int(head.get("resumed", 0)):
            facts["resumed"] = int(head["resumed"])
        if used.get("timestep_factor") != row.values["timestep_factor"]:
            facts["retried"] = True
        return "", facts


def _mismatch(used: dict, row: Row) -> str | None:
    """The first parameter that the run used otherwise than planned, as one line."""
    for name, wanted in row.values.items():
        if name not in used or name in ("assembly", "start"):
            continue
        found = used[name]
        found = found.item() if hasattr(found, "item") else found
        allowed = [wanted, wanted * RETRY_STEP] if name == "timestep_factor" else [wanted]
        if not any(_same(found, w) for w in allowed):
            return f"belongs to another plan: {name} = {_show(found)}, planned {_show(wanted)}"
    return None


def _same(found, wanted) -> bool:
    if isinstance(wanted, (int, float)) and isinstance(found, (int, float)):
        return abs(found - wanted) <= 1e-12 * abs(wanted)
    return str(found) == str(wanted)


def _show(value) -> str:
    return f"{value:g}" if isinstance(value, float) else json.dumps(value, default=str)
