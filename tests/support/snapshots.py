"""Packings with known answers: cubic lattices, random contact networks, and moves that must change nothing.

Everything here is geometry plus Hertz-Mindlin springs; no simulation.  `closed_form_fcc` and the lattice tables hold
the answers that the tests compare with.
"""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np

from analysis.micromechanics.snapshot import Snapshot
from analysis.quantities import RECORD

SNAPSHOT_ARRAYS = ("position", "radius", "cell", "contact_ids", "normal", "branch", "overlap", "f_n", "f_t")
SNAPSHOT_ARRAYS += ("k_n", "k_t")

LATTICE_BASES = {
    "sc": [[0.0, 0.0, 0.0]],
    "bcc": [[0.0, 0.0, 0.0], [0.5, 0.5, 0.5]],
    "fcc": [[0.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]],
}
#: Cell edge over sphere diameter, coordination number and solid fraction of touching spheres.
LATTICE_FACTS = {
    "sc": (1.0, 6, np.pi / 6.0),
    "bcc": (2.0 / np.sqrt(3.0), 8, np.pi * np.sqrt(3.0) / 8.0),
    "fcc": (np.sqrt(2.0), 12, np.pi / (3.0 * np.sqrt(2.0))),
}


def lattice_positions(kind: str, cells: int, diameter: float) -> tuple[np.ndarray, float]:
    """Sphere centres (N, 3) of cells^3 unit cells of touching spheres, and the edge of the whole cube."""
    edge = LATTICE_FACTS[kind][0] * diameter
    corner = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return edge * (corner + np.array(LATTICE_BASES[kind])).reshape(-1, 3), cells * edge


def lattice(kind: str, cells: int = 3, diameter: float = 1e-3, p: float = 0.0, G_p: float = 25.7e9, nu: float = 0.2):
    """Snapshot of a lattice under isotropic pressure p (Pa), contacts slightly closer than touching; p = 0: touching.

    The centres keep the distance `diameter`; the radii are what grows with p, so that closed forms in the centre
    distance hold exactly.
    """
    position, edge = lattice_positions(kind, cells, diameter)
    Z, density = LATTICE_FACTS[kind][1], len(position) / edge**3
    force = 6.0 * p / (Z * density * diameter)
    overlap = 0.0
    for _ in range(20):
        overlap = hertz_overlap(force, 0.5 * (diameter + overlap), G_p, nu)
    radius = np.full(len(position), 0.5 * (diameter + overlap))
    ids, branch = contacts(position, radius * (1.0 + 1e-9), edge * np.eye(3))
    return hertzian(position, radius, edge * np.eye(3), ids, branch, G_p, nu)


def hertz_overlap(force: float, radius: float, G_p: float, nu: float) -> float:
    """Overlap (m) of two equal spheres pressed by a force (N): F = 4/3 E* sqrt(R*) overlap^1.5."""
    E_star, _ = contact_moduli(G_p, nu)
    return (0.75 * force / (E_star * np.sqrt(0.5 * radius))) ** (2.0 / 3.0)


def contact_moduli(G_p: float, nu: float) -> tuple[float, float]:
    """E* = E / 2 (1 - nu^2) = G / (1 - nu) and G* = G / 2 (2 - nu) of two equal materials, Pa."""
    return G_p / (1.0 - nu), G_p / (2.0 * (2.0 - nu))


def closed_form_fcc(k_n: float, k_t: float, distance: float) -> dict[str, float]:
    """K, C44 and (C11 - C12) / 2 (Pa) of a face-centred cubic array with contact springs k_n, k_t (N/m)."""
    return {
        "K": 2.0 * np.sqrt(2.0) / 3.0 * k_n / distance,
        "C44": (k_n + k_t) / (np.sqrt(2.0) * distance),
        "C_prime": np.sqrt(2.0) / 4.0 * (k_n + 3.0 * k_t) / distance,
    }


