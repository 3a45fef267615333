"""The command line: python3 -m campaign COMMAND ..., or grain-scatter COMMAND ... where the package is installed."""

from __future__ import annotations

if __name__ == "__main__":  # before the other imports, which need Python 3.11
    from campaign.pythons import go_on_with_packages

    go_on_with_packages("campaign")

import argparse
import io
import os
import sys
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from analysis import __version__
from analysis.errors_and_files import GrainScatterError
from campaign import commands
from campaign.config import COMMAND, INSTALLED, ROOT, RUNS, Config, ConfigError, read_config
from campaign.config_keys import MOST_JOBS
from campaign.pythons import missing_package
from campaign.scope import SCOPE

CONFIG = "the TOML file of a campaign, such as campaign/demo.toml"
RESULTS = "a results.h5, the folder of a campaign, or its TOML file"
#: The results in the repository.
LAPTOP = "data/laptop/results.h5"


def main(argv: list[str] | None = None) -> int:
    """Run one command and return the exit code: that of the command, 2 for an error of use, 130 if interrupted.

    An error of use is printed in one line on stderr. Any exception that is raised from here is a bug.
    """
    options = _parser().parse_args(argv)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # in a log file the plan stands before the progress
    try:
        command = COMMANDS[options.command]
        if command.source != CONFIG:
            return command.run([_results(source) for source in options.sources], options)
        if options.command == "report" and (options.config.endswith(".h5") or Path(options.config).is_dir()):
            return commands.report_file(_results(options.config), options)
        config = _config(options)
        name = f"{config.name}_sweep" if options.command == "sweep" else config.name
        folder = Path(options.folder) if options.folder else RUNS / name
        return command.run(config, folder, options)
    except KeyboardInterrupt:
        print("stopped; the same command goes on from here", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ModuleNotFoundError as error:
        if str(error.name).split(".")[0] in ("analysis", "campaign"):
            raise
        print(f"campaign: {missing_package(str(error.name))}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"campaign: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
        return 2
    except GrainScatterError as error:
        print(f"campaign: {' '.join(str(error).split())}", file=sys.stderr)
        return 2


def _config(options: Namespace) -> Config:
    """The campaign file with the options that replace keys of it, where the command has them."""
    config = read_config(options.config)
    run_keys = {}
    if getattr(options, "engine", None):
        run_keys["engine"] = options.engine
    if (jobs := getattr(options, "jobs", None)) is not None:
        if not 1 <= jobs <= MOST_JOBS:
            raise ConfigError(f"--jobs = {jobs} is outside [1, {MOST_JOBS}]")
        if options.command != "status" and run_keys.get("engine", config.run.engine) == "slurm":
            raise ConfigError(f"--jobs = {jobs} has no effect in SLURM; run.slurm.throttle limits the tasks at once")
        run_keys["jobs"] = jobs
    return replace(config, run=replace(config.run, **run_keys))


def _results(source: str) -> Path:
    """The results file that a results file, a campaign's folder or a campaign file stands for."""
    if Path(source).is_dir():
        return Path(source) / "results.h5"
    return RUNS / read_config(source).name / "results.h5" if source.endswith(".toml") else Path(source)


def _parser() -> argparse.ArgumentParser:
    """The parser; a command accepts only the options it uses."""
    parser = argparse.ArgumentParser(
        prog=COMMAND,
        description="Stochastic DEM campaigns with YADE.",
        epilog=SCOPE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"grain-scatter {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    parents = {}
    for flag, settings in OPTIONS.items():
        parents[flag] = argparse.ArgumentParser(add_help=False)
        parents[flag].add_argument(flag, **settings)
    for name, command in COMMANDS.items():
        sub = commands.add_parser(
            name, help=command.help, description=command.help, parents=[parents[flag] for flag in command.options]
        )
        if command.source != CONFIG:
            sub.add_argument("sources", metavar="RESULTS", nargs=command.count, help=command.source)
        elif name == "report":
            default: dict[str, Any] = {} if INSTALLED else {"nargs": "?", "default": str(ROOT / LAPTOP)}
            text = f"{CONFIG}, or {RESULTS[: RESULTS.rindex(',')]}" + ("" if INSTALLED else f" (default: {LAPTOP})")
            sub.add_argument("config", metavar="CONFIG", help=text, **default)
        else:
            sub.add_argument("config", metavar="CONFIG", help=CONFIG)
    return parser


@dataclass(frozen=True)
class Command:
    """One command: its function, its line of help, the options that it accepts, and what it is given.

    With the source CONFIG, `run` takes a Config, the campaign's folder and the options; with RESULTS, the paths of
    `count` results files and the options.
    """

    run: Callable[..., int]
    help: str
    options: tuple[str, ...]
    source: str = CONFIG
    count: str | int = 1


RUN_OPTIONS = ("--folder", "--jobs", "--engine", "--failed", "--quiet")
COMMANDS = {
    "plan": Command(
        commands.plan, "fit the inputs, choose the points, write the tables of runs, predict the cost", ("--folder",)
    ),
    "run": Command(commands.run, "run what is missing", RUN_OPTIONS),
    "status": Command(
        commands.status,
        "print how many runs are done, running, failed and missing",
        ("--folder", "--jobs", "--json", "--check"),
    ),
    "missing": Command(commands.missing, "list the runs without a usable product", ("--folder", "--check")),
    "analyse": Command(
        commands.analyse, "compute metrics, PDFs and tables; write results.h5 and tables/", ("--folder",)
    ),
    "archive": Command(
        commands.archive,
        "write runs.h5, a compact archive of all runs; product files can then be deleted",
        ("--folder",),
    ),
    "report": Command(
        commands.report,
        "draw figures and report.html; given a results.h5 instead of CONFIG, also write the tables",
        ("--folder", "--figures", "--columns", "--dpi", "--interactive"),
    ),
    "compare": Command(
        commands.compare_results,
        "compare campaigns: settings, responses along strain, and moments with intervals, as HTML and CSV",
        ("--to",),
        RESULTS,
        "+",
    ),
    "export": Command(
        commands.export_results, "write all results as tidy CSV files, or as an Excel file", ("--to",), RESULTS
    ),
    "sweep": Command(
        commands.sweep,
        "run one campaign for each value of a key; write one table and one figure of the states",
        ("--folder", "--jobs", "--failed", "--quiet", "--set", "--with"),
    ),
    "prune": Command(
        commands.prune, "list the products that are stale or refused; --yes removes them", ("--folder", "--yes")
    ),
    "all": Command(commands.everything, "plan, run, analyse and report; nothing is done twice", RUN_OPTIONS),
}
OPTIONS: dict[str, dict] = {
    "--folder": {"help": "folder of the campaign (default: runs/<name>; for a results.h5: the folder it is in)"},
    "--jobs": {"type": int, "help": "number of runs at once (default: run.jobs, else one per core)"},
    "--engine": {"choices": ("local", "slurm"), "help": "where to run (default: run.engine)"},
    "--failed": {"action": "store_true", "help": "repeat failed runs, too"},
    "--quiet": {"action": "store_true", "help": "show no progress line"},
    "--set": {
        "action": "append",
        "default": [],
        "metavar": "KEY=VALUE,VALUE",
        "help": "the key and its values, such as consolidation.sigma_3_kPa=50,100,200; a list has brackets",
    },
    "--with": {
        "action": "append",
        "default": [],
        "dest": "along",
        "metavar": "KEY=VALUE,VALUE",
        "help": "a key that changes together with that of --set, with as many values; may be repeated",
    },
    "--figures": {
        "metavar": "FORMAT",
        "help": "also draw figures for print, into figures/print/: pdf (fonts embedded), svg (text as outlines), png",
    },
    "--columns": {
        "type": int,
        "help": "columns of a journal that a figure for print takes: 1 (88 mm) or 2 (180 mm; default)",
    },
    "--dpi": {
        "type": int,
        "help": "dots per inch of a png, and of the surfaces in a pdf or svg, from 72 to 1200 (default: 600)",
    },
    "--interactive": {
        "action": "store_true",
        "help": "also write explore.html, a page to explore the results in a browser (needs plotly)",
    },
    "--to": {"metavar": "PATH", "help": "folder of the output; for export also a file, such as results.xlsx"},
    "--yes": {"action": "store_true", "help": "remove the files that are listed"},
    "--json": {"action": "store_true", "help": "print JSON, for scripts"},
    "--check": {
        "action": "store_true",
        "help": "read every product again, also those whose size and times are unchanged",
    },
}


if __name__ == "__main__":
    sys.exit(main())
