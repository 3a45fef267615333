"""Moving points so that they carry the marginals exactly, and changing probabilities so that moments come out right."""

from __future__ import annotations

import math

import numpy as np
from scipy import optimize, special

from ..inputs.joint import Joint
from ..inputs.marginals import Marginal

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_REACH = 7.5
_LARGEST_RATIO = 2.0
#: Means, variances and covariance of two variables.  With at most as many, more points are always left free than that.
_MOMENTS_OF_TWO = 5


def middles(x: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Probabilities (n, d) of the middles of the strata that points x carry in each coordinate, in the points'
    order."""
    order = np.argsort(x, axis=0, kind="stable")
    u = np.empty_like(x)
    np.put_along_axis(u, order, np.cumsum(probability[order], axis=0) - 0.5 * probability[order], axis=0)
    return u / math.fsum(probability)


def gauss_rearranged(joint: Joint, x: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Points x (n, d) moved, coordinate by coordinate and keeping their order, onto composite two-point quadrature
    rules.

    Neighbours in a coordinate share the probability of both; inside that block they sit at mean -+ sd (weighted by
    their probabilities), so every block, and with it the marginal, keeps its mean and variance: points in the
    *middles* of their strata lose 2-5 % of the standard deviation. A jump of the distribution function is still
    about one probability.
    """
    moved = np.empty_like(x)
    for i, marginal in enumerate(joint.marginals):
        order = np.argsort(x[:, i], kind="stable")
        moved[order, i] = _two_point_rule(marginal, probability[order] / math.fsum(probability))
    return moved


def _two_point_rule(marginal: Marginal, w: np.ndarray) -> np.ndarray:
    n = len(w)
    start = np.arange(0, n, 2)
    if n % 2:
        middle = n // 2 - (n // 2) % 2
        start = np.concatenate([np.arange(0, middle + 1, 2), np.arange(middle + 1, n, 2)])
    end = np.append(start[1:], n)
    edges = np.concatenate([[-_REACH], special.ndtri(np.cumsum(w)[end[:-1] - 1]), [_REACH]])
    half, centre = 0.5 * np.diff(edges)[:, None], 0.5 * (edges[1:] + edges[:-1])[:, None]
    z = centre + half * _NODES
    mass = _WEIGHTS * np.exp(-0.5 * z * z)
    mass /= mass.sum(axis=1, keepdims=True)
    value = marginal.ppf(special.ndtr(z))
    mean = (mass * value).sum(axis=1)
    sd = np.sqrt((mass * (value - mean[:, None]) ** 2).sum(axis=1))
    x = np.empty(n)
    x[start] = mean
    pair = end - start == 2
    a, b, mean, sd = start[pair], start[pair] + 1, mean[pair], sd[pair]
    ratio = np.clip(w[b] / w[a], 1.0 / _LARGEST_RATIO, _LARGEST_RATIO)
    todo = np.ones(len(a), dtype=bool)
    for r in (ratio, np.ones_like(ratio)):
        below, above = mean - sd * np.sqrt(r), mean + sd / np.sqrt(r)
        shift = mean - (w[a] * below + w[b] * above) / (w[a] + w[b])
        x[a], x[b] = np.where(todo, below + shift, x[a]), np.where(todo, above + shift, x[b])
        todo = _out_of_order(marginal, x, a, b)
    medians = marginal.ppf(np.cumsum(w) - 0.5 * w)
    x[a], x[b] = np.where(todo, medians[a], x[a]), np.where(todo, medians[b], x[b])
    return np.sort(x)


def _out_of_order(marginal: Marginal, x: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Which pairs (a, b) of neighbours reach past the points beside them or out of the support."""
    padded = np.concatenate([[marginal.ppf(1e-12)], x, [marginal.ppf(1.0 - 1e-12)]])
    return (x[a] <= padded[a]) | (x[b] >= padded[b + 2])


def sheared(joint: Joint, x: np.ndarray, probability: np.ndarray, widest: float = 0.15) -> np.ndarray:
    """The points rearranged after a small shear of their independent normals that makes each correlation exact.

    A shear reorders a few neighbours; the marginals, set by the order alone, keep their moments.
    """
    _, covariance = joint.moments()
    sd = np.sqrt(np.diag(covariance))
    for i in range(1, joint.dimension):
        for j in range(i):
            z = joint.to_normal(x)

            def moved(angle, i=i, j=j, z=z):
                turned = z.copy()
                turned[:, i] = math.cos(angle) * z[:, i] + math.sin(angle) * z[:, j]
                return gauss_rearranged(joint, joint.from_normal(turned), probability)

            def error(angle, i=i, j=j, moved=moved):
                y = moved(angle)
                y = (y - probability @ y) / sd
                return probability @ (y[:, i] * y[:, j]) - covariance[i, j] / (sd[i] * sd[j])

            if error(-widest) * error(widest) < 0.0:
                x = moved(optimize.brentq(error, -widest, widest, xtol=1e-5, maxiter=40))
    return x


def calibrated(joint: Joint, x: np.ndarray, probability: np.ndarray, nodes: int | None = None) -> np.ndarray:
    """Positive weights near `probability` with exact means, variances and covariances, and marginals as right as can
    be.

    Minimises sum (P - P0)^2 / P0 / n + sum over points and marginals of (F_weighted - F)^2 subject to the moments
    (calibration, Deville and Sarndal 1992), by its linear equations; weights that would fall below a twentieth of
    their P0 stay there. Where few points, or points far from the distribution, leave no such weights, moments are
    matched softly: with three or more variables the covariances first, then all. `nodes` as in Joint.moments.
    """
    start = np.maximum(probability, 1e-3 * np.mean(probability))
    start = start / start.sum()
    n, d = x.shape
    mean, covariance = joint.moments(nodes)
    sd = np.sqrt(np.diag(covariance))
    y = (x - mean) / sd
    i, j = np.triu_indices(d)
    moments = np.hstack([y, y[:, i] * y[:, j] - (covariance / np.outer(sd, sd))[i, j]]).T
    before = 0.5 * ((x[:, None] > x[None]).astype(float) + (x[:, None] >= x[None])).transpose(2, 0, 1).reshape(d * n, n)
    hessian = before.T @ before + np.diag(1.0 / start) / n
    slope = before.T @ joint.uniforms(x).T.ravel() + 1.0 / n
    floor = 0.05 * start
    covariances = np.concatenate([np.zeros(d), i != j])
    levels = np.array([1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0])
    softness = [0.0 * covariances, *np.outer(levels, np.ones(len(moments)))]
    if d > 2:
        softness[1:1] = np.outer(levels, covariances)
    for soft in softness:
        weights = _constrained(hessian, slope, moments, soft, floor)
        if weights is not None:
            return weights
    return start


def _constrained(
    hessian: np.ndarray, slope: np.ndarray, moments: np.ndarray, softness: np.ndarray, floor: np.ndarray
) -> np.ndarray | None:
    """Solve the quadratic programme, fixing weights that hit the floor; None if the floor takes more than a third of
    them, or if there are more exact moments (softness 0) than weights can meet.
    """
    n, exact = len(slope), 1 + np.count_nonzero(softness == 0.0)
    if n < exact:
        return None
    fewest = exact if len(moments) > _MOMENTS_OF_TWO else 1 + len(moments)
    weights, fixed = np.empty(n), np.zeros(n, dtype=bool)
    for _ in range(50):
        free = ~fixed
        weights[fixed] = floor[fixed]
        rows = np.vstack([np.ones(n), moments])
        corner = np.diag(np.append(0.0, -softness))
        matrix = np.block([[hessian[np.ix_(free, free)], rows[:, free].T], [rows[:, free], corner]])
        right = slope[free] - hessian[np.ix_(free, fixed)] @ weights[fixed]
        target = np.append(1.0, np.zeros(len(moments))) - rows[:, fixed] @ weights[fixed]
        weights[free] = np.linalg.solve(matrix, np.append(right, target))[: free.sum()]
        low = free & (weights < floor)
        if not low.any():
            return weights
        fixed |= low
        if fixed.sum() > n / 3 or free.sum() - low.sum() <= fewest:
            return None
    return None
