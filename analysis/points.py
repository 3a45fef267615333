"""Representative points: few inputs with probabilities that stand for the whole joint distribution.

Cells are Voronoi cells in the space of independent standard normals (Rosenblatt's map); cells in scaled (mu_s, G_p) would
give other probabilities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special, stats

from analysis.discrepancy import gf_discrepancy
from analysis.joint import Joint
from analysis.voronoi import cell_probabilities, sampled_cell_probabilities

METHODS = ("gf", "gf-published", "sobol", "lhs", "mc")
_SMALLEST = 8
_ROUNDS = 3


class PointsError(ValueError):
    """Representative points cannot be made as asked."""


@dataclass(frozen=True)
class RepresentativePoints:
    """Points x (n, d) in SI units with their probabilities (n,), which are positive and sum to 1.

    `discrepancy` is the GF-discrepancy of each marginal; `method`, `seed` and `nested` say how the points were made.
    """

    x: np.ndarray
    probability: np.ndarray
    method: str
    seed: int
    discrepancy: tuple[float, ...]
    nested: bool = False

    @property
    def n(self) -> int:
        """Number of points."""
        return len(self.x)

    def to_dict(self) -> dict:
        """A JSON-ready dictionary."""
        record = {name: getattr(self, name) for name in ("method", "seed", "nested")}
        arrays = {"x": self.x.tolist(), "probability": self.probability.tolist()}
        return record | arrays | {"discrepancy": list(self.discrepancy)}

    @staticmethod
    def from_dict(data: dict) -> RepresentativePoints:
        """The inverse of to_dict."""
        arrays = {name: np.array(data[name], dtype=float) for name in ("x", "probability")}
        return RepresentativePoints(**{**data, **arrays, "discrepancy": tuple(data["discrepancy"])})


def select_points(
    joint: Joint, n: int, method: str = "gf", seed: int = 1, nested: bool = False
) -> RepresentativePoints:
    """Choose n points with probabilities for a joint distribution; seconds at most, the same for the same seed.

    method: `gf` (Sobol' set, rearranged in the physical marginals with exact Voronoi probabilities, which are then
    changed as little as possible until means, variances and covariances are exact), `gf-published` (Chen, Yang and Li
    2016: rearrangement in the independent space), or `sobol`, `lhs`, `mc` with equal probabilities.
    `nested=True` (gf only): the first n/2 points are those of select_points(joint, n/2, nested=True), and so on.
    Raises PointsError for n < 8 or an unknown method.
    """
    if n < _SMALLEST:
        raise PointsError(f"n = {n} points cannot carry the moments of the inputs; need at least {_SMALLEST}")
    if method not in METHODS:
        raise PointsError(f"unknown method {method!r}; known: {', '.join(METHODS)}")
    if nested and method != "gf":
        raise PointsError(f"nested points are made by the method gf, not by {method}")
    equal = np.full(n, 1.0 / n)
    if method == "gf":
        x, probability = _nested(joint, n, seed) if nested else _rearranged(joint, n, seed)
    elif method == "gf-published":
        x, probability = _published(joint, n, seed)
    else:
        x, probability = joint.inverse_rosenblatt(_uniform(method, n, joint.dimension, seed)), equal
    return _points(joint, x, probability, method, seed, nested)


def reweight(points: RepresentativePoints, joint: Joint, samples: int = 2**14) -> RepresentativePoints:
    """The same points with the probabilities that another joint distribution gives them: no new simulation is needed.

    Cells are those of the points under the new distribution (exact in two dimensions), calibrated as in select_points.
    """
    probability = _calibrated(joint, points.x, _cells(joint.to_normal(points.x), samples))
    return _points(joint, points.x, probability, points.method, points.seed, points.nested)


def _points(joint, x, probability, method, seed, nested) -> RepresentativePoints:
    probability = normalised(probability)
    discrepancy = tuple(float(value) for value in gf_discrepancy(x, probability, joint))
    return RepresentativePoints(x, probability, method, seed, discrepancy, nested)


def normalised(probability: np.ndarray) -> np.ndarray:
    """Positive weights (n,) scaled so that their exact sum is 1 to the last bit or two."""
    p = np.asarray(probability, dtype=float)
    p = p / math.fsum(p)
    p[np.argmax(p)] += 1.0 - math.fsum(p)
    return p


def _rearranged(joint: Joint, n: int, seed: int):
    x = joint.inverse_rosenblatt(_uniform("sobol", n, joint.dimension, seed))
    probability = np.full(n, 1.0 / n)
    x = _rearrange(joint, x, probability)
    for _ in range(_ROUNDS):
        probability = _cells(joint.to_normal(x))
        x = _rearrange(joint, x, probability)
    return x, _calibrated(joint, x, probability)


def _rearrange(joint: Joint, x: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Move every coordinate, keeping its order, to the middle of the probability that its point carries."""
    return joint.from_uniforms(_middles(x, probability))


