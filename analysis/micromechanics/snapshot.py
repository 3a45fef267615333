"""All particles and contacts of a packing at one instant, and the check of their arrays."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors_and_files import RunFileError


class SnapshotError(RunFileError):
    """The arrays of a snapshot contradict each other or hold values that no packing can have."""


@dataclass(frozen=True)
class Snapshot:
    """All particles and contacts at one instant.

    position (N, 3) m, radius (N,) m, cell (3, 3) m with the cell vectors as columns.  For each of C contacts:
    contact_ids (C, 2) of the two particles, unit normal (C, 3) from the first to the second, branch (C, 3) m between
    their centres through the periodic image, overlap (C,) m, normal and tangential force f_n and f_t (C, 3) N of the
    first on the second, tangent stiffnesses k_n and k_t (C,) N/m.  eps_a is the axial strain (compression positive),
    `where` names the source in error messages.
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


def check_snapshot(s: Snapshot) -> Snapshot:
    """Return the snapshot if it is physically possible; else raise SnapshotError with array, index and value.

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
    self_contact = s.contact_ids[:, 0] == s.contact_ids[:, 1]
    _refuse(s, "contact_ids", self_contact, "is a self-contact")
    _refuse(s, "normal", np.abs(np.einsum("ij,ij->i", s.normal, s.normal) - 1.0) > 1e-6, "is not a unit vector")
    _refuse(s, "branch", np.einsum("ij,ij->i", s.normal, s.branch) <= 0.0, "points against its normal")
    return s


def _refuse(s: Snapshot, name: str, bad: np.ndarray, words: str) -> None:
    """Raise SnapshotError for the first bad entry of an array, with its index and value."""
    if bad.any():
        first = int(np.flatnonzero(bad.reshape(len(bad), -1).any(axis=1))[0])
        raise SnapshotError(f"{s.where}: {name}[{first}] = {getattr(s, name)[first]} {words} ({int(bad.sum())} such)")
