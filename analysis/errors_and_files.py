"""What every package stands on: the user's error, files written whole and opened with care, and late imports.

Standard library only; h5py is imported where a file is opened.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import importlib
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py


#: First bytes of a file of `write_hdf5`, before the sha256 of all that follows its user block.
_SEAL, _USER_BLOCK = b"grain-scatter sha256 ", 512
_HDF5 = b"\x89HDF\r\n\x1a\n"
SUMS = "SHA256SUMS"
#: Bytes that a dataset may declare, and what deflate can at most make of a file's bytes.
_LARGEST, _DEFLATE, _SMALL = 1 << 32, 1032, 1 << 20
#: Whether a child process reads files without checksum first, and for how long at most.
TRIALS, TRIAL_SECONDS = True, 600
#: Groups below each other in a file of the project: 5 at most.
_DEEPEST = 16
#: Errors of `flock` where a file system has no locks.
_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
#: What h5py, numpy and json raise for contents that are damaged or of another kind than expected.
_DAMAGED = (OSError, LookupError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError, ArithmeticError)
#: Files that were checked, and their stamps then.
_CHECKED: dict[Path, tuple[int, ...]] = {}


class GrainScatterError(ValueError):
    """A user's error. The command line prints its text in one line; any other exception is a bug."""


class RunFileError(GrainScatterError):
    """A product of a run that is missing, cut short or not what it claims to be; names the file and the value."""


@contextmanager
def atomic_write(path: str | Path, *, fsync: bool = False) -> Iterator[Path]:
    """Give a temporary name beside `path`; what was written there takes the place of `path` at the end.

    After an exception `path` is as it was and nothing is left beside it; an OSError without a file's name, as of a full
    disk, gets that of `path`.  fsync: the bytes are on the disk before the old file goes.

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
    except OSError as error:
        if error.filename is None and error.errno is not None:
            error.filename = str(path)
        raise
    finally:
        part.unlink(missing_ok=True)


def decoded(data: bytes, path: str | Path, error: type[GrainScatterError]) -> str:
    """Text of a user's file in UTF-8, with or without a byte-order mark.

    Raises `error` with one line that names the file, the line, the byte and the encoding that the file seems to have.

    >>> decoded("\ufeffmu_s".encode(), "pairs.csv", GrainScatterError)
    'mu_s'
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or data[1:2] == b"\0":
        raise error(f"{path}: seems to be in UTF-16 (or is no text); save it as UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as failure:
        line = data[: failure.start].count(b"\n") + 1
        byte = data[failure.start]
    where = f"{path}, line {line}: byte 0x{byte:02x} is not UTF-8"
    try:
        sign = bytes([byte]).decode("cp1252")
        data.decode("cp1252")
    except UnicodeDecodeError:
        raise error(f"{where}; is it a text file? Save it as UTF-8") from None
    raise error(f"{where}; in Windows-1252 it is {sign!r}: save the file as UTF-8")


def shown(text: str, longest: int = 60) -> str:
    """A user's text for one line of an error: without control characters, and cut if it is too long.

    >>> shown("9" * 5000, 10)
    '9999999999... (5,000 characters)'
    """
    plain = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text[: longest + 1])
    return plain if len(text) <= longest else f"{plain[:longest]}... ({len(text):,} characters)"


@contextmanager
def open_hdf5(
    path: str | Path, error: type[GrainScatterError], what: str = "file", *, trial: bool = True
) -> Iterator[h5py.File]:
    """Open an HDF5 file for reading; raises `error` with one line if it, or what is read from it, cannot be used.

    A file that has a checksum (`write_hdf5`, or a line in SHA256SUMS beside it) is compared with it before HDF5 sees
    it.  A file without checksum is read by a child process first (unless `trial` is false), because HDF5 can crash on
    damaged structures.  Then its structure is checked, so that reading it reads nothing else and executes nothing: see
    `_foreign`.  A file that stays unchanged is checked once per process.
    """
    path = Path(path)
    if not path.is_file():
        raise error(f"{path}: no such {what}")
    try:
        stamp = _stamp(path)
        known = _CHECKED.get(path) == stamp
        if not known and (
            fault := _changed(path) or (_crash(path) if trial and TRIALS and not _has_checksum(path) else "")
        ):
            raise error(f"{path}: {fault}")
        file = open_without_locks(path)
    except OSError as failure:
        raise error(f"{path}: {_why_not_opened(failure)}") from failure
    with file:
        try:
            if not known:
                if fault := _foreign(file, stamp[2]):
                    raise error(f"{path}: {fault}")
                _CHECKED[path] = stamp
            yield file
        except GrainScatterError:
            raise
        except _DAMAGED as failure:
            raise error(f"{path}: not a readable {what} ({one_line(failure)})") from failure


