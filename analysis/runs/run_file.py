"""Reading the product of a run: its parameters, its record and its snapshots, all checked.

A product is one HDF5 file (format "dem-run", version 1).  Opening it checks that it is complete; arrays of the record
are read when they are first used.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..errors_and_files import RunFileError, one_line, open_hdf5
from ..micromechanics.snapshot import Snapshot, SnapshotError, check_snapshot
from ..quantities import RECORD, Loading

FORMAT, VERSION = "dem-run", 1
STAGES = ("consolidate", "shear", "probe")
#: Energies that a shear run accumulates up to its `energy_strain` only; NaN in the rows beyond.
ENDING = ("E_elastic", "E_friction", "E_damping")
#: Quantities that a code may not give: NaN in every row where the attribute `not_given` of the file names them.
OPTIONAL = ("E_friction",)
#: Quantities without a finite value where no contacts are left, after a test has liquefied.
OF_CONTACTS = ("e_m", "Z_m", "Phi", "f_sliding", "I", "F_unb")


@dataclass(frozen=True)
class Run:
    """One finished run: parameters in SI units, `record` symbol -> (T, ...), snapshots as (key, eps_a, label).

    Arrays of the record are read on demand.  `timing` and `proofs` are the attributes of these groups, `attrs` those of
    the file.  `probe` holds the numbers and arrays of a probe run and is None for other runs.
    """

    path: Path
    run_id: str
    stage: str
    parameters: dict[str, Any]
    timing: dict[str, Any]
    proofs: dict[str, Any]
    record: Mapping[str, np.ndarray]
    probe: dict[str, Any] | None
    snapshots: tuple[tuple[str, float, str], ...]
    attrs: dict[str, Any]

    @property
    def loading(self) -> Loading:
        """The test of a shear run; drained compression where the product does not state it."""
        usual = Loading()
        return Loading(*(str(self.parameters.get(name, default)) for name, default in usual._asdict().items()))

    @property
    def strain(self) -> np.ndarray:
        """Axial strain (T,) of the record in the direction of the test, so that it increases."""
        return self.loading.sign * self.record["eps_a"]

    @property
    def rows_before_end(self) -> int:
        """Rows of the record before the test liquefied; all rows if it did not."""
        return _rows_before(self.strain, self.attrs)


_ARRAYS = tuple(f.name for f in fields(Snapshot) if f.name not in ("eps_a", "label", "where"))


def read_run(path: str | Path) -> Run:
    """Open the product of a run and check that it is complete.

    Parameters
    ----------
    path : str or Path
        HDF5 file of one run, format "dem-run", version 1.

    Returns
    -------
    Run
        Parameters, proofs and the list of snapshots in memory; arrays of the record are read when they are first used.

    Raises
    ------
    RunFileError
        With the file and the fault, if it is missing, truncated, incomplete or of another format.

    Examples
    --------
    >>> run = read_run("data/laptop/example_runs/shear_mu0.212_G20.4_iso0.040_s6_625b1c34.h5")
    >>> run.stage, run.parameters["N"]
    ('shear', 1000)
    >>> run.record["sigma"].shape
    (97, 3, 3)
    """
    path = Path(path)
    with open_hdf5(path, RunFileError, "run file") as file:
        attrs = _plain(file.attrs)
        name, version, stage = (one_line(repr(attrs.get(key))) for key in ("format", "format_version", "stage"))
        if name != repr(FORMAT):
            raise RunFileError(f"{path}: not a run product (format = {name}, not {FORMAT!r})")
        if version != repr(VERSION):
            raise RunFileError(f"{path}: format_version = {version}, this reader knows {VERSION}")
        if stage not in map(repr, STAGES):
            raise RunFileError(f"{path}: stage = {stage} is none of {', '.join(STAGES)}")
        if not attrs.get("complete", False):
            raise RunFileError(f"{path}: run {attrs.get('run_id')} is not complete")
        if not isinstance(attrs.get("run_id", ""), str):
            raise RunFileError(f"{path}: run_id = {one_line(repr(attrs['run_id']))} is no text")
        needed = {"shear": ("record", "snapshots"), "probe": ("probe", "snapshots"), "consolidate": ("snapshots",)}
        for group in ("parameters", "timing", "proofs", *needed[attrs["stage"]]):
            if not isinstance(file.get(group), h5py.Group):
                raise RunFileError(f"{path}: group /{group} is missing")
        probe = None
        if "probe" in file:
            probe = {**_plain(file["probe"].attrs), **{k: v[()] for k, v in file["probe"].items()}}
        return Run(
            path=path,
            run_id=one_line(attrs.get("run_id", path.stem)),
            stage=attrs["stage"],
            parameters=_plain(file["parameters"].attrs),
            timing=_plain(file["timing"].attrs),
            proofs=_plain(file["proofs"].attrs),
            record=_Record(path, _record_shapes(path, file), attrs),
            probe=probe,
            snapshots=_snapshot_list(file),
            attrs=attrs,
        )


def read_snapshot(source: str | Path | Run, k: int | str = -1, check: bool = True) -> Snapshot:
    """Read one snapshot of a run and check it.

    Parameters
    ----------
    source : str, Path or Run
        Path of a product, or a run that is already open.
    k : int or str
        Number of the snapshot (negative from the end), key ("00") or label ("start", "end").
    check : bool
        Whether the arrays are checked (see `check_snapshot`).

    Returns
    -------
    Snapshot
        Particles and contacts in SI units.

    Raises
    ------
    RunFileError
        If the snapshot does not exist or the file is truncated.
    SnapshotError
        If its arrays contradict each other or are physically impossible.

    Examples
    --------
    >>> path = "data/laptop/example_runs/shear_mu0.212_G20.4_iso0.040_s6_625b1c34.h5"
    >>> snapshot = read_snapshot(path, "end")
    >>> snapshot.N, snapshot.contact_ids.shape
    (1000, (2262, 2))
    """
    path = source.path if isinstance(source, Run) else Path(source)
    with open_hdf5(path, RunFileError, "run file") as file:
        if "snapshots" not in file or len(file["snapshots"]) == 0:
            raise RunFileError(f"{path}: holds no snapshots")
        listed = _snapshot_list(file)
        keys = [key for key, _, label in listed if k in (key, label)] if isinstance(k, str) else [s[0] for s in listed]
        if not keys or (not isinstance(k, str) and not -len(keys) <= k < len(keys)):
            raise RunFileError(f"{path}: no snapshot {k!r} among the {len(listed)} of this run")
        key = keys[0] if isinstance(k, str) else keys[k]
        group = file["snapshots"][key]
        where = f"{path}: snapshot {key}"
        missing = [name for name in _ARRAYS if name not in group]
        if missing:
            raise SnapshotError(f"{where}: dataset {missing[0]} is missing")
        arrays = {name: _numbers(where, group, name) for name in _ARRAYS}
        attrs = _plain(group.attrs)
    snapshot = Snapshot(**arrays, eps_a=float(attrs.get("eps_a", 0.0)), label=str(attrs.get("label", "")), where=where)
    return check_snapshot(snapshot) if check else snapshot


class _Record(Mapping[str, np.ndarray]):
    """Record arrays by symbol, read from the file when first used and then kept."""

    def __init__(self, path: Path, shapes: dict[str, tuple[int, ...]], attrs: Mapping[str, Any]):
        self._path, self._shapes, self._attrs = path, shapes, attrs
        self._liquefied = attrs.get("exit_reason") == "liquefied"
        self._read: dict[str, np.ndarray] = {}

    def _rows(self) -> int:
        return _rows_before(np.abs(self["eps_a"]), self._attrs)

    def __getitem__(self, symbol: str) -> np.ndarray:
        if symbol not in self._read:
            given = symbol not in OPTIONAL or symbol not in not_given(self._attrs)
            if symbol not in self._shapes:
                raise RunFileError(f"{self._path}: /record has no {symbol}")
            with open_hdf5(self._path, RunFileError, "run file") as file:
                values = _numbers(f"{self._path}: /record", file["record"], symbol)
            checked = values[: self._rows()] if symbol in OF_CONTACTS and self._liquefied else values
            if (
                values.dtype.kind == "f"
                and given
                and (row := _first_bad(checked, may_end=symbol in ENDING)) is not None
            ):
                raise RunFileError(f"{self._path}: /record/{symbol}[{row}] is not finite")
            self._read[symbol] = values
        return self._read[symbol]

    def __contains__(self, symbol: object) -> bool:
        return symbol in self._shapes

    def __iter__(self) -> Iterator[str]:
        return iter(self._shapes)

    def __len__(self) -> int:
        return len(self._shapes)


def not_given(attrs: Mapping[str, Any]) -> list[str]:
    """Names of the quantities and proofs that the code of a run cannot give, from the file's attributes."""
    return [name for name in str(attrs.get("not_given", "")).split(",") if name]


