"""Small-strain stiffness: from the increments of a probe, from the static contact network, by the effective medium.

The network solve takes the contacts of a snapshot as springs (k_n along the normal, k_t across).  Under a given mean
strain every particle moves and turns until all forces and moments balance; the stress of that state gives the moduli.
There is no time stepping and no sliding: the result is the elastic tangent of the packing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from ..errors_and_files import GrainScatterError
from .metrics import contact_count
from .snapshot import Snapshot

#: Unit strains, compression positive: constant-volume axisymmetric shear (eps_q = 1) and isotropic (eps_v = 1).
SHEAR = np.diag([-0.5, -0.5, 1.0])
BULK = np.eye(3) / 3.0
#: Rows of the 6 x 6 matrix: 11, 22, 33, 23, 13, 12, with engineering shear strains.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


class StiffnessError(GrainScatterError):
    """Increments or a contact network from which no stiffness can be computed."""


@dataclass(frozen=True)
class Moduli:
    """Shear modulus G_0 of the axisymmetric probe and bulk modulus K_0, Pa, with two numbers on the solve.

    `active` is the number of particles in the network (rattlers are not), `residual` the norm of the unbalanced forces
    relative to that of the affine contact forces.
    """

    G_0: float
    K_0: float
    active: int
    residual: float


def network_moduli(s: Snapshot, affine: bool = False) -> Moduli:
    """G_0 and K_0 of the contact network of a snapshot by one sparse linear solve; `affine` omits the relaxation.

    G_0 = dq / (3 d eps_q) at constant volume, K_0 = dp' / d eps_v.  Raises StiffnessError if no particle carries load.
    """
    sigma, active, residual = network_response(s, np.stack([SHEAR, BULK]), affine)
    return Moduli(shear_modulus(sigma[0], SHEAR), bulk_modulus(sigma[1], BULK), active, residual)


def network_stiffness(s: Snapshot, affine: bool = False) -> np.ndarray:
    """All elastic constants (6, 6) Pa of the contact network, rows and columns in the order of VOIGT."""
    strains = np.zeros((6, 3, 3))
    for k, (i, j) in enumerate(VOIGT):
        strains[k, i, j] += 0.5
        strains[k, j, i] += 0.5
    sigma = network_response(s, strains, affine)[0]
    return np.array([[0.5 * (sigma[k, i, j] + sigma[k, j, i]) for k in range(6)] for i, j in VOIGT])


def shear_modulus(d_sigma: np.ndarray, d_eps: np.ndarray) -> float:
    """G_0 = dq / (3 d eps_q), Pa, of an increment that is axisymmetric about z: d_sigma (3, 3) Pa, d_eps (3, 3).

    Raises StiffnessError if d_eps contains no axisymmetric shear.
    """
    dq = d_sigma[2, 2] - 0.5 * (d_sigma[0, 0] + d_sigma[1, 1])
    d_eps_q = 2.0 / 3.0 * (d_eps[2, 2] - 0.5 * (d_eps[0, 0] + d_eps[1, 1]))
    if d_eps_q == 0.0:
        raise StiffnessError("stiffness: the strain increment holds no axisymmetric shear, so it gives no G_0")
    return float(dq / (3.0 * d_eps_q))


def bulk_modulus(d_sigma: np.ndarray, d_eps: np.ndarray) -> float:
    """K_0 = dp' / d eps_v, Pa, of an increment d_sigma (3, 3) Pa, d_eps (3, 3).

    Raises StiffnessError if d_eps contains no volume change.
    """
    if np.trace(d_eps) == 0.0:
        raise StiffnessError("stiffness: the strain increment holds no volume change, so it gives no K_0")
    return float(np.trace(d_sigma) / 3.0 / np.trace(d_eps))


def effective_medium(solid_fraction: float, Z: float, p: float, G_p: float, nu: float) -> tuple[float, float]:
    """G_0 and K_0 (Pa) if all particles move with the mean strain (Walton 1987), which overestimates G_0.

    solid_fraction, coordination number Z, mean stress p (Pa), shear modulus G_p (Pa) and Poisson's ratio nu of grains.
    """
    squared = (Z * solid_fraction * G_p / (np.pi * (1.0 - nu))) ** 2 * p
    K = (squared / 18.0) ** (1.0 / 3.0)
    return (5.0 - 4.0 * nu) / (5.0 * (2.0 - nu)) * (1.5 * squared) ** (1.0 / 3.0), K


def network_response(s: Snapshot, strains: np.ndarray, affine: bool = False) -> tuple[np.ndarray, int, float]:
    """Stress (M, 3, 3) Pa per unit of each strain (M, 3, 3), number of active particles, relative residual.

    Springs only: the rotation of the forces already present adds terms of order p'/G_0, which are neglected.
    """
    volume = s.volume
    s, active = without_rattlers(s)
    springs = _contact_springs(s)
    # Compression shortens the branches: the second particle of a contact moves by -eps l relative to the first.
    relative = -np.einsum("mij,cj->cim", strains, s.branch)
    residual = 0.0
    if not affine:
        B = _compatibility(s)
        index = np.arange(len(springs) + 1)
        K = (B.T @ sparse.bsr_matrix((springs, index[:-1], index)) @ B).tocsr()
        force = np.einsum("cij,cjm->cim", springs, relative).reshape(-1, len(strains))
        size = np.linalg.norm(force, axis=0)
        motion = _solve(K, -(B.T @ force), 1e-12 * size)
        residual = float(np.max(np.linalg.norm(K @ motion + B.T @ force, axis=0) / size))
        relative += (B @ motion).reshape(relative.shape)
    # The force on the second particle opposes its motion; in Love's sum it is multiplied with the branch.
    d_force = -np.einsum("cij,cjm->cim", springs, relative)
    return np.einsum("cim,cj->mij", d_force, s.branch) / volume, active, residual


def without_rattlers(s: Snapshot) -> tuple[Snapshot, int]:
    """The snapshot without the contacts of particles that carry no load, and the number of particles in the rest.

    A particle with a single contact carries no load.  Removing that contact may leave another particle with one, so
    the step is repeated.  Raises StiffnessError if no contact remains.
    """
    keep = np.ones(len(s.contact_ids), bool)
    while True:
        count = contact_count(s.N, s.contact_ids[keep])
        loose = keep & (count[s.contact_ids] < 2).any(axis=1)
        if not loose.any():
            break
        keep &= ~loose
    if not keep.any():
        raise StiffnessError(f"{s.where}: no particle of {s.N} has two contacts, so the network has no stiffness")
    names = ("contact_ids", "normal", "branch", "overlap", "f_n", "f_t", "k_n", "k_t")
    return replace(s, **{name: getattr(s, name)[keep] for name in names}), int(np.sum(count > 0))


def _contact_springs(s: Snapshot) -> np.ndarray:
    """Spring matrices (C, 3, 3) N/m: k_n along the normal, k_t across."""
    along = s.normal[:, :, None] * s.normal[:, None, :]
    return s.k_t[:, None, None] * np.eye(3) + (s.k_n - s.k_t)[:, None, None] * along


def _compatibility(s: Snapshot) -> sparse.csr_matrix:
    """Matrix (3 C, 6 N) from displacements and rotations (times the radius) to relative motion at the contact points.

    u_2 - u_1 - r_1 theta_1 x n - r_2 theta_2 x n, where r_1 and r_2 are the distances of the contact point from the
    two centres.
    """
    c, (i, j) = len(s.normal), s.contact_ids.T
    cross = np.zeros((c, 3, 3))  # -(theta x n) = n x theta as a matrix on theta
    for a, b, k, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 0, 2, 1), (1, 2, 0, -1), (2, 0, 1, -1), (2, 1, 0, 1)):
        cross[:, a, b] = sign * s.normal[:, k]
    arm_1, arm_2 = (1.0 - 0.5 * s.overlap / s.radius[k] for k in (i, j))
    unit = np.broadcast_to(np.eye(3), (c, 3, 3))
    parts = [(i, 0, -unit), (j, 0, unit), (i, 3, arm_1[:, None, None] * cross), (j, 3, arm_2[:, None, None] * cross)]
    rows = np.broadcast_to((3 * np.arange(c))[:, None, None] + np.arange(3)[:, None], (c, 3, 3)).ravel()
    row = np.tile(rows, len(parts))
    column = np.concatenate(
        [np.broadcast_to((6 * k + first)[:, None, None] + np.arange(3), (c, 3, 3)).ravel() for k, first, _ in parts]
    )
    value = np.concatenate([part.ravel() for *_, part in parts])
    return sparse.csr_matrix((value, (row, column)), shape=(3 * c, 6 * s.N))


def _solve(K: sparse.csr_matrix, load: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """x (n, M) of K x = load by conjugate gradients, preconditioned by the inverse of each particle's 6 x 6 block.

    K is singular (free translations, free particles), but the load has no part in its null space, because both come
    from the same springs.  Raises StiffnessError if the norms of the residuals do not fall to `goal` (M,).
    """
    n = K.shape[0] // 6
    blocks = K.tobsr((6, 6))
    row = np.repeat(np.arange(n), np.diff(blocks.indptr))
    diagonal = np.zeros((n, 6, 6))
    diagonal[row[row == blocks.indices]] = blocks.data[row == blocks.indices]
    inverse = np.linalg.pinv(diagonal, rcond=1e-10, hermitian=True)
    x, residual = np.zeros_like(load), load.copy()
    scaled = direction = np.einsum("nij,njm->nim", inverse, residual.reshape(n, 6, -1)).reshape(load.shape)
    product = np.sum(residual * scaled, axis=0)
    for _ in range(20 * load.shape[0]):
        if np.all(np.linalg.norm(residual, axis=0) <= goal):
            return x
        image = K @ direction
        length = product / np.maximum(np.sum(direction * image, axis=0), 1e-300)
        x += length * direction
        residual -= length * image
        scaled = np.einsum("nij,njm->nim", inverse, residual.reshape(n, 6, -1)).reshape(load.shape)
        product, previous = np.sum(residual * scaled, axis=0), product
        direction = scaled + product / np.maximum(previous, 1e-300) * direction
    worst = float(np.max(np.linalg.norm(residual, axis=0) / goal))
    raise StiffnessError(f"stiffness: the network solve stalls at a residual {worst:.1e} times the tolerance")
