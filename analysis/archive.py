"""All that the analysis takes from a campaign's runs in one small file, so that the products themselves may go.

A product holds whole packings, some 1.5 kB a grain; what becomes of it in results.h5 is a few kilobytes.  `runs.h5`
keeps those, bit by bit: a campaign's folder with the archive instead of products gives the same results, and its runs
count as done wherever they were made.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from analysis.run_states import RunStates, run_states
from analysis.runfile import Run

NAME = "runs.h5"
FORMAT, VERSION = "dem-archive", 2
STAGE_STATES = {"shear": ("initial", "peak", "critical"), "probe": ("probe",)}
TIMES = ("steps", "cpu_seconds", "wall_seconds", "particle_steps_per_cpu_second")
SETTINGS = ("inertial_number", "strain_end", "timestep_factor", "stiffness_scale", "damping")
PROOFS = ("max_inertial_number", "servo_mean_error", "servo_max_error", "energy_error", "F_unb")
CONSOLIDATED = ("e", "e_m", "Z", "Z_m")
TEXTS = ("created", "yade_version", "script_digest")
#: What a run without a product has in place of each number and text.
NOTHING = (
    dict.fromkeys((*TIMES, *PROOFS, *SETTINGS, *CONSOLIDATED), np.nan)
    | dict.fromkeys(("probe_asymmetry", "probe_pushed", "probe_off", "critical_from", "drift_eta", "drift_e"), np.nan)
    | dict.fromkeys((*TEXTS, "unsteady"), "")
    | {"N": 0, "resumed": 0, "step_factor": np.nan, "measured_by": ""}
)


class ArchiveError(ValueError):
    """A file that is no archive of runs; one line naming it."""


@dataclass(frozen=True)
class Contribution:
    """What one run gives: `facts`, its line in the table of runs (floats, ints and texts), and its states if any."""

    facts: dict
    states: RunStates | None


def contribution(run: Run) -> Contribution:
    """What the analysis takes from a product.  Raises runfile.RunFileError if something needed is missing."""
    states = run_states(run) if run.stage in STAGE_STATES else None
    facts = {"reason": str(run.attrs.get("exit_reason", "")), "N": int(run.parameters.get("N", 0)),
             "resumed": int(run.attrs.get("resumed", 0)),
             "step_factor": float(run.parameters.get("timestep_factor", np.nan))}  # fmt: skip
    facts |= {name: float(run.timing.get(name, np.nan)) for name in TIMES}
    facts |= {name: float(run.proofs.get(name, np.nan)) for name in PROOFS}
    facts |= {name: str(run.attrs.get(name, "")) for name in TEXTS}
    if run.stage == "shear":
        facts |= {name: float(run.parameters.get(name, np.nan)) for name in SETTINGS}
        facts |= {"critical_from": float(states.critical_from), "unsteady": states.unsteady}
        facts |= {f"drift_{symbol}": float(value) for symbol, value in states.drift.items()}
    if run.stage == "consolidate":
        facts |= {symbol: float(run.record[symbol][-1]) for symbol in CONSOLIDATED if symbol in run.record}
    if run.stage == "probe":
        facts |= {f"probe_{name}": value for name, value in states.checks.items()}
    return Contribution(NOTHING | facts, states)


class Archive(Mapping):
    """Run id -> Contribution, read from a file when asked for.  A file that is not there holds nothing."""

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self._ids = ()
        if self.path.exists():
            with _open(self.path) as file:
                self._ids = tuple(file["runs"])
        self._known = frozenset(self._ids)

    def __getitem__(self, run_id: str) -> Contribution:
        if run_id not in self._known:
            raise KeyError(run_id)
        with _open(self.path) as file:
            data = file["runs"][run_id]
            values = list(data[()]) if data.shape else []
            if _digest(data.attrs["told"], values) != data.attrs["sha256"]:
                raise ArchiveError(f"{self.path}: run {run_id} has changed since it was written (checksum)")
            told = json.loads(data.attrs["told"])
            grains = file["grains"][told["grains"]] if told["grains"] else None
            grains = None if grains is None else (grains[()], json.loads(grains.attrs["grading"]))
        states = told["states"]
        if states is not None:
            curves = dict(zip(told["symbols"], values, strict=True))
            eps_a = {"eps_a": curves.pop("eps_a")} if curves else {}
            states = RunStates(**eps_a, responses=curves, grains=grains, **states)
        return Contribution(told["facts"], states)

    def facts(self) -> dict[str, dict]:
        """Run id -> its facts, all at once."""
        if not self._ids:
            return {}
        with _open(self.path) as file:
            return {name: json.loads(data.attrs["told"])["facts"] for name, data in file["runs"].items()}

    def __contains__(self, run_id: object) -> bool:
        return run_id in self._known

    def __iter__(self) -> Iterator[str]:
        return iter(self._ids)

    def __len__(self) -> int:
        return len(self._ids)


def write_archive(path: str | Path, contributions: Mapping[str, Contribution]) -> None:
    """Write an archive of these runs; a file that was there is replaced once the new one is whole."""
    path = Path(path)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with h5py.File(part, "w") as file:
            file.attrs.update(format=FORMAT, format_version=VERSION)
            runs, grains = file.create_group("runs"), file.create_group("grains")
            for run_id in sorted(contributions):
                _write(runs, grains, run_id, contributions[run_id])
        with open(part, "rb") as file:
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _write(runs, grains, run_id: str, given: Contribution) -> None:
    """One run: its responses as rows of one dataset, the strain first; everything else as JSON beside them."""
    told = {"facts": given.facts, "states": None, "symbols": [], "grains": ""}
    rows = None
    if (s := given.states) is not None:
        told["states"] = {name: getattr(s, name) for name in ("states", "errors", "steady_end", "critical_from",
                                                              "unsteady", "drift")}  # fmt: skip
        curves = {"eps_a": s.eps_a, **s.responses} if s.responses else {}
        told["symbols"] = list(curves)
        rows = np.array(list(curves.values())) if curves else None
        told["grains"] = _write_grains(grains, *s.grains) if s.grains else ""
    packed = {} if rows is None else {"compression": "gzip", "shuffle": True, "fletcher32": True}
    data = runs.create_dataset(run_id, data=h5py.Empty("f8") if rows is None else rows, **packed)
    data.attrs["told"] = json.dumps(told, default=lambda value: value.item())
    data.attrs["sha256"] = _digest(data.attrs["told"], [] if rows is None else rows)


def _write_grains(grains, diameter, grading: dict) -> str:
    """Diameters and grading, once for all runs of a packing; returns the name under which they stand."""
    name = hashlib.sha256(diameter.tobytes()).hexdigest()[:12]
    if name not in grains:
        grains.create_dataset(name, data=diameter, compression="gzip", shuffle=True, fletcher32=True)
        grains[name].attrs["grading"] = json.dumps(grading, default=lambda value: value.item())
    return name


def _digest(told: str, rows) -> str:
    """Checksum of one run's numbers and texts."""
    return hashlib.sha256(told.encode() + b"".join(np.ascontiguousarray(row).tobytes() for row in rows)).hexdigest()


def _open(path: Path) -> h5py.File:
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise ArchiveError(f"{path}: truncated or not an HDF5 file ({str(error).splitlines()[0]})") from error
    found = (file.attrs.get("format"), file.attrs.get("format_version"))
    if found != (FORMAT, VERSION):
        file.close()
        raise ArchiveError(f"{path}: format {found[0]!r}, version {found[1]}; this reader knows {FORMAT!r}, {VERSION}")
    return file
