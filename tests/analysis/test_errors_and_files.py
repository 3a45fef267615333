"""Files written whole or not at all, and HDF5 files opened with one line for the user."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os

import h5py
import numpy as np
import pytest

from analysis import errors_and_files
from analysis.errors_and_files import (
    GrainScatterError,
    atomic_write,
    digest,
    is_locked_elsewhere,
    open_hdf5,
    open_without_locks,
    seal_hdf5,
    write_hdf5,
)


def test_a_file_is_written_whole(tmp_path):
    with atomic_write(tmp_path / "a.txt", fsync=True) as part:
        part.write_text("new")
        assert not (tmp_path / "a.txt").exists()
    assert (tmp_path / "a.txt").read_text() == "new" and len(list(tmp_path.iterdir())) == 1


def test_after_an_error_the_old_file_stands_and_no_part_is_left(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(OSError, match="disk full"), atomic_write(tmp_path / "a.txt") as part:
        part.write_text("half")
        raise OSError("disk full")
    assert (tmp_path / "a.txt").read_text() == "old" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("content, words", [(None, "no such thing"), (b"text", "truncated or not an HDF5 file")])
def test_a_bad_hdf5_file_ends_in_one_line_that_names_it(tmp_path, content, words):
    path = tmp_path / "a.h5"
    if content:
        path.write_bytes(content)
    with pytest.raises(GrainScatterError, match=words) as caught, open_hdf5(path, GrainScatterError, "thing"):
        pass
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_good_hdf5_file_is_opened_for_reading(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = 1
    with open_hdf5(tmp_path / "a.h5", GrainScatterError) as file:
        assert file["x"][()] == 1 and file.mode == "r"


def opened(path, what="file"):
    """The error of opening a file, or nothing."""
    with open_hdf5(path, GrainScatterError, what):
        pass


def test_a_file_that_another_process_holds_is_not_called_truncated(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with open(path, "rb") as holder:
        fcntl.flock(holder, fcntl.LOCK_EX)
        with pytest.raises(GrainScatterError, match="another process holds a lock on it, try again") as caught:
            opened(path)
        assert "truncated" not in str(caught.value) and "\n" not in str(caught.value)
        with pytest.raises(OSError) as failure:
            open_without_locks(path)
        assert is_locked_elsewhere(failure.value)
    with open_hdf5(path, GrainScatterError) as file:
        assert file["x"][()] == 1


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS])
def test_a_file_system_without_locks_is_read_without_them(tmp_path, monkeypatch, number):
    """HDF5's message is that of version 1.10.8 on a file system whose `flock` fails."""
    path, real, asked = tmp_path / "a.h5", h5py.File, []
    with h5py.File(path, "w") as file:
        file["x"] = 1

    def without_locks(name, mode, **settings):
        asked.append(settings)
        if settings.get("locking") is not False:
            text = (
                f"Unable to open file (unable to lock file, errno = {number}, error message = '{os.strerror(number)}')"
            )
            raise OSError(number, text)
        return real(name, mode, **settings)

    monkeypatch.setattr(h5py, "File", without_locks)
    with open_hdf5(path, GrainScatterError) as file:
        assert file["x"][()] == 1
    assert asked == [{}, {"locking": False}]


def test_a_file_that_cannot_be_read_for_once_is_not_called_truncated(tmp_path, monkeypatch):
    path = tmp_path / "a.h5"
    path.write_bytes(b"x")

    def broken(*_, **__):
        raise OSError(
            errno.EIO, "Unable to open file (file read failed: errno = 5, error message = 'Input/output error')"
        )

    monkeypatch.setattr(errors_and_files, "_changed", lambda _: "")
    monkeypatch.setattr(h5py, "File", broken)
    with pytest.raises(GrainScatterError, match="cannot be read now .*Input/output error"):
        opened(path)


def test_a_written_hdf5_file_states_its_checksum_and_a_changed_one_is_refused(tmp_path):
    path = tmp_path / "a.h5"
    with write_hdf5(path) as file:
        file["x"] = 1
    assert path.read_bytes().startswith(b"grain-scatter sha256 " + digest(path.read_bytes()[512:]).encode())
    with open_hdf5(path, GrainScatterError) as file:
        assert file["x"][()] == 1 and file.userblock_size == 512
    with h5py.File(path, "r+") as file:
        file["x"][...] = 2
    with pytest.raises(GrainScatterError, match="changed since it was written .checksum."):
        opened(path)
    seal_hdf5(path)
    with open_hdf5(path, GrainScatterError) as file:
        assert file["x"][()] == 2


def test_a_file_that_ends_its_reader_is_refused_with_a_line(tmp_path, monkeypatch):
    """A child process reads a file without checksum first: HDF5 1.10.8 crashes on some damaged structures."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = 1
    monkeypatch.setattr(errors_and_files, "TRIALS", True)
    monkeypatch.setattr(errors_and_files, "_read_all", lambda _: os.kill(os.getpid(), 9))
    with pytest.raises(GrainScatterError, match="a.h5: damaged: reading it ends a process by SIGKILL"):
        opened(path)
    with open_hdf5(path, GrainScatterError, trial=False) as file:
        assert file["x"][()] == 1


def test_a_full_disk_ends_the_writing_of_an_hdf5_file_in_an_error(tmp_path):
    if not os.path.exists("/dev/full"):
        pytest.skip("this system has no /dev/full")
    with pytest.raises(OSError, match="No space left"), write_hdf5("/dev/full") as file:
        file["x"] = np.zeros(1000)


def test_faults_while_reading_end_in_one_line_and_the_programs_own_errors_pass(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = 1
    for fault in (KeyError("no\nname"), MemoryError(), RecursionError("deep"), ValueError("a\n b")):
        words = f"{path}: not a readable thing"
        with pytest.raises(GrainScatterError, match=words) as caught, open_hdf5(path, GrainScatterError, "thing"):
            raise fault
        assert "\n" not in str(caught.value)
    with pytest.raises(GrainScatterError, match="^mine$"), open_hdf5(path, GrainScatterError):
        raise GrainScatterError("mine")


def test_a_digest_is_the_beginning_of_a_sha256():
    assert digest(b"soil", 12) == hashlib.sha256(b"soil").hexdigest()[:12] and len(digest(b"")) == 64
