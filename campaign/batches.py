"""Sequential stopping: run points in batches until the estimated error of the PDFs is below the target.

With `pdem.stop_when` set, the points run in an order in which every beginning covers their range and uses the
packings evenly. After each batch the stress ratio at the peak, and the stress ratio and the void ratio at the
critical state, are judged (`analysis.surrogates.stopping`). tables/enough.json keeps the order, the current batch and
every judgement. A decision to stop is valid as long as the planned runs and the target stay the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.errors_and_files import digest
from campaign.config import Config
from campaign.files import read_json, write_json
from campaign.plan import PlannedRun
from campaign.prepare import read_inputs
from campaign.products import ARCHIVE, run_statuses

if TYPE_CHECKING:
    import numpy as np

NOTE = "tables/enough.json"


@dataclass(frozen=True)
class Step:
    """What to run next: all runs but the `spared` ones; `last` if nothing will be run after this step."""

    spared: frozenset[str]
    last: bool


def run_in_steps(
    config: Config,
    folder: Path,
    rows: Sequence[PlannedRun],
    engine: Callable[[frozenset[str]], int],
    show: Callable[[str], Any] = print,
) -> int:
    """Run batch after batch until the target error is reached or all points have run; return the products added.

    engine: runs all but the ids it is given and returns the number of products added. show: takes one line per
    judgement. Also ends when the engine leaves runs of its batch without an outcome (disk full, YADE missing). Raises
    the errors of the engine and of the analysis.
    """
    added = 0
    while True:
        step = next_step(config, folder, rows, show)
        added += engine(step.spared)
        if step.last or _any_open(folder, [row for row in rows if row.run_id not in step.spared]):
            return added


def next_step(config: Config, folder: Path, rows: Sequence[PlannedRun], show: Callable[[str], Any] = print) -> Step:
    """Judge the current batch if all its runs have an outcome, and return what to run now.

    Without `pdem.stop_when` that is everything, in one step. A batch is judged once. Raises the errors of the analysis
    for a product that cannot be used, OSError if tables/enough.json cannot be written.
    """
    if not config.pdem.stop_when:
        return Step(frozenset(), True)
    from analysis.surrogates import stopping

    note = _read_note(config, folder, rows) or _begin(config, folder, rows)
    points = len(note["order"])
    while not note["reached"] and note["used"] <= points:
        needed = _needed(rows, note)
        if _any_open(folder, needed):
            return Step(_others(rows, needed), False)
        if not note["history"] or note["history"][-1]["points"] < note["used"]:
            note = _judge(config, folder, needed, note, show)
            write_json(folder / NOTE, note)
        if note["reached"] or note["used"] == points:
            break
        note = note | {"used": stopping.next_batch(note["used"], points)}
        write_json(folder / NOTE, note)
    return Step(_others(rows, _needed(rows, note)), True)


def spared(config: Config, folder: Path, rows: Sequence[PlannedRun]) -> frozenset[str]:
    """Return the ids of the runs that are not needed since the target error was reached; none before that."""
    note = _read_note(config, folder, rows)
    return _others(rows, _needed(rows, note)) if note and note["reached"] else frozenset()


def last_judgement(config: Config, folder: Path, rows: Sequence[PlannedRun]) -> str:
    """Return the last judgement in one line, "" if there is none."""
    note = _read_note(config, folder, rows)
    return note["history"][-1]["sentence"] if note and note["history"] else ""


def _begin(config: Config, folder: Path, rows: Sequence[PlannedRun]) -> dict[str, Any]:
    """The note before the first batch: the order of the points and the size of the batch."""
    import numpy as np

    from analysis.surrogates import stopping
    from analysis.surrogates.rotation import nested_order

    inputs = _inputs(rows, _names(folder))
    ids = np.array(sorted(inputs))
    order = ids[nested_order([inputs[k] for k in ids])].tolist()
    note = {"runs": _digest(rows), "target": config.pdem.stop_when, "order": order, "claimed": {}, "reached": False,
            "used": stopping.first_batch(len(order), len(_names(folder))), "history": []}  # fmt: skip
    write_json(folder / NOTE, note)
    return note


def _judge(
    config: Config, folder: Path, needed: Sequence[PlannedRun], note: dict[str, Any], show: Callable[[str], Any]
) -> dict[str, Any]:
    """The note with one more judgement, of the points used so far."""
    import numpy as np

    from analysis.inputs.joint import Joint
    from analysis.surrogates import stopping

    used = note["order"][: note["used"]]
    inputs, packing = (
        _inputs(needed, _names(folder)),
        {row.point: row.packing for row in needed if row.stage == "shear"},
    )
    joint = Joint.from_dict(read_inputs(folder)["joint"])
    samples = stopping.judged_samples(joint)
    responses = _responses(folder, needed, used)
    x, seeds = np.array([inputs[k] for k in used]), np.array([packing[k] for k in used])
    assessment = stopping.assess(x, responses, samples, note["target"], seeds)
    sentence = assessment.sentence()
    show(f"{config.name}: {sentence}")
    claimed = {name: value if math.isfinite(value) else None for name, value in assessment.claimed.items()}
    judgement = {
        "points": assessment.runs, "sentence": sentence, "reached": assessment.reached, "claimed": claimed
    }  # fmt: skip
    return note | {"claimed": claimed, "reached": assessment.reached, "history": [*note["history"], judgement]}


def _responses(folder: Path, needed: Sequence[PlannedRun], used: list[int]) -> dict[str, np.ndarray]:
    """The judged responses, {name: (points used,)}, NaN where the run failed.

    The second family, with mu_s fixed, runs at the same points and is not judged: its scatter is little more than that
    of the packings.
    """
    import numpy as np

    from analysis.runs.archive import Archive
    from analysis.surrogates.stopping import JUDGED, judged_name

    shear_rows = [row for row in needed if row.stage == "shear" and row.family == "coupled"]
    responses: dict[str, np.ndarray] = {}
    archive = Archive(folder / ARCHIVE)
    for row in shear_rows:
        path = folder / row.product
        states = _states(path, path.stat().st_mtime_ns) if path.exists() else _archived_states(archive, row.run_id)
        for state, symbol in JUDGED:
            name = judged_name(state, symbol, row.mu_iso)
            values = responses.setdefault(name, np.full(len(used), np.nan))
            values[used.index(row.point)] = states.get((state, symbol), np.nan)
    return responses


@lru_cache(maxsize=100_000)
def _states(path: Path, changed: int) -> dict[tuple[str, str], float]:
    """{(state, symbol): value} of one shear product; `changed` is its time, so that a changed file is read again."""
    from analysis.runs.run_file import read_run
    from analysis.runs.states import run_states

    return _judged(run_states(read_run(path)).states)


def _archived_states(archive: Mapping[str, Any], run_id: str) -> dict[tuple[str, str], float]:
    return _judged(archive[run_id].states.states) if run_id in archive else {}


def _judged(states: dict[str, dict[str, float]]) -> dict[tuple[str, str], float]:
    from analysis.surrogates.stopping import JUDGED

    return {(state, symbol): states[state][symbol] for state, symbol in JUDGED}


def _names(folder: Path) -> Sequence[str]:
    """Symbols of the random variables."""
    return read_inputs(folder).get("names", ("mu_s", "G_p"))


def _inputs(rows: Sequence[PlannedRun], names: Sequence[str]) -> dict[int, tuple[float, ...]]:
    """Point -> values of its random variables; of its families "coupled" counts, which has all as measured."""
    shear_rows = sorted((row for row in rows if row.stage == "shear"), key=lambda row: row.family == "coupled")
    return {row.point: tuple({"mu_s": row.mu_s, "G_p": row.G_p, **row.further}[name] for name in names)
            for row in shear_rows}  # fmt: skip


def _needed(rows: Sequence[PlannedRun], note: dict[str, Any]) -> list[PlannedRun]:
    """The rows of the points used so far, with all runs that they start from."""
    used, by_id, ids = set(note["order"][: note["used"]]), {row.run_id: row for row in rows}, set()
    for used_row in (row for row in rows if row.point in used):
        row: PlannedRun | None = used_row
        while row and row.run_id not in ids:
            ids.add(row.run_id)
            row = by_id.get(row.start)
    return [row for row in rows if row.run_id in ids]


def _others(rows: Sequence[PlannedRun], needed: Sequence[PlannedRun]) -> frozenset[str]:
    return frozenset(row.run_id for row in rows) - {row.run_id for row in needed}


def _any_open(folder: Path, rows: Sequence[PlannedRun]) -> bool:
    """Whether a run has no outcome yet."""
    return any(status.status not in ("done", "failed") for status in run_statuses(folder, rows).values())


def _read_note(config: Config, folder: Path, rows: Sequence[PlannedRun]) -> dict[str, Any]:
    """The note, if it was made for these runs and this target; else {}."""
    note = read_json(folder / NOTE, {})
    if note.get("target") != config.pdem.stop_when or note.get("runs") != _digest(rows):
        return {}
    return note if _is_whole(note, {row.point for row in rows if row.stage == "shear"}) else {}


def _is_whole(note: dict[str, Any], points: set[int]) -> bool:
    """Whether a note has everything that is read from it; a damaged one is begun anew, from the runs that there are."""
    order, history = note.get("order"), note.get("history")
    return (
        isinstance(order, list)
        and all(isinstance(k, int) for k in order)
        and sorted(order) == sorted(points)
        and isinstance(note.get("used"), int)
        and isinstance(note.get("reached"), bool)
        and isinstance(note.get("claimed"), dict)
        and isinstance(history, list)
        and all(isinstance(j, dict) and isinstance(j.get("sentence"), str) for j in history)
        and all(isinstance(j.get("points"), int) for j in history)
    )


def _digest(rows: Sequence[PlannedRun]) -> str:
    return digest("\n".join(sorted(row.run_id for row in rows)).encode(), 16)
