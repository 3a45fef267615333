"""The command line: python3 -m campaign {plan,run,status,missing,analyse,archive,report,all} CONFIG"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path

from campaign.config import ROOT, Config, ConfigError, read_config
from campaign.plan import collapsing, make_rows, predicted_cost, write_plan

COMMANDS = {
    "plan": "fit the inputs, choose the points, write the tables of runs and predict the cost",
    "run": "run what is missing",
    "status": "tell what is done, running, failed and missing",
    "missing": "list the runs without a product",
    "analyse": "metrics, probability densities and tables into results.h5",
    "archive": "runs.h5: all that analyse takes from the products, which may then go",
    "report": "figures and report.html; of a results.h5 in place of CONFIG the tables, too, no folder needed",
    "all": "plan, run, analyse and report; nothing is done twice",
}

CONFIG = "a campaign's TOML file, such as campaign/demo.toml"
#: The results in the repository.
LAPTOP = ROOT / "data" / "laptop" / "results.h5"


def main(argv: list[str] | None = None) -> int:
    """Run one command; a user's error ends in one line on stderr and status 2."""
    options = _parser().parse_args(argv)
    try:
        if options.command == "report" and options.config.endswith(".h5"):
            return report_file(Path(options.config), options.folder)
        config = read_config(options.config)
        if options.jobs is not None:
            if options.jobs < 1:
                raise ConfigError(f"--jobs = {options.jobs} is outside [1, 4096]")
            config = replace(config, run=replace(config.run, jobs=options.jobs))
        if options.engine:
            config = replace(config, run=replace(config.run, engine=options.engine))
        folder = Path(options.folder) if options.folder else ROOT / "runs" / config.name
        return _command(options)(config, folder, options)
    except KeyboardInterrupt:
        print("stopped; the same command goes on from here", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ModuleNotFoundError as error:
        print(f"campaign: {error.name}: no such package for {sys.executable}; `make setup` installs it for "
              "/usr/bin/python3", file=sys.stderr)  # fmt: skip
        return 2
    except OSError as error:
        print(f"campaign: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
        return 2
    except (ValueError, RuntimeError) as error:
        if not _is_ours(error):
            raise
        print(f"campaign: {' '.join(str(error).split())}", file=sys.stderr)
        return 2


def _is_ours(error: Exception) -> bool:
    """Errors with a line for the user are subclasses of this project's own; a bare ValueError is a bug."""
    return type(error).__module__.split(".")[0] in ("campaign", "analysis")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python3 -m campaign", description="Stochastic DEM campaigns with YADE.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, text in COMMANDS.items():
        sub = commands.add_parser(name, help=text, description=text)
        default = {"nargs": "?", "default": str(LAPTOP)} if name == "report" else {}
        told = f"a campaign's TOML file, or a results.h5 (default: {LAPTOP.relative_to(ROOT)})" if default else CONFIG
        sub.add_argument("config", metavar="CONFIG", help=told, **default)
        sub.add_argument("--folder", help="where the campaign lives (default: runs/<name>; of a results.h5: its own)")
        sub.add_argument("--jobs", type=int, help="runs at once (default: run.jobs, else one per core)")
        sub.add_argument("--engine", choices=("local", "slurm"), help="default: run.engine")
        sub.add_argument("--failed", action="store_true", help="run failed ones again, too")
        sub.add_argument("--json", action="store_true", help="status for scripts")
        sub.add_argument("--check", action="store_true", help="read every product again, however unchanged it looks")
        sub.add_argument("--quiet", action="store_true", help="no progress line")
    return parser


def _command(options):
    return {"plan": plan, "run": run, "status": status, "missing": missing, "analyse": analyse, "archive": archive,
            "report": report, "all": everything}[options.command]  # fmt: skip


def plan(config: Config, folder: Path, options) -> int:
    rows, word, points = _plan(config, folder)
    print(f"{config.name}: {len(points)} points {word}, {len(rows)} runs in {_shown(folder)}")
    print(f"{'':12}{'runs':>8}{'particle-steps':>18}{'core-hours':>12}   (predicted)")
    for stage, cost in predicted_cost(rows).items():
        print(f"{stage:12}{cost['runs']:>8}{cost['particle_steps']:>18.2e}{cost['core_hours']:>12.2f}")
    for mu_iso, count in collapsing(rows).items():
        print(f"mu_iso = {mu_iso:g}: {count} of {len(points)} points have a lower mu_s; their packings collapse when "
              "the grains take it on, and how far depends on the grains' inertia too (e: by under 1 %)")  # fmt: skip
    return 0


def run(config: Config, folder: Path, options) -> int:
    from campaign import enough
    from campaign.status import campaign_status

    rows, _, _ = _plan(config, folder)
    if config.run.engine == "slurm":
        from campaign.slurm import submit_missing

        step = enough.next_step(config, folder, rows, say=print)
        print(submit_missing(config, folder, rows, again=options.failed, spared=step.spared))
        return 0
    from campaign.local import run_missing

    again = iter([options.failed])  # failed runs get one more try, not one a batch

    def engine(spared):
        return run_missing(config, folder, rows, again=next(again, False), quiet=options.quiet, spared=spared)

    added = enough.run_in_steps(config, folder, rows, engine, say=print)
    told = campaign_status(config, folder, rows)
    counts = told["counts"]["total"]
    spared = f", {counts['spared']} spared" if counts["spared"] else ""
    print(f"{config.name}: {added} runs finished now, {counts['done']} of {counts['total']} done{spared}")
    for failure in told["failures"]:
        print(f"{failure['state']}: {failure['run_id']}: {failure['reason']}", file=sys.stderr)
    left = counts["missing"] + counts["refused"]
    if left:
        print(f"campaign: {left} runs are still missing; their logs tell why: {_why(folder, rows)}", file=sys.stderr)
        return 3
    return 1 if counts["failed"] else 0


def _why(folder: Path, rows) -> str:
    """Why runs are missing: the disk, or the last line of the first missing run's log."""
    free = shutil.disk_usage(folder).free
    if free < 16 << 20:
        return f"no space left on the disk ({free >> 20} MiB free)"
    for row in rows:
        log = folder / "logs" / f"{row.run_id}.log"
        if not (folder / row.product).exists() and log.exists():
            lines = [t for t in log.read_text(errors="replace").split("=====")[0].splitlines() if t.strip()]
            return f"{row.run_id}: {lines[-1].strip()[:200]}" if lines else str(log)
    return "no log was written"


def status(config: Config, folder: Path, options) -> int:
    from campaign.status import campaign_status, status_text

    told = campaign_status(config, folder, _rows(config, folder), rehash=options.check)
    print(json.dumps(told, indent=1) if options.json else status_text(told))
    return 0


def missing(config: Config, folder: Path, options) -> int:
    from campaign import enough
    from campaign.products import look

    rows = _rows(config, folder)
    states = look(folder, rows, rehash=options.check, spared=enough.spared(config, folder, rows))
    for row in rows:
        if states[row.run_id].state in ("missing", "refused"):
            print(row.run_id)
    return 0


def analyse(config: Config, folder: Path, options) -> int:
    from campaign.evaluate import analyse as evaluate

    print(evaluate(config, folder, _rows(config, folder)))
    return 0


def archive(config: Config, folder: Path, options) -> int:
    from campaign.evaluate import archive as write

    print(write(config, folder, _rows(config, folder)))
    return 0


def report(config: Config, folder: Path, options) -> int:
    from campaign.evaluate import report as write

    print(write(config, folder))
    return 0


def report_file(results: Path, folder: str | None) -> int:
    """Every table and figure and the report of a results file, beside it or in a folder."""
    from campaign.evaluate import report_of_file

    print(report_of_file(results, Path(folder) if folder else results.parent))
    return 0


def everything(config: Config, folder: Path, options) -> int:
    plan(config, folder, options)
    code = run(config, folder, options)
    if code > 1 or config.run.engine == "slurm":
        return code
    return analyse(config, folder, options) or report(config, folder, options)


def _plan(config: Config, folder: Path):
    from campaign.prepare import prepare

    points, word = prepare(config, folder)
    rows = make_rows(config, points)
    for name in write_plan(rows, folder):
        print(f"note: {name} was edited by hand; written anew from the campaign file", file=sys.stderr)
    return rows, word, points


def _rows(config: Config, folder: Path):
    """The rows of a planned campaign; nothing is written."""
    from campaign.prepare import read_planned_points

    return make_rows(config, read_planned_points(config, folder))


def _shown(path: Path) -> str:
    return os.path.relpath(path) if len(os.path.relpath(path)) < len(str(path)) else str(path)


if __name__ == "__main__":
    sys.exit(main())
