"""Every metric of one packing from its particles and contacts alone.

Conventions: ids (C, 2) are the particles of each contact, normal (C, 3) the unit vector from the first to the second,
branch (C, 3) joins their centres through the periodic image, force (C, 3) is what the first exerts on the second.
Stress is positive in compression.  An active particle has at least two contacts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.grading import active_grading_index, grading_index, stress_grading_index
from analysis.runfile import Snapshot, SnapshotError

Z_AXIS = (0.0, 0.0, 1.0)


def snapshot_metrics(s: Snapshot, mu_s: float | None = None, axis: tuple[float, float, float] = Z_AXIS) -> dict:
    """All metrics of a snapshot, keyed by the registry's symbols, in SI; the fabric and the stress are (3, 3).

    `axis` is the direction of sigma_1.  The sliding fraction needs the friction coefficient mu_s.
    Void ratios count the spheres' full volumes, as the running record does; see `overlap_volume`.
    Raises SnapshotError if the contacts bear no pressure.
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
    """Numbers of contacts and of particles with none and with one, and the two coordination numbers."""

    N: int
    N_c: int
    N_0: int
    N_1: int
    Z: float
    Z_m: float


def contact_count(N: int, ids: np.ndarray) -> np.ndarray:
    """Number of contacts of each of N particles (N,)."""
    return np.bincount(np.ravel(ids), minlength=N)


def coordination(count: np.ndarray) -> Coordination:
    """Z = 2 N_c / N and Z_m = (2 N_c - N_1) / (N - N_0 - N_1) from the contacts of each particle (N,).

    Z_m is 0 where no particle has two contacts.  Thornton (2000).
    """
    n, ends = len(count), int(np.sum(count))
    n0, n1 = int(np.sum(count == 0)), int(np.sum(count == 1))
    active = n - n0 - n1
    return Coordination(n, ends // 2, n0, n1, ends / n, (ends - n1) / active if active else 0.0)


def void_ratio(radius: np.ndarray, volume: float, shared: float = 0.0) -> float:
    """e = (V - V_s) / V_s of spheres (N,) m in a cell of `volume` m3; `shared` m3 of overlap is taken off V_s."""
    solid = sphere_volume(radius).sum() - shared
    return float((volume - solid) / solid)


def mechanical_void_ratio(radius: np.ndarray, count: np.ndarray, volume: float, shared: float = 0.0) -> float:
    """e_m: the void ratio with particles of fewer than two contacts counted as void."""
    return void_ratio(radius[count >= 2], volume, shared)


def sphere_volume(radius: np.ndarray) -> np.ndarray:
    """Volumes (N,) m3."""
    return 4.0 / 3.0 * np.pi * radius**3


def overlap_volume(radius: np.ndarray, ids: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """Volume (C,) m3 of the lens that each pair of overlapping spheres shares, exact; counted once, not per particle.

    lens = pi h^2 (d^2 + 2 d (a + b) - 3 (a - b)^2) / (12 d), h the overlap, d = a + b - h the distance of the centres.
    """
    a, b = radius[ids[:, 0]], radius[ids[:, 1]]
    d = a + b - overlap
    return np.pi * overlap**2 * (d**2 + 2.0 * d * (a + b) - 3.0 * (a - b) ** 2) / (12.0 * d)


def fabric(normal: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Fabric tensor (3, 3): mean of n_i n_j over contacts (Eq. 17), or its weighted mean, e.g. by |f_n| (C,)."""
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
    """Mean stress (3, 3) Pa of the cell: the sum of f_i l_j over contacts over the cell's volume (Love 1927)."""
    return force.T @ branch / volume


def mean_and_deviator(sigma: np.ndarray, axis: tuple[float, float, float] = Z_AXIS) -> tuple[float, float]:
    """p' = (sigma_1 + 2 sigma_3) / 3 and q = sigma_1 - sigma_3, sigma_1 along `axis`, sigma_3 the mean across."""
    a = np.asarray(axis)
    along, trace = float(a @ sigma @ a), float(np.trace(sigma))
    return trace / 3.0, along - 0.5 * (trace - along)


def particle_stress(s: Snapshot) -> np.ndarray:
    """Mean stress (N, 3, 3) Pa inside each particle, over the particle's own volume (Eq. 22).

    The contact point lies in the middle of the overlap, so that V_m sigma_m summed over the particles is V times Love's
    stress (Eq. 21) exactly.
    """
    i, j, force = s.contact_ids[:, 0], s.contact_ids[:, 1], s.force
    first, second = _levers(s)
    out = np.empty((s.N, 9))
    for k in range(9):
        f = force[:, k // 3]
        out[:, k] = np.bincount(i, f * first[:, k % 3], s.N) + np.bincount(j, f * second[:, k % 3], s.N)
    return out.reshape(-1, 3, 3) / sphere_volume(s.radius)[:, None, None]


def particle_p_volume(s: Snapshot) -> np.ndarray:
    """p^(m) V^(m) (N,) in J: mean stress of each particle times its volume, a third of the trace of its stress sum."""
    first, second = _levers(s)
    out = np.bincount(s.contact_ids[:, 0], np.einsum("ij,ij->i", s.force, first), s.N)
    out += np.bincount(s.contact_ids[:, 1], np.einsum("ij,ij->i", s.force, second), s.N)
    return out / 3.0


def sliding_fraction(f_n: np.ndarray, f_t: np.ndarray, mu_s: float, tolerance: float = 1e-6) -> float:
    """Share of contacts at the Coulomb limit: |f_t| >= (1 - tolerance) mu_s |f_n|; f_n, f_t (C, 3) N."""
    return float(np.mean(sliding(f_n, f_t, mu_s, tolerance)))


def sliding(f_n: np.ndarray, f_t: np.ndarray, mu_s: float, tolerance: float = 1e-6) -> np.ndarray:
    """Which contacts (C,) are at the Coulomb limit; a contact that bears no force is not."""
    normal, tangential = np.einsum("ij,ij->i", f_n, f_n), np.einsum("ij,ij->i", f_t, f_t)
    return (tangential >= ((1.0 - tolerance) * mu_s) ** 2 * normal) & (normal > 0.0)


def force_distribution(f: np.ndarray, bins: int = 40, top: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    """Probability density (bins,) of force magnitudes over their mean, at bin centres (bins,) from 0 to `top`.

    f (C,) or (C, 3) N.  What lies beyond `top` is left out of the bins but not of the normalisation.
    """
    size = np.linalg.norm(f, axis=1) if f.ndim == 2 else np.abs(f)
    count, edge = np.histogram(size / size.mean(), bins=bins, range=(0.0, top))
    return 0.5 * (edge[1:] + edge[:-1]), count / len(size) / np.diff(edge)


def _levers(s: Snapshot) -> tuple[np.ndarray, np.ndarray]:
    """Vectors (C, 3) m that the force goes with in the two stress sums: centre 1 to contact, contact to centre 2."""
    first = (s.radius[s.contact_ids[:, 0]] - 0.5 * s.overlap)[:, None] * s.normal
    return first, s.branch - first