def _middles(x, probability):
    order = np.argsort(x, axis=0, kind="stable")
    u = np.empty_like(x)
    np.put_along_axis(u, order, np.cumsum(probability[order], axis=0) - 0.5 * probability[order], axis=0)
    return u / math.fsum(probability)


def _published(joint: Joint, n: int, seed: int, rounds: int = 10):
    u = _middles(_uniform("sobol", n, joint.dimension, seed), np.full(n, 1.0 / n))
    best = (np.inf, None, None)
    for _ in range(rounds):
        z = special.ndtri(u)
        probability = normalised(_cells(z))
        x = joint.from_normal(z)
        worst = gf_discrepancy(x, probability, joint).max()
        if worst < best[0]:
            best = (worst, x, probability)
        u = _middles(u, probability)
    return best[1:]


def _nested(joint: Joint, n: int, seed: int):
    sizes = [n]
    while sizes[0] % 2 == 0 and sizes[0] // 2 >= _SMALLEST:
        sizes.insert(0, sizes[0] // 2)
    sequence = joint.uniforms(joint.inverse_rosenblatt(_uniform("sobol", n, joint.dimension, seed)))
    u = np.empty((0, joint.dimension))
    for size in sizes:
        u = _extended(u, sequence[len(u) : size])
    x = joint.from_uniforms(u)
    trials = [_calibrated(joint, x, start) for start in (_cells(joint.to_normal(x)), np.full(n, 1.0 / n))]
    return x, min(trials, key=lambda p: gf_discrepancy(x, p, joint).max())


def _extended(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Add points: each coordinate of a new point goes to the middle of a stratum of probability 1/n that is still empty."""
    n = len(old) + len(new)
    moved = np.empty_like(new)
    for i in range(new.shape[1]):
        empty = np.setdiff1d(np.arange(n), np.floor(old[:, i] * n).astype(int))
        middles = (empty + 0.5) / n
        rows, columns = optimize.linear_sum_assignment((new[:, [i]] - middles) ** 2)
        moved[rows, i] = middles[columns]
    return np.vstack([old, moved])


def _cells(z: np.ndarray, samples: int = 2**18) -> np.ndarray:
    return cell_probabilities(z) if z.shape[1] == 2 else sampled_cell_probabilities(z, samples)


def _calibrated(joint: Joint, x: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """The positive weights nearest to `probability` (Kullback-Leibler) with exact means, variances and covariances.

    Exponential tilting (Deville and Sarndal 1992): P_q exp(lambda . g_q), Newton's method on the convex dual.
    """
    mean, covariance = joint.moments()
    sd = np.sqrt(np.diag(covariance))
    y = (x - mean) / sd
    i, j = np.triu_indices(y.shape[1])
    g = np.hstack([y, y[:, i] * y[:, j] - (covariance / np.outer(sd, sd))[i, j]])
    start = np.maximum(probability, 1e-6 / len(x))
    start = start / start.sum()
    multiplier = np.zeros(g.shape[1])
    for _ in range(100):
        exponent = g @ multiplier
        w = start * np.exp(exponent - exponent.max())
        w = w / w.sum()
        residual = w @ g
        if np.abs(residual).max() < 1e-13:
            break
        hessian = (g * w[:, None]).T @ g - np.outer(residual, residual)
        step = np.linalg.solve(hessian + 1e-10 * np.eye(len(residual)), -residual)
        multiplier = multiplier + min(1.0, 2.0 / np.abs(g @ step).max()) * step
    return w


def _uniform(method: str, n: int, d: int, seed: int) -> np.ndarray:
    """n points of the unit cube (n, d): scrambled Sobol', Latin hypercube or random."""
    if method == "lhs":
        return stats.qmc.LatinHypercube(d, seed=seed).random(n)
    if method == "mc":
        return np.random.default_rng(seed).random((n, d))
    size = int(np.ceil(np.log2(n)))
    return np.clip(stats.qmc.Sobol(d, seed=seed).random_base2(size)[:n], 2.0**-33, 1.0 - 2.0**-33)
