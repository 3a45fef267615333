"""Metrics of one packing, computed from its particles and contacts alone.

Conventions: ids (C, 2) are the two particles of each contact, normal (C, 3) is the unit vector from the first to the
second, branch (C, 3) m joins their centres through the periodic image, force (C, 3) N acts from the first on the
second.  Stress is positive in compression.  An active particle has at least two contacts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .grading import active_grading_index, grading_index, stress_grading_index
from .snapshot import Snapshot, SnapshotError

Z_AXIS = (0.0, 0.0, 1.0)


def snapshot_metrics(
    s: Snapshot, mu_s: float | None = None, axis: tuple[float, float, float] = Z_AXIS
) -> dict[str, Any]:
    """Compute all metrics of a snapshot.

    Void ratios count the full volume of every sphere, as the record of a run does; see `overlap_volume`.

    Parameters
    ----------
    s : Snapshot
        Particles and contacts at one instant.
    mu_s : float, optional
        Friction coefficient of the contacts; with it, the sliding fraction `f_sliding` is computed too.
    axis : tuple of float
        Direction of sigma_1, a unit vector.

    Returns
    -------
    dict of str to float or array
        Symbol of `quantities` -> value in SI units; the fabric Phi and the stress sigma are (3, 3) arrays.

    Raises
    ------
    SnapshotError
        If the mean stress of the contacts is not positive.

    Examples
    --------
    >>> path = "data/laptop/example_runs/shear_mu0.212_G20.4_iso0.040_s6_625b1c34.h5"
    >>> metrics = snapshot_metrics(read_snapshot(path, "end"), mu_s=0.212)
    >>> round(metrics["eta"], 3), round(metrics["Z_m"], 2)
    (0.621, 4.96)
    """
    n, ids, radius = s.N, s.contact_ids, s.radius
    count = contact_count(n, ids)
    c = coordination(count)
    sigma = love_stress(s.branch, s.force, s.volume)
    p, q = mean_and_deviator(sigma, axis)
    if not p > 0.0:
        raise SnapshotError(f"{s.where}: the mean stress p' = {p:.3g} Pa is not positive, so q / p' has no value")
    Phi = fabric(s.normal)
    d = 2.0 * radius
    metrics = {
        "e": void_ratio(radius, s.volume),
        "e_m": mechanical_void_ratio(radius, count, s.volume),
        "Z": c.Z,
        "Z_m": c.Z_m,
        "Phi": Phi,
        "Phi_dev": fabric_deviator(Phi),
        "sigma": sigma,
        "p": p,
        "q": q,
        "eta": q / p,
        "I_G": grading_index(d),
        "I_G_active": active_grading_index(d, count),
        "I_G_stress": stress_grading_index(d, particle_p_volume(s)),
    }
    if mu_s is not None:
        metrics["f_sliding"] = sliding_fraction(s.f_n, s.f_t, mu_s)
    return metrics


@dataclass(frozen=True)
class Coordination:
    """Number of particles N, of contacts N_c, of particles with no and with one contact N_0, N_1; Z and Z_m."""

    N: int
    N_c: int
    N_0: int
    N_1: int
    Z: float
    Z_m: float


def contact_count(N: int, ids: np.ndarray) -> np.ndarray:
    """Number of contacts (N,) of each of N particles; ids (C, 2)."""
    return np.bincount(np.ravel(ids), minlength=N)


def coordination(count: np.ndarray) -> Coordination:
    """Z = 2 N_c / N and Z_m = (2 N_c - N_1) / (N - N_0 - N_1) from the number of contacts of each particle (N,).

    Z_m is 0 where no particle has two contacts.  Thornton (2000).
    """
    n, ends = len(count), int(np.sum(count))
    n0, n1 = int(np.sum(count == 0)), int(np.sum(count == 1))
    active = n - n0 - n1
    return Coordination(n, ends // 2, n0, n1, ends / n, (ends - n1) / active if active else 0.0)


def void_ratio(radius: np.ndarray, volume: float, shared: float = 0.0) -> float:
    """e = (V - V_s) / V_s of spheres of radius (N,) m in a cell of `volume` m3; overlap of `shared` m3 reduces V_s."""
    solid = sphere_volume(radius).sum() - shared
    return float((volume - solid) / solid)


def mechanical_void_ratio(radius: np.ndarray, count: np.ndarray, volume: float, shared: float = 0.0) -> float:
    """e_m: void ratio, as in `void_ratio`, in which particles with fewer than two contacts (count (N,)) are void."""
    return void_ratio(radius[count >= 2], volume, shared)


def sphere_volume(radius: np.ndarray) -> np.ndarray:
    """Volumes (N,) m3 of spheres of radius (N,) m."""
    return 4.0 / 3.0 * np.pi * radius**3


def overlap_volume(radius: np.ndarray, ids: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """Exact volume (C,) m3 of the lens that two overlapping spheres share, once per contact.

    lens = pi h^2 (d^2 + 2 d (a + b) - 3 (a - b)^2) / (12 d) with the overlap h (C,) m, the radii a and b, and the
    distance of the centres d = a + b - h.
    """
    a, b = radius[ids[:, 0]], radius[ids[:, 1]]
    d = a + b - overlap
    return np.pi * overlap**2 * (d**2 + 2.0 * d * (a + b) - 3.0 * (a - b) ** 2) / (12.0 * d)


def fabric(normal: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Fabric tensor (3, 3): mean of n_i n_j over the contacts (Eq. 17), or the mean weighted by e.g. |f_n| (C,)."""
    if weight is None:
        return normal.T @ normal / len(normal)
    return (normal * weight[:, None]).T @ normal / np.sum(weight)


