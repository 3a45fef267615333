"""The pace of this machine, from the campaigns that ran on it: with it `plan` states the cost for this machine.

The constants of `campaign.plan` hold for the machine of the laptop campaign; other machines took up to twice as long.
`run` leaves the pace of its stages in the campaign's folder; `plan` takes the newest one of the same DEM code in
the folders beside.
"""

from __future__ import annotations

import contextlib
import math
import os
import platform
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from campaign.estimate import paces
from campaign.files import read_json, write_json
from campaign.plan import STAGES, PlannedRun, cost_model
from campaign.products import RunStatus

FILE = "pace.json"


@dataclass(frozen=True)
class Pace:
    """CPU time over predicted CPU time by stage, the number of runs that it is taken from, and their folder."""

    by_stage: dict[str, float]
    runs: int
    folder: Path

    def core_hours(self, rows: Iterable[PlannedRun]) -> float:
        """Return the core-hours of these runs at this pace."""
        return sum(row.cpu_seconds * self.by_stage[row.stage] for row in rows) / 3600.0


def sentence(rows: Collection[PlannedRun], folder: Path) -> str:
    """Return what these runs cost on this machine, as a line for people.

    Empty where the pace is not known, and for runs of two DEM codes, which have no pace in common.
    """
    known = newest(folder, _code(rows))
    if known is None or len({row.values.get("code") for row in rows}) > 1:
        return ""
    hours = known.core_hours(rows)
    return f"on this machine about {hours:.2g} core-hours, at the pace of {known.runs} runs in {known.folder.name}\n"


def keep(folder: Path, rows: Sequence[PlannedRun], statuses: Mapping[str, RunStatus]) -> None:
    """Write the pace of the runs that are done into the folder; nothing where none is done or the disk is full.

    The runs must come from this machine.
    """
    done = sum(statuses[row.run_id].status == "done" for row in rows)
    if done:
        by_stage = paces(rows, statuses, "cpu_seconds")
        with contextlib.suppress(OSError):
            known = {"machine": machine(), "code": _code(rows), "model": cost_model()}
            write_json(folder / FILE, known | {"runs": done, "pace": by_stage})


def newest(folder: Path, code: str = "yade") -> Pace | None:
    """Return the newest pace of this machine, DEM code and cost model in the folder or in those beside it, or None."""
    found = []
    for path in {*folder.parent.glob(f"*/{FILE}"), folder / FILE}:
        with contextlib.suppress(OSError):  # the file of another campaign cannot be read: its pace is not known
            kept = read_json(path, {})
            by_stage = kept.get("pace")
            of = (kept.get("machine"), kept.get("code", "yade"), kept.get("model"))
            if of != (machine(), code, cost_model()) or not isinstance(by_stage, dict):
                continue
            if all(_positive(by_stage.get(stage)) for stage in STAGES):
                found.append((path.stat().st_mtime, Pace(by_stage, int(kept.get("runs", 0)), path.parent)))
    return max(found, key=lambda one: one[0])[1] if found else None


def _code(rows: Iterable[PlannedRun]) -> str:
    """The DEM code of the runs of a campaign."""
    return next((str(row.values.get("code", "yade")) for row in rows), "yade")


def machine() -> str:
    """Name of this machine and of its processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    processor = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
    return f"{platform.node()}, {processor or platform.machine()}, {os.cpu_count()} cores"


def _positive(value: object) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value) and value > 0
