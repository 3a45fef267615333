"""Text and JSON files that are written completely or not at all, notes on stderr, the digest of a folder of code."""

from __future__ import annotations

import contextlib
import hashlib
import json
import sys
from pathlib import Path
from typing import Any

from analysis.errors_and_files import atomic_write


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 and make its folder; a file that has this text already is not touched.

    Raises OSError if the file cannot be written; the old file then stays as it is.
    """
    with contextlib.suppress(OSError, UnicodeDecodeError):
        if path.read_text(encoding="utf-8") == text:
            return
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write a value as JSON. Raises OSError if the file cannot be written, TypeError if JSON cannot hold the value."""
    write_text(path, json.dumps(value, indent=1) + "\n")


def read_json(path: Path, default: Any = None) -> Any:
    """Return the value in a JSON file, or `default` if the file is missing, damaged, or of another type than `default`.

    Raises OSError, with the file's name, if the file is there and cannot be read now: its contents are not known then.
    """
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, ValueError, RecursionError):
        return default
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
    return value if default is None or isinstance(value, type(default)) else default


_SAID: set[str] = set()


def say_once(text: str) -> None:
    """Write a note to stderr, once per process."""
    if text not in _SAID:
        _SAID.add(text)
        with contextlib.suppress(OSError):
            print(f"note: {text}", file=sys.stderr, flush=True)


def code_digest(folder: Path) -> str:
    """Return the sha256 of all Python files below a folder: the version of the code that made a result."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
