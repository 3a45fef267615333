"""Checkpoints of a long run: the scene and the record so far in one file, replaced atomically, taken up after a kill.

A resumed run continues gaplessly in strain and record.  It is not bit-identical to an uninterrupted one: YADE reloads
its scene self-consistently, but the collider's order of contacts is new.  `resumed` in the product counts how often.

The file is a line of JSON (format, identity, length and sha256 of what follows) and then an npz archive without pickle:
the scene's bytes, large arrays, and everything else as JSON.  YADE's own save file executes what it contains, so the
identity and the sum are compared before any of it is read; a checkpoint that does not fit is left alone, in one line.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import time
import zipfile
from pathlib import Path

import numpy as np

from yade_scripts import rve
from yade_scripts.product import load_scene, saved_scene
from yade_scripts.record import Windows
from yade_scripts.rve import O
from yade_scripts.start import INHERITED

FORMAT, FORMAT_VERSION = "dem-checkpoint", 1
LONGEST_HEADING = 1 << 16  # bytes of the first line
INLINE = 16  # arrays up to this size are written as JSON: a record has hundreds of them
#: Parameters that do not make a run this run: where it is written, how often it is saved, and what its start decides.
_OTHER = ("product", "started", "script", "checkpoint_seconds", *INHERITED)


class CheckpointError(RuntimeError):
    """A checkpoint that cannot be taken up; the text says why."""


class Checkpoint:
    """The checkpoint file of one run, beside its product."""

    def __init__(self, p, product):
        self.p, self.product = p, product
        self.path = Path(p.product).with_suffix(".checkpoint")
        self.identity = {
            "run_id": p.run_id, "scripts": product.scripts,
            "parameters": {k: v for k, v in sorted(vars(p).items()) if k not in _OTHER},
        }  # fmt: skip
        self.saved_at = time.monotonic()

    def save_when_due(self, windows: Windows) -> None:
        """Save when `checkpoint_seconds` have passed since the last time."""
        if time.monotonic() - self.saved_at < self.p.checkpoint_seconds:
            return
        data = {
            "windows": windows.to_dict(),
            "snapshots": self.product.snapshots,
            "steps": O.iter + self.product.steps_before,
            "seconds": time.process_time() + self.product.seconds_before,
            "resumed": self.product.resumed,
            "inherited": {name: getattr(self.p, name) for name in INHERITED if hasattr(self.p, name)},
        }
        part = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        part.write_bytes(packed(self.identity, saved_scene(), data))
        os.replace(part, self.path)
        self.saved_at = time.monotonic()

    def resume(self, path) -> Windows | None:
        """The record to go on with, scene loaded and `path` restored; None when there is nothing of this run and code."""
        try:
            scene, data = unpacked(self.path.read_bytes(), self.identity)
        except FileNotFoundError:
            return None
        except (OSError, CheckpointError) as error:
            print(f"{self.p.run_id}: {self.path.name} is not used, the run starts anew: {error}")
            return None
        vars(self.p).update(data["inherited"])
        load_scene(scene)
        O.resetTime()
        rve.quiet()
        O.run(1, True)  # the contact law knows its scene only after a step
        windows = Windows(self.p, path)
        windows.restore(data["windows"])
        product = self.product
        product.snapshots, product.resumed = data["snapshots"], data["resumed"] + 1
        product.steps_before, product.seconds_before = data["steps"], data["seconds"]
        print(f"{self.p.run_id}: resumed at strain {windows.rows[-1]['eps_a']:.4f}")
        return windows

    def remove(self) -> None:
        self.path.unlink(missing_ok=True)


def packed(identity: dict, scene: bytes, data) -> bytes:
    """The bytes of a checkpoint file."""
    arrays = {"scene": np.frombuffer(scene, np.uint8)}
    text = json.dumps(_plain(data, arrays))
    arrays["data"] = np.frombuffer(text.encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    body = buffer.getvalue()
    heading = {"format": FORMAT, "format_version": FORMAT_VERSION, "identity": identity, "length": len(body),
               "sha256": hashlib.sha256(body).hexdigest()}  # fmt: skip
    return json.dumps(heading).encode() + b"\n" + body


def unpacked(content: bytes, identity: dict) -> tuple[bytes, dict]:
    """Scene and data of a checkpoint file of that identity; raises CheckpointError with what does not fit."""
    line, _, body = content.partition(b"\n")
    try:
        heading = json.loads(line) if len(line) <= LONGEST_HEADING else {}
    except (ValueError, RecursionError):
        heading = {}
    if not isinstance(heading, dict) or heading.get("format") != FORMAT:
        raise CheckpointError("it is of another format")
    if heading.get("format_version") != FORMAT_VERSION:
        raise CheckpointError(f"format_version = {heading.get('format_version')!r} is not {FORMAT_VERSION}")
    if other := _difference(heading.get("identity"), json.loads(json.dumps(identity))):
        raise CheckpointError(f"it is of another run: {other}")
    if heading.get("length") != len(body) or heading.get("sha256") != hashlib.sha256(body).hexdigest():
        raise CheckpointError(f"it is damaged: {len(body)} bytes whose sha256 is not the one written")
    try:
        with np.load(io.BytesIO(body), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return arrays["scene"].tobytes(), _restored(json.loads(arrays["data"].tobytes()), arrays)
    except (ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise CheckpointError(f"it cannot be read ({error})") from error


def _difference(found, wanted: dict) -> str:
    """The first entry in which an identity differs from the one wanted, in words; "" where none does."""
    if not isinstance(found, dict) or not isinstance(found.get("parameters"), dict):
        return "no identity"
    if found.get("run_id") != wanted["run_id"]:
        return f"run_id = {str(found.get('run_id'))[:80]!r}, not {wanted['run_id']!r}"
    if found.get("scripts") != wanted["scripts"]:
        return f"scripts {str(found.get('scripts'))[:10]}, not {wanted['scripts'][:10]}"
    for name in sorted({*found["parameters"], *wanted["parameters"]}):
        mine, other = wanted["parameters"].get(name), found["parameters"].get(name)
        if repr(mine) != repr(other):
            return f"{name} = {str(other)[:80]}, not {mine}"
    return ""


def _plain(value, arrays: dict):
    """A value as JSON has it; a large array goes to `arrays` and leaves its name."""
    if isinstance(value, dict):
        return {"dict": {key: _plain(item, arrays) for key, item in value.items()}}
    if isinstance(value, (list, tuple)):
        return [_plain(item, arrays) for item in value]
    if isinstance(value, np.ndarray):
        form = {"dtype": value.dtype.str, "shape": value.shape}
        if value.size <= INLINE:
            return form | {"values": value.ravel().tolist()}
        name = f"array_{len(arrays)}"
        arrays[name] = value
        return form | {"array": name}
    return value.item() if isinstance(value, np.generic) else value


def _restored(value, arrays: dict):
    """What `_plain` was given; tuples come back as lists, numpy's numbers as Python's."""
    if isinstance(value, list):
        return [_restored(item, arrays) for item in value]
    if not isinstance(value, dict):
        return value
    if "dict" in value:
        return {key: _restored(item, arrays) for key, item in value["dict"].items()}
    if "array" in value:
        return arrays[value["array"]]
    return np.array(value["values"], value["dtype"]).reshape(value["shape"])
