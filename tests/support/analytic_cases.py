"""Cases with known answers, named after what they prove; used by tests and benchmarks alike."""

from __future__ import annotations

import numpy as np
from scipy import optimize, stats
from scipy.special import ndtr, ndtri

MEDIAN = np.array([0.214, 25.7e9])  # medians of the paper's lognormals (Table 1): mu_s, G_p in Pa
SIGMA_LN = np.array([0.469, 0.354])
RHO = -0.738  # Gaussian copula of mu_s and G_p (Table 2)

# Trials of the whole test on spheres, dense start: stress ratio at the peak and the critical state.
TRIAL_MU_S = np.array([0.065, 0.10, 0.15, 0.25, 0.40, 0.65])
TRIAL_PEAK = np.array([0.593, 0.703, 0.819, 0.956, 1.104, 1.311])
TRIAL_CRITICAL = np.array([0.449, 0.523, 0.612, 0.671, 0.739, 0.787])


def oscillator_cdf(x, time: float, amplitude: float = 0.1, low=1.25 * np.pi, high=1.75 * np.pi) -> np.ndarray:
    """CDF of amplitude * cos(omega t) at x, omega uniform on low ... high: the share of phases on which cos <= x.

    The closed form of the standard PDEM test (Li & Chen 2009): omega t runs over low t ... high t.
    """
    angle = np.arccos(np.clip(np.asarray(x, float) / amplitude, -1.0, 1.0))

    def measure(phase):
        """Length of the part of 0 ... phase where cos <= x: between angle and 2 pi - angle of every turn."""
        turns, rest = np.divmod(phase, 2 * np.pi)
        return turns * 2 * (np.pi - angle) + np.clip(rest - angle, 0.0, 2 * (np.pi - angle))

    return (measure(high * time) - measure(low * time)) / ((high - low) * time)


def oscillator_moments(time: float, amplitude: float = 0.1, low=1.25 * np.pi, high=1.75 * np.pi) -> tuple:
    """Mean and standard deviation of amplitude * cos(omega t)."""
    a, b = low * time, high * time
    mean = (np.sin(b) - np.sin(a)) / (b - a)
    square = 0.5 + (np.sin(2 * b) - np.sin(2 * a)) / (4 * (b - a))
    return amplitude * mean, amplitude * np.sqrt(square - mean**2)


def oscillator_paths(n: int, times, amplitude: float = 0.1, low=1.25 * np.pi, high=1.75 * np.pi) -> tuple:
    """Paths (T, n) at the middles of n equal parts of the frequencies, and their probabilities (n,)."""
    omega = low + (high - low) * (np.arange(n) + 0.5) / n
    return amplitude * np.cos(np.outer(times, omega)), np.full(n, 1.0 / n)


def joint_inputs(normals) -> np.ndarray:
    """(mu_s, G_p) (n, 2) with the paper's lognormals and Gaussian copula from independent standard normals (n, 2)."""
    z1, z2 = np.asarray(normals, float).T
    both = np.stack([z1, RHO * z1 + np.sqrt(1 - RHO**2) * z2], axis=1)
    return MEDIAN * np.exp(SIGMA_LN * both)


def sobol_normals(n: int, seed: int, dimensions: int = 2) -> np.ndarray:
    """Scrambled Sobol' points (n, dimensions) as standard normals."""
    sampler = stats.qmc.Sobol(dimensions, scramble=True, seed=seed)
    power = int(np.ceil(np.log2(max(n, 2))))
    return ndtri(np.clip(sampler.random_base2(power)[:n], 1e-12, 1 - 1e-12))


def golden_normals(n: int) -> np.ndarray:
    """A golden-ratio lattice as independent standard normals (n, 2): evenly spread, equal probabilities."""
    index = np.arange(1, n + 1)
    return ndtri(np.stack([(index - 0.5) / n, (index * 0.6180339887498949) % 1.0], axis=1))


def bivariate_normal(x1, x2, rho: float) -> np.ndarray:
    """PDF (X1, X2) of two standard normals of correlation rho."""
    one, two = np.meshgrid(x1, x2, indexing="ij")
    square = (one**2 - 2 * rho * one * two + two**2) / (1 - rho**2)
    return np.exp(-0.5 * square) / (2 * np.pi * np.sqrt(1 - rho**2))


