"""What every package stands on: the user's error, files written whole, and names imported when asked for.

Standard library only; h5py is imported where a file is opened.
"""

from __future__ import annotations

import hashlib
import importlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py


class GrainScatterError(ValueError):
    """A user's error. The command line prints its text in one line; any other exception is a bug."""


class RunFileError(GrainScatterError):
    """A product of a run that is missing, cut short or not what it claims to be; names the file and the value."""


@contextmanager
def atomic_write(path: str | Path, *, fsync: bool = False) -> Iterator[Path]:
    """Give a temporary name beside `path`; what was written there takes the place of `path` at the end.

    After an exception `path` is as it was and nothing is left beside it.  fsync: the bytes are on the disk before the
    old file goes.

    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "a.txt"
    >>> with atomic_write(target) as part:
    ...     _ = part.write_text("whole")
    >>> target.read_text()
    'whole'
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        if fsync:
            with open(part, "rb") as file:
                os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def open_hdf5(path: str | Path, error: type[GrainScatterError], what: str = "file") -> h5py.File:
    """Open an HDF5 file for reading; raises `error` with one line if it is missing, truncated or of another kind."""
    import h5py

    path = Path(path)
    if not path.is_file():
        raise error(f"{path}: no such {what}")
    try:
        return h5py.File(path, "r")
    except OSError as failure:
        raise error(f"{path}: truncated or not an HDF5 file ({str(failure).splitlines()[0]})") from failure


def digest(data: bytes, length: int = 64) -> str:
    """The first `length` hexadecimal figures of the sha256 of some bytes."""
    return hashlib.sha256(data).hexdigest()[:length]


def lazy_names(package: str, homes: dict[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package whose names live in submodules; homes: name -> relative module."""

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(homes[name], package), name)

    return load, lambda: sorted(homes)
