"""Rows of a resumable benchmark: appended to a CSV as they finish, failed ones too, and found at the next start."""

from __future__ import annotations

import csv
import threading
from pathlib import Path

_one_at_a_time = threading.Lock()


def finished(path: Path, keys: tuple[str, ...]) -> set[tuple[str, ...]]:
    """The cases that have a row, each as the texts of its key columns."""
    if not path.exists():
        return set()
    with open(path, newline="") as file:
        return {tuple(row[key] for key in keys) for row in csv.DictReader(file)}


def append(path: Path, columns: tuple[str, ...], row: dict) -> None:
    """Append one row under a heading that is written once, and print it; a file of other columns gets these first."""
    with _one_at_a_time:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        if not new:
            _bring_to(path, columns)
        with open(path, "a", newline="") as file:
            writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
            if new:
                writer.writeheader()
            writer.writerow({key: written(value) for key, value in row.items()})
    print(", ".join(f"{key} {value}" for key, value in row.items() if value != ""), flush=True)


def written(value) -> str:
    """A value as a row has it."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _bring_to(path, columns):
    """Give a file these columns: what its rows have of them is kept."""
    with open(path, newline="") as file:
        reader = csv.DictReader(file)
        if reader.fieldnames == list(columns):
            return
        rows = list(reader)
    part = path.with_suffix(".part")
    with open(part, "w", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="", extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    part.replace(path)
