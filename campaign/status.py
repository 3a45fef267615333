"""Done, running, failed, missing: a constant total, what it has cost, and how long it will take."""

from __future__ import annotations

import os
import shutil
import sys
import time
from pathlib import Path

from campaign.config import ROOT, Config
from campaign.enough import spared, verdict
from campaign.files import code_digest
from campaign.plan import STAGES, Row
from campaign.products import State, look, stale

ORDER = ("done", "running", "queued", "failed", "refused", "missing", "spared")


def campaign_status(config: Config, folder: Path, rows: list[Row], *, rehash: bool = False) -> dict:
    """Everything `status` tells, as one plain dict (what --json prints)."""
    states = look(folder, rows, rehash=rehash, spared=spared(config, folder, rows))
    lost, queue = {}, ""
    if (folder / "batch" / "slurm.json").exists():
        from campaign.local import RunError
        from campaign.slurm import ended_without_product, queued_rows

        try:
            for run_id, word in queued_rows(folder).items():
                if run_id in states and states[run_id].state == "missing":
                    states[run_id] = State(run_id, word)
            lost = ended_without_product(folder, [s.run_id for s in states.values() if s.state == "missing"])
        except RunError as error:
            queue = str(error)
    return summary(config, rows, states) | {
        "stale": stale(folder, rows), "folder": str(folder), "lost": lost, "queue": queue,
        "enough": verdict(config, folder, rows),
    }  # fmt: skip


def summary(config: Config, rows: list[Row], states: dict[str, State]) -> dict:
    """Counts by stage, failures with reasons, core-hours spent and predicted, seconds to go."""
    counts = {stage: dict.fromkeys(ORDER, 0) | {"total": 0} for stage in (*STAGES, "total")}
    failed, spent, lost, done_predicted, to_go = [], 0.0, 0.0, 0.0, 0.0
    notes = {"retried": 0, "resumed": 0, "other_scripts": 0}
    digests, present = set(), code_digest(ROOT / "yade_scripts")
    for row in rows:
        state = states[row.run_id]
        for stage in (row.stage, "total"):
            counts[stage][state.state] += 1
            counts[stage]["total"] += 1
        if state.state in ("failed", "refused"):
            failed.append({"run_id": row.run_id, "state": state.state, "reason": state.reason,
                           "log": f"logs/{row.run_id}.log"})  # fmt: skip
            lost += state.facts.get("cpu_seconds", 0.0)
        if state.state == "done":
            spent += state.facts.get("cpu_seconds", 0.0)
            done_predicted += row.cpu_seconds
            notes["retried"] += bool(state.facts.get("retried"))
            notes["resumed"] += bool(state.facts.get("resumed"))
            made_by = state.facts.get("script_digest", "")
            notes["other_scripts"] += not present.startswith(made_by)
            digests.add(made_by)
        elif state.state not in ("failed", "spared"):
            to_go += row.cpu_seconds
    pace = spent / done_predicted if done_predicted and spent else 1.0
    total = counts["total"]
    places = max(total["running"], 1) if total["queued"] else jobs(config)  # a cluster shows how much it gives at once
    return {
        "campaign": config.name,
        "counts": counts,
        "failures": failed,
        "core_hours_spent": (spent + lost) / 3600.0,
        "core_hours_predicted": sum(r.cpu_seconds for r in rows) / 3600.0,
        "core_hours_to_go": to_go * pace / 3600.0,
        "seconds_to_go": to_go * pace / places,
        "script_versions": len(digests),
        **notes,
    }


def jobs(config: Config) -> int:
    """Runs at once: as asked, or one per core that this process may use."""
    return config.run.jobs or len(os.sched_getaffinity(0))


def status_text(told: dict) -> str:
    """The same for a person, in a few lines."""
    counts = told["counts"]
    words = [w for w in ORDER if counts["total"][w] or w in ("done", "running", "failed", "missing")]
    lines = [f"{told['campaign']}: " + bar(counts["total"]["done"], counts["total"]["total"])]
    lines.append(f"{'':12}" + "".join(f"{w:>9}" for w in (*words, "total")))
    for stage in (*STAGES, "total"):
        lines.append(f"{stage:12}" + "".join(f"{counts[stage][w]:>9}" for w in (*words, "total")))
    lines.append(
        f"core-hours: {told['core_hours_spent']:.2f} spent, {told['core_hours_predicted']:.2f} predicted in all; "
        f"about {span(told['seconds_to_go'])} to go"
    )
    if told["enough"]:
        lines.append(told["enough"])
    for f in told["failures"]:
        lines.append(f"{f['state']}: {f['run_id']}: {f['reason']}")
    if told["queue"]:
        lines.append(told["queue"])
    lines += [f"missing: {run_id}: {reason}" for run_id, reason in told["lost"].items()]
    if told["stale"]:
        lines.append(f"stale: {len(told['stale'])} products of earlier settings, kept and not used")
    if told["retried"]:
        lines.append(f"{told['retried']} runs needed a second try with a smaller step")
    if told["resumed"]:
        lines.append(f"{told['resumed']} runs went on from a checkpoint")
    if told["other_scripts"]:
        lines.append(f"note: {told['other_scripts']} products were made by other yade_scripts than the present ones "
                     f"({told['script_versions']} versions in all)")  # fmt: skip
    return "\n".join(lines)


def bar(done: int, total: int, width: int = 30) -> str:
    filled = width * done // max(total, 1)
    return f"[{'#' * filled}{'-' * (width - filled)}] {done}/{total} runs"


def span(seconds: float) -> str:
    """Seconds as a person says them."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


class Progress:
    """One line that is written over on a terminal, and a line now and then in a log file."""

    def __init__(self, quiet: bool = False):
        self.live = sys.stderr.isatty()
        self.quiet, self.said, self.text = quiet, time.monotonic(), ""

    def show(self, text: str) -> None:
        """Show the state; never let a closed terminal stop the campaign."""
        now = time.monotonic()
        if self.quiet or text == self.text or not (self.live or now - self.said > 20.0):
            return
        self.text, self.said = text, now
        width = shutil.get_terminal_size().columns - 1
        self._write(f"\r{text[:width].ljust(width)}" if self.live else f"{text}\n")

    def end(self) -> None:
        if self.live and self.text:
            self._write("\n")

    @staticmethod
    def _write(text: str) -> None:
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except OSError:
            pass
