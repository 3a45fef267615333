"""Representative points: few inputs with probabilities that stand for the whole joint distribution.

Cells are Voronoi cells in the space of independent standard normals (Rosenblatt's map); cells in scaled (mu_s, G_p)
would give other probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ..inputs.joint import Joint, bootstrap_joints
from ..inputs.refits import Candidates
from .discrepancy import gf_discrepancy, moment_errors
from .moment_matching import calibrated, gauss_rearranged, middles, sheared
from .representative_points import PointsError, RepresentativePoints
from .unit_cube import fair_order, kernel_discrepancy, uniform_set
from .voronoi import cell_probabilities, sampled_cell_probabilities

METHODS = ("gf", "gf-published", "sobol", "lhs", "mc")
_SMALLEST = 8
_SMALLEST_NESTED = 40
_ROUNDS = 3
#: A point whose conditional probability is below this over n is brought back, so that no run
#: is spent on an improbable point.
_FARTHEST = 0.1


def select_points(
    joint: Joint,
    n: int,
    method: str = "gf",
    seed: int = 1,
    nested: bool = False,
    names: Sequence[str] = (),
    constants: Mapping[str, float] | None = None,
) -> RepresentativePoints:
    """Choose n points with probabilities for a joint distribution.

    Parameters
    ----------
    joint : Joint
        The joint distribution of the inputs, as in `fit_joint(pairs).joint`.
    n : int
        Number of points, at least 8.
    method : {"gf", "gf-published", "sobol", "lhs", "mc"}
        "gf": a rank-one lattice in the independent space (from three variables on the fairest of many sets), then
        rounds of exact Voronoi probabilities (from three variables on sampled ones) and rearrangement in the *physical*
        marginals onto two-point rules that keep means and variances, a small shear for the correlations, and a smallest
        change of the probabilities that makes means, variances and covariances exact.  Few points may not carry them
        all; `moment_errors` and `moment_warnings` of the result then state what differs.  Points come in an order in
        which every beginning is a fair set.  "gf-published": Sobol' points and rearrangement in the independent space
        (Chen, Yang and Li 2016).  "sobol", "lhs", "mc": equal probabilities.
    seed : int
        Seed of the search; the same seed gives the same points.
    nested : bool
        With "gf": the first n/2 points are select_points(joint, n/2, nested=True), and so on down to 40 points.
    names : sequence of str
        Symbols of the d variables (analysis/inputs/variables.py); by default mu_s and G_p for d = 2.
    constants : mapping of str to float
        Values (SI units) of the needed variables that are not random.

    Returns
    -------
    RepresentativePoints
        x (n, d) in SI units, for two variables mu_s and G_p (Pa), probability (n,) of sum 1.  For n = 100 it takes well
        under a second with one or two variables, and a few seconds with three, whose cells are sampled.

    Raises
    ------
    PointsError
        For n < 8 or an unknown method.

    Examples
    --------
    >>> fit = fit_joint(read_pairs("data/pairs_reconstructed.csv"), n_boot=0)
    >>> points = select_points(fit.joint, 20)
    >>> len(points), round(float(points.probability.sum()), 12)
    (20, 1.0)
    >>> round(float(points.probability @ points.mu_s / fit.joint.marginals[0].mean), 6)
    1.0
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
        x, probability = joint.inverse_rosenblatt(uniform_set(method, n, joint.dimension, seed)), equal
    chosen = _points(joint, x, probability, method, seed, nested)
    return replace(chosen, names=tuple(names), constants=constants or {})


def reweight(points: RepresentativePoints, joint: Joint, samples: int = 2**14) -> RepresentativePoints:
    """The same points with the probabilities that another joint distribution gives them: no new simulation is needed.

    Cells are those of the points under the new distribution (exact up to two dimensions), calibrated as in
    select_points.
    """
    new = _points(joint, points.x, reweighted(points.x, joint, samples), points.method, points.seed, points.nested)
    return replace(new, names=points.names, constants=points.constants)


def reweighted(x: np.ndarray, joint: Joint, samples: int = 2**14) -> np.ndarray:
    """Probabilities (n,) that a joint distribution gives to points x (n, d), positive and of sum 1; as in `reweight`.

    Quadrature with 64 nodes a variable: covariances to 1e-7, a sixth of the time.
    """
    return normalised(calibrated(joint, x, _cells(joint.to_normal(x), samples), 64))


