"""The files beside the products of a campaign's folder: locks, checksums and failure files."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import os
import socket
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from analysis.errors_and_files import GrainScatterError
from campaign.files import say_once, write_json
from campaign.progress import span

SUMS = "SHA256SUMS"
#: What `flock` answers on a file system that has no locks, as network file systems of clusters often are.
NO_LOCKS = frozenset({errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOTSUP, errno.ENOSYS})
#: Ending of the file that stands for a lock where there are none.
OWNER = ".owner"
#: Folder of a run in LAMMPS: its scripts with this ending, their logs, and what they read, the grains or a state.
SCRIPTS, READ_BY_SCRIPTS = ".lammps", ("grains.data", "start.restart")
#: Folders that this process holds the lock of.
_OWN: set[Path] = set()


class RunError(GrainScatterError):
    """Runs cannot be started or submitted; the text is one line for the user."""


class HeldError(Exception):
    """Another process holds a lock; the text states which, if it is known."""


@contextlib.contextmanager
def folder_lock(folder: Path, *inside: str) -> Iterator[None]:
    """Allow one process at a time to plan or run in a campaign's folder; the lock ends with the process.

    A process that has the lock gets it again. inside: folders in it that are needed. Raises RunError if the folder
    cannot be written, or if another process holds the lock.
    """
    place = folder.resolve()
    if place in _OWN:
        yield
        return
    with contextlib.ExitStack() as stack:
        try:
            for place_inside in (folder, *(folder / name for name in inside)):
                place_inside.mkdir(parents=True, exist_ok=True)
            stack.enter_context(exclusive(folder / ".lock"))
        except OSError as error:
            raise RunError(f"{folder}: cannot be written: {_reason(error, folder / '.lock')}") from None
        except HeldError as held:
            raise RunError(f"{folder}: another `run` is at work here ({held})") from None
        _OWN.add(place)
        stack.callback(_OWN.discard, place)
        yield


@contextlib.contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Hold a lock file, which ends with this process however that ends, and write process and host into it.

    Where the file system has no locks, a file <path>.owner stands for one. Raises HeldError if another process holds
    the lock, OSError if the file cannot be written or is a symbolic link.
    """
    fd = open_plain(path, os.O_RDWR | os.O_CREAT)
    with open(fd, "r+", encoding="utf-8", errors="replace") as file:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise HeldError(f"process {_shown(file.read(200))}") from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
            say_once(f"{path.parent}: this file system has no locks ({error.strerror}); files *{OWNER} stand for them")
            with _owner_file(path.with_name(path.name + OWNER)):
                yield
            return
        file.truncate(0)
        file.write(_myself() + "\n")
        file.flush()
        yield


@contextlib.contextmanager
def _owner_file(path: Path) -> Iterator[None]:
    """Hold a file that only one process can create; one that a dead process of this machine left is taken over."""
    while True:
        try:
            fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
            break
        except FileExistsError:
            owner = _owner(path)
            if _is_alive(owner):
                raise HeldError(holder(path)) from None
            with contextlib.suppress(FileNotFoundError):
                os.rename(path, stale := path.with_name(f"{path.name}.{os.getpid()}"))  # one process succeeds
                os.unlink(stale)
    with open(fd, "w") as file:
        file.write(_myself() + "\n")
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def _myself() -> str:
    """This process and its host, in the form that `_is_alive` reads."""
    return f"{os.getpid()} on {socket.gethostname()}, begun {_begun(os.getpid())}"


def _shown(owner: str) -> str:
    return owner.partition(", begun")[0].strip()


def holder(path: Path) -> str:
    """Who holds the lock that an owner file stands for, and since when: process, host, age and file, in one line."""
    age = 0.0
    with contextlib.suppress(OSError):
        age = max(0.0, time.time() - path.stat().st_mtime)
    return f"process {_shown(_owner(path))}, which took it {span(age)} ago; if it has ended, delete {path.resolve()}"


