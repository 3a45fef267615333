"""HDF5 files that a test changes on purpose."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from analysis.errors_and_files import seal_hdf5


@contextmanager
def changed_on_purpose(path: str | Path) -> Iterator[h5py.File]:
    """An archive or a results file opened for changes; its checksum is then that of the changed file."""
    with h5py.File(path, "r+") as file:
        yield file
    seal_hdf5(path)
