"""Probabilities of Voronoi cells under the standard normal distribution: exact up to two dimensions, else sampled."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import spatial, special, stats

_FAR = 60.0


def cell_probabilities(z: np.ndarray) -> np.ndarray:
    """P(nearest point is q) under independent standard normals, for points z (n, 1) or (n, 2): shape (n,), to 1e-14.

    On a line a cell ends half-way to its neighbours.  In the plane each cell is a polygon; its measure is a signed sum
    over its edges of triangles seen from the origin, (theta_2 - theta_1) / 2 pi - T(d, tan theta_2) + T(d, tan theta_1)
    with Owen's T (1956), d the edge's distance and theta measured from its perpendicular.  Coinciding points share
    their cell's probability equally.
    """
    z = np.asarray(z, dtype=float)
    unique, inverse, counts = np.unique(z, axis=0, return_inverse=True, return_counts=True)
    inverse = np.ravel(inverse)
    if z.shape[1] == 1:
        edges = special.ndtr(np.concatenate([[-np.inf], 0.5 * (unique[1:, 0] + unique[:-1, 0]), [np.inf]]))
        return (np.diff(edges) / counts)[inverse]
    guards = _FAR * np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]], dtype=float)
    diagram = spatial.Voronoi(np.vstack([unique, guards]))
    owner, start, end = [], [], []
    for q in range(len(unique)):
        corners = diagram.vertices[diagram.regions[diagram.point_region[q]]]
        angle = np.arctan2(*(corners - unique[q]).T[::-1])
        corners = corners[np.argsort(angle)]
        owner.append(np.full(len(corners), q))
        start.append(corners)
        end.append(np.roll(corners, -1, axis=0))
    measure = _wedge(np.vstack(start), np.vstack(end))
    cells = np.bincount(np.concatenate(owner), measure, len(unique))
    return (cells / counts)[inverse]


def sampled_cell_probabilities(z: np.ndarray, samples: int = 2**20, seed: int = 1) -> np.ndarray:
    """The same in any dimension, points z (n, d), from scrambled Sobol' samples and a k-d tree; error about 1e-4."""
    z = np.asarray(z, dtype=float)
    return nearest_shares(z, _normals(z.shape[1], samples, seed))


@lru_cache(maxsize=4)
def _normals(d: int, samples: int, seed: int) -> np.ndarray:
    """Standard normals (samples, d) of scrambled Sobol' points."""
    uniform = stats.qmc.Sobol(d, seed=seed).random_base2(int(np.log2(samples)))
    return special.ndtri(np.clip(uniform, 2.0**-32, 1.0 - 2.0**-32))


def nearest_shares(z: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """The share of samples (m, d) nearest to each point z (n, d): shape (n,)."""
    nearest = spatial.cKDTree(z).query(samples)[1]
    return np.bincount(nearest, minlength=len(z)) / len(samples)


def _wedge(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Signed standard normal measure of the triangles (origin, a, b), rows of two (m, 2) arrays."""
    edge = b - a
    length = np.hypot(*edge.T)
    along = edge / np.maximum(length, 1e-300)[:, None]
    distance = a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0]
    first, second = (a * along).sum(axis=1), (b * along).sum(axis=1)
    d = np.abs(distance)
    safe = np.maximum(d, 1e-300)
    angle = (np.arctan2(second, d) - np.arctan2(first, d)) / (2.0 * np.pi)
    value = angle - special.owens_t(d, second / safe) + special.owens_t(d, first / safe)
    return np.where((d > 1e-12) & (length > 0.0), np.sign(distance) * value, 0.0)
