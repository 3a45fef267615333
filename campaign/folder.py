"""The files beside the products of a campaign's folder: locks, checksums and failure files."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from analysis.errors_and_files import GrainScatterError
from campaign.files import write_json

SUMS = "SHA256SUMS"


class RunError(GrainScatterError):
    """Runs cannot be started or submitted; the text is one line for the user."""


@contextlib.contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Allow one `run` at a time in a campaign's folder; the lock ends with the process, however the process ends.

    Raises RunError if the folder cannot be written, or if another process holds the lock.
    """
    try:
        (folder / "products").mkdir(parents=True, exist_ok=True)
        (folder / "logs").mkdir(exist_ok=True)
        file = open(folder / ".lock", "a+")  # noqa: SIM115  closed below
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            raise RunError(f"{folder}: another `run` is at work here (process {file.read().strip()})") from None
        file.truncate(0)
        file.write(f"{os.getpid()}\n")
        file.flush()
        yield


def is_locked(path: Path) -> bool:
    """Return whether a living process holds the lock file. The lock file of a dead process does not count."""
    try:
        with open(path, "rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def record_sum(product: Path) -> None:
    """Append a product's checksum to SHA256SUMS beside it, in the form that `sha256sum --check` reads.

    Raises OSError if the product cannot be read or SHA256SUMS cannot be written.
    """
    line = f"{file_sum(product)}  {product.name}\n"
    with open(product.parent / SUMS, "a", encoding="ascii") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.write(line)


def recorded_sums(products: Path) -> dict[str, str]:
    """Return product name -> recorded checksum. The last line of a product counts; damaged lines are left out."""
    try:
        lines = (products / SUMS).read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return {}
    parts = [line.split() for line in lines]
    return {p[1]: p[0] for p in parts if len(p) == 2 and len(p[0]) == 64}


def file_sum(path: Path) -> str:
    """Return the sha256 of a file. Raises OSError if it cannot be read."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def write_failure(products: Path, run_id: str, reason: str, log: str = "", **facts: Any) -> None:
    """Write <run_id>.failed.json into the folder of products: the reason in one line, the log, and further facts.

    Raises OSError if the file cannot be written.
    """
    reason = " ".join(str(reason).split())[:400]
    now = time.strftime("%Y-%m-%dT%H:%M:%S")
    record = {"run_id": run_id, "reason": reason, "time": now, "log": log, **facts}
    write_json(products / f"{run_id}.failed.json", record)
