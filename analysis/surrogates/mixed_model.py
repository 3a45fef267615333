"""The mixed model y = f(inputs) + packing + own noise, fitted to many rows (strains, responses) at once.

f is a trend plus a Gaussian process, both in the basis of `basis`, so that every draw of f is a vector of coefficients.
The trend has a flat prior;
the trend and the variance of the own noise are integrated out in closed form (restricted likelihood; scaled inverse
chi-square).  The other hyperparameters have a grid: the variance of packings, the growth of the own noise along
friction, the variance of the process and its kernel.  The matrices depend on the grid only, so that one set of them
serves all rows.

With the covariance W = D + lambda_b Z Z' of the runs' noise (D: own noise, with mean 1; Z: packing of each run), the
features of the process less their projection on the trend are diagonalised: each cell of the grid is then diagonal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import stats

from .basis import KERNELS, basis_of, fewest_runs

#: Mean variance at the runs that the process adds to the trend, over that of the own noise.
CURVATURES = np.array([0.0, *np.geomspace(0.01, 1e6, 17)])
#: Edges of B = 1 / (1 + m lambda_b), with m runs per packing (sums of 1 / D) and lambda_b the variance of packings
#: over that of the own noise.  log B is uniform a priori, which gives the mean the interval of Student's t with R - 1
#: degrees of freedom.  B > 1 stands for packings that differ less than the own noise explains: no variance of
#: packings; their means then have the weight B.  The small values are tried only where needed.
SHRINKAGE = 2.0 ** np.array([-6, -5, -4, *np.arange(-3, 2, 0.5), 2, 3])
SMALL_SHRINKAGE = 2.0 ** np.arange(-30, -5, 1.5)
#: Growth of the own noise: its standard deviation is proportional to exp(growth u1); prior weights.
GROWTHS, GROWTH_PRIOR = (-0.6, -0.3, 0.0, 0.3, 0.6), (0.1, 0.2, 0.4, 0.2, 0.1)
#: Weight of cells, over the largest of a row, below which they are left out.
_NEGLIGIBLE = 1e-6


@dataclass(frozen=True)
class Noise:
    """Covariance W of the runs' noise in a part of the grid, and what is left of it beside the trend.

    bounds of B and per_packing (m) give the variance of packings; growth is that of the own noise.  whitened (Q, Q):
    W^-1 less its projection on the trend; trend (p, Q) maps values to scores of the trend.  One kernel for each of
    KERNELS.
    """

    bounds: tuple[float, float]
    per_packing: float
    growth: float
    whitened: np.ndarray
    trend: np.ndarray
    kernels: tuple[Kernel, ...]


@dataclass(frozen=True)
class Kernel:
    """The process beside the trend: cells (J,) of the grid that differ in CURVATURES.

    log_determinant (J,), with the prior; process (k, Q) maps values to orthogonal scores; gain (J, k): what remains of
    them; to_coefficients (p + k, M), from the scores of trend and process.
    """

    log_determinant: np.ndarray
    process: np.ndarray
    gain: np.ndarray
    to_coefficients: np.ndarray


@lru_cache(maxsize=2)
def grid(inputs: bytes, known: bytes, packing: bytes, small: bool) -> tuple[Noise, ...]:
    """The grid for runs at the inputs (Q, d; float), those known (Q; bool), with packing (Q'; int; empty: one).

    The arguments are the bytes of the arrays, so that responses with the same runs share a grid.
    """
    labels = np.frombuffer(packing, int)
    mask = np.frombuffer(known, bool)
    points = np.frombuffer(inputs).reshape(len(mask), -1)
    basis = basis_of(points)
    columns = basis(points[mask])
    count = len(columns)
    varying = basis.high > basis.low
    varies = np.flatnonzero([True, *varying, varying[0] and count >= fewest_runs(points.shape[1])])
    trend, process = columns[:, varies], columns[:, basis.trend :]
    off_trend = np.eye(count) - trend @ np.linalg.pinv(trend)
    features = []
    for kernel, length in KERNELS:
        factor = basis.features(kernel, length)
        size = np.sqrt(np.mean(np.sum((off_trend @ process @ factor) ** 2, axis=1)))
        features.append(factor / max(size, 1e-300))
    members = (labels == np.unique(labels)[:, None]).astype(float).reshape(-1, count)
    edges = SMALL_SHRINKAGE if small else SHRINKAGE
    if not len(members):
        edges = np.array([]) if small else np.array([np.exp(-0.5), np.exp(0.5)])
    parts = []
    for growth, share in zip(GROWTHS, GROWTH_PRIOR, strict=True):
        variance = np.exp(2 * growth * columns[:, 1])
        inverse = variance.mean() / variance
        runs = members @ inverse
        per_packing = runs.mean() if len(runs) else 1.0
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            middle = np.sqrt(low * high)
            left = 1.0 / (1.0 + (1.0 / middle - 1.0) * runs / per_packing) if middle < 1 else np.full(len(runs), middle)
            spread = members * inverse
            white = np.diag(inverse) - spread.T @ (((1.0 - left) / runs)[:, None] * spread)
            information = trend.T @ white @ trend
            root = np.linalg.cholesky(information + 1e-14 * np.trace(information) * np.eye(len(varies)))
            flat = np.linalg.inv(root)
            to_trend = flat @ trend.T @ white
            whitened = white - to_trend.T @ to_trend
            log = np.log(share) + 0.5 * np.log(inverse).sum() + 0.5 * np.log(left).sum()
            log += np.log(np.log(high / low)) - np.log(np.diag(root)).sum()
            kernels = tuple(_kernel(log, process @ f, f, whitened, to_trend, flat, varies, basis) for f in features)
            parts.append(Noise((low, high), per_packing, growth, whitened, to_trend, kernels))
    return tuple(parts)


def _kernel(log, phi, factor, whitened, to_trend, flat, varies, basis):
    """The `Kernel` with the features phi (Q, k) of the process at the runs and factor (knots, k) at the knots."""
    value, vector = np.linalg.eigh(phi.T @ whitened @ phi)
    value = np.maximum(value, 0.0)
    mixed, p = vector.T @ phi.T, len(flat)
    to = np.zeros((p + len(value), basis.size))
    to[:p, varies] = flat
    to[p:, varies] = -(mixed @ to_trend.T) @ flat
    to[p:, basis.trend :] = vector.T @ factor.T
    more = CURVATURES[:, None] * value
    log = log + np.log(_curvature_prior(len(phi))) - 0.5 * np.log1p(more).sum(axis=1)
    return Kernel(log, mixed @ whitened, CURVATURES[:, None] / (1.0 + more), to)


def _curvature_prior(count: int) -> np.ndarray:
    """Prior weights (J,) of CURVATURES: C = 1 / (1 + count lambda / 4) is uniform."""
    edges = np.sqrt(CURVATURES[1:-1] * CURVATURES[2:])
    return -np.diff(1.0 / (1.0 + count / 4 * np.array([0.0, CURVATURES[1] / 3, *edges, np.inf])))


@dataclass(frozen=True)
class Posterior:
    """Distribution of coefficients and noise of rows (T,) that have the same runs (Q,).

    Cells are (g, j), with g a noise and a kernel and j a curvature.  weights (T, G, J) of the cells; squares (T, G, J):
    sums of squares S, with sigma^2 = S / chi^2 of `dof` the mean variance of the own noise; scores: G times (p + k, T);
    loo (T, Q): leave-one-out residuals; heavy (T,): factor by which log sigma is less certain than for normal noise,
    from the kurtosis of the residuals (Bonett 2006) and half a standard error of it.
    """

    noises: list[Noise]
    dof: int
    weights: np.ndarray
    squares: np.ndarray
    scores: list[np.ndarray]
    loo: np.ndarray
    heavy: np.ndarray
    separate: bool

    def cells(self) -> Iterator[tuple[int, Noise, Kernel]]:
        """The groups g of cells with their noise and kernel."""
        pairs = ((noise, kernel) for noise in self.noises for kernel in noise.kernels)
        return ((g, *pair) for g, pair in enumerate(pairs))

    def mean(self) -> np.ndarray:
        """Mean coefficients (T, M)."""
        total = 0.0
        for g, _, kernel in self.cells():
            total = total + (self._gain(self.weights[:, g], g, kernel) * self.scores[g].T) @ kernel.to_coefficients
        return np.asarray(total)

    def draws(
        self, n: int, rng: np.random.Generator, noise_only: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients (n, T, M; empty if only the noise is asked for), and for the noise three arrays (n, T).

        They are the standard deviations of packings (NaN where they are not separated) and of the own noise, the latter
        as root mean square over the runs, and its growth.
        Rows of one draw share their random numbers, so that it varies along strain as smoothly as the values do.
        The variance of packings is drawn within its cell; that of the own noise gets the factor `heavy`.
        """
        below = np.cumsum(self.weights.reshape(len(self.weights), -1), axis=1)
        uniform = (rng.permutation(n) + 0.5) / n
        cells = np.stack([np.searchsorted(row, uniform * row[-1]) for row in below], axis=1)
        chi2 = stats.chi2.ppf((rng.permutation(n) + 0.5) / n, self.dof)[:, None]
        sigma = np.sqrt(np.take_along_axis(self.squares.reshape(len(below), -1).T, cells, axis=0) / chi2)
        which, curvature = np.divmod(cells, len(CURVATURES))
        part = which // len(KERNELS)
        middle = np.median(sigma, axis=0)
        own = middle * (sigma / np.where(middle > 0, middle, 1.0)) ** self.heavy
        low, high = np.array([noise.bounds for noise in self.noises])[part].transpose(2, 0, 1)
        share = low * (high / low) ** rng.random((n, 1))
        per_packing = np.array([noise.per_packing for noise in self.noises])[part]
        packing = own * np.sqrt(np.maximum(1.0 / share - 1.0, 0.0) / per_packing)
        growth = np.array([noise.growth for noise in self.noises])[part]
        normal = rng.normal(size=(n, max(len(score) for score in self.scores)))
        first = self.noises[0].kernels[0]
        coefficients = np.zeros((n, len(below), 0 if noise_only else first.to_coefficients.shape[1]))
        for g, _, kernel in () if noise_only else self.cells():
            i, t = np.nonzero(which == g)
            if len(i):
                gain, score = self._gain(np.eye(len(CURVATURES))[curvature[i, t]], g, kernel), self.scores[g]
                drawn = gain * score.T[t] + np.sqrt(gain) * sigma[i, t][:, None] * normal[i, : len(score)]
                coefficients[i, t] = drawn @ kernel.to_coefficients
        return coefficients, packing if self.separate else packing * np.nan, own, growth

    def _gain(self, weights: np.ndarray, g: int, kernel: Kernel) -> np.ndarray:
        """Gains (..., p + k) of all scores of group g for weights (..., J) of the curvatures."""
        trend = len(self.scores[g]) - len(kernel.process)
        flat = np.repeat(weights.sum(axis=1, keepdims=True), trend, axis=1)
        return np.concatenate([flat, weights @ kernel.gain], axis=1)


def posterior(inputs: np.ndarray, known: np.ndarray, packing: np.ndarray | None, values: np.ndarray) -> Posterior:
    """Posterior of values (T, Q') of the known runs (Q,) at the inputs (Q, d).

    packing (Q',): codes of the packings; None if they cannot be separated from the own noise or the mean.
    """
    codes = np.zeros(0, int) if packing is None else np.asarray(packing, int)
    key = np.ascontiguousarray(inputs).tobytes(), np.ascontiguousarray(known).tobytes(), codes.tobytes()
    rough = values - values.mean(axis=1, keepdims=True)
    noises = list(grid(*key, small=False))
    logs, squares, scores = _fit_cells(noises, values, rough)
    smallest = np.repeat([noise.bounds[0] == SHRINKAGE[0] for noise in noises], len(KERNELS))
    if smallest.any() and _relative(logs)[:, smallest].max() > _NEGLIGIBLE:
        more = list(grid(*key, small=True))
        more_logs, more_squares, more_scores = _fit_cells(more, values, rough)
        noises, scores = noises + more, scores + more_scores
        logs, squares = np.concatenate([logs, more_logs], axis=1), np.concatenate([squares, more_squares], axis=1)
    weights, size = _relative(logs), len(KERNELS)
    kept = [k for k in range(len(noises)) if weights[:, k * size : (k + 1) * size].max() > _NEGLIGIBLE]
    groups = np.ravel([range(k * size, (k + 1) * size) for k in kept])
    noises, scores = [noises[k] for k in kept], [scores[g] for g in groups]
    weights, squares = weights[:, groups], squares[:, groups]
    weights /= weights.sum(axis=(1, 2), keepdims=True)
    count, trend = values.shape[1], len(noises[0].trend)
    residual, leverage = np.zeros_like(values), np.zeros_like(values)
    for k, noise in enumerate(noises):
        share = weights[:, k * size : (k + 1) * size].sum(axis=(1, 2))[:, None]
        residual += share * (rough @ noise.whitened)
        leverage += share * np.diag(noise.whitened)
        for g, kernel in enumerate(noise.kernels, k * size):
            gain = weights[:, g] @ kernel.gain
            residual -= (gain * scores[g][trend:].T) @ kernel.process
            leverage -= gain @ kernel.process**2
    leverage = np.maximum(leverage, 1e-12)
    square = np.maximum(np.mean(residual**2 / leverage, axis=1), 1e-150)
    fourth = np.mean(residual**4 / leverage**2, axis=1) / square**2
    heavy = np.sqrt(np.maximum(fourth + np.sqrt(6 / count) - (count - 3) / count, 2.0) / 2.0)
    return Posterior(noises, count - trend, weights, squares, scores, residual / leverage, heavy, packing is not None)


def _relative(logs: np.ndarray) -> np.ndarray:
    """Weights (T, G, J) over the largest of each row."""
    return np.exp(logs - logs.max(axis=(1, 2), keepdims=True))


def _fit_cells(noises, values, rough):
    """Log likelihoods with priors and sums of squares (T, G, J), and scores, of all cells."""
    dof = values.shape[1] - len(noises[0].trend)
    floor = dof * np.maximum(1e-13 * np.abs(values).max(axis=1), 1e-150) ** 2
    logs, squares, scores = [], [], []
    for noise in noises:
        total = np.einsum("tq,tq->t", rough @ noise.whitened, rough)
        trend = noise.trend @ values.T
        for kernel in noise.kernels:
            score = kernel.process @ rough.T
            squares.append(np.maximum(total - kernel.gain @ score**2, floor).T)
            logs.append(kernel.log_determinant - 0.5 * dof * np.log(squares[-1]))
            scores.append(np.concatenate([trend, score]))
    return np.stack(logs, axis=1), np.stack(squares, axis=1), scores