def contacts(position: np.ndarray, radius: np.ndarray, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All overlapping pairs (C, 2) and branch vectors (C, 3) in a periodic cell of any shape, by brute force.

    Every image within one cell is tried, so that a pair may touch through more than one of them.
    """
    images = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3) @ cell.T
    wrapped = (np.linalg.solve(cell, position.T) % 1.0).T @ cell.T
    i, j = np.triu_indices(len(radius), 1)
    found = []
    for shift in images:
        branch = wrapped[j] - wrapped[i] + shift
        near = np.einsum("ij,ij->i", branch, branch) < (radius[i] + radius[j]) ** 2
        found.append((np.column_stack([i, j])[near], branch[near]))
    ids, branch = (np.concatenate(part) for part in zip(*found, strict=True))
    return ids, branch


def hertzian(position, radius, cell, ids, branch, G_p=25.7e9, nu=0.2, f_t=None) -> Snapshot:
    """Snapshot whose contacts bear Hertz's normal force and Mindlin's no-slip stiffness; f_t (C, 3) N, or zero."""
    distance = np.linalg.norm(branch, axis=1)
    a, b = radius[ids[:, 0]], radius[ids[:, 1]]
    overlap = np.maximum(a + b - distance, 0.0)
    normal = branch / distance[:, None]
    E_star, G_star = contact_moduli(G_p, nu)
    contact_radius = np.sqrt(a * b / (a + b) * overlap)
    f_n = (4.0 / 3.0 * E_star * contact_radius * overlap)[:, None] * normal
    f_t = np.zeros_like(f_n) if f_t is None else f_t
    k_n, k_t = 2.0 * E_star * contact_radius, 8.0 * G_star * contact_radius
    return Snapshot(position, radius, cell, ids, normal, branch, overlap, f_n, f_t, k_n, k_t)


def random_network(N: int = 120, seed: int = 0, sigma_ln: float = 0.3) -> Snapshot:
    """Overlapping random spheres with Hertz's normal forces and random tangential ones under the Coulomb limit of 0.5.

    Not in equilibrium: a snapshot for identities that hold for any contacts and forces.
    """
    rng = np.random.default_rng(seed)
    radius = 0.5e-3 * np.exp(sigma_ln * rng.normal(size=N))
    edge = (np.sum(4.0 / 3.0 * np.pi * radius**3) / 0.55) ** (1.0 / 3.0)
    cell = edge * np.array([[1.0, 0.1, 0.0], [0.0, 1.0, -0.2], [0.05, 0.0, 1.0]])
    position = rng.uniform(0.0, 1.0, (N, 3)) @ cell.T
    for _ in range(12):
        ids, branch = contacts(position, radius, cell)
        s = hertzian(position, radius, cell, ids, branch)
        push = 0.25 * s.overlap[:, None] * s.normal
        np.add.at(position, ids[:, 1], push)
        np.add.at(position, ids[:, 0], -push)
    ids, branch = contacts(position, radius, cell)
    s = hertzian(position, radius, cell, ids, branch)
    t = np.cross(s.normal, rng.normal(size=s.normal.shape))
    t *= (rng.choice([0.1, 0.3, 0.5], size=len(t)) * np.linalg.norm(s.f_n, axis=1) / np.linalg.norm(t, axis=1))[:, None]
    return replace(s, f_t=t)


def rotated(s: Snapshot, Q: np.ndarray) -> Snapshot:
    """The packing turned by the rotation matrix Q, its contacts found anew."""
    return _again(s, s.position @ Q.T, s.radius, Q @ s.cell, lambda v: v @ Q.T, np.arange(s.N))


def shifted(s: Snapshot, shift: np.ndarray) -> Snapshot:
    """The packing moved by a vector (3,) through its periodic cell, contacts found anew."""
    return _again(s, s.position + shift, s.radius, s.cell, lambda v: v, np.arange(s.N))


def permuted(s: Snapshot, order: np.ndarray) -> Snapshot:
    """The particles in another order: new particle k is old particle order[k]."""
    new_id = np.empty(s.N, int)
    new_id[order] = np.arange(s.N)
    return _again(s, s.position[order], s.radius[order], s.cell, lambda v: v, new_id)


def recut(s: Snapshot, integers: np.ndarray) -> Snapshot:
    """The same periodic packing in another cell: cell @ integers, an integer matrix (3, 3) of determinant 1."""
    cell = s.cell @ integers
    position = (np.linalg.solve(cell, s.position.T) % 1.0).T @ cell.T
    return _again(s, position, s.radius, cell, lambda v: v, np.arange(s.N))


def _again(s: Snapshot, position, radius, cell, turn, new_id) -> Snapshot:
    """Contacts found from the moved positions; tangential forces carried over from the contact they belong to."""
    ids, branch = contacts(position, radius, cell)
    old = {
        _key(i, j, b): (i, f) for (i, j), b, f in zip(new_id[s.contact_ids], turn(s.branch), turn(s.f_t), strict=True)
    }
    f_t = np.empty((len(ids), 3))
    for k, ((i, j), b) in enumerate(zip(ids, branch, strict=True)):
        first, f = old[_key(i, j, b)]
        f_t[k] = f if first == i else -f
    return hertzian(position, radius, cell, ids, branch, f_t=f_t)


def _key(i: int, j: int, branch: np.ndarray) -> tuple:
    """A contact's name whichever particle comes first; the branch tells apart contacts through different images."""
    b = branch if i < j else -branch
    return (min(i, j), max(i, j), *np.round(b * 1e9).astype(int))


def directed_contacts(C: int, a_c: float) -> np.ndarray:
    """Normals (C, 3), evenly spread, whose density over directions is (1 + a_c (3 n_z^2 - 1) / 2) / 4 pi."""
    z = np.linspace(-1.0, 1.0, 20001)
    share = 0.5 * (1.0 + z + 0.5 * a_c * (z**3 - z))
    height = np.interp((np.arange(C) + 0.5) / C, share, z)
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(C)
    ring = np.sqrt(1.0 - height**2)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])


