"""From products to results.h5, tables, figures and the report; only when something changed since the last time."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path

from campaign import enough
from campaign.config import ROOT, SECTIONS, Config
from campaign.files import code_digest, read_json, write_json
from campaign.plan import Row
from campaign.prepare import PlanError, read_points
from campaign.products import ARCHIVE, State, archived, look, write_blocked

NOTE = "tables/analysed.json"
ANALYSIS = ROOT / "analysis"
#: Resamplings of the pairs behind the bands: the 2.5 % quantile of a moment is then known to a twentieth of the band.
INPUT_BOOTSTRAP = 200


def analyse(config: Config, folder: Path, rows: list[Row]) -> str:
    """Build results.h5 and the tables from every product of the plan; returns a line that tells what was done.

    Raises PlanError when runs are missing or refused, and the analysis' own errors.
    """
    spared = enough.spared(config, folder, rows)
    states = _usable(folder, rows, spared=spared)
    left = [s for s in states.values() if s.state not in ("done", "failed")]
    spared &= {s.run_id for s in left if s.state == "spared"}
    left = [s for s in left if s.state != "spared"]
    if left:
        raise PlanError(f"{len(left)} of {len(rows)} runs have no product yet ({left[0].run_id}); `run` makes them")
    write_blocked(folder, states)
    wanted = _digest(config, folder, rows, spared)
    if read_json(folder / NOTE, {}).get("results") == wanted and (folder / "results.h5").exists():
        return f"{folder.name}: results.h5 is up to date"
    import pandas as pd

    from analysis import responses, tables

    _usable(folder, rows, rehash=True, spared=spared)  # before numbers are made of them, read every byte again
    results = responses.build_results(folder, plan_frame(folder, rows, spared), pd.DataFrame(read_points(folder)),
                                      _settings(config, folder))  # fmt: skip
    tables.write_tables(results, folder)
    write_json(folder / NOTE, {"results": wanted})
    return f"{folder.name}: results.h5 and tables from {len(rows) - len(spared)} runs"


def archive(config: Config, folder: Path, rows: list[Row]) -> str:
    """Write runs.h5: what the analysis takes from every product, with the runs that it had already.

    Returns a line that tells what was done.  Raises PlanError for a product that cannot be used.
    """
    from analysis.archive import Archive, contribution, write_archive
    from analysis.runfile import read_run

    path = folder / ARCHIVE
    had = Archive(path)
    states = _usable(folder, rows, rehash=True)
    done = [s.run_id for s in states.values() if s.state == "done" and not s.facts.get("archived")]
    code = {"measured_by": code_digest(ANALYSIS)[:12]}
    found = {run_id: contribution(read_run(folder / f"products/{run_id}.h5")) for run_id in done}
    kept = {run_id: replace(given, facts=given.facts | code) for run_id, given in found.items()}
    write_archive(path, {**{run_id: had[run_id] for run_id in had if run_id not in kept}, **kept})
    return f"{folder.name}: {path.name} keeps {len(set(had) | set(kept))} runs, {path.stat().st_size / 2**20:.1f} MiB"


def _usable(
    folder: Path, rows: list[Row], rehash: bool = False, spared: frozenset[str] = frozenset()
) -> dict[str, State]:
    """The states of all rows.  Raises PlanError where a product is there and cannot be used."""
    states = look(folder, rows, rehash=rehash, spared=spared)
    if bad := [s for s in states.values() if s.state == "refused"]:
        raise PlanError(f"products/{bad[0].run_id}.h5: {bad[0].reason} ({len(bad)} such products)")
    return states


def report(config: Config, folder: Path) -> str:
    """Draw the figures and write report.html; returns a line that tells what was done."""
    results = folder / "results.h5"
    if not results.exists():
        raise PlanError(f"{folder}: has no results.h5; `analyse` makes it")
    stat = results.stat()
    wanted = hashlib.sha256(f"{stat.st_size} {stat.st_mtime_ns} {code_digest(ANALYSIS)}".encode()).hexdigest()
    noted = read_json(folder / NOTE, {})
    if noted.get("report") == wanted and (folder / "report.html").exists():
        return f"{folder.name}: report.html is up to date"
    from analysis.report import write_report

    path = write_report(results, folder)
    write_json(folder / NOTE, noted | {"report": wanted})
    return f"{folder.name}: {path}"


def report_of_file(results: Path, folder: Path) -> str:
    """Tables, figures and report.html of a results file into a folder; returns a line that tells what was done.

    Needs nothing else of the campaign.  Raises analysis.results.ResultsError for a file that cannot be used.
    """
    from analysis import tables
    from analysis.report import write_report
    from analysis.results import read_results

    opened = read_results(results)
    folder.mkdir(parents=True, exist_ok=True)
    written = tables.write_tables(opened, folder)
    return f"{results}: {len(written)} tables and {write_report(opened, folder)}"


def plan_frame(folder: Path, rows: list[Row], spared: frozenset[str] = frozenset()):
    """The plan as the analysis takes it: one line a run, the product's full path, status "spared" where none is due."""
    import pandas as pd

    names = ("run_id", "stage", "family", "point", "packing", "mu_iso", "mu_s", "G_p", "start", "particle_steps")
    frame = pd.DataFrame([{name: getattr(row, name) for name in names} for row in rows])
    frame["product"] = [str((folder / row.product).resolve()) for row in rows]
    frame["status"] = ["spared" if row.run_id in spared else "" for row in rows]
    return frame


def _settings(config: Config, folder: Path) -> dict:
    noted = read_json(folder / "inputs.json", {})
    return {
        "campaign": config.name,
        "config": config.text,
        "settings": {name: asdict(getattr(config, name)) for name in SECTIONS},
        "versions": {"analysis code": code_digest(ANALYSIS)[:12]},
        **{k: noted[k] for k in ("pairs", "source", "marginals", "copulas", "joint", "point_attrs")},
        "max_lost_probability": config.failures.max_lost_probability,
        "density_method": config.pdem.method,
        "cells": config.pdem.cells,
        "input_bootstrap": INPUT_BOOTSTRAP,
    }


def _digest(config: Config, folder: Path, rows: list[Row], spared: frozenset[str] = frozenset()) -> str:
    """What results.h5 depends on: rows, products, points, settings and the analysis' code."""
    digest = hashlib.sha256(code_digest(ANALYSIS).encode())
    digest.update(json.dumps([config.text, asdict(config.pdem), asdict(config.failures)]).encode())
    digest.update((folder / "inputs.json").read_bytes())
    kept = archived(folder)
    for row in rows:
        if row.run_id in spared:
            digest.update(f"{row.run_id} spared\n".encode())
            continue
        places = (folder / row.product, folder / ARCHIVE, (folder / row.product).with_suffix(".failed.json"))
        path = next(p for p in places if p.exists() and (p.name != ARCHIVE or row.run_id in kept))
        s = path.stat()
        digest.update(f"{row.run_id} {path.suffix} {s.st_size} {s.st_mtime_ns}\n".encode())
    return digest.hexdigest()
