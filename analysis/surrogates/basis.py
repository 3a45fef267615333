"""Basis of f over d inputs: a trend, and a Gaussian process that is given by its values at knots.

The trend is a plane in the standardised logarithms of the inputs, bent along the first one (friction).  The process
follows curvature, kinks and plateaus as far as the runs show them.  With up to two inputs it is a function of both.
With more it is a sum of functions of one and of two of them: u1 with u2 as before, and each further coordinate alone
and with each of those before it (a functional analysis of variance up to pairs).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import interpolate, linalg

#: Standard deviations (of the logarithms of the inputs) by which the trend is continued beyond the runs.
MARGIN = 1.0
#: Knots along u1, u2 and every further coordinate.
KNOTS = (13, 9, 7)
#: Kernels and correlation lengths in standard deviations.  Smooth (squared exponential) or rough (Matern 3/2, which
#: follows kinks) along the coordinates, alone and in pairs; oblique: rough along the two diagonals of a pair.
KERNELS = (("smooth", 1.5), ("smooth", 4.0), ("rough", 0.7), ("rough", 2.0), ("oblique", 0.7))
#: Eigenvalues of the process, over the largest, below which its features are left out.
_SMALLEST = 1e-7


def fewest_runs(d: int) -> int:
    """Runs below which no error is claimed from a response surface over d inputs, and its trend is not bent."""
    return max(12, 4 * (d + 1))


def fewest_fitted(d: int) -> int:
    """Runs below which no response surface over d inputs is fitted: two more than the plane has coefficients."""
    return max(5, d + 3)


@dataclass(frozen=True)
class Basis:
    """Basis functions of f: 1, the coordinates u, u1^2, and the process's values at the knots of grids over pairs of u.

    u1 is the standardised logarithm of the first input, and each further coordinate the standardised rest of its
    logarithm after the regression on those before it, so that the runs fill the grids although the inputs depend on
    each other: u = (ln x - centre) to_u.  low, high (D,) are the range of u of the runs.  Beyond it the process keeps
    its value at the bound; the plane goes on by MARGIN and is constant from there.  runs (Q,): u1 of the runs.  D is
    the number of inputs, but at least 2: a single input has a second coordinate that does not vary.
    """

    centre: np.ndarray
    to_u: np.ndarray
    low: np.ndarray
    high: np.ndarray
    runs: np.ndarray

    @property
    def knots(self) -> list[np.ndarray]:
        """Knots of u along each coordinate; one where it does not vary."""
        counts = (*KNOTS[:2], *[KNOTS[2]] * (len(self.low) - 2))
        return [np.linspace(a, b, k if b > a else 1) for a, b, k in zip(self.low, self.high, counts, strict=True)]

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """The coordinates of each grid of knots."""
        return [(i, j) for j in range(1, len(self.low)) for i in range(j)]

    @property
    def trend(self) -> int:
        """Number of columns of the trend: 1, u, u1^2."""
        return len(self.low) + 2

    @property
    def size(self) -> int:
        """Number M of basis functions."""
        return self.trend + sum(len(self.knots[i]) * len(self.knots[j]) for i, j in self.pairs)

    def __call__(self, inputs: ArrayLike) -> np.ndarray:
        """Values (n, M) at the inputs (n, d); inputs that are not positive count as very small."""
        u = (_logs(np.maximum(np.asarray(inputs, float), 1e-300)) - self.centre) @ self.to_u
        margin = np.where(self.high > self.low, MARGIN, 0.0)
        within, inside = np.clip(u, self.low - margin, self.high + margin), np.clip(u, self.low, self.high)
        cardinal = [_cardinal(k, v) for k, v in zip(self.knots, inside.T, strict=True)]
        products = [(cardinal[i][:, :, None] * cardinal[j][:, None, :]).reshape(len(u), -1) for i, j in self.pairs]
        return np.column_stack([np.ones(len(u)), within, inside[:, 0] ** 2, *products])

    def growth(self, u1: np.ndarray, growth: np.ndarray) -> np.ndarray:
        """Own noise (T, n) at u1 (n,) over its root mean square over the runs, for growth (T,)."""
        mean_square = np.mean(np.exp(2 * np.outer(growth, self.runs)), axis=1, keepdims=True)
        return np.exp(np.outer(growth, u1)) / np.sqrt(mean_square)

    def features(self, kernel: str, length: float) -> np.ndarray:
        """Factor (knots, k) of the covariance of the process at the knots: F F' with the least important left out."""
        return linalg.block_diag(*(self._features(i, j, kernel, length) for i, j in self.pairs))

    def _features(self, i: int, j: int, kernel: str, length: float) -> np.ndarray:
        """The factor of one grid.  Effects of one coordinate alone are in the first grid that has it."""
        first, second = (part.ravel() for part in np.meshgrid(self.knots[i], self.knots[j], indexing="ij"))
        if kernel == "oblique":
            first, second = (first + second) / np.sqrt(2), (first - second) / np.sqrt(2)
        one, two = (_correlation(kernel, np.abs(axis[:, None] - axis) / length) for axis in (first, second))
        if j == 1:
            covariance = one + two if kernel == "oblique" else (1.0 + one) * (1.0 + two)
        else:
            covariance = one + two if kernel == "oblique" else (float(i == 0) + one) * two
        value, vector = np.linalg.eigh(covariance)
        kept = value > _SMALLEST * value.max()
        return vector[:, kept] * np.sqrt(value[kept])


def _correlation(kernel: str, distance: np.ndarray) -> np.ndarray:
    """Correlation at a distance in correlation lengths."""
    if kernel == "smooth":
        return np.exp(-0.5 * distance**2)
    return (1.0 + np.sqrt(3.0) * distance) * np.exp(-np.sqrt(3.0) * distance)


def basis_of(inputs: np.ndarray) -> Basis:
    """The basis for runs at the inputs (Q, d)."""
    logs = _logs(inputs)
    centre = logs.mean(axis=0)
    one, two, *others = (logs - centre).T
    slope = one @ two / (one @ one) if _varies(one, centre[0]) else 0.0
    rests, to_rest = [one, two - slope * one], np.eye(len(centre))
    to_rest[0, 1] = -slope
    for j, other in enumerate(others, 2):
        before = np.column_stack(rests)
        slopes = np.linalg.lstsq(before, other, rcond=1e-9)[0]
        rests.append(other - before @ slopes)
        to_rest[:, j] -= to_rest[:, :j] @ slopes
    varies = np.array([_varies(rest, at) for rest, at in zip(rests, centre, strict=True)])
    scale = np.where(varies, [rest.std() for rest in rests], np.inf)
    to_u = to_rest / scale
    u = (logs - centre) @ to_u
    return Basis(centre, to_u, u.min(axis=0), u.max(axis=0), u[:, 0])


def _logs(inputs: np.ndarray) -> np.ndarray:
    """Logarithms (n, D) of inputs (n, d), with a second column of zeros for a single input."""
    logs = np.log(inputs)
    return logs if logs.shape[1] > 1 else np.column_stack([logs, np.zeros(len(logs))])


def _varies(off: np.ndarray, centre: float) -> bool:
    return bool(off.std() > 1e-9 * max(abs(centre), 1.0))


def _cardinal(knots: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Natural cubic splines (n, k) that are one at one knot and zero at the others."""
    if len(knots) == 1:
        return np.ones((len(z), 1))
    return interpolate.CubicSpline(knots, np.eye(len(knots)), bc_type="natural")(z)
