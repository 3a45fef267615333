"""A run's one HDF5 file in the format of the YADE stages (data/README.md), with the state that LAMMPS starts from."""

from __future__ import annotations

import hashlib
import os
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from analysis.quantities import RECORD
from campaign.files import code_digest
from campaign.lammps.record import NOT_GIVEN

FORMAT, FORMAT_VERSION, CODE = "dem-run", 1, "lammps"
#: Parameters that are no parameters of a product.
_SKIPPED = ("stage", "started", "run_id", "product")
_RESIDUAL = ("J", "Residual of the energy balance")


class StartError(RuntimeError):
    """A product that cannot be the start of a stage; the text is one line."""


@dataclass
class Product:
    """What a stage produces; `write` writes it in one go."""

    p: Any
    version: str = ""
    record: dict[str, np.ndarray] = field(default_factory=dict)
    snapshots: list[dict] = field(default_factory=list)
    probe: dict[str, Any] = field(default_factory=dict)
    proofs: dict[str, float] = field(default_factory=dict)
    exit_reason: str = ""
    state: bytes = b""
    script: str = ""
    steps: int = 0
    dt: float = 0.0
    cpu_seconds: float = 0.0

    def write(self) -> Path:
        """Write everything under a temporary name, flush it to disk, and move it into place."""
        path = Path(self.p.product)
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            with h5py.File(part, "w") as file:
                self._fill(file)
                file.attrs["complete"] = True
            with open(part, "rb") as written:
                os.fsync(written.fileno())
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
        path.with_suffix(".failed.json").unlink(missing_ok=True)
        return path

    def _fill(self, file: h5py.File) -> None:
        p = self.p
        file.attrs.update(
            format=FORMAT, format_version=FORMAT_VERSION, stage=p.stage, run_id=p.run_id, complete=False,
            exit_reason=self.exit_reason, failure="", resumed=0, yade_version=f"LAMMPS {self.version}", code=CODE,
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            script_digest=code_digest(Path(__file__).parent),
        )  # fmt: skip
        if p.stage == "shear":
            file.attrs["not_given"] = ",".join([*NOT_GIVEN, "energy_error"])
            file.attrs["not_given_because"] = "; ".join(NOT_GIVEN.values())
        file.create_group("parameters").attrs.update({k: v for k, v in vars(p).items() if k not in _SKIPPED})
        file.create_group("timing").attrs.update(
            steps=self.steps, cpu_seconds=self.cpu_seconds, wall_seconds=time.time() - p.started, dt_mean=self.dt,
            particle_steps_per_cpu_second=self.steps * p.N / max(self.cpu_seconds, 1e-9),
        )  # fmt: skip
        file.create_group("proofs").attrs.update(self.proofs)
        for symbol, values in self.record.items():
            data = file.create_dataset(f"record/{symbol}", data=values, compression="gzip", shuffle=True)
            quantity = RECORD.get(symbol)
            unit, name = (
                (quantity.unit, quantity.name) if quantity else _RESIDUAL if symbol == "E_residual" else ("1", symbol)
            )
            data.attrs.update(unit=unit, name=name)
        for k, snapshot in enumerate(self.snapshots):
            _write_group(file.create_group(f"snapshots/{k:02d}"), snapshot)
        if self.probe:
            _write_group(file.create_group("probe"), self.probe)
        if self.state:
            data = file.create_dataset("state", data=np.frombuffer(self.state, np.uint8))
            data.attrs["sha256"] = hashlib.sha256(self.state).hexdigest()
        file.create_dataset("script", data=self.script)


def _write_group(group: h5py.Group, values: dict[str, Any]) -> None:
    """Arrays become datasets, everything else attributes."""
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            group.create_dataset(name, data=value, compression="gzip", shuffle=True)
        else:
            group.attrs[name] = value


def is_complete(path: Path, run_id: str) -> bool:
    """Whether the file is there, complete and of this very run."""
    try:
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("complete", False)) and file.attrs.get("run_id") == run_id
    except OSError:
        return False


def read_start(path: Path) -> tuple[dict[str, Any], bytes]:
    """Parameters (with `stage`) and the state of a product that a run starts from.

    Raises StartError where the file is missing, damaged, of another code, or holds no state.
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT or not file.attrs.get("complete", False) or "state" not in file:
                raise StartError(f"start {path}: holds no complete state")
            if (code := str(file.attrs.get("code", "yade"))) != CODE:
                raise StartError(f"start {path}: was made by code = {code!r}, and this run has code = {CODE!r}")
            state = file["state"][()].tobytes()
            if (found := hashlib.sha256(state).hexdigest()) != file["state"].attrs.get("sha256"):
                raise StartError(f"start {path}: its state is damaged (sha256 {found[:10]} is not the one written)")
            values = {k: v.item() if isinstance(v, np.generic) else v for k, v in file["parameters"].attrs.items()}
            return values | {"stage": str(file.attrs["stage"])}, state
    except (OSError, KeyError) as error:
        raise StartError(f"start {path}: cannot be read ({error})") from error
