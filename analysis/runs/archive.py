"""Compact archive of all runs (runs.h5).  Once it is written, the large product files can be deleted.

A product holds whole packings, about 1.5 kB per grain; the results use a few kilobytes of it.  `runs.h5` keeps those
bit by bit: a campaign folder with the archive instead of products gives the same results, and its runs count as done
on any machine.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..errors_and_files import GrainScatterError, atomic_write, digest, one_line, open_hdf5, write_hdf5
from ..quantities import CONSOLIDATED, DRAINED, STAGE_STATES, Loading
from . import peak_critical
from .gate import check_product
from .run_file import Run, _plain
from .states import RunStates, run_states

NAME = "runs.h5"
FORMAT, VERSION = "dem-archive", 2
TIMES = ("steps", "cpu_seconds", "wall_seconds", "particle_steps_per_cpu_second")
SETTINGS = ("inertial_number", "strain_end", "timestep_factor", "stiffness_scale", "damping")
PROOFS = ("max_inertial_number", "servo_mean_error", "servo_max_error", "energy_error", "F_unb")
TEXTS = ("created", "yade_version", "script_digest")
#: Versions of the analysis (`measured_by`) whose archives hold the same states to the last bit: from before the files
#: of the analysis moved into packages.  tests/test_laptop.py measures the example runs again and compares.
SAME_STATES = ("aebd68a2264a", "49c981dc949e")
#: Attribute of layout 2 that holds the JSON of a run: its facts, states, symbols and the name of its grains.
_ENTRY = "told"
#: Attributes of RunStates that are kept as JSON; responses and grains are datasets.
_STATE_FIELDS = ("states", "errors", "steady_end", "critical_from", "unsteady", "drift")
#: Those that only runs other than drained compression have.
_LATER_FIELDS = ("loading", "end", "end_strain")
#: Facts that every archive of this layout has; the others came later.
_NEEDED = {"reason", "resumed", "step_factor", "script_digest", "cpu_seconds", "wall_seconds", "steps"}
#: The facts of a run without a product: NaN for numbers, an empty text for texts.
NOTHING: dict[str, Any] = (
    dict.fromkeys((*TIMES, *PROOFS, *SETTINGS, *CONSOLIDATED), np.nan)
    | dict.fromkeys(("probe_asymmetry", "probe_pushed", "probe_off", "critical_from", "drift_eta", "drift_e"), np.nan)
    | dict.fromkeys(("axes_off_diagonal", "axes_eta_windows", "axes_eta_mean"), np.nan)
    | dict.fromkeys((*TEXTS, "unsteady"), "")
    | {"N": 0, "resumed": 0, "step_factor": np.nan, "measured_by": ""}
)


class ArchiveError(GrainScatterError):
    """A file that is not an archive of runs, or a run in it that has changed; names the file."""


@dataclass(frozen=True)
class RunSummary:
    """Result of one run: `facts`, its row in the table of runs (floats, ints and texts), and its states, if any."""

    facts: dict[str, Any]
    states: RunStates | None


def run_summary(run: Run) -> RunSummary:
    """Summary of a product for the analysis.

    Raises run_file.RunFileError if something needed is missing, or if the product fails the physical gate
    (`gate.check_product`).
    """
    check_product(run)
    states = run_states(run) if run.stage in STAGE_STATES else None
    facts: dict[str, Any] = {
        "reason": str(run.attrs.get("exit_reason", "")),
        "N": int(run.parameters.get("N", 0)),
        "resumed": int(run.attrs.get("resumed", 0)),
        "step_factor": float(run.parameters.get("timestep_factor", np.nan)),
    }
    facts |= {name: float(run.timing.get(name, np.nan)) for name in TIMES}
    facts |= {name: float(run.proofs.get(name, np.nan)) for name in PROOFS}
    facts |= {name: str(run.attrs.get(name, "")) for name in TEXTS}
    if run.stage == "shear" and states is not None:
        facts |= {name: float(run.parameters.get(name, np.nan)) for name in SETTINGS}
        facts |= {"critical_from": float(states.critical_from), "unsteady": states.unsteady}
        facts |= {f"drift_{symbol}": float(value) for symbol, value in states.drift.items()}
        critical = run.record["sigma"][run.strain > states.critical_from]
        if len(critical):
            axes = peak_critical.off_axis(critical, states.loading.sign)
            facts |= {f"axes_{name}": value for name, value in axes.items()}
        if states.loading != DRAINED:
            facts |= states.loading._asdict()
        if states.end:
            facts |= {"end_strain": states.end_strain}
    if run.stage == "consolidate":
        facts |= {symbol: float(run.record[symbol][-1]) for symbol in CONSOLIDATED if symbol in run.record}
    if run.stage == "probe" and states is not None:
        facts |= {f"probe_{name}": value for name, value in states.checks.items()}
    return RunSummary(NOTHING | facts, states)


class Archive(Mapping[str, RunSummary]):
    """Run id -> RunSummary, read from the archive when it is used; a file that does not exist is an empty archive.

    Raises ArchiveError for a file of another kind and for a run whose checksum does not match.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self._ids: tuple[str, ...] = ()
        if self.path.exists():
            with _open(self.path) as file:
                self._ids = tuple(file["runs"])
        self._known = frozenset(self._ids)

    def __getitem__(self, run_id: str) -> RunSummary:
        if run_id not in self._known:
            raise KeyError(run_id)
        with _open(self.path) as file:
            data = file["runs"][run_id]
            rows = list(data[()]) if data.shape else []
            if _digest(data.attrs[_ENTRY], rows) != data.attrs["sha256"]:
                raise ArchiveError(f"{self.path}: run {run_id} has changed since it was written (checksum)")
            entry = _entry(self.path, run_id, data)
            grains = _read_grains(file["grains"], entry["grains"])
            if entry["states"] is None:
                return RunSummary(entry["facts"], None)
            responses = dict(zip(entry["symbols"], rows, strict=True))
            eps_a = {"eps_a": responses.pop("eps_a")} if responses else {}
            kept = entry["states"]
            kept |= {"loading": Loading(*kept["loading"])} if "loading" in kept else {}
            return RunSummary(entry["facts"], RunStates(**eps_a, responses=responses, grains=grains, **kept))

    def facts(self) -> dict[str, dict[str, Any]]:
        """Run id -> its facts, for all runs in one reading of the file."""
        if not self._ids:
            return {}
        with _open(self.path) as file:
            return {name: _entry(self.path, name, data)["facts"] for name, data in file["runs"].items()}

    def __contains__(self, run_id: object) -> bool:
        return run_id in self._known

    def __iter__(self) -> Iterator[str]:
        return iter(self._ids)

    def __len__(self) -> int:
        return len(self._ids)


