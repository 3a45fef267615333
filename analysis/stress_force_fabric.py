"""Where the stress ratio comes from: anisotropy of contacts (a_c), of normal (a_n) and of tangential forces (a_t).

Second-order expansions over directions n (Ouadfel & Rothenburg 2001; Guo & Zhao 2013):
    contacts E(n) = (1 + a_c:nn) / 4 pi,  normal force f_0 (1 + a_n:nn),  tangential force f_0 (a_t.n - (a_t:nn) n),
    branch length l_0 (1 + a_b:nn).
Together they predict the stress tensor, and to first order q / p' = 0.4 (a_c + a_n + 1.5 a_t + a_b).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.micromechanics import Z_AXIS, fabric, love_stress, mean_and_deviator
from analysis.runfile import Snapshot


@dataclass(frozen=True)
class StressForceFabric:
    """Anisotropies (positive where they help to carry q), and the stress ratio they predict.

    `eta` is the measured q / p', `eta_predicted` that of the stress tensor integrated from the four expansions with all
    their products, `eta_linear` is 0.4 (a_c + a_n + 1.5 a_t), which drops the products and the branch's share.
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
    n = s.normal
    f_n = np.einsum("ij,ij->i", s.f_n, n)
    length = np.linalg.norm(s.branch, axis=1)
    A_c = contact_anisotropy(n)
    f_0, A_n = scalar_anisotropy(n, f_n, A_c)
    A_t = tangential_anisotropy(n, s.f_t, A_c, f_0)
    l_0, A_b = scalar_anisotropy(n, length, A_c)
    sigma = love_stress(s.branch, s.force, s.volume)
    p, q = mean_and_deviator(sigma, axis)
    p_predicted, q_predicted = mean_and_deviator(predicted_stress(A_c, A_n, A_t, A_b), axis)
    a_c, a_n, a_t, a_b = (magnitude(A, sigma) for A in (A_c, A_n, A_t, A_b))
    return StressForceFabric(a_c, a_n, a_t, a_b, q / p, q_predicted / p_predicted, 0.4 * (a_c + a_n + 1.5 * a_t))


def contact_anisotropy(normal: np.ndarray) -> np.ndarray:
    """Tensor a_c (3, 3) = 15/2 times the deviator of the fabric tensor of the normals (C, 3)."""
    return 7.5 * deviator(fabric(normal))


def scalar_anisotropy(normal: np.ndarray, value: np.ndarray, A_c: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean over directions and tensor (3, 3) of a scalar on contacts (C,), such as the normal force.

    Each contact weighs 1 / (1 + a_c:nn), so that directions with many contacts do not count more.
    """
    moment = _moment(normal, value[:, None] * normal, A_c)
    mean = float(np.trace(moment))
    return mean, 7.5 * deviator(moment) / mean


def tangential_anisotropy(normal: np.ndarray, f_t: np.ndarray, A_c: np.ndarray, f_0: float) -> np.ndarray:
    """Tensor a_t (3, 3) of the tangential forces (C, 3) N over the mean normal force f_0."""
    return 5.0 * deviator(_moment(normal, f_t, A_c)) / f_0


def predicted_stress(A_c: np.ndarray, A_n: np.ndarray, A_t: np.ndarray, A_b: np.ndarray) -> np.ndarray:
    """Stress (3, 3) over N_c f_0 l_0 / V: the product of the four expansions integrated over all directions."""
    n, weight = directions()
    along = {name: np.einsum("ki,ij,kj->k", n, A, n) for name, A in zip("cntb", (A_c, A_n, A_t, A_b), strict=True)}
    force = (1.0 + along["n"] - along["t"])[:, None] * n + n @ A_t
    density = weight * (1.0 + along["c"]) * (1.0 + along["b"])
    return (density[:, None] * force).T @ n


def directions(order: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (K, 3) and weights (K,) that average polynomials of degree below 2 order exactly over the sphere."""
    height, weight = np.polynomial.legendre.leggauss(order)
    angle = np.arange(2 * order) * np.pi / order
    h, a = (x.ravel() for x in np.meshgrid(height, angle, indexing="ij"))
    ring = np.sqrt(1.0 - h**2)
    return np.column_stack([ring * np.cos(a), ring * np.sin(a), h]), np.repeat(weight, 2 * order) / (4.0 * order)


def magnitude(A: np.ndarray, sigma: np.ndarray) -> float:
    """Scalar of an anisotropy tensor: sqrt(3/2 A:A), negative if it works against the stress deviator."""
    return float(np.sign(np.sum(A * deviator(sigma))) * np.sqrt(1.5 * np.sum(A * A)))


def deviator(tensor: np.ndarray) -> np.ndarray:
    """Symmetric, traceless part of a tensor (3, 3)."""
    symmetric = 0.5 * (tensor + tensor.T)
    return symmetric - np.trace(symmetric) / 3.0 * np.eye(3)


def _moment(normal: np.ndarray, vector: np.ndarray, A_c: np.ndarray) -> np.ndarray:
    """Mean over contacts of vector_i n_j / (1 + a_c:nn)."""
    weight = 1.0 / (1.0 + np.einsum("ci,ci->c", normal @ A_c, normal))
    return (vector * weight[:, None]).T @ normal / len(normal)