def open_without_locks(path: str | Path) -> h5py.File:
    """Open an HDF5 file for reading; without HDF5's own lock where the file system has none.

    Raises OSError; `is_locked_elsewhere` tells whether another process holds the lock.
    """
    import h5py

    try:
        return h5py.File(path, "r")
    except OSError as failure:
        if _lock_errno(failure) not in _NO_LOCKS:
            raise
    return h5py.File(path, "r", locking=False)


def is_locked_elsewhere(failure: OSError) -> bool:
    """Whether opening an HDF5 file failed because another process holds a lock on it."""
    return _lock_errno(failure) in (errno.EAGAIN, errno.EACCES)


@contextmanager
def write_hdf5(path: str | Path) -> Iterator[h5py.File]:
    """Give an HDF5 file in memory; it is written to `path` at the end, behind 512 bytes that state its checksum.

    The 512 bytes are a user block, which HDF5 allows at the beginning of a file and skips.  Raises OSError if the file
    cannot be written; HDF5 itself may end the process when the disk is full.
    """
    import h5py

    with h5py.File(str(path), "w", driver="core", backing_store=False) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    with open(path, "wb") as out:
        out.write(_user_block(image))
        out.write(image)


def seal_hdf5(path: str | Path) -> None:
    """State the present bytes of a file of `write_hdf5` as its checksum, after it was changed on purpose."""
    with open(path, "r+b") as file:
        if not file.read(_USER_BLOCK).startswith(_SEAL):
            raise OSError(f"{path}: has no checksum to renew")
        block = _user_block(file.read())
        file.seek(0)
        file.write(block)


def one_line(error: object) -> str:
    """The text of an error in one line; its kind where it has none."""
    text = error.args[0] if isinstance(error, KeyError) and error.args else error
    return " ".join(str(text).split())[:300] or type(error).__name__


def digest(data: bytes, length: int = 64) -> str:
    """The first `length` hexadecimal figures of the sha256 of some bytes."""
    return hashlib.sha256(data).hexdigest()[:length]


