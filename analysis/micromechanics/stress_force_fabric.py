"""Stress-force-fabric relation: the stress ratio from the anisotropy of contacts (a_c), normal and tangential forces.

Expansions over directions n (Ouadfel & Rothenburg 2001; Guo & Zhao 2013), each fitted by least squares over contacts:
    contacts E(n) = (1 + a_c:nn + fourth order) / 4 pi,   branch length l_0 (1 + a_b:nn),
    normal force f_0 (1 + a_n:nn),                        tangential force f_0 (a_t.n - (a_t:nn) n).
Together they predict the stress tensor, and to first order q / p' = 0.4 (a_c + a_n + 1.5 a_t).  The fourth order
of E matters at the critical state: without it the predicted q / p' is about 5 % too large.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .metrics import Z_AXIS, love_stress, mean_and_deviator
from .snapshot import Snapshot


@dataclass(frozen=True)
class StressForceFabric:
    """Anisotropies of contacts, normal forces, tangential forces and branches, and the stress ratio they predict.

    An anisotropy is positive if it increases q.  `eta` is the measured q / p'; `eta_predicted` follows from the stress
    tensor integrated from the four expansions with all their products; `eta_linear` = 0.4 (a_c + a_n + 1.5 a_t)
    neglects products, the fourth order and the branches.
    """

    a_c: float
    a_n: float
    a_t: float
    a_b: float
    eta: float
    eta_predicted: float
    eta_linear: float


def stress_force_fabric(s: Snapshot, axis: tuple[float, float, float] = Z_AXIS) -> StressForceFabric:
    """Decompose the stress ratio of a snapshot; `axis` is the direction of sigma_1."""
    Phi, fourth, pairs = direction_moments(s.normal)
    f_0, A_n = scalar_anisotropy(fourth, pairs, np.einsum("ij,ij->i", s.f_n, s.normal))
    A_t = tangential_anisotropy(Phi, fourth, s.normal, s.f_t) / f_0
    A_b = scalar_anisotropy(fourth, pairs, np.sqrt(np.einsum("ij,ij->i", s.branch, s.branch)))[1]
    sigma = love_stress(s.branch, s.force, s.volume)
    p, q = mean_and_deviator(sigma, axis)
    p_predicted, q_predicted = mean_and_deviator(predicted_stress(Phi, fourth, A_n, A_t, A_b), axis)
    a_c, a_n, a_t, a_b = (magnitude(A, sigma) for A in (contact_anisotropy(Phi), A_n, A_t, A_b))
    return StressForceFabric(a_c, a_n, a_t, a_b, q / p, q_predicted / p_predicted, 0.4 * (a_c + a_n + 1.5 * a_t))


def direction_moments(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fabric tensor (3, 3), mean of n_i n_j n_k n_l as a matrix (9, 9), and n_i n_j of each contact (C, 9)."""
    pairs = (normal[:, :, None] * normal[:, None, :]).reshape(-1, 9)
    return pairs.mean(axis=0).reshape(3, 3), pairs.T @ pairs / len(pairs), pairs


def contact_anisotropy(Phi: np.ndarray) -> np.ndarray:
    """Tensor a_c (3, 3) = 15/2 times the deviator of the fabric tensor Phi (3, 3)."""
    return 7.5 * deviator(Phi)


def scalar_anisotropy(fourth: np.ndarray, pairs: np.ndarray, value: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean over directions and anisotropy tensor (3, 3) of a scalar `value` (C,) on contacts, such as the normal force.

    fourth (9, 9) and pairs (C, 9) as from `direction_moments`.
    """
    fit = (np.linalg.pinv(fourth, rcond=1e-10, hermitian=True) @ (value @ pairs / len(pairs))).reshape(3, 3)
    mean = float(np.trace(fit)) / 3.0
    return mean, deviator(fit) / mean


def tangential_anisotropy(Phi: np.ndarray, fourth: np.ndarray, normal: np.ndarray, f_t: np.ndarray) -> np.ndarray:
    """Tensor f_0 a_t (3, 3) N of the tangential forces f_t (C, 3) N, which follow a_t.n without its normal part."""
    unit = np.eye(3)
    rules = ("ik,jl->ijkl", "il,jk->ijkl", "jk,il->ijkl", "jl,ik->ijkl")
    symmetric = 0.25 * sum(np.einsum(rule, Phi, unit) for rule in rules)
    moment = deviator(f_t.T @ normal / len(normal)).ravel()
    inverse = np.linalg.pinv(symmetric.reshape(9, 9) - fourth, rcond=1e-10, hermitian=True)
    return deviator((inverse @ moment).reshape(3, 3))


def predicted_stress(
    Phi: np.ndarray, fourth: np.ndarray, A_n: np.ndarray, A_t: np.ndarray, A_b: np.ndarray
) -> np.ndarray:
    """Stress (3, 3) in units of N_c f_0 l_0 / V: the product of the four expansions integrated over all directions."""
    n, weight = directions()
    along = {name: np.einsum("ki,ij,kj->k", n, A, n) for name, A in zip("ntb", (A_n, A_t, A_b), strict=True)}
    force = (1.0 + along["n"] - along["t"])[:, None] * n + n @ A_t
    contacts = weight * contact_distribution(Phi, fourth, n) * (1.0 + along["b"])
    return (contacts[:, None] * force).T @ n


def contact_distribution(Phi: np.ndarray, fourth: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """4 pi E (K,) in given directions (K, 3): Legendre expansion of the PDF E of contact normals to fourth order."""
    pairs = (direction[:, :, None] * direction[:, None, :]).reshape(-1, 9)
    second, quartic = pairs @ Phi.ravel(), np.einsum("ki,ij,kj->k", pairs, fourth, pairs)
    return 1.0 + 2.5 * (3.0 * second - 1.0) + 1.125 * (35.0 * quartic - 30.0 * second + 3.0)


def directions(order: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (K, 3) and weights (K,): exact averages over the sphere of polynomials of degree below 2 * order."""
    height, weight = np.polynomial.legendre.leggauss(order)
    angle = np.arange(2 * order) * np.pi / order
    h, a = (x.ravel() for x in np.meshgrid(height, angle, indexing="ij"))
    ring = np.sqrt(1.0 - h**2)
    return np.column_stack([ring * np.cos(a), ring * np.sin(a), h]), np.repeat(weight, 2 * order) / (4.0 * order)


def magnitude(A: np.ndarray, sigma: np.ndarray) -> float:
    """Scalar of an anisotropy tensor A (3, 3): sqrt(3/2 A:A), negative if A opposes the deviator of sigma (3, 3)."""
    return float(np.sign(np.sum(A * deviator(sigma))) * np.sqrt(1.5 * np.sum(A * A)))


def deviator(tensor: np.ndarray) -> np.ndarray:
    """Symmetric, traceless part of a tensor (3, 3)."""
    symmetric = 0.5 * (tensor + tensor.T)
    return symmetric - np.trace(symmetric) / 3.0 * np.eye(3)