def write_archive(path: str | Path, summaries: Mapping[str, RunSummary]) -> None:
    """Write an archive of these runs, with its checksum; an existing file is replaced once the new one is complete."""
    with atomic_write(path, fsync=True) as part, write_hdf5(part) as file:
        file.attrs.update(format=FORMAT, format_version=VERSION)
        runs, grains = file.create_group("runs"), file.create_group("grains")
        for run_id in sorted(summaries):
            _write(runs, grains, run_id, summaries[run_id])


def _write(runs: h5py.Group, grains: h5py.Group, run_id: str, summary: RunSummary) -> None:
    """Write one run: its responses as rows of one dataset, the strain first; everything else as JSON beside them."""
    entry: dict[str, Any] = {"facts": summary.facts, "states": None, "symbols": [], "grains": ""}
    rows = None
    if (s := summary.states) is not None:
        fields = (*_STATE_FIELDS, *(_LATER_FIELDS if s.loading != DRAINED else ()))
        entry["states"] = {name: getattr(s, name) for name in fields}
        curves = {"eps_a": s.eps_a, **s.responses} if s.responses else {}
        entry["symbols"] = list(curves)
        rows = np.array(list(curves.values())) if curves else None
        entry["grains"] = _write_grains(grains, *s.grains) if s.grains else ""
    packed = {} if rows is None else {"compression": "gzip", "shuffle": True, "fletcher32": True}
    data = runs.create_dataset(run_id, data=h5py.Empty("f8") if rows is None else rows, **packed)
    data.attrs[_ENTRY] = json.dumps(entry, default=lambda value: value.item())
    data.attrs["sha256"] = _digest(data.attrs[_ENTRY], [] if rows is None else rows)