def _owner(path: Path) -> str:
    """The text of an owner file; "" if it is gone or empty."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")[:200].strip()
    except FileNotFoundError:
        return ""


def _is_alive(owner: str) -> bool:
    """Whether a process may still hold a lock: on another host nobody can tell, so it may."""
    pid, _, rest = owner.partition(" on ")
    host, _, begun = rest.rpartition(", begun ")
    if not pid.isdigit() or not host:
        return False
    return host != socket.gethostname() or (bool(begun) and _begun(int(pid)) == begun)


def _begun(pid: int) -> str:
    """When a process of this machine was started, in ticks since the machine was; "" if there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""


def is_locked(path: Path) -> bool:
    """Return whether a living process holds the lock file. The lock file of a dead process does not count."""
    try:
        fd = open_plain(path, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError as error:
        return error.errno in NO_LOCKS and _is_alive(_owner(path.with_name(path.name + OWNER)))
    finally:
        os.close(fd)
    return False


def open_plain(path: Path, flags: int) -> int:
    """Open a file of a folder that others may have prepared: a symbolic link is not followed. Raises OSError."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)


def _reason(error: OSError, path: Path) -> str:
    return f"{path.name} is a symbolic link" if error.errno == errno.ELOOP else str(error.strerror or error)


def record_sum(product: Path) -> None:
    """Append a product's checksum to SHA256SUMS beside it, in the form that `sha256sum --check` reads.

    A comment before it states when. Raises OSError if the product cannot be read or SHA256SUMS cannot be written.
    """
    now = datetime.now(UTC).isoformat(timespec="seconds")
    line = f"# {now}\n{file_sum(product)}  {product.name}\n"
    with open(open_plain(product.parent / SUMS, os.O_RDWR | os.O_APPEND | os.O_CREAT), "rb+", buffering=0) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
        if (end := file.seek(0, os.SEEK_END)) and (os.pread(file.fileno(), 1, end - 1) != b"\n"):
            line = "\n" + line  # a process was killed, or the disk was full, in the middle of a line
        file.write(line.encode("ascii"))


def recorded_sums(products: Path) -> dict[str, str]:
    """Return product name -> recorded checksum. The last line of a product counts; damaged lines are left out.

    Raises OSError if SHA256SUMS is there and cannot be read.
    """
    return {name: recorded for name, (recorded, _) in _records(products).items()}


def recorded_times(products: Path) -> dict[str, str]:
    """Return product name -> when its checksum was recorded (UTC, ISO 8601), as far as that was noted."""
    return {name: when for name, (_, when) in _records(products).items() if when}


def _records(products: Path) -> dict[str, tuple[str, str]]:
    try:
        lines = (products / SUMS).read_text(encoding="ascii", errors="replace").splitlines()
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except OSError as error:
        error.filename = error.filename or str(products / SUMS)
        raise
    records, when = {}, ""
    for line in lines:
        part = line.split()
        if len(part) == 2 and len(part[0]) == 64:
            records[part[1]] = (part[0], when)
        when = part[1] if len(part) == 2 and part[0] == "#" else ""
    return records


def file_sum(path: Path) -> str:
    """Return the sha256 of a file. Raises OSError if it cannot be read."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def clear_scripts(folder: Path) -> None:
    """Remove from the folder of a run in LAMMPS what its product holds; scripts, what they read, and logs stay."""
    for path in folder.iterdir():
        if path.suffix not in (SCRIPTS, ".log") and path.name not in READ_BY_SCRIPTS:
            path.unlink()


def write_failure(products: Path, run_id: str, reason: str, log: str = "", **facts: Any) -> None:
    """Write <run_id>.failed.json into the folder of products: the reason in one line, the log, and further facts.

    Raises OSError if the file cannot be written.
    """
    reason = " ".join(str(reason).split())[:400]
    now = time.strftime("%Y-%m-%dT%H:%M:%S")
    record = {"run_id": run_id, "reason": reason, "time": now, "log": log, **facts}
    write_json(products / f"{run_id}.failed.json", record)
