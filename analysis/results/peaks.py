"""Peak states of a density, estimated from all its points together.

The largest value of a noisy curve is too large.  Therefore the strain of a peak is taken from curves that are pooled
over the points by a regression over the logarithms of the inputs and smoothed along ln strain, and each run gives its
own smoothed value at that strain.  What is left of the bias is estimated by a parametric bootstrap and subtracted:
noise as it was measured is added to the pooled curves, and the peaks of these are estimated in the same way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..quantities import DRAINED, Loading
from ..runs.peak_critical import admissible, error_of_fit, local_fits, log_smoother
from ..surrogates.basis import fewest_runs

#: Points with a run below which peaks are not pooled; the peak of each single run is kept.
FEWEST = 5
#: Noise of the laptop campaign (tests/benchmarks/bench_peaks.py --noise): strain over which the correlation of a run's
#: own noise, and of the noise that all points of a packing share, falls by the factor e.
OWN_CORRELATION, SHARED_CORRELATION = 0.022, 0.035
#: Standard deviation of the shared noise over that of the own noise: SHARED_RATIO exp(-strain / SHARED_DECAY).
SHARED_RATIO, SHARED_DECAY = 2.0, 0.13
#: Draws of the bootstrap, and their seed.
DRAWS, SEED = 100, 1
#: Strain over which the variance of the noise is averaged.
VARIANCE_WIDTH = 0.03


@dataclass(frozen=True)
class PooledPeaks:
    """Peaks of the Q points of a density: `row` (Q,) of the strain grid, and whether it is `interior` (Q,).

    A maximum at the first or last admissible row is not interior.  `bias` (Q,) is subtracted from the stress ratio of
    the runs at this row; it is NaN for a point without a run.
    """

    row: np.ndarray
    interior: np.ndarray
    bias: np.ndarray


def pool_peaks(strain: np.ndarray, eta: np.ndarray, inputs: np.ndarray, packing: np.ndarray) -> PooledPeaks | None:
    """Peaks of points at the inputs (Q, d) from their stress ratios eta (T, Q) over strain (T,); -eta in extension.

    packing (Q,): that of each point; in the bootstrap, the points of a packing share its noise.  A column of eta that
    is not finite is a point without a run.  None if fewer than FEWEST points have a run.
    """
    known = np.isfinite(eta).all(axis=0)
    if known.sum() < FEWEST:
        return None
    order = np.lexsort(inputs.T)  # the draws of the bootstrap must not depend on the order of the points
    loaded = strain > 0
    x, mask, s = inputs[order], known[order], strain[loaded]
    y = eta[np.ix_(loaded, order)]
    basis = _basis(x, int(mask.sum()))
    regression = np.linalg.pinv(basis[mask])
    fits, half = local_fits(strain)
    local, log_smooth = fits[:, 0][np.ix_(loaded, loaded)], log_smoother(s)
    rows = np.flatnonzero(admissible(strain, half)[loaded])

    peak = _peak_rows(log_smooth @ (y[:, mask] @ regression.T) @ basis.T, rows)
    bias = np.full(len(x), np.nan)
    bias[mask] = _bias(s, y[:, mask], basis[mask], packing[order][mask], rows, local, log_smooth)
    place = np.argsort(order)
    interior = (peak > rows[0]) & (peak < rows[-1])
    return PooledPeaks(np.flatnonzero(loaded)[peak][place], interior[place], bias[place])


def peak_states(
    strain: np.ndarray,
    curves: Mapping[str, np.ndarray],
    peaks: PooledPeaks,
    single: Mapping[str, np.ndarray],
    loading: Loading = DRAINED,
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Peak states (Q,), by symbol, of the points' runs at the pooled peaks, and the standard errors (Q,) of eta.

    curves: eta and the other responses (T, Q) over strain (T,), NaN without a run; each is smoothed as a single run
    is.  single: p and q (Pa) at the runs' own peaks, which give the stress that a drained or constant-p' test holds; an
    undrained one has p' among its curves.  loading: the test; `peaks` are those of its eta times its sign.
    """
    fits, half = local_fits(strain)
    weights, slopes = fits[peaks.row, 0], fits[peaks.row, 1] / half[peaks.row, None]
    states = {symbol: np.einsum("qt,tq->q", weights, values) for symbol, values in curves.items()}
    states["eta"] = states["eta"] - loading.sign * peaks.bias
    states["eps_peak"] = np.where(np.isfinite(states["eta"]), strain[peaks.row], np.nan)
    if "eps_v" in curves:
        d_volume = np.einsum("qt,tq->q", slopes, curves["eps_v"])
        states["D_p"] = -d_volume / (1.0 - loading.sign * d_volume / 3.0)
    if loading.path != "drained":
        states["p"] = states.get("p", single.get("p", np.full(states["eta"].shape, np.nan)))
        states["q"] = states["eta"] * states["p"]
    elif {"p", "q"} <= set(single):
        lateral = single["p"] - single["q"] / 3.0
        states["p"] = lateral / (1.0 - states["eta"] / 3.0)
        states["q"] = states["eta"] * states["p"]
    errors = np.full(states["eta"].shape, np.nan)
    for q in np.flatnonzero(np.isfinite(states["eta"])):
        k = peaks.row[q]
        errors[q] = error_of_fit(strain, curves["eta"][:, q], fits[k], half[k], k)
    return states, errors


