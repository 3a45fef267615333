"""What each command does: from a campaign file, its folder and the options to printed lines and an exit code."""

from __future__ import annotations

import json
import os
import shutil
import sys
from argparse import Namespace
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from campaign import batches, compare, engine_local, engine_slurm, evaluate, pace
from campaign.cell import check_cell
from campaign.config import Config, ConfigError
from campaign.config_checks import settings_warnings
from campaign.plan import PlannedRun, collapsing, make_rows, predicted_cost, write_plan
from campaign.prepare import describe_inputs, prepare, read_planned_points
from campaign.products import run_statuses
from campaign.prune import prune_products
from campaign.run_one import FREE_BYTES
from campaign.status import campaign_status, status_text
from campaign.sweep import run_sweep
from campaign.sweep_values import variants

if TYPE_CHECKING:
    from analysis.points import RepresentativePoints


def plan(config: Config, folder: Path, options: Namespace) -> int:
    """Plan the campaign and print the fitted inputs, the points and the predicted cost."""
    _plan_and_print(config, folder)
    return 0


def _plan_and_print(config: Config, folder: Path) -> list[PlannedRun]:
    rows, points, outcome = _plan(config, folder)
    count = len(points)
    lines, warnings = describe_inputs(folder, points)
    warnings += settings_warnings(config)
    print("\n".join([*lines, *(f"warning: {warning}" for warning in warnings)]))
    print(f"{config.name}: {count} points {outcome}, {len(rows)} runs in {_shown(folder)}")
    print(f"{'':12}{'runs':>8}{'particle-steps':>18}{'core-hours':>12}   (predicted)")
    for stage, cost in predicted_cost(rows).items():
        print(f"{stage:12}{cost['runs']:>8}{cost['particle_steps']:>18.2e}{cost['core_hours']:>12.2f}")
    print(pace.sentence(rows, folder), end="")
    for mu_iso, lower in collapsing(rows).items():
        print(f"mu_iso = {mu_iso:g}: {lower} of {count} points have a lower mu_s; there the packing collapses when the "
              "grains take on their own mu_s; e then depends on the grains' inertia, by under 1 %")  # fmt: skip
    return rows


def run(config: Config, folder: Path, options: Namespace) -> int:
    """Plan the campaign and run what is missing. Exit codes: 0 all done, 1 runs failed, 3 runs are still missing."""
    rows, points, outcome = _plan(config, folder)
    if outcome != "kept":
        for warning in describe_inputs(folder, points)[1]:
            print(f"warning: {warning}", file=sys.stderr)
    return _run(config, folder, rows, options)


def _run(config: Config, folder: Path, rows: Sequence[PlannedRun], options: Namespace) -> int:
    if config.run.engine == "slurm":
        step = batches.next_step(config, folder, rows)
        print(engine_slurm.submit_missing(config, folder, rows, again=options.failed, spared=step.spared))
        return 0
    again = iter([options.failed])  # failed runs are repeated once, not once per batch of points

    def engine(spared: frozenset[str]) -> int:
        return engine_local.run_missing(
            config, folder, rows, again=next(again, False), quiet=options.quiet, spared=spared
        )

    added = batches.run_in_steps(config, folder, rows, engine)
    if added:
        pace.keep(folder, rows, run_statuses(folder, rows))
    status = campaign_status(config, folder, rows)
    counts = status["counts"]["total"]
    spared = f", {counts['spared']} spared" if counts["spared"] else ""
    print(f"{config.name}: {added} runs finished now, {counts['done']} of {counts['total']} done{spared}")
    for failure in status["failures"]:
        print(f"{failure['state']}: {failure['run_id']}: {failure['reason']}", file=sys.stderr)
    if counts["unknown"]:
        print(f"campaign: {counts['unknown']} runs are unknown: their files cannot be read now", file=sys.stderr)
        return 3
    still_missing = counts["missing"] + counts["refused"]
    if still_missing:
        print(f"campaign: {still_missing} runs are still missing: {_why_missing(folder, rows)}", file=sys.stderr)
        return 3
    return 1 if counts["failed"] else 0


def _why_missing(folder: Path, rows: Sequence[PlannedRun]) -> str:
    """Why runs are missing: the disk is full, or the last line in the log of the first missing run."""
    free = shutil.disk_usage(folder).free
    if free < FREE_BYTES:
        return f"no space left on the disk ({free >> 20} MiB free)"
    for row in rows:
        log = folder / "logs" / f"{row.run_id}.log"
        if not (folder / row.product).exists() and log.exists():
            lines = [t for t in log.read_text(errors="replace").split("=====")[0].splitlines() if t.strip()]
            return f"{row.run_id}: {lines[-1].strip()[:200]}" if lines else str(log)
    return "no log was written"


