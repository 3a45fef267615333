"""The work and the time that a campaign still needs, from the pace of its runs so far; `status` and `run` use the same.

The pace of a stage is the time of its finished runs over their predicted time. A stage with few finished runs gets the
pace of all stages, with the weight of one run. Before the first run has ended, the pace is at least that of the run
that takes longest over its predicted time. The time to go is that of a schedule of the remaining runs on so many
places: the costliest first, each once the run that it starts from has ended, as the local engine does it.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from campaign.plan import STAGES, PlannedRun
from campaign.products import RunStatus

#: Share of its expected time that a run still needs which has taken that long already, or longer.
OVERDUE = 0.1
TO_RUN = ("missing", "refused", "unknown", "queued", "running")


@dataclass(frozen=True)
class Estimate:
    """CPU seconds and elapsed seconds that the runs without an outcome still need."""

    cpu_seconds: float
    seconds: float


def estimate(rows: Sequence[PlannedRun], statuses: Mapping[str, RunStatus], at_once: int) -> Estimate:
    """Return what is still needed with `at_once` runs at once. Failed and spared runs need nothing."""
    cpu, elapsed = (paces(rows, statuses, fact) for fact in ("cpu_seconds", "wall_seconds"))
    to_run = [row for row in rows if statuses[row.run_id].status in TO_RUN]
    running = {row.run_id for row in to_run if statuses[row.run_id].status == "running"}
    seconds = {}
    for row in to_run:
        expected = row.cpu_seconds * elapsed[row.stage]
        since = statuses[row.run_id].facts.get("elapsed", 0.0) if row.run_id in running else 0.0
        seconds[row.run_id] = max(expected - since, OVERDUE * expected)
    work = sum(row.cpu_seconds * cpu[row.stage] for row in to_run if row.run_id not in running)
    work += sum(seconds[run_id] for run_id in running)
    starts = {row.run_id: row.start for row in to_run}
    return Estimate(work, _schedule(seconds, starts, running, at_once))


def paces(rows: Sequence[PlannedRun], statuses: Mapping[str, RunStatus], fact: str) -> dict[str, float]:
    """Return stage -> time over predicted time; the fact is "cpu_seconds" or "wall_seconds"."""
    taken, predicted = dict.fromkeys(STAGES, 0.0), dict.fromkeys(STAGES, 0.0)
    count, total = dict.fromkeys(STAGES, 0), dict.fromkeys(STAGES, 0.0)
    for row in rows:
        count[row.stage] += 1
        total[row.stage] += row.cpu_seconds
        facts = statuses[row.run_id].facts
        seconds = facts.get(fact, facts.get("cpu_seconds", 0.0))
        if statuses[row.run_id].status == "done" and seconds > 0 and row.cpu_seconds > 0:
            taken[row.stage] += seconds
            predicted[row.stage] += row.cpu_seconds
    known = sum(predicted.values())
    overall = sum(taken.values()) / known if known else _least_pace(rows, statuses)
    paces = {}
    for stage in STAGES:
        of_one_run = total[stage] / count[stage] if count[stage] else 1.0
        paces[stage] = (taken[stage] + overall * of_one_run) / (predicted[stage] + of_one_run)
    return paces


def _least_pace(rows: Sequence[PlannedRun], statuses: Mapping[str, RunStatus]) -> float:
    """The pace that the runs at work show so far, at least 1."""
    found = [statuses[row.run_id].facts["elapsed"] / row.cpu_seconds for row in rows
             if "elapsed" in statuses[row.run_id].facts and row.cpu_seconds > 0]  # fmt: skip
    return max([1.0, *found])


def _schedule(seconds: Mapping[str, float], starts: Mapping[str, str], running: set[str], places: int) -> float:
    """When the last run ends: seconds by run id, the run that each starts from, and the ids of those that run now."""
    followers: dict[str, list[str]] = {}
    for run_id, start in starts.items():
        if run_id not in running and start in seconds:
            followers.setdefault(start, []).append(run_id)
    ready = [(-s, run_id) for run_id, s in seconds.items() if run_id not in running and starts[run_id] not in seconds]
    busy = [(seconds[run_id], run_id) for run_id in running]
    heapq.heapify(ready)
    heapq.heapify(busy)
    now = 0.0
    while ready or busy:
        while ready and len(busy) < places:
            cost, run_id = heapq.heappop(ready)
            heapq.heappush(busy, (now - cost, run_id))
        now, ended = heapq.heappop(busy)
        for run_id in followers.get(ended, ()):
            heapq.heappush(ready, (-seconds[run_id], run_id))
    return now
