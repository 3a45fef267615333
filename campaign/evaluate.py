"""From products to results.h5, tables, figures and report; each is made again only if something changed."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from campaign import batches
from campaign.config import ROOT, Config, ConfigError
from campaign.config_keys import SECTIONS
from campaign.files import code_digest, read_json, write_json
from campaign.plan import PlannedRun
from campaign.prepare import PlanError, read_inputs, read_points
from campaign.products import ARCHIVE, RunStatus, archived, run_statuses, write_blocked

if TYPE_CHECKING:
    import pandas as pd

    from analysis.results.build import CampaignInfo
    from analysis.results.reader import Results

    Frames = dict[str, pd.DataFrame]

NOTE = "tables/analysed.json"
#: Folder of the figures for print, and what they may be: formats, columns of a journal, and dots per inch.
PRINT_FOLDER = Path("figures") / "print"
PRINT_FORMATS, PRINT_COLUMNS, PRINT_DPI = ("pdf", "svg", "png"), (1, 2), (72, 1200)
ANALYSIS = ROOT / "analysis"
#: Sections that hold the distributions of the inputs.
STATED = ("variables", "dependence")
#: Bootstrap samples of the pairs behind the bands. With 200, the statistical error of the 2.5 % quantile of a moment is
#: a twentieth of the band.
INPUT_BOOTSTRAP = 200


def analyse(config: Config, folder: Path, rows: Sequence[PlannedRun]) -> tuple[str, Frames | None]:
    """Build results.h5 and the tables from the products of all planned runs.

    Returns one line on what was done, and the tables' frames, or None where results.h5 was up to date. Raises PlanError
    if runs are missing or refused, and the errors of the analysis.
    """
    spared = batches.spared(config, folder, rows)
    statuses = _usable(folder, rows, spared=spared)
    spared &= {status.run_id for status in statuses.values() if status.status == "spared"}
    without_outcome = [s for s in statuses.values() if s.status not in ("done", "failed", "spared")]
    if without_outcome:
        raise PlanError(
            f"{len(without_outcome)} of {len(rows)} runs have no product yet ({without_outcome[0].run_id}); "
            "`run` makes them"
        )
    write_blocked(folder, statuses)
    digest = results_digest(config, folder, rows, spared)
    if read_json(folder / NOTE, {}).get("results") == digest and (folder / "results.h5").exists():
        return f"{folder.name}: results.h5 is up to date", None
    from analysis.results import read_results
    from analysis.results.build import build_results
    from analysis.tables import evaluate, write_tables

    _usable(folder, rows, rehash=True, spared=spared)  # read every byte again before numbers are computed from it
    build_results(
        folder,
        plan_frame(folder, rows, spared),
        read_points(folder),
        campaign_info(config, folder),
        max_lost_probability=config.failures.max_lost_probability,
        pdf_method=config.pdem.method,
        cells=config.pdem.cells,
        input_bootstrap=INPUT_BOOTSTRAP,
    )
    frames = evaluate(read_results(folder / "results.h5"))
    write_tables(frames, folder)
    write_json(folder / NOTE, {"results": digest})
    return f"{folder.name}: results.h5 and tables from {len(rows) - len(spared)} runs", frames


def archive(folder: Path, rows: Sequence[PlannedRun]) -> str:
    """Write runs.h5: the runs that it held before, and a summary of every product of the plan.

    Returns one line on what was done. Raises PlanError for a product that cannot be used, and the analysis' errors.
    """
    from analysis.runs.archive import Archive, run_summary, write_archive
    from analysis.runs.run_file import read_run

    path = folder / ARCHIVE
    before = Archive(path)
    statuses = _usable(folder, rows, rehash=True)
    measured_by = {"measured_by": code_digest(ANALYSIS)[:12]}
    summaries = {}
    for status in statuses.values():
        if status.status == "done" and not status.facts.get("archived"):
            summary = run_summary(read_run(folder / f"products/{status.run_id}.h5"))
            summaries[status.run_id] = replace(summary, facts=summary.facts | measured_by)
    merged = {**{run_id: before[run_id] for run_id in before if run_id not in summaries}, **summaries}
    write_archive(path, merged)
    return f"{folder.name}: {path.name} keeps {len(merged)} runs, {path.stat().st_size / 2**20:.1f} MiB"


def _usable(
    folder: Path, rows: Sequence[PlannedRun], rehash: bool = False, spared: frozenset[str] = frozenset()
) -> dict[str, RunStatus]:
    """The status of every run. Raises PlanError if there is a product that cannot be used, or not be read now."""
    statuses = run_statuses(folder, rows, rehash=rehash, spared=spared)
    if unknown := [status for status in statuses.values() if status.status == "unknown"]:
        raise PlanError(f"{unknown[0].reason} ({len(unknown)} such files)")
    if refused := [status for status in statuses.values() if status.status == "refused"]:
        first = refused[0]
        raise PlanError(f"products/{first.run_id}.h5: {first.reason} ({len(refused)} such products)")
    return statuses


@dataclass(frozen=True)
class Print:
    """Figures for print: their format, the columns of a journal that they take, and the dots per inch of pixels.

    Raises ConfigError for a value that is not possible.
    """

    file_format: str
    columns: int = 2
    dpi: int = 600

    def __post_init__(self) -> None:
        if self.file_format not in PRINT_FORMATS:
            raise ConfigError(f"--figures = {self.file_format!r} is not one of {', '.join(PRINT_FORMATS)}")
        if self.columns not in PRINT_COLUMNS:
            raise ConfigError(f"--columns = {self.columns} is not 1 or 2 (columns of a journal)")
        low, high = PRINT_DPI
        if not low <= self.dpi <= high:
            raise ConfigError(f"--dpi = {self.dpi} is outside [{low}, {high}]")


def _print_figures(path: Path, folder: Path, wanted: Print | None, frames: Frames | None) -> str:
    """Draw the figures of a results file for print into figures/print of a folder, if wanted; one more line, or ""."""
    if wanted is None:
        return ""
    from analysis.figures import write_print_figures
    from analysis.results import read_results
    from analysis.tables import evaluate

    results = read_results(path)
    frames = evaluate(results) if frames is None else frames
    target = folder / PRINT_FOLDER
    paths = write_print_figures(results, frames, target, wanted.file_format, wanted.columns, wanted.dpi)
    return f"\n{target}: {len(paths)} figures for print ({wanted.file_format}, columns: {wanted.columns})"


def report(
    config: Config, folder: Path, frames: Frames | None = None, wanted: Print | None = None, interactive: bool = False
) -> str:
    """Draw the figures and write report.html from the folder's results.h5; draw the figures for print, if wanted.

    interactive: write explore.html, too. frames: the tables of these results, if they have been computed already.
    Returns a line on each thing that was done. Raises PlanError if there is no results.h5 or it was made with other
    settings, ConfigError if explore.html is wanted and plotly is not installed, and the analysis' errors.
    """
    path = folder / "results.h5"
    if not path.exists():
        raise PlanError(f"{folder}: has no results.h5; `analyse` makes it")
    if changed := _changed_setting(config, path):
        raise PlanError(f"{path}: was made with other settings ({changed}); `analyse` makes it again")
    _check_interactive(interactive)
    from analysis.results import read_results

    stat = path.stat()
    digest = hashlib.sha256(f"{stat.st_size} {stat.st_mtime_ns} {code_digest(ANALYSIS)}".encode()).hexdigest()
    note = read_json(folder / NOTE, {})
    if note.get("report") == digest and (folder / "report.html").exists():
        line = f"{folder.name}: report.html is up to date" + _print_figures(path, folder, wanted, frames)
        return line + (_explore(read_results(path), folder) if interactive else "")
    from analysis.report import write_report
    from analysis.tables import evaluate

    results = read_results(path)
    frames = evaluate(results) if frames is None else frames
    page = write_report(results, frames, folder)
    write_json(folder / NOTE, note | {"report": digest})
    line = f"{folder.name}: {page}" + _print_figures(path, folder, wanted, frames)
    return line + (_explore(results, folder) if interactive else "")


def _check_interactive(interactive: bool) -> None:
    """Raise ConfigError, before anything is computed, if explore.html is wanted and plotly is not installed."""
    if interactive and importlib.util.find_spec("plotly") is None:
        raise ConfigError("--interactive needs plotly, which is not installed (Debian: python3-plotly; PyPI: plotly)")


def _explore(results: Results, folder: Path) -> str:
    """Write explore.html; one more line."""
    from analysis.report.explore import write_explore

    return f"\n{write_explore(results, folder)}"


def _settings(config: Config) -> dict[str, Any]:
    """Every key of a campaign by section; [variables] and [dependence] only where they are given."""
    settings = {name: asdict(getattr(config, name)) for name in SECTIONS}
    if config.curve:
        settings["assembly"]["sieve_curve"] = asdict(config.curve)
    return settings | {name: getattr(config, name) for name in STATED if getattr(config, name)}


def _changed_setting(config: Config, results: Path) -> str:
    """The first setting of a results file that is not the campaign file's, as one line; "" if there is none.

    How runs are started ([run]) does not count.
    """
    from analysis.errors_and_files import open_hdf5
    from analysis.results import ResultsError

    with open_hdf5(results, ResultsError, "results file") as file:
        text = file.attrs.get("settings", "{}")
    try:
        stored = json.loads(text)
    except ValueError as error:
        raise PlanError(f"{results}: its settings cannot be read ({error})") from error
    present = json.loads(json.dumps({name: keys for name, keys in _settings(config).items() if name != "run"}))
    stored = stored if isinstance(stored, dict) else {}
    for section in STATED:
        if stored.get(section, {}) != present.pop(section, {}):
            return f"[{section}]"
    for section, keys in present.items():
        before = stored.get(section, keys)
        for key, value in keys.items():
            if before.get(key, value) != value:
                return f"{section}.{key} = {before[key]!r}, now {value!r}"
    return ""


def report_of_file(path: Path, folder: Path, wanted: Print | None = None, interactive: bool = False) -> str:
    """Write tables, figures and report.html of a results file into a folder; nothing else of the campaign is needed.

    Draws the figures for print and writes explore.html, too, if wanted. Returns a line on each thing that was done.
    Raises analysis.results.ResultsError for a file that cannot be used.
    """
    _check_interactive(interactive)
    from analysis.report import write_report
    from analysis.results import read_results
    from analysis.tables import evaluate, write_tables

    results = read_results(path)
    folder.mkdir(parents=True, exist_ok=True)
    frames = evaluate(results)
    written = write_tables(frames, folder)
    line = f"{path}: {len(written)} tables and {write_report(results, frames, folder)}"
    return line + _print_figures(path, folder, wanted, frames) + (_explore(results, folder) if interactive else "")


def plan_frame(folder: Path, rows: Sequence[PlannedRun], spared: frozenset[str] = frozenset()) -> pd.DataFrame:
    """Return the plan as the analysis reads it: one line per run, with the product's path and status "spared" or ""."""
    import pandas as pd

    names = ("run_id", "stage", "family", "point", "packing", "mu_iso", "mu_s", "G_p", "start", "particle_steps")
    frame = pd.DataFrame([{name: getattr(row, name) for name in names} for row in rows])
    for name in dict.fromkeys(name for row in rows for name in row.further):
        frame[name] = [row.values.get(name, row.further.get(name, math.nan)) for row in rows]
    frame["product"] = [str((folder / row.product).resolve()) for row in rows]
    frame["status"] = ["spared" if row.run_id in spared else "" for row in rows]
    return frame


