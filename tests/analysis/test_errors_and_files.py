"""Files written whole or not at all, and HDF5 files opened with one line for the user."""

from __future__ import annotations

import hashlib

import h5py
import pytest

from analysis.errors_and_files import GrainScatterError, atomic_write, digest, open_hdf5


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
    with pytest.raises(GrainScatterError, match=words) as caught:
        open_hdf5(path, GrainScatterError, "thing")
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_good_hdf5_file_is_opened_for_reading(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = 1
    with open_hdf5(tmp_path / "a.h5", GrainScatterError) as file:
        assert file["x"][()] == 1 and file.mode == "r"


def test_a_digest_is_the_beginning_of_a_sha256():
    assert digest(b"soil", 12) == hashlib.sha256(b"soil").hexdigest()[:12] and len(digest(b"")) == 64