def _bias(s, y, basis, packing, rows, local, log_smooth):
    """Bias (K,) of the stress ratio at the pooled peaks of K runs y (T, K), by a parametric bootstrap.

    The truth of the bootstrap are the pooled curves, smoothed twice, because the noise that is left in them makes their
    peaks too sharp.  What noise adds at the peaks of the truth has no bias and is taken out of each draw.
    """
    regression = np.linalg.pinv(basis)
    surface = y @ regression.T @ basis.T
    pooled = log_smooth @ log_smooth @ surface
    of_packing = (packing == np.unique(packing)[:, None]).astype(float)
    ratio = SHARED_RATIO * np.exp(-s / SHARED_DECAY)
    # the residuals contain the own noise, and the noise of the packings as far as the regression does not follow it
    residual = of_packing - of_packing @ regression.T @ basis.T
    freedom = max(y.shape[1] - np.linalg.matrix_rank(basis), 1) + ratio**2 * np.sum(residual**2)
    relative = (y - surface) / np.maximum(np.abs(surface), 1e-9)
    own = np.sqrt(_averaged(s, np.sum(relative**2, axis=1) / freedom))[:, None] * pooled
    shared = own * ratio[:, None]
    own_root, shared_root = (correlation_root(s, length) for length in (OWN_CORRELATION, SHARED_CORRELATION))
    at_truth = local[_peak_rows(pooled, rows)].T
    rng = np.random.default_rng(SEED)
    excess = np.zeros(y.shape[1])
    for _ in range(DRAWS):
        drawn_own, drawn_shared = rng.normal(size=y.shape), rng.normal(size=(len(s), len(of_packing))) @ of_packing
        noise = own * (own_root @ drawn_own) + shared * (shared_root @ drawn_shared)
        drawn = pooled + noise
        peak = _peak_rows(log_smooth @ (drawn @ regression.T) @ basis.T, rows)
        excess += np.sum(local[peak].T * drawn - at_truth * noise, axis=0)
    return excess / DRAWS - pooled[rows].max(axis=0)


def correlation_root(strain: np.ndarray, length: float) -> np.ndarray:
    """Matrix (T, T) that turns independent noise into noise of unit variance with correlation exp(-gap / length)."""
    gap = np.abs(strain[:, None] - strain)
    return np.linalg.cholesky(np.exp(-gap / length) + 1e-10 * np.eye(len(strain)))


def _basis(inputs: np.ndarray, runs: int) -> np.ndarray:
    """Polynomials (Q, M) of the standardised logarithms of the inputs: the fewer, the fewer runs there are.

    1, a and a^2 of the first input always; the others in a line from `fewest_runs` runs on; and a^3 and a b, with the
    second input b, from twice as many on.
    """
    logs = np.log(inputs)
    scale = logs.std(axis=0)
    a, *others = ((logs - logs.mean(axis=0)) / np.where(scale > 1e-9, scale, 1.0)).T
    needed = fewest_runs(inputs.shape[1])
    columns = [np.ones(len(a)), a, a**2]
    if runs >= needed:
        columns += others
    if runs >= 2 * needed:
        columns += [a * b for b in others[:1]] + [a**3]
    return np.column_stack(columns)


def _peak_rows(curves, rows):
    return rows[np.argmax(curves[rows], axis=0)]


def _averaged(s, variance):
    """Means of the variance (T,) over VARIANCE_WIDTH of strain."""
    weight = np.exp(-0.5 * ((s[:, None] - s) / VARIANCE_WIDTH) ** 2)
    return weight @ variance / weight.sum(axis=1)