def _first_bad(values: np.ndarray, may_end: bool) -> int | None:
    """First row that is not finite; where the record may end early, only if a finite row follows it."""
    finite = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if may_end and finite.any():
        finite = finite[: int(np.flatnonzero(finite)[-1]) + 1]
    return None if finite.all() else int(np.flatnonzero(~finite)[0])


def _rows_before(strain: np.ndarray, attrs: Mapping[str, Any]) -> int:
    """Rows of strain (T,) whose window ends before the strain `liquefied_from`, at least the first; T without it.

    A row holds the mean strain of its window, which ends about half way to the next row.
    """
    if attrs.get("exit_reason") != "liquefied":
        return len(strain)
    start = attrs.get("liquefied_from")
    if not isinstance(start, (int, float)) or isinstance(start, bool) or not np.isfinite(start):
        return len(strain)
    steps = np.diff(strain)
    ends = strain + 0.5 * np.append(steps, steps[-1:])
    ends[0] = strain[0]
    return max(1, int(np.argmax(ends > start)) if (ends > start).any() else len(strain))


def _record_shapes(path: Path, file: h5py.File) -> dict[str, tuple[int, ...]]:
    """Shapes of the record's arrays; a shear run must have every quantity of RECORD with its shape in `quantities`."""
    shapes = {name: data.shape for name, data in file["record"].items()} if "record" in file else {}
    if file.attrs["stage"] != "shear":
        return shapes
    rows = shapes.get("eps_a", (0,))[0]
    for symbol, quantity in RECORD.items():
        if symbol not in shapes:
            raise RunFileError(f"{path}: /record/{symbol} is missing")
        expected = (rows, *(int(k) for k in quantity.shape.split(",") if k))
        if shapes[symbol] != expected or rows < 2:
            raise RunFileError(
                f"{path}: /record/{symbol} has shape {shapes[symbol]}, not {expected} with 2 rows or more"
            )
    return shapes


def _snapshot_list(file: h5py.File) -> tuple[tuple[str, float, str], ...]:
    groups = file["snapshots"].items() if "snapshots" in file else ()
    return tuple((k, float(g.attrs.get("eps_a", 0.0)), str(_text(g.attrs.get("label", "")))) for k, g in groups)


def _numbers(where: str, group: h5py.Group, name: str) -> np.ndarray:
    """Values of a dataset; raises RunFileError if they cannot be read or are no numbers."""
    try:
        values = np.asarray(group[name][()])
    except OSError as error:
        raise RunFileError(f"{where}/{name} cannot be read: truncated or damaged ({one_line(error)})") from error
    if values.dtype.kind not in "fiu":
        raise RunFileError(f"{where}/{name} holds no numbers but {values.dtype}")
    return values


def _text(value: Any) -> Any:
    return value.decode() if isinstance(value, bytes) else value


def _plain(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """HDF5 attributes as Python values."""
    return {k: v.item() if isinstance(v, np.generic) else _text(v) for k, v in attrs.items()}
