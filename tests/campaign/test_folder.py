"""Locks of a folder: where a file system has none, where the holder is dead, where a link lies in their place."""

import errno
import fcntl
import os
import socket
import time

import h5py
import pytest
from campaign_cases import finish, make_small

from campaign import files, folder
from campaign.engine_local import run_missing
from campaign.folder import OWNER, HeldError, RunError, exclusive, folder_lock, is_locked, record_sum, recorded_sums
from campaign.products import run_statuses


@pytest.fixture(params=[errno.ENOLCK, errno.EOPNOTSUPP])
def without_locks(request, monkeypatch):
    """A file system whose `flock` fails, for Python and for HDF5."""
    File = h5py.File

    def no_locks(*_):
        raise OSError(request.param, os.strerror(request.param))

    def open_file(name, *words, locking=None, **options):
        if locking is not False and os.environ.get("HDF5_USE_FILE_LOCKING") != "FALSE":
            why = f"unable to lock file, errno = {request.param}, error message = '{os.strerror(request.param)}'"
            raise OSError(request.param, f"Unable to open file ({why})")
        return File(name, *words, locking=locking, **options)

    monkeypatch.setattr(fcntl, "flock", no_locks)
    monkeypatch.setattr(h5py, "File", open_file)
    monkeypatch.setattr(files, "_SAID", set())


@pytest.fixture
def small(tmp_path):
    return finish(make_small(tmp_path))


def test_products_are_read_where_files_cannot_be_locked(small, without_locks):
    statuses = run_statuses(small.folder, small.rows)
    assert {(s.status, s.reason) for s in statuses.values()} == {("done", "")}
    assert len(recorded_sums(small.folder / "products")) == 10


def test_an_exclusive_file_stands_for_the_lock_and_is_mentioned_once(tmp_path, without_locks, capsys):
    lock = tmp_path / "run" / ".lock"
    for _ in range(2):
        with folder_lock(tmp_path / "run"):
            assert is_locked(lock)
            owner = lock.with_name(f".lock{OWNER}").read_text()
            assert owner.startswith(f"{os.getpid()} on {socket.gethostname()}")
            with pytest.raises(HeldError, match=f"process {os.getpid()} on .* delete"), exclusive(lock):
                pass
        assert not is_locked(lock) and not lock.with_name(f".lock{OWNER}").exists()
    assert capsys.readouterr().err.count("has no locks") == 1


def test_only_the_file_of_a_dead_process_of_this_machine_is_taken_over(tmp_path, without_locks):
    lock = tmp_path / ".lock"
    owner, mine = lock.with_name(f".lock{OWNER}"), folder._myself()
    another_time = mine.rpartition(" ")[0] + " 1"  # the number of a dead process may have come back
    for stale in (f"{2**22} on {socket.gethostname()}, begun 5", another_time, "", "half a li"):
        owner.write_text(stale)
        assert not is_locked(lock)
        with exclusive(lock):
            assert owner.read_text().strip() == mine
    for living in (mine, f"{2**22} on another-host, begun 5"):
        lock.touch()
        owner.write_text(living)
        assert is_locked(lock)
        with pytest.raises(HeldError), exclusive(lock):
            pass
        assert owner.read_text() == living


def test_the_lock_of_another_host_is_refused_with_all_that_one_needs_to_judge_it(tmp_path, without_locks):
    lock = tmp_path / ".lock"
    lock.touch()
    owner = lock.with_name(f".lock{OWNER}")
    owner.write_text("17 on node3, begun 5")
    three_hours_ago = time.time() - 3 * 3600
    os.utime(owner, (three_hours_ago, three_hours_ago))
    with pytest.raises(RunError) as refused, folder_lock(tmp_path):
        pass
    told = f"(process 17 on node3, which took it 3.0 h ago; if it has ended, delete {owner})"
    assert str(refused.value) == f"{tmp_path}: another `run` is at work here {told}"


def test_a_run_that_another_host_may_work_on_is_mentioned_and_its_places_are_free(small, without_locks, capsys):
    """Places for runs at once belong to one `run`; runs would wait for ever for one that a dead host has left."""
    run_id = small.rows[-1].run_id
    lock, place = small.folder / "products" / f".{run_id}.lock", small.folder / "batch" / "slot_0.lock"
    place.parent.mkdir(exist_ok=True)
    for path in (lock, place):
        path.touch()
        path.with_name(path.name + OWNER).write_text("17 on node3, begun 5")
    assert run_missing(small.config, small.folder, small.rows, quiet=True) == 0
    line = f"{run_id}: runs in process 17 on node3, which took it 0 s ago; if it has ended, delete {lock}{OWNER}"
    assert line in capsys.readouterr().err
    assert lock.with_name(lock.name + OWNER).exists() and not place.with_name(place.name + OWNER).exists()


def test_a_link_in_place_of_a_lock_is_not_followed(tmp_path):
    victim = tmp_path / "letters.txt"
    victim.write_text("dear reader")
    (tmp_path / "run" / "products").mkdir(parents=True)
    for name in (".lock", "products/SHA256SUMS"):
        (tmp_path / "run" / name).symlink_to(victim)
    with pytest.raises(RunError, match="symbolic link"), folder_lock(tmp_path / "run"):
        pass
    (tmp_path / "run" / "products" / "a.h5").write_bytes(b"1")
    with pytest.raises(OSError):
        record_sum(tmp_path / "run" / "products" / "a.h5")
    assert victim.read_text() == "dear reader"


def test_a_lock_that_is_held_keeps_its_text(tmp_path):
    with folder_lock(tmp_path):
        text = (tmp_path / ".lock").read_text()
        assert text.startswith(f"{os.getpid()} on ")
        with pytest.raises(HeldError, match=f"process {os.getpid()}"), exclusive(tmp_path / ".lock"):
            pass
        assert (tmp_path / ".lock").read_text() == text
        with folder_lock(tmp_path):  # what the process has, it gets again
            pass


def test_half_a_line_of_checksums_spoils_no_other(tmp_path):
    for name in ("a.h5", "b.h5"):
        (tmp_path / name).write_bytes(name.encode())
    record_sum(tmp_path / "a.h5")
    with open(tmp_path / "SHA256SUMS", "a") as file:
        file.write("0123456789abcdef")
    record_sum(tmp_path / "b.h5")
    assert set(recorded_sums(tmp_path)) == {"a.h5", "b.h5"}
