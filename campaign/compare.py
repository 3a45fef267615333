"""Results that travel: all numbers of a results file for other programs, and several campaigns side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from campaign.config import ConfigError

#: Fewest campaigns of a comparison.
FEWEST = 2
EXCEL = ".xlsx"


def export(results_file: Path, target: Path) -> str:
    """Write all results as CSV files into a folder, or into an Excel file; returns a line on each thing that was done.

    Raises ConfigError for a target that is neither, and ResultsError if the results file cannot be used or openpyxl is
    missing.
    """
    if target.suffix and target.suffix != EXCEL and not target.is_dir():
        raise ConfigError(f"--to = {str(target)!r} is neither a folder nor a file *{EXCEL}")
    if target.exists() and target.is_dir() == (target.suffix == EXCEL):
        raise ConfigError(f"--to = {str(target)!r} is {'a folder' if target.is_dir() else 'a file'}")
    from analysis.results import read_results
    from analysis.tables.export import write_csv_export, write_excel_export

    results = read_results(results_file)
    if target.suffix != EXCEL:
        return f"{target}: {len(write_csv_export(results, target))} tables in SI units; columns.csv has their units"
    lines = [f"{target}: all tables in SI units; the sheet `columns` has their units"]
    for name, path in write_excel_export(results, target).items():
        lines.append(f"{path}: the table {name}, which has more rows than a sheet of Excel")
    return "\n".join(lines)


def compare(paths: Sequence[Path], target: Path) -> str:
    """Write compare.html, its tables and its figures for several results files; returns a line on what was done.

    Raises ConfigError for fewer than two files, and the errors of the analysis.
    """
    if len(paths) < FEWEST:
        raise ConfigError(f"compare needs at least {FEWEST} results files or campaigns, not {len(paths)}")
    if target.exists() and not target.is_dir():
        raise ConfigError(f"--to = {str(target)!r} is a file, not a folder")
    from analysis.report.comparison import write_comparison

    return f"{write_comparison(paths, target)}: {len(paths)} campaigns compared"