def status(config: Config, folder: Path, options: Namespace) -> int:
    """Print the status of a planned campaign; nothing is planned or run."""
    status = campaign_status(config, folder, _planned_rows(config, folder), rehash=options.check)
    print(json.dumps(status, indent=1) if options.json else status_text(status))
    return 3 if status["counts"]["total"]["unknown"] else 0


def missing(config: Config, folder: Path, options: Namespace) -> int:
    """Print the ids of the runs without a usable product."""
    rows = _planned_rows(config, folder)
    spared = batches.spared(config, folder, rows)
    statuses = run_statuses(folder, rows, rehash=options.check, spared=spared)
    for row in rows:
        if statuses[row.run_id].status in ("missing", "refused"):
            print(row.run_id)
    unknown = [status for status in statuses.values() if status.status == "unknown"]
    for state in unknown:
        print(f"campaign: unknown: {state.run_id}: {state.reason}", file=sys.stderr)
    return 3 if unknown else 0


def analyse(config: Config, folder: Path, options: Namespace) -> int:
    """Write results.h5 and the tables."""
    line, _ = evaluate.analyse(config, folder, _planned_rows(config, folder))
    print(line)
    return 0


def archive(config: Config, folder: Path, options: Namespace) -> int:
    """Write runs.h5."""
    print(evaluate.archive(folder, _planned_rows(config, folder)))
    return 0


def report(config: Config, folder: Path, options: Namespace) -> int:
    """Write the figures and report.html, and the figures for print and explore.html if wanted."""
    print(evaluate.report(config, folder, wanted=_print(options), interactive=options.interactive))
    return 0


def report_file(results: Path, options: Namespace) -> int:
    """Write tables, figures and report.html of a results file, beside the file or into a folder."""
    folder = Path(options.folder) if options.folder else results.parent
    print(evaluate.report_of_file(results, folder, _print(options), options.interactive))
    return 0


def compare_results(paths: Sequence[Path], options: Namespace) -> int:
    """Compare campaigns by their results files."""
    print(compare.compare(paths, Path(options.to or "comparison")))
    return 0


def export_results(paths: Sequence[Path], options: Namespace) -> int:
    """Write all results of a results file as CSV files or as an Excel file."""
    if options.to is None:
        raise ConfigError("export needs --to FOLDER or --to FILE.xlsx")
    print(compare.export(paths[0], Path(options.to)))
    return 0


def prune(config: Config, folder: Path, options: Namespace) -> int:
    """List the products that no planned run uses; remove them if asked to."""
    print(prune_products(folder, _planned_rows(config, folder), remove=options.yes))
    return 0


def _print(options: Namespace) -> evaluate.Print | None:
    """The figures for print that the options ask for, or None. Raises ConfigError for a value that is not possible."""
    given = {key: value for key in ("columns", "dpi") if (value := getattr(options, key)) is not None}
    if options.figures is None:
        if given:
            raise ConfigError(f"--{next(iter(given))} has an effect with --figures only")
        return None
    return evaluate.Print(options.figures, **given)


def everything(config: Config, folder: Path, options: Namespace) -> int:
    """Plan, run, analyse and report; ends after `run` if runs are still missing, or wait in SLURM."""
    rows = _plan_and_print(config, folder)
    code = _run(config, folder, rows, options)
    if code > 1 or config.run.engine == "slurm":
        return code
    line, frames = evaluate.analyse(config, folder, rows)
    print(line)
    print(evaluate.report(config, folder, frames))
    return 0


def sweep(config: Config, folder: Path, options: Namespace) -> int:
    """Plan, run, analyse and report one campaign per value of a key; write a table and a figure of the states."""
    key, campaigns = variants(config, options.set, options.along)
    return run_sweep(
        key, campaigns, folder, lambda one, place: _plan(one, place)[0],
        lambda one, place: everything(one, place, options),
    )  # fmt: skip


def _plan(config: Config, folder: Path) -> tuple[list[PlannedRun], RepresentativePoints, str]:
    """Plan the campaign; the rows, the points and what was done with them."""
    if "sigma_ln" not in config.variables:
        check_cell(config)
    points, outcome = prepare(config, folder, partial(check_cell, config))
    rows = make_rows(config, points)
    for name in write_plan(rows, folder):
        print(f"note: {name} was edited by hand; written anew from the campaign file", file=sys.stderr)
    return rows, points, outcome


def _planned_rows(config: Config, folder: Path) -> list[PlannedRun]:
    """The rows of a planned campaign; nothing is written."""
    return make_rows(config, read_planned_points(config, folder))


def _shown(path: Path) -> str:
    return os.path.relpath(path) if len(os.path.relpath(path)) < len(str(path)) else str(path)
