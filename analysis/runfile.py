"""Reading a run's product: what was asked, what was recorded, and the snapshots; nothing is trusted unchecked.

A product is one HDF5 file (format "dem-run", version 1).  Opening it checks that it is whole; arrays of the record are
read when they are first asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

import h5py
import numpy as np

from analysis.quantities import RECORD

FORMAT, VERSION = "dem-run", 1
STAGES = ("consolidate", "shear", "probe")
#: What a shear run sums up to its `energy_strain` only; NaN in the rows beyond.
ENDING = ("E_elastic", "E_friction", "E_damping")


class RunFileError(ValueError):
    """A product that is missing, cut short or not what it says; one line naming the file, the thing and the value."""


class SnapshotError(RunFileError):
    """A snapshot whose arrays contradict each other or hold values that no packing can have."""


@dataclass(frozen=True)
class Run:
    """One finished run: parameters in SI, `record` symbol -> (T, ...) read on demand, snapshots (key, eps_a, label)."""

    path: Path
    run_id: str
    stage: str
    parameters: dict
    timing: dict
    proofs: dict
    record: Mapping[str, np.ndarray]
    probe: dict | None
    snapshots: tuple[tuple[str, float, str], ...]
    attrs: dict


@dataclass(frozen=True)
class Snapshot:
    """All particles and contacts at one instant.

    position (N, 3) m, radius (N,) m, cell (3, 3) m with the cell vectors as columns; for each of C contacts the pair of
    ids (C, 2), the unit normal (C, 3) from the first to the second, the branch (C, 3) m between their centres through
    the periodic image, the overlap (C,) m, the forces f_n and f_t (C, 3) N of the first on the second, and the tangent
    stiffnesses k_n and k_t (C,) N/m.
    """

    position: np.ndarray
    radius: np.ndarray
    cell: np.ndarray
    contact_ids: np.ndarray
    normal: np.ndarray
    branch: np.ndarray
    overlap: np.ndarray
    f_n: np.ndarray
    f_t: np.ndarray
    k_n: np.ndarray
    k_t: np.ndarray
    eps_a: float = 0.0
    label: str = ""
    where: str = field(default="snapshot", compare=False)

    @property
    def N(self) -> int:
        """Number of particles."""
        return len(self.radius)

    @property
    def volume(self) -> float:
        """Volume of the cell, m3."""
        return float(np.linalg.det(self.cell))

    @property
    def force(self) -> np.ndarray:
        """Contact force (C, 3) N of the first particle on the second."""
        return self.f_n + self.f_t


_ARRAYS = tuple(f.name for f in fields(Snapshot) if f.name not in ("eps_a", "label", "where"))


def read_run(path: str | Path) -> Run:
    """Open a product and check that it is whole; RunFileError names the file and what is wrong with it."""
    path = Path(path)
    with _open(path) as file:
        attrs = _plain(file.attrs)
        if attrs.get("format") != FORMAT:
            raise RunFileError(f"{path}: not a run product (format = {attrs.get('format')!r}, not {FORMAT!r})")
        if attrs.get("format_version") != VERSION:
            raise RunFileError(f"{path}: format_version = {attrs.get('format_version')}, this reader knows {VERSION}")
        if attrs.get("stage") not in STAGES:
            raise RunFileError(f"{path}: stage = {attrs.get('stage')!r} is none of {', '.join(STAGES)}")
        if not attrs.get("complete", False):
            raise RunFileError(f"{path}: run {attrs.get('run_id')} is not complete")
        needed = {"shear": ("record", "snapshots"), "probe": ("probe", "snapshots"), "consolidate": ("snapshots",)}
        for group in ("parameters", "timing", "proofs", *needed[attrs["stage"]]):
            if group not in file:
                raise RunFileError(f"{path}: group /{group} is missing")
        probe = None
        if "probe" in file:
            probe = {**_plain(file["probe"].attrs), **{k: v[()] for k, v in file["probe"].items()}}
        return Run(
            path=path,
            run_id=str(attrs.get("run_id", path.stem)),
            stage=attrs["stage"],
            parameters=_plain(file["parameters"].attrs),
            timing=_plain(file["timing"].attrs),
            proofs=_plain(file["proofs"].attrs),
            record=_Record(path, _record_shapes(path, file)),
            probe=probe,
            snapshots=_snapshot_list(file),
            attrs=attrs,
        )


def read_snapshot(source: str | Path | Run, k: int | str = -1, check: bool = True) -> Snapshot:
    """Read one snapshot by number (negative from the end), key ("00") or label ("start", "end"), and check it.

    Raises RunFileError if there is none such, SnapshotError if its arrays are wrong (see `check_snapshot`).
    """
    path = source.path if isinstance(source, Run) else Path(source)
    with _open(path) as file:
        if "snapshots" not in file or len(file["snapshots"]) == 0:
            raise RunFileError(f"{path}: holds no snapshots")
        listed = _snapshot_list(file)
        keys = [key for key, _, label in listed if k in (key, label)] if isinstance(k, str) else [s[0] for s in listed]
        if not keys or (not isinstance(k, str) and not -len(keys) <= k < len(keys)):
            raise RunFileError(f"{path}: no snapshot {k!r} among the {len(listed)} there are")
        key = keys[0] if isinstance(k, str) else keys[k]
        group = file["snapshots"][key]
        where = f"{path}: snapshot {key}"
        missing = [name for name in _ARRAYS if name not in group]
        if missing:
            raise SnapshotError(f"{where}: dataset {missing[0]} is missing")
        try:
            arrays = {name: group[name][()] for name in _ARRAYS}
        except OSError as error:
            raise RunFileError(f"{where}: truncated ({error})") from error
        attrs = _plain(group.attrs)
    snapshot = Snapshot(**arrays, eps_a=float(attrs.get("eps_a", 0.0)), label=str(attrs.get("label", "")), where=where)
    return check_snapshot(snapshot) if check else snapshot


def check_snapshot(s: Snapshot) -> Snapshot:
    """Return the snapshot if a packing can look like this; else SnapshotError names the array, the place, the value.

    Checked: shapes, finite values, positive radii and cell volume, at least one contact, ids that exist, no
    self-contact, unit normals, branches that point along the normals.
    """
    n, c = len(s.radius), len(s.contact_ids)
    shapes = {"position": (n, 3), "radius": (n,), "cell": (3, 3), "contact_ids": (c, 2)}
    shapes |= dict.fromkeys(("normal", "branch", "f_n", "f_t"), (c, 3))
    shapes |= dict.fromkeys(("overlap", "k_n", "k_t"), (c,))
    for name, shape in shapes.items():
        array = getattr(s, name)
        if array.shape != shape:
            raise SnapshotError(f"{s.where}: {name} has shape {array.shape}, not {shape}")
        _refuse(s, name, ~np.isfinite(array), "is not finite")
    _refuse(s, "radius", s.radius <= 0.0, "is not positive")
    if s.volume <= 0.0:
        raise SnapshotError(f"{s.where}: the cell's volume {s.volume:.3g} m3 is not positive")
    if n == 0 or c == 0:
        raise SnapshotError(f"{s.where}: {n} particles and {c} contacts; an empty list has no metrics")
    _refuse(s, "contact_ids", (s.contact_ids < 0) | (s.contact_ids >= n), f"is unknown (ids run from 0 to {n - 1})")
    own = s.contact_ids[:, 0] == s.contact_ids[:, 1]
    _refuse(s, "contact_ids", own, "is a self-contact")
    _refuse(s, "normal", np.abs(np.einsum("ij,ij->i", s.normal, s.normal) - 1.0) > 1e-6, "is not a unit vector")
    _refuse(s, "branch", np.einsum("ij,ij->i", s.normal, s.branch) <= 0.0, "points against its normal")
    return s


def _refuse(s: Snapshot, name: str, bad: np.ndarray, words: str) -> None:
    """Raise for the first bad entry of an array, with its index and value."""
    if bad.any():
        first = int(np.flatnonzero(bad.reshape(len(bad), -1).any(axis=1))[0])
        raise SnapshotError(f"{s.where}: {name}[{first}] = {getattr(s, name)[first]} {words} ({int(bad.sum())} such)")


class _Record(Mapping):
    """Record arrays by symbol, read from the file when first asked for and then kept."""

    def __init__(self, path: Path, shapes: dict[str, tuple]):
        self._path, self._shapes, self._read = path, shapes, {}

    def __getitem__(self, symbol: str) -> np.ndarray:
        if symbol not in self._read:
            if symbol not in self._shapes:
                raise RunFileError(f"{self._path}: /record has no {symbol}")
            try:
                with _open(self._path) as file:
                    values = file["record"][symbol][()]
            except OSError as error:
                raise RunFileError(f"{self._path}: /record/{symbol} cannot be read ({error})") from error
            if values.dtype.kind == "f" and (row := _first_bad(values, may_end=symbol in ENDING)) is not None:
                raise RunFileError(f"{self._path}: /record/{symbol}[{row}] is not finite")
            self._read[symbol] = values
        return self._read[symbol]

    def __contains__(self, symbol: object) -> bool:
        return symbol in self._shapes

    def __iter__(self) -> Iterator[str]:
        return iter(self._shapes)

    def __len__(self) -> int:
        return len(self._shapes)


def _first_bad(values: np.ndarray, may_end: bool) -> int | None:
    """The first row that is not finite; where the record may end early, only one with a finite row after it."""
    finite = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if may_end and finite.any():
        finite = finite[: int(np.flatnonzero(finite)[-1]) + 1]
    return None if finite.all() else int(np.flatnonzero(~finite)[0])


def _record_shapes(path: Path, file: h5py.File) -> dict[str, tuple]:
    """Shapes of the record's arrays; in a shear run every recorded quantity must be there with the registry's shape."""
    shapes = {name: data.shape for name, data in file["record"].items()} if "record" in file else {}
    if file.attrs["stage"] != "shear":
        return shapes
    rows = shapes.get("eps_a", (0,))[0]
    for symbol, quantity in RECORD.items():
        if symbol not in shapes:
            raise RunFileError(f"{path}: /record/{symbol} is missing")
        wanted = (rows, *(int(k) for k in quantity.shape.split(",") if k))
        if shapes[symbol] != wanted or rows < 2:
            raise RunFileError(f"{path}: /record/{symbol} has shape {shapes[symbol]}, not {wanted} with 2 rows or more")
    return shapes


def _snapshot_list(file: h5py.File) -> tuple[tuple[str, float, str], ...]:
    groups = file["snapshots"].items() if "snapshots" in file else ()
    return tuple((k, float(g.attrs.get("eps_a", 0.0)), str(_text(g.attrs.get("label", "")))) for k, g in groups)


def _open(path: Path) -> h5py.File:
    if not path.is_file():
        raise RunFileError(f"{path}: no such run file")
    try:
        return h5py.File(path, "r")
    except OSError as error:
        raise RunFileError(f"{path}: truncated or not an HDF5 file ({str(error).splitlines()[0]})") from error


def _text(value):
    return value.decode() if isinstance(value, bytes) else value


def _plain(attrs: Mapping) -> dict:
    """HDF5 attributes as Python values."""
    return {k: v.item() if isinstance(v, np.generic) else _text(v) for k, v in attrs.items()}