def write_product(path, stage: str = "shear", snapshots=(), record=None, **attrs):
    """A run product as the scenes write it, with the given snapshots and record; attributes can be replaced."""
    with h5py.File(path, "w") as file:
        file.attrs.update({"format": "dem-run", "format_version": 1, "stage": stage, "run_id": path.stem})
        file.attrs.update({"complete": True, "exit_reason": "strain_end", "failure": "", **attrs})
        file.create_group("parameters").attrs.update({"mu_s": 0.25, "G_p": 25.7e9, "N": 8})
        file.create_group("timing").attrs.update({"steps": 10, "cpu_seconds": 1.0})
        file.create_group("proofs").attrs["max_inertial_number"] = 1e-3
        for symbol, values in (record or {}).items():
            file.require_group("record")[symbol] = values
        for k, s in enumerate(snapshots):
            group = file.create_group(f"snapshots/{k:02d}")
            group.attrs.update({"eps_a": s.eps_a, "label": s.label})
            for name in SNAPSHOT_ARRAYS:
                group[name] = getattr(s, name)
        if stage == "probe":
            file.create_group("probe").attrs.update({"G_0": 170e6, "K_0": 180e6, "strain": 1e-5})
            file["probe"]["d_sigma"] = np.zeros((3, 3, 3))
    return path


def shear_record(rows: int = 12) -> dict[str, np.ndarray]:
    """A record (T, ...) of every recorded quantity with the registry's shapes; values rise with the row number."""
    shapes = {symbol: tuple(int(k) for k in quantity.shape.split(",") if k) for symbol, quantity in RECORD.items()}
    ramp = np.arange(rows, dtype=float)
    return {symbol: ramp.reshape(-1, *[1] * len(shape)) * np.ones((rows, *shape)) for symbol, shape in shapes.items()}