def linear_gaussian_shapley(a: float, b: float, rho: float) -> dict[str, float]:
    """Variance shares of y = a x1 + b x2, standard normals of correlation rho (Owen & Prieur 2017, Eq. 11)."""
    variance = a * a + b * b + 2 * a * b * rho
    first, second = (a + b * rho) ** 2 / variance, (b + a * rho) ** 2 / variance
    return {"first": first, "second": second, "shapley_first": 0.5 * (1 + first - second), "shared": first + second - 1}


def plain_tvd_loop(path, probability, width: float, cells: int) -> tuple[np.ndarray, int]:
    """The textbook scheme: points, outputs and steps in three loops, arrays over all cells of the grid."""
    total, taken = np.zeros((len(path), cells)), 0
    for q in range(path.shape[1]):
        edges = np.clip((np.arange(cells + 1) - path[0, q]) / width, -6, 6)
        p = np.diff(ndtr(edges))
        p /= p.sum()
        total[0] += probability[0, q] * p
        for k in range(1, len(path)):
            move = path[k, q] - path[k - 1, q]
            steps = max(int(np.ceil(abs(move) / 0.9)), 1)
            c = move / steps
            for _ in range(steps):
                _plain_step(p, c)
            taken += steps
            total[k] += probability[k, q] * p
    return total, taken


def _plain_step(p, c: float) -> None:
    """One step in place, flux as in Li & Chen (2009) with minmod."""
    jump = np.diff(p)
    upwind = np.concatenate([[0.0], jump[:-1]]) if c > 0 else np.concatenate([jump[1:], [0.0]])
    with np.errstate(divide="ignore", invalid="ignore"):
        r = np.where(jump != 0, upwind / jump, 0.0)
    phi = np.maximum(0, np.minimum(r, 1))
    flux = 0.5 * c * (p[:-1] + p[1:]) - 0.5 * abs(c) * jump + 0.5 * (abs(c) - c * c) * phi * jump
    p[:-1] -= flux
    p[1:] += flux


def _logistic(log_mu, top, slope, middle):
    return top / (1.0 + np.exp(-slope * (log_mu - middle)))


_CURVES = {
    name: optimize.curve_fit(_logistic, np.log(TRIAL_MU_S), values, p0=(1.0, 1.0, -2.5))[0]
    for name, values in (("peak", TRIAL_PEAK), ("critical", TRIAL_CRITICAL))
}
_LOOSER = {0.001: 1.0, 0.04: 0.5, 0.1: 0.2}  # share of the dense excess of the peak over the critical state


def dem_like_states(inputs, mu_iso: float = 0.001) -> dict[str, np.ndarray]:
    """Smooth peak and critical stress ratio (n,) of (mu_s, G_p) (n, 2): logistic in ln mu_s, through the trials."""
    mu_s, g_p = np.asarray(inputs, float).T
    critical = _logistic(np.log(mu_s), *_CURVES["critical"]) * (1 + 0.005 * np.log(g_p / MEDIAN[1]))
    excess = _logistic(np.log(mu_s), *_CURVES["peak"]) - _logistic(np.log(mu_s), *_CURVES["critical"])
    stiff = 1 + 0.03 * np.log(g_p / MEDIAN[1])
    return {"peak": critical + _LOOSER[mu_iso] * excess * stiff, "critical": critical}


def dem_like_paths(inputs, strain, mu_iso: float = 0.001) -> np.ndarray:
    """Stress ratio (T, n) along strain: rises at a rate set by G_p, passes its peak, ends at the critical state."""
    states = dem_like_states(inputs, mu_iso)
    rise = 0.004 * np.sqrt(MEDIAN[1] / np.asarray(inputs, float)[:, 1])
    strain = np.asarray(strain, float)[:, None]
    return (states["critical"] + (states["peak"] - states["critical"]) * np.exp(-strain / 0.08)) * -np.expm1(
        -strain / rise
    )


def normal_cell_averages(edges, mean: float, std: float) -> np.ndarray:
    """Cell averages (X,) of a normal PDF."""
    return np.diff(ndtr((np.asarray(edges) - mean) / std)) / np.diff(edges)