def lazy_names(package: str, homes: dict[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package whose names live in submodules; homes: name -> relative module."""

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(homes[name], package), name)

    return load, lambda: sorted({*homes, *vars(sys.modules[package])})


def _stamp(path: Path) -> tuple[int, ...]:
    """Device, number, size and times of a file: they change when the file does."""
    stat = path.stat()
    return (stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)


def _lock_errno(failure: OSError) -> int:
    """The system's error number where HDF5 could not lock a file, 0 for other failures."""
    found = re.search(r"unable to lock file, errno = (\d+)", str(failure))
    return int(found[1]) if found else 0


def _why_not_opened(failure: OSError) -> str:
    if is_locked_elsewhere(failure):
        return "another process holds a lock on it, try again when that has ended"
    if _lock_errno(failure) or failure.errno in (errno.EIO, errno.EACCES, errno.EPERM, errno.ESTALE):
        return f"cannot be read now ({one_line(failure)})"
    return f"truncated or not an HDF5 file ({one_line(failure)})"


def _user_block(image: bytes) -> bytes:
    return (_SEAL + digest(image).encode() + b"\n").ljust(_USER_BLOCK, b"\0")


def _changed(path: Path) -> str:
    """What speaks against the bytes of a file: its own checksum, or that in SHA256SUMS beside it; "" if nothing."""
    with open(path, "rb") as file:
        data = file.read(len(_HDF5))
        recorded = _recorded_sum(path)
        sealed = data != _HDF5[: len(data)]
        if not sealed and not recorded:
            return ""
        data += file.read()
    if sealed and not data.startswith(_SEAL):
        return "truncated or not an HDF5 file (it begins with other bytes)"
    if (sealed and data[:_USER_BLOCK] != _user_block(data[_USER_BLOCK:])) or (recorded and digest(data) != recorded):
        return "its bytes have changed since it was written (checksum): truncated or damaged"
    return ""


def _has_checksum(path: Path) -> bool:
    with open(path, "rb") as file:
        return file.read(len(_SEAL)) == _SEAL or bool(_recorded_sum(path))


def _crash(path: Path) -> str:
    """The signal that ends a child process which reads all of a file, in words; "" if none does."""
    import h5py  # noqa: F401  imported before the fork, not by every child

    if not hasattr(os, "fork"):
        return ""
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # Python 3.12 warns of threads, which the child does not use
        child = os.fork()
    if child == 0:
        try:
            _read_all(path)
        finally:
            os._exit(0)
    _, status = os.waitpid(child, 0)
    if not os.WIFSIGNALED(status):
        return ""
    name = signal.Signals(os.WTERMSIG(status)).name
    return f"damaged: reading it ends a process by {name}"


def _read_all(path: Path) -> None:
    """Read every attribute and dataset, in silence and within TRIAL_SECONDS; errors are found again by the parent."""
    import resource

    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(TRIAL_SECONDS)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    with open_without_locks(path) as file:
        if _foreign(file, path.stat().st_size):
            return

        def read(_: str, item: Any) -> None:
            for name in item.attrs:
                with contextlib.suppress(*_DAMAGED):
                    item.attrs[name]
            if hasattr(item, "shape"):
                with contextlib.suppress(*_DAMAGED):
                    item[()]

        read("/", file)
        file.visititems(read)


def _recorded_sum(path: Path) -> str:
    """The last checksum of a file in SHA256SUMS beside it; "" without one."""
    sums = path.with_name(SUMS)
    try:
        return _read_sums(sums, _stamp(sums)).get(path.name, "")
    except OSError:
        return ""


@functools.lru_cache(maxsize=8)
def _read_sums(path: Path, stamp: tuple[int, ...]) -> dict[str, str]:
    lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    parts = [line.split() for line in lines]
    return {part[1]: part[0] for part in parts if len(part) == 2 and len(part[0]) == 64}


def _foreign(file: h5py.File, size: int) -> str:
    """What a file of the project does not have, and what could read elsewhere or exhaust the memory; "" if nothing.

    Only hard links, one to each object; datasets in the file itself with the filters that HDF5 has built in, and not
    larger than a file of this many bytes can hold; plain numbers and texts of the machine's own kinds.
    """
    import h5py
    from h5py import h5g, h5l, h5o

    seen = {h5o.get_info(file.id).addr}
    groups = [("", h5g.open(file.id, b"/"), 0)]
    while groups:
        name, group, depth = groups.pop()
        if fault := _foreign_attributes(group, size):
            return f"{name or '/'}: {fault}"
        links: list[tuple[bytes, Any]] = []
        group.links.iterate(lambda link, info, links=links: links.append((link, info.type)), info=True)
        for link, kind in links:
            path = f"{name}/{link.decode(errors='replace')}"
            if kind != h5l.TYPE_HARD:
                word = {h5l.TYPE_SOFT: "a soft link", h5l.TYPE_EXTERNAL: "a link to another file"}.get(kind, "a link")
                return f"{path} is {word}, which is not followed"
            item = h5o.open(group, link)
            address = h5o.get_info(item).addr
            if address in seen:
                return f"{path} is a second name of another object, or a loop"
            seen.add(address)
            if isinstance(item, h5g.GroupID):
                if depth == _DEEPEST:
                    return f"{path}: more than {_DEEPEST} groups below each other"
                groups.append((path, item, depth + 1))
            elif fault := _foreign_dataset(item, size) if isinstance(item, h5py.h5d.DatasetID) else "is no data":
                return f"{path}: {fault}"
    return ""


def _foreign_dataset(data: Any, size: int) -> str:
    from h5py import h5d, h5z

    storage = data.get_create_plist()
    if storage.get_layout() == h5d.VIRTUAL:
        return "its values lie in other files (virtual dataset)"
    if storage.get_external_count():
        return "its values lie in another file (external storage)"
    filters = [storage.get_filter(k)[0] for k in range(storage.get_nfilters())]
    if not set(filters) <= {h5z.FILTER_DEFLATE, h5z.FILTER_SHUFFLE, h5z.FILTER_FLETCHER32}:
        return f"its values are packed by a filter that is not known here ({filters})"
    declared = data.get_type().get_size()
    for length in data.shape or ():
        declared *= length
    limit = min(_LARGEST, max(_SMALL, _DEFLATE * size))
    if declared > limit:
        return f"declares {declared:.3g} bytes, more than the {limit:.3g} that a file of {size:.3g} bytes may"
    return _foreign_type(data.get_type()) or _foreign_attributes(data, size)


def _foreign_attributes(item: Any, size: int) -> str:
    from h5py import h5a

    for k in range(h5a.get_num_attrs(item)):
        attribute = h5a.open(item, index=k)
        if attribute.get_storage_size() > size:
            return f"attribute {attribute.name!r} declares more bytes than the file has"
        if fault := _foreign_type(attribute.get_type()):
            return f"attribute {attribute.name!r} {fault}"
    return ""


def _foreign_type(kind: Any) -> str:
    """Only texts, truth values, and numbers as this machine stores them; an opaque type can stand for pointers."""
    from h5py import h5t

    if kind.get_class() in (h5t.INTEGER, h5t.FLOAT):
        plain = h5t.py_create(kind.dtype)
        return "" if kind.dtype.isnative and kind.equal(plain) else "has numbers of another machine's kind"
    return "" if kind.get_class() in (h5t.STRING, h5t.ENUM) else "holds neither numbers nor texts"