def _points(
    joint: Joint, x: np.ndarray, probability: np.ndarray, method: str, seed: int, nested: bool
) -> RepresentativePoints:
    probability = normalised(probability)
    discrepancy = tuple(float(value) for value in gf_discrepancy(x, probability, joint))
    errors = np.concatenate(list(moment_errors(x, probability, joint).values()))
    return RepresentativePoints(
        x, probability, method, seed, discrepancy, nested, moment_errors=tuple(float(error) for error in errors)
    )


def normalised(probability: np.ndarray) -> np.ndarray:
    """Positive weights (n,) scaled so that their exact sum is 1 to the last bit or two."""
    p = np.asarray(probability, dtype=float)
    p = p / math.fsum(p)
    p[np.argmax(p)] += 1.0 - math.fsum(p)
    return p


def _rearranged(joint: Joint, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Lattice, then rounds of Voronoi probabilities and rearrangement in the physical marginals, then the
    correlation.
    """
    start = "lattice" if joint.dimension <= 2 else "fairest"
    x = joint.inverse_rosenblatt(uniform_set(start, n, joint.dimension, seed))
    x = gauss_rearranged(joint, x, np.full(n, 1.0 / n))
    farthest = -special.ndtri(_FARTHEST / n)
    for _ in range(_ROUNDS):
        z = joint.to_normal(x)
        probability = normalised(_cells(z))
        x = gauss_rearranged(joint, joint.from_normal(np.clip(z, -farthest, farthest)), probability)
    x = sheared(joint, x, probability)
    order = fair_order(joint.rosenblatt(x), probability)
    return x[order], calibrated(joint, x, probability)[order]


def _published(joint: Joint, n: int, seed: int, rounds: int = 10) -> tuple[np.ndarray, np.ndarray]:
    u = middles(uniform_set("sobol", n, joint.dimension, seed), np.full(n, 1.0 / n))
    tried = []
    for _ in range(rounds):
        z = special.ndtri(u)
        probability = normalised(_cells(z))
        x = joint.from_normal(z)
        tried.append((gf_discrepancy(x, probability, joint).max(), x, probability))
        u = middles(u, probability)
    return min(tried, key=lambda trial: trial[0])[1:]


def _nested(joint: Joint, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Start from the smallest half of halves with at least 40 points, and double it again and again."""
    sizes = [n]
    while sizes[0] % 2 == 0 and sizes[0] // 2 >= _SMALLEST_NESTED:
        sizes.insert(0, sizes[0] // 2)
    x, probability = _rearranged(joint, sizes[0], seed)
    for _ in sizes[1:]:
        x, probability = _doubled(joint, x, seed)
    return x, probability


def _doubled(joint: Joint, old: np.ndarray, seed: int, trials: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """As many new points again: the shifted lattice that fills the old points' gaps best, moved to the free
    probability.
    """
    n = len(old)
    shifts = np.random.default_rng([seed, n]).integers(0, 2**32, trials)
    w_old = joint.rosenblatt(old)
    lattices = (uniform_set("lattice", n, joint.dimension, int(shift)) for shift in shifts)
    fill = min(lattices, key=lambda w: kernel_discrepancy(np.vstack([w_old, w])))
    x = np.vstack([old, joint.inverse_rosenblatt(fill)])
    probability = np.full(2 * n, 0.5 / n)
    for _ in range(_ROUNDS):
        x[n:] = joint.from_uniforms(middles(x, probability))[n:]
        probability = normalised(_cells(joint.to_normal(x)))
    order = fair_order(joint.rosenblatt(x), probability, first=n)
    return x[order], calibrated(joint, x, probability)[order]


def _cells(z: np.ndarray, samples: int = 2**18) -> np.ndarray:
    if z.shape[1] <= 2:
        return cell_probabilities(z)
    return np.maximum(sampled_cell_probabilities(z, samples), 0.5 / samples)  # without a sample: small, not empty


def bootstrap_probabilities(
    pairs: np.ndarray, joint: Joint, x: ArrayLike, n_boot: int, seed: int = 1, candidates: Candidates | None = None
) -> np.ndarray:
    """Probabilities (n_boot, Q) of the points x (Q, d) under the inputs refitted to resampled pairs (n, d).

    With `candidates` every refit chooses its families again, else they stay those of `joint`; every row is positive and
    sums to 1.  Raises InputError for bad pairs.
    """
    return probabilities_under(bootstrap_joints(pairs, n_boot, np.random.default_rng(seed), joint, candidates), x)


def probabilities_under(joints: Sequence[Joint], x: ArrayLike) -> np.ndarray:
    """Probabilities (B, Q) that each of B joint distributions gives to the points x (Q, d); every row sums to 1."""
    return np.array([reweighted(np.asarray(x, float), joint) for joint in joints])
