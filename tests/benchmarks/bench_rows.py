"""Rows of a resumable benchmark: appended to a CSV as they finish, failed ones too, and found at the next start."""

from __future__ import annotations

import csv
from pathlib import Path


def finished(path: Path, keys: tuple[str, ...]) -> set[tuple[str, ...]]:
    """The cases that have a row, each as the texts of its key columns."""
    if not path.exists():
        return set()
    with open(path, newline="") as file:
        return {tuple(row[key] for key in keys) for row in csv.DictReader(file)}


def append(path: Path, columns: tuple[str, ...], row: dict) -> None:
    """Append one row under a heading that is written once, and print it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new = not path.exists()
    with open(path, "a", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow({key: f"{value:.6g}" if isinstance(value, float) else value for key, value in row.items()})
    print(", ".join(f"{key} {value}" for key, value in row.items() if value != ""), flush=True)
