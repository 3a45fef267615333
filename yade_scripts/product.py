"""A run's one HDF5 file: written under a temporary name, moved into place when complete, and read again as a start.

The layout is described in data/README.md; names and units come from the registry.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
from yade import config

from analysis.quantities import RECORD
from yade_scripts.rve import O

FORMAT, FORMAT_VERSION = "dem-run", 1


class ProductError(RuntimeError):
    """A product that cannot be read as the start of a stage, or cannot be written."""


class Product:
    """Collects what a stage produces and writes it in one go: `record`, `snapshots`, `probe`, `proofs`, `state`."""

    def __init__(self, p):
        self.p = p
        self.path = Path(p.product)
        self.record: dict[str, np.ndarray] = {}
        self.snapshots: list[dict] = []
        self.probe: dict = {}
        self.proofs: dict[str, float] = {}
        self.exit_reason = ""
        self.facts: dict[str, float] = {}  # further attributes of the file
        self.resumed = 0
        self.steps_before = 0
        self.seconds_before = 0.0
        self.state = b""
        self.scripts = script_digest()  # now, since a long run may see them edited

    def is_complete(self) -> bool:
        """True when the file is there, complete and of this very run."""
        try:
            with h5py.File(self.path, "r") as file:
                return bool(file.attrs.get("complete", False)) and file.attrs.get("run_id") == self.p.run_id
        except OSError:
            return False

    def write(self) -> None:
        """Write everything under a temporary name, flush it to disk, and move it into place."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        part = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        try:
            with h5py.File(part, "w") as file:
                self._fill(file)
                file.attrs["complete"] = True
            with open(part, "rb") as file:
                os.fsync(file.fileno())
            os.replace(part, self.path)
        finally:
            part.unlink(missing_ok=True)
        self.path.with_suffix(".failed.json").unlink(missing_ok=True)

    def _fill(self, file) -> None:
        p = self.p
        file.attrs.update(
            format=FORMAT,
            format_version=FORMAT_VERSION,
            stage=p.stage,
            run_id=p.run_id,
            complete=False,
            exit_reason=self.exit_reason,
            failure="",
            resumed=self.resumed,
            yade_version=str(config.version),
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            script_digest=self.scripts,
            **self.facts,
        )
        skipped = ("stage", "started", "script", "run_id", "product")
        file.create_group("parameters").attrs.update({k: v for k, v in vars(p).items() if k not in skipped})
        cpu, steps = time.process_time() + self.seconds_before, O.iter + self.steps_before
        file.create_group("timing").attrs.update(
            steps=steps,
            cpu_seconds=cpu,
            wall_seconds=time.time() - p.started,
            dt_mean=O.time / max(O.iter, 1),
            particle_steps_per_cpu_second=steps * len(O.bodies) / cpu,
        )
        file.create_group("proofs").attrs.update(self.proofs)
        for symbol, values in self.record.items():
            data = file.create_dataset(f"record/{symbol}", data=values, compression="gzip", shuffle=True)
            quantity = RECORD.get(symbol)
            data.attrs.update(unit=quantity.unit if quantity else "1", name=quantity.name if quantity else symbol)
        for k, snapshot in enumerate(self.snapshots):
            _write_group(file.create_group(f"snapshots/{k:02d}"), snapshot)
        if self.probe:
            _write_group(file.create_group("probe"), self.probe)
        if self.state:
            data = file.create_dataset("state", data=np.frombuffer(self.state, np.uint8))
            data.attrs["sha256"] = hashlib.sha256(self.state).hexdigest()


def _write_group(group, values: dict) -> None:
    """Arrays become datasets, everything else attributes."""
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            group.create_dataset(name, data=value, compression="gzip", shuffle=True)
        else:
            group.attrs[name] = value


def load_start(path: str) -> dict:
    """Load the scene embedded in a product into YADE and return the product's parameters.

    A scene executes what it contains, so format and sum are compared before (products of earlier scripts have no sum).
    Raises ProductError where the file is missing, truncated or damaged, or holds no state.
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT or not file.attrs.get("complete", False) or "state" not in file:
                raise ProductError(f"start {path}: holds no complete state")
            state = file["state"][()].tobytes()
            if (found := hashlib.sha256(state).hexdigest()) != file["state"].attrs.get("sha256", found):
                raise ProductError(f"start {path}: its state is damaged (sha256 {found[:10]} is not the one written)")
            load_scene(state)
            return dict(file["parameters"].attrs) | {"stage": file.attrs["stage"]}
    except (OSError, KeyError) as error:
        raise ProductError(f"start {path}: cannot be read ({error})") from error


def saved_scene() -> bytes:
    """The whole YADE scene as the bytes of its own save file."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "scene.yade.bin.gz")
        O.save(path, quiet=True)
        return Path(path).read_bytes()


def load_scene(data: bytes) -> None:
    """Replace the scene by a saved one; step and time counters start at what was saved."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "scene.yade.bin.gz")
        Path(path).write_bytes(data)
        O.load(path, quiet=True)


def script_digest() -> str:
    """sha256 over the scripts of this folder: which code made the run."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
