"""The grains of a packing for LAMMPS: their inertia, the file that LAMMPS reads, and the time step they allow."""

from __future__ import annotations

import math

import numpy as np

from analysis.micromechanics.snapshot import Snapshot

AXES = ("x", "y", "z")
#: Mass of a balanced grain ~ radius to this power, as in yade_scripts/inertia.py.
EXPONENT = 1.35
#: Stiffness that holds a grain of the median diameter in a consolidated packing, over G_p^(2/3) sigma_3^(1/3) d50, at
#: the exponent above: the largest of all grains of three packings of 400 (20.6 to 23.6 at mu_iso = 0.1, 0.04, 0.001).
HELD = 24.0


def masses(radius: np.ndarray, rho: float, balanced: bool) -> np.ndarray:
    """Masses (N,) in kg of spheres of radius (N,) m: their own, or balanced with the same sum (~ r^1.35).

    LAMMPS fixes the moment of inertia of a sphere at 2/5 m r2, so that only the masses can be balanced.
    """
    mass = rho * 4.0 / 3.0 * np.pi * radius**3
    return mass.sum() * radius**EXPONENT / np.sum(radius**EXPONENT) if balanced else mass


def data_file(position: np.ndarray, radius: np.ndarray, edge: np.ndarray, mass: np.ndarray) -> str:
    """Spheres (N, 3) m, wrapped into the cell of edges (3,) m, with diameters and densities, as LAMMPS reads them."""
    density = mass / (4.0 / 3.0 * np.pi * radius**3)
    rows = [
        f"{k + 1} 1 {2.0 * r:.17g} {rho:.17g} {x:.17g} {y:.17g} {z:.17g}"
        for k, (r, rho, (x, y, z)) in enumerate(zip(radius, density, np.mod(position, edge), strict=True))
    ]
    box = [f"0 {length:.17g} {axis}lo {axis}hi" for axis, length in zip(AXES, edge, strict=True)]
    head = [f"{len(radius)} spheres", "", f"{len(radius)} atoms", "1 atom types", "", *box, "", "Atoms # sphere", ""]
    return "\n".join([*head, *rows]) + "\n"


def edges(s: Snapshot) -> np.ndarray:
    """Edges (3,) m of a snapshot's cell; ValueError for a skew one, which LAMMPS does not shear here."""
    edge = np.diag(s.cell)
    skew = float(np.abs(s.cell - np.diag(edge)).max())
    if skew > 1e-12 * edge.min():
        raise ValueError(f"{s.where}: cell skewed by {skew:.3g} m; only a rectangular one can be written")
    return edge


def stable_step(s: Snapshot, mass: np.ndarray) -> float:
    """Largest stable time step (s): sqrt(2 m / k) of the grain whose contacts are stiffest, moving or turning.

    mass: that of each grain (N,), kg.
    """
    moving, turning = np.zeros((s.N, 3)), np.zeros((s.N, 3))
    along = s.normal**2
    for side in (0, 1):
        np.add.at(moving, s.contact_ids[:, side], s.k_n[:, None] * along + s.k_t[:, None] * (1.0 - along))
        np.add.at(turning, s.contact_ids[:, side], s.k_t[:, None] * (1.0 - along))
    # a turning sphere: (2/5) m r2 against k_t r2
    stiffest = np.maximum(moving, 2.5 * turning).max(axis=1)
    held = stiffest > 0.0
    return math.sqrt(2.0 * float((mass[held] / stiffest[held]).min()))


def expected_step(radius: np.ndarray, mass: np.ndarray, G_p: float, sigma_3: float, d50: float) -> float:
    """The stable time step (s) expected of a packing at sigma_3 before it is there, from the grains alone."""
    stiffness = HELD * G_p ** (2.0 / 3.0) * sigma_3 ** (1.0 / 3.0) * d50 * (2.0 * radius / d50) ** EXPONENT
    return math.sqrt(2.0 * float((mass / stiffness).min()))