def campaign_info(config: Config, folder: Path) -> CampaignInfo:
    """What results.h5 states of the campaign beside its runs."""
    import numpy as np

    from analysis.results.build import CampaignInfo

    inputs = read_inputs(folder)
    return CampaignInfo(
        name=config.name,
        config=config.text,
        settings=_settings(config),
        pairs=np.asarray(inputs["pairs"], float),
        versions={"analysis code": code_digest(ANALYSIS)[:12]},
        warnings=inputs.get("warnings", []),
        specified=inputs.get("specified", {}),
        pairs_behind=inputs.get("pairs_behind", 0),
        **{name: inputs[name] for name in ("source", "marginals", "copulas", "joint", "point_attrs")},
    )


def results_digest(
    config: Config, folder: Path, rows: Sequence[PlannedRun], spared: frozenset[str] = frozenset()
) -> str:
    """Return the hash of everything that results.h5 depends on: rows, products, points, settings, analysis code.

    Raises OSError if inputs.json cannot be read, StopIteration if a run is neither spared nor has an outcome.
    """
    digest = hashlib.sha256(code_digest(ANALYSIS).encode())
    digest.update(json.dumps([config.text, asdict(config.pdem), asdict(config.failures)]).encode())
    digest.update((folder / "inputs.json").read_bytes())
    archive_ids = archived(folder).keys()
    for row in rows:
        if row.run_id in spared:
            digest.update(f"{row.run_id} spared\n".encode())
            continue
        outcomes = (folder / row.product, folder / ARCHIVE, (folder / row.product).with_suffix(".failed.json"))
        path = next(p for p in outcomes if p.exists() and (p.name != ARCHIVE or row.run_id in archive_ids))
        stat = path.stat()
        digest.update(f"{row.run_id} {path.suffix} {stat.st_size} {stat.st_mtime_ns}\n".encode())
    return digest.hexdigest()