def fabric_deviator(Phi: np.ndarray) -> float:
    """Phi_dev = Phi_1 - Phi_3, major minus minor principal value (Eq. 18)."""
    principal = principal_values(Phi)
    return float(principal[0] - principal[2])


def principal_values(tensor: np.ndarray) -> np.ndarray:
    """Principal values (3,) of a symmetric tensor, largest first."""
    return np.linalg.eigvalsh(0.5 * (tensor + tensor.T))[::-1]


def love_stress(branch: np.ndarray, force: np.ndarray, volume: float) -> np.ndarray:
    """Mean stress (3, 3) Pa of the cell: sum of f_i l_j over the contacts, divided by the volume (Love 1927)."""
    return force.T @ branch / volume


def mean_and_deviator(sigma: np.ndarray, axis: tuple[float, float, float] = Z_AXIS) -> tuple[float, float]:
    """p' = (sigma_1 + 2 sigma_3) / 3 and q = sigma_1 - sigma_3, Pa: sigma_1 along `axis`, sigma_3 the mean across."""
    a = np.asarray(axis)
    along, trace = float(a @ sigma @ a), float(np.trace(sigma))
    return trace / 3.0, along - 0.5 * (trace - along)


def particle_stress(s: Snapshot) -> np.ndarray:
    """Mean stress (N, 3, 3) Pa of each particle over its own volume (Eq. 22).

    The contact point lies in the middle of the overlap.  The sum of V_m sigma_m over the particles is then exactly V
    times Love's stress (Eq. 21).
    """
    i, j, force = s.contact_ids[:, 0], s.contact_ids[:, 1], s.force
    first, second = _levers(s)
    out = np.empty((s.N, 9))
    for k in range(9):
        f = force[:, k // 3]
        out[:, k] = np.bincount(i, f * first[:, k % 3], s.N) + np.bincount(j, f * second[:, k % 3], s.N)
    return out.reshape(-1, 3, 3) / sphere_volume(s.radius)[:, None, None]


def particle_p_volume(s: Snapshot) -> np.ndarray:
    """p^(m) V^(m) (N,) in J: mean pressure of each particle times its volume (Eq. 23)."""
    first, second = _levers(s)
    out = np.bincount(s.contact_ids[:, 0], np.einsum("ij,ij->i", s.force, first), s.N)
    out += np.bincount(s.contact_ids[:, 1], np.einsum("ij,ij->i", s.force, second), s.N)
    return out / 3.0


def sliding_fraction(f_n: np.ndarray, f_t: np.ndarray, mu_s: float, tolerance: float = 1e-6) -> float:
    """Share of the contacts at the Coulomb limit, |f_t| >= (1 - tolerance) mu_s |f_n|; f_n, f_t (C, 3) N."""
    return float(np.mean(sliding(f_n, f_t, mu_s, tolerance)))


def sliding(f_n: np.ndarray, f_t: np.ndarray, mu_s: float, tolerance: float = 1e-6) -> np.ndarray:
    """Mask (C,) of the contacts at the Coulomb limit, as in `sliding_fraction`; a contact without force is not."""
    normal, tangential = np.einsum("ij,ij->i", f_n, f_n), np.einsum("ij,ij->i", f_t, f_t)
    return (tangential >= ((1.0 - tolerance) * mu_s) ** 2 * normal) & (normal > 0.0)


def force_distribution(f: np.ndarray, bins: int = 40, top: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    """Bin centres (bins,) from 0 to `top` and the PDF (bins,) there of force magnitudes divided by their mean.

    f (C,) or (C, 3) N.  Forces beyond `top` fall in no bin but count in the normalisation.
    """
    size = np.linalg.norm(f, axis=1) if f.ndim == 2 else np.abs(f)
    count, edge = np.histogram(size / size.mean(), bins=bins, range=(0.0, top))
    return 0.5 * (edge[1:] + edge[:-1]), count / len(size) / np.diff(edge)


def _levers(s: Snapshot) -> tuple[np.ndarray, np.ndarray]:
    """Levers (C, 3) m of the contact force in the stress sums: centre 1 to contact point, contact point to centre 2."""
    first = (s.radius[s.contact_ids[:, 0]] - 0.5 * s.overlap)[:, None] * s.normal
    return first, s.branch - first