def _write_grains(grains: h5py.Group, diameter: np.ndarray, grading: dict[str, Any]) -> str:
    """Write diameters and grading, once for all runs of a packing; returns the name of their dataset."""
    name = digest(diameter.tobytes(), 12)
    if name not in grains:
        grains.create_dataset(name, data=diameter, compression="gzip", shuffle=True, fletcher32=True)
        grains[name].attrs["grading"] = json.dumps(grading, default=lambda value: value.item())
    return name


def _read_grains(grains: h5py.Group, name: str) -> tuple[np.ndarray, dict[str, Any]] | None:
    """Diameters (N,) m and grading under a name that `_write_grains` gave; None for an empty name."""
    return (grains[name][()], json.loads(grains[name].attrs["grading"])) if name else None


def _digest(entry: str, rows: Iterable[np.ndarray]) -> str:
    """Checksum of the JSON and the responses of one run."""
    return digest(entry.encode() + b"".join(np.ascontiguousarray(row).tobytes() for row in rows))


def _entry(path: Path, run_id: str, data: h5py.Dataset) -> dict[str, Any]:
    """The JSON of one run; raises ArchiveError if it is not what `_write` writes."""
    entry = json.loads(data.attrs[_ENTRY])
    parts: dict[str, Any] = {"facts": dict, "states": (dict, type(None)), "symbols": list, "grains": str}
    for name, kind in parts.items():
        if not isinstance(entry, dict) or not isinstance(entry.get(name), kind):
            raise ArchiveError(f"{path}: run {run_id}: its JSON has no proper {name!r}")
    facts = entry["facts"]
    if missing := sorted(_NEEDED - facts.keys()):
        raise ArchiveError(f"{path}: run {run_id}: its JSON has no {missing[0]!r}")
    for name, nothing in {"reason": "", **NOTHING}.items():
        value = facts.get(name, nothing)
        if isinstance(value, str) is not isinstance(nothing, str) or not isinstance(value, (str, int, float)):
            raise ArchiveError(f"{path}: run {run_id}: {name} = {value!r} is not of the kind of {nothing!r}")
    for name in ("states", "errors") if entry["states"] else ():
        tables = entry["states"].get(name)
        if not isinstance(tables, dict) or not all(isinstance(table, dict) for table in tables.values()):
            raise ArchiveError(f"{path}: run {run_id}: its {name!r} are no tables")
        for state, table in tables.items():
            if bad := [symbol for symbol, value in table.items() if not isinstance(value, (int, float))]:
                raise ArchiveError(f"{path}: run {run_id}: {bad[0]} of {state!r} is no number")
    return entry


@contextmanager
def _open(path: Path) -> Iterator[h5py.File]:
    with open_hdf5(path, ArchiveError, "archive of runs") as file:
        name, version = (one_line(repr(_plain(file.attrs).get(key))) for key in ("format", "format_version"))
        if (name, version) != (repr(FORMAT), repr(VERSION)):
            raise ArchiveError(f"{path}: format {name}, version {version}; this reader knows {FORMAT!r}, {VERSION}")
        for group in ("runs", "grains"):
            if not isinstance(file.get(group), h5py.Group):
                raise ArchiveError(f"{path}: group /{group} is missing")
        yield file
