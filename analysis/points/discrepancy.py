"""How well weighted points stand for a distribution: GF-discrepancy of the marginals, and errors of the moments."""

from __future__ import annotations

import numpy as np

from ..inputs.joint import Joint


def gf_discrepancy(x: np.ndarray, probability: np.ndarray, joint: Joint) -> np.ndarray:
    """D_i = sup_x |sum_q P_q 1{x_qi <= x} - F_i(x)| of each physical marginal, shape (d,); D_GF is the largest.

    x (n, d), probability (n,).  Both sides of every jump count (Chen, Yang and Li 2016; Chen and Zhang 2013).
    """
    u = joint.uniforms(x)
    return np.array([star_discrepancy(column, probability) for column in u.T])


def star_discrepancy(u: np.ndarray, probability: np.ndarray) -> float:
    """sup |weighted empirical distribution - uniform distribution| of points u (n,) in [0, 1] with their
    probabilities.
    """
    order = np.argsort(u, kind="stable")
    u, total = u[order], np.cumsum(probability[order])
    last = np.append(u[1:] > u[:-1], True)
    first = np.append(True, u[1:] > u[:-1])
    before = (total - probability[order])[first]
    return float(max(np.abs(total[last] - u[last]).max(), np.abs(before - u[first]).max()))


def weighted_moments(x: np.ndarray, probability: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (d,) and covariance matrix (d, d) of points x (n, d) with probabilities (n,).

    `pdem.weighted` has the moments of one quantity for points of which some have no value; sums are taken in another
    order there, so the last bit differs.
    """
    mean = probability @ x
    centred = x - mean
    return mean, (centred * probability[:, None]).T @ centred


def moment_errors(x: np.ndarray, probability: np.ndarray, joint: Joint) -> dict[str, np.ndarray]:
    """Errors of weighted points against the exact joint distribution.

    Returns `mean` and `std` (d,), relative, and `correlation` (d (d-1) / 2,), absolute, of the physical variables.
    """
    exact_mean, exact_cov = joint.moments()
    mean, cov = weighted_moments(x, probability)
    upper = np.triu_indices(len(mean), 1)

    def correlation(matrix):
        sd = np.sqrt(np.diag(matrix))
        return (matrix / np.outer(sd, sd))[upper]

    return {
        "mean": mean / exact_mean - 1.0,
        "std": np.sqrt(np.diag(cov) / np.diag(exact_cov)) - 1.0,
        "correlation": correlation(cov) - correlation(exact_cov),
    }
