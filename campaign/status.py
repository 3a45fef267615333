"""The status of a campaign: counts that add up to a constant total, core-hours spent and predicted, and time to go."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from campaign.batches import last_judgement, spared
from campaign.config import ROOT, Config, places
from campaign.engine_slurm import NOTE, ended_without_product, queued_rows
from campaign.estimate import estimate
from campaign.files import code_digest
from campaign.folder import RunError
from campaign.plan import STAGES, PlannedRun
from campaign.products import RunStatus, run_statuses, stale
from campaign.progress import bar, span

ORDER = ("done", "running", "queued", "failed", "refused", "unknown", "missing", "spared")


def campaign_status(
    config: Config, folder: Path, rows: Sequence[PlannedRun], *, rehash: bool = False
) -> dict[str, Any]:
    """Return everything that `status` prints, as one dict of plain values (`status --json` prints the dict).

    rehash: read every product again. Raises the errors of `run_statuses`.
    """
    statuses = run_statuses(folder, rows, rehash=rehash, spared=spared(config, folder, rows))
    lost, queue_error = {}, ""
    if (folder / NOTE).exists():
        try:
            for run_id, word in queued_rows(folder).items():
                if run_id in statuses and statuses[run_id].status == "missing":
                    statuses[run_id] = RunStatus(run_id, word)
            missing = [run_id for run_id, status in statuses.items() if status.status == "missing"]
            lost = ended_without_product(folder, missing)
        except RunError as error:
            queue_error = str(error)
    return summary(config, rows, statuses) | {
        "stale": stale(folder, rows),
        "folder": str(folder),
        "lost": lost,
        "queue": queue_error,
        "enough": last_judgement(config, folder, rows),
    }


def summary(config: Config, rows: Sequence[PlannedRun], statuses: dict[str, RunStatus]) -> dict[str, Any]:
    """Return counts by stage, failures with their reasons, core-hours spent and predicted, and seconds to go."""
    counts = {stage: dict.fromkeys(ORDER, 0) | {"total": 0} for stage in (*STAGES, "total")}
    failures: list[dict[str, str]] = []
    spent = spent_on_failures = 0.0
    notes = {"retried": 0, "resumed": 0, "other_scripts": 0}
    scripts = "yade_scripts" if config.dem.code == "yade" else f"campaign/{config.dem.code}"
    script_digests, present_digest = set(), code_digest(ROOT / scripts)
    for row in rows:
        status = statuses[row.run_id]
        for stage in (row.stage, "total"):
            counts[stage][status.status] += 1
            counts[stage]["total"] += 1
        if status.status in ("failed", "refused", "unknown"):
            failures.append({"run_id": row.run_id, "state": status.status, "reason": status.reason,
                             "log": f"logs/{row.run_id}.log"})  # fmt: skip
            spent_on_failures += status.facts.get("cpu_seconds", 0.0)
        if status.status == "done":
            spent += status.facts.get("cpu_seconds", 0.0)
            notes["retried"] += bool(status.facts.get("retried"))
            notes["resumed"] += bool(status.facts.get("resumed"))
            script_digest = status.facts.get("script_digest", "")
            notes["other_scripts"] += not present_digest.startswith(script_digest)
            script_digests.add(script_digest)
    total = counts["total"]
    # the number of runs at once on a cluster shows only in what runs there now
    at_once = max(total["running"], 1) if total["queued"] else places(config)
    to_go = estimate(rows, statuses, at_once)
    return {
        "campaign": config.name,
        "counts": counts,
        "failures": failures,
        "core_hours_spent": (spent + spent_on_failures) / 3600.0,
        "core_hours_predicted": sum(row.cpu_seconds for row in rows) / 3600.0,
        "core_hours_to_go": to_go.cpu_seconds / 3600.0,
        "seconds_to_go": to_go.seconds,
        "scripts": scripts,
        "script_versions": len(script_digests),
        **notes,
    }


def status_text(status: dict[str, Any]) -> str:
    """Return the dict of `campaign_status` as a few lines of text."""
    counts = status["counts"]
    words = [w for w in ORDER if counts["total"][w] or w in ("done", "running", "failed", "missing")]
    lines = [f"{status['campaign']}: " + bar(counts["total"]["done"], counts["total"]["total"])]
    lines.append(f"{'':12}" + "".join(f"{w:>9}" for w in (*words, "total")))
    for stage in (*STAGES, "total"):
        lines.append(f"{stage:12}" + "".join(f"{counts[stage][w]:>9}" for w in (*words, "total")))
    lines.append(
        f"core-hours: {status['core_hours_spent']:.2f} spent, {status['core_hours_predicted']:.2f} predicted in all; "
        f"about {span(status['seconds_to_go'])} to go"
    )
    if status["enough"]:
        lines.append(status["enough"])
    if counts["total"]["spared"]:
        lines.append(f"spared: {counts['total']['spared']} runs are not needed, since the target error was reached")
    for failure in status["failures"]:
        lines.append(f"{failure['state']}: {failure['run_id']}: {failure['reason']}")
    if status["queue"]:
        lines.append(status["queue"])
    lines += [f"missing: {run_id}: {reason}" for run_id, reason in status["lost"].items()]
    if status["stale"]:
        lines.append(f"stale: {len(status['stale'])} products of earlier settings, kept and not used")
    if status["retried"]:
        lines.append(f"{status['retried']} runs needed a second try with a smaller step")
    if status["resumed"]:
        lines.append(f"{status['resumed']} runs went on from a checkpoint")
    if status["other_scripts"]:
        lines.append(f"note: {status['other_scripts']} products were made by other {status['scripts']} "
                     f"than the present ones ({status['script_versions']} versions in all)")  # fmt: skip
    return "\n".join(lines)
