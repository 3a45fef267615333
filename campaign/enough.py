"""Runs that the answer does not need are not made: batches of points until the claimed error is the one asked for.

With `pdem.stop_when` set, the points run in an order in which every beginning covers their range, those that replicate
packings serve first.  After each batch the
stress ratio at the peak and the stress ratio and void ratio at the critical state are judged (`analysis.stopping`).
tables/enough.json keeps the order, the batch at work and every judgement; a decision to stop stands as long as the runs
and the target are those it was made for.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from campaign.config import Config
from campaign.files import read_json, write_json
from campaign.plan import Row
from campaign.products import ARCHIVE, look

NOTE = "tables/enough.json"


@dataclass(frozen=True)
class Step:
    """What to do next: the ids of the runs that are not to be made now, and whether this step is the last."""

    spared: frozenset[str]
    last: bool


def run_in_steps(config: Config, folder: Path, rows: list[Row], engine: Callable, say: Callable = print) -> int:
    """Run batch after batch by engine(spared ids) -> products added, until it is enough; returns the products added.

    Stops also when an engine leaves runs of its batch without an outcome (disk full, YADE gone).
    """
    added = 0
    while True:
        step = next_step(config, folder, rows, say)
        added += engine(step.spared)
        if step.last or _is_open(folder, [row for row in rows if row.run_id not in step.spared]):
            return added


def next_step(config: Config, folder: Path, rows: list[Row], say: Callable = print) -> Step:
    """Judge the batch at work once all its runs have an outcome; returns what is to be run now.

    Without `pdem.stop_when` everything is, in one step.  Judging again what was judged changes nothing.
    """
    if not config.pdem.stop_when:
        return Step(frozenset(), True)
    from analysis import stopping

    note = _read_note(config, folder, rows) or _begin(config, folder, rows)
    points = len(note["order"])
    while not note["reached"] and note["used"] <= points:
        needed = _needed(rows, note)
        if _is_open(folder, needed):
            return Step(_others(rows, needed), False)
        if not note["history"] or note["history"][-1]["points"] < note["used"]:
            note = _judge(config, folder, needed, note, say)
            write_json(folder / NOTE, note)
        if note["reached"] or note["used"] == points:
            break
        note = note | {"used": stopping.next_batch(note["used"], points)}
        write_json(folder / NOTE, note)
    return Step(_others(rows, _needed(rows, note)), True)


def spared(config: Config, folder: Path, rows: list[Row]) -> frozenset[str]:
    """Ids of the runs that a decision to stop has made needless; none before that."""
    note = _read_note(config, folder, rows)
    return _others(rows, _needed(rows, note)) if note and note["reached"] else frozenset()


def verdict(config: Config, folder: Path, rows: list[Row]) -> str:
    """One line on the last judgement, empty if there is none."""
    note = _read_note(config, folder, rows)
    return note["history"][-1]["sentence"] if note and note["history"] else ""


def _begin(config: Config, folder: Path, rows: list[Row]) -> dict:
    import numpy as np

    from analysis import stopping

    inputs = _inputs(rows)
    ids = np.array(sorted(inputs))
    packings = {point: {row.packing for row in rows if row.point == point} for point in inputs}
    first = [len(packings[k]) > 1 for k in ids]
    order = ids[stopping.nested_order([inputs[k] for k in ids], first)].tolist()
    note = {"runs": _digest(rows), "target": config.pdem.stop_when, "order": order, "claimed": {}, "reached": False,
            "used": stopping.first_batch(len(order)), "history": []}  # fmt: skip
    write_json(folder / NOTE, note)
    return note


def _judge(config: Config, folder: Path, needed: list[Row], note: dict, say: Callable) -> dict:
    """The note with one more judgement, of the points used so far."""
    import numpy as np

    from analysis import stopping
    from analysis.joint import Joint

    used = note["order"][: note["used"]]
    inputs = _inputs(needed)
    joint = Joint.from_dict(read_json(folder / "inputs.json")["joint"])
    samples = stopping.judged_samples(joint)
    found = stopping.assess(
        np.array([inputs[k] for k in used]), _responses(folder, needed, used), samples, note["target"]
    )
    say(f"{config.name}: {found.sentence()}")
    claimed = {name: value if math.isfinite(value) else None for name, value in found.claimed.items()}
    told = {"points": found.runs, "sentence": found.sentence(), "reached": found.reached, "claimed": claimed}
    return note | {"claimed": claimed, "reached": found.reached, "history": [*note["history"], told]}


def _responses(folder: Path, needed: list[Row], used: list[int]) -> dict:
    """What is judged at every density, {name: (points used,)}: packings levelled as in results.h5, NaN if all failed.

    A second family with mu_s fixed goes with the first and is not judged: its spread is little more than noise.
    """
    import numpy as np

    from analysis.archive import Archive
    from analysis.packings import average
    from analysis.stopping import JUDGED, judged_name

    shear = [row for row in needed if row.stage == "shear" and row.family == "coupled"]
    packings = sorted({row.packing for row in shear})
    sets, kept = {}, Archive(folder / ARCHIVE)
    for row in shear:
        path = folder / row.product
        values = _states(path, path.stat().st_mtime_ns) if path.exists() else _archived(kept, row.run_id)
        for state, symbol in JUDGED:
            found = sets.setdefault(judged_name(state, symbol, row.mu_iso), np.full((len(packings), len(used)), np.nan))
            found[packings.index(row.packing), used.index(row.point)] = values.get((state, symbol), np.nan)
    return {name: average(found) for name, found in sets.items()}


@lru_cache(maxsize=100_000)
def _states(path: Path, changed: int) -> dict:
    """{(state, symbol): value} of one shear product; `changed`: its time, so that a new one is read anew."""
    from analysis.run_states import run_states
    from analysis.runfile import read_run

    return _judged(run_states(read_run(path)).states)


def _archived(kept, run_id: str) -> dict:
    return _judged(kept[run_id].states.states) if run_id in kept else {}


def _judged(states: dict) -> dict:
    from analysis.stopping import JUDGED

    return {(state, symbol): states[state][symbol] for state, symbol in JUDGED}


def _inputs(rows: list[Row]) -> dict[int, tuple[float, float]]:
    """Point -> (mu_s, G_p), as measured where a family has them so."""
    probes = sorted((row for row in rows if row.stage == "shear"), key=lambda row: row.family == "coupled")
    return {row.point: (row.mu_s, row.G_p) for row in probes}


def _needed(rows: list[Row], note: dict) -> list[Row]:
    """The rows of the points used so far, with all that they start from."""
    used, by_id, ids = set(note["order"][: note["used"]]), {row.run_id: row for row in rows}, set()
    for row in (row for row in rows if row.point in used):
        while row and row.run_id not in ids:
            ids.add(row.run_id)
            row = by_id.get(row.start)
    return [row for row in rows if row.run_id in ids]


def _others(rows: list[Row], needed: list[Row]) -> frozenset[str]:
    return frozenset(row.run_id for row in rows) - {row.run_id for row in needed}


def _is_open(folder: Path, rows: list[Row]) -> bool:
    return any(state.state not in ("done", "failed") for state in look(folder, rows).values())


def _read_note(config: Config, folder: Path, rows: list[Row]) -> dict:
    """The note, if there is one and it was made for these runs and this target; else {}."""
    note = read_json(folder / NOTE, {})
    if not note or note["target"] != config.pdem.stop_when or note["runs"] != _digest(rows):
        return {}
    return note


def _digest(rows: list[Row]) -> str:
    return hashlib.sha256("\n".join(sorted(row.run_id for row in rows)).encode()).hexdigest()[:16]
