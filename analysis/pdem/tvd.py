"""Transport of many narrow PDFs on one grid: Lax-Wendroff scheme with a flux limiter, all points at once.

The PDF of each point is kept in a window of a few dozen cells that moves with the point, so that no time is spent on
the empty rest of the grid.  Every point makes its own steps, independent of the steps of the others.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

COURANT = 0.9
_DRIFT = 6  # cells: distance of a point from the middle of its window at which the window is centred again
_SPILL = 1e-11  # probability near the end of a window at which the window is widened
_BATCH = 512  # windows collected before they are added to the result
_NOTHING = 1e-40  # probabilities below this become zero, because arithmetic with denormal numbers is slow


def transport(
    path: np.ndarray, probability: np.ndarray, start: float, cells: int, limiter: str = "minmod"
) -> tuple[np.ndarray, np.ndarray]:
    """Move one PDF per point along its path and add them up at every output.

    path (T, Q) positions in *cells* from the left edge of cell 0, finite; probability (T, Q), each row with the sum 1;
    start: width of the initial kernels in cells; limiter minmod, vanleer or superbee.  minmod adds the most width,
    and the PDF of few points then has the smallest error, unless it has a plateau (`tests/benchmarks/bench_tails.py`).
    Per output interval a point takes n = ceil(|move| / 0.9) steps of Courant number c = move / n, so that it arrives
    exactly.  The flux out of cell j is |c| p_j +- (|c| - c^2)/2 phi(r) (p_{j+1} - p_j), as in Li & Chen (2009), with
    the symmetric limiter phi.  Returns p (T, cells), whose rows sum to 1, and the weighted mean variance (T,) in
    cells^2 of the PDFs of the single points.  Raises ValueError for an unknown limiter.
    """
    if limiter not in LIMITERS:
        raise ValueError(f"limiter {limiter!r} is not one of {', '.join(LIMITERS)}")
    move = np.diff(path, axis=0)
    steps = np.maximum(np.ceil(np.abs(move) / COURANT), 1).astype(np.int32)
    order = np.argsort(-steps.sum(axis=0), kind="stable")
    result = _Result(np.zeros((len(path), cells)), np.zeros(len(path)), probability[:, order])
    _march(path[0, order], (move / steps)[:, order], steps[:, order], start, LIMITERS[limiter], result)
    return result.p, result.variance


def kernel_cells(position: np.ndarray, width: np.ndarray | float, left: np.ndarray, size: int) -> np.ndarray:
    """Gaussian cell averages (size, Q) for positions, widths and left ends (Q,), all in cells; columns sum to 1.

    The kernel is cut at six widths and normalised, which moves 2e-9 of the probability.
    """
    edge = (np.arange(size + 1)[:, None] + (left - position)) / width
    np.clip(edge, -6.0, 6.0, out=edge)
    cdf = ndtr(edge, out=edge)
    mass = cdf[1:] - cdf[:-1]
    return mass / mass.sum(axis=0)


def half_window(width: float) -> int:
    """Cells of half a window: half of a kernel (its width in cells) and the usual numerical diffusion."""
    return int(np.ceil(6 * np.hypot(width, 1.5))) + 1


def _superbee(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    small = np.minimum(one, two)
    small += small
    return np.minimum(small, np.maximum(one, two), out=small)


def _minmod(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    return np.minimum(one, two)


def _vanleer(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    mean = one * two
    mean /= one + two + 1e-300
    mean += mean
    return mean


#: phi(r) * |jump| from the upwind and the local |jump|, of equal sign; all three are symmetric in the two.
LIMITERS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "minmod": _minmod,
    "vanleer": _vanleer,
    "superbee": _superbee,
}


class _Result:
    """Adds the windows of the points to the rows of p (T, cells) and variance (T,), many at a time."""

    def __init__(self, p: np.ndarray, variance: np.ndarray, probability: np.ndarray):
        self.p, self.variance, self.probability = p, variance, probability
        self.waiting: list[tuple[np.ndarray, ...]] = []
        self.size = 0

    def add(self, window: np.ndarray, left: np.ndarray, row: np.ndarray, point: np.ndarray) -> None:
        """Take windows (W, n) whose first cells are left (n,), of these rows and points (n,)."""
        self.waiting.append((window, left, row, point))
        self.size += len(row)
        if self.size >= _BATCH:
            self.flush()

    def flush(self) -> None:
        """Add the waiting windows to p and variance."""
        if not self.size:
            return
        window, left, row, point = (np.concatenate(part, axis=-1) for part in zip(*self.waiting, strict=True))
        self.waiting, self.size = [], 0
        place = np.arange(len(window))
        probability = self.probability[row, point]
        spread = (place**2.0) @ window - (place @ window) ** 2
        self.variance += np.bincount(row, probability * spread, minlength=len(self.p))
        cells = self.p.shape[1]
        first, last = row.min(), row.max() + 1
        index = np.clip(left + place[:, None], 0, cells - 1) + (row - first) * cells
        added = np.bincount(index.ravel(), (window * probability).ravel(), minlength=(last - first) * cells)
        self.p[first:last] += added.reshape(-1, cells)


def _march(
    position: np.ndarray,
    courant: np.ndarray,
    steps: np.ndarray,
    width: float,
    limiter: Callable[[np.ndarray, np.ndarray], np.ndarray],
    result: _Result,
) -> None:
    """All steps of all points; courant, steps (T - 1, Q) with the points in decreasing order of the steps in total."""
    points = np.arange(len(position))
    half = half_window(width) + _DRIFT
    left = np.floor(position).astype(np.int64) - half
    window = kernel_cells(position, width, left, 2 * half + 1)
    result.add(window.copy(), left, np.zeros_like(points), points)
    if not len(steps):
        result.flush()
        return
    interval = np.zeros_like(points)
    drift = position - left - half - 0.5
    todo, c = steps[0].copy(), courant[0].copy()
    active = len(points)
    while active:
        _step(window, c, limiter)
        drift += c
        todo -= 1
        done = np.flatnonzero(todo == 0)
        if len(done):
            interval[done] += 1
            result.add(window[:, done], left[done], interval[done], done)
            finished = done[interval[done] == len(steps)]
            done = done[interval[done] < len(steps)]
            todo[done], c[done] = steps[interval[done], done], courant[interval[done], done]
            todo[finished], c[finished] = -1, 0.0
            active -= len(finished)
            if active < 0.8 * len(c):
                window, left, drift, todo, c, interval = (
                    np.ascontiguousarray(a[..., :active]) for a in (window, left, drift, todo, c, interval)
                )
        if np.abs(drift).max(initial=0.0) > _DRIFT - 1:
            window, left, drift = _centred(window, left, drift)
            if max(window[:2].max(), window[-2:].max()) > _SPILL:
                result.flush()
                grow = len(window) // 4
                window, left = np.pad(window, ((grow, grow), (0, 0))), left - grow
    result.flush()


def _centred(window: np.ndarray, left: np.ndarray, drift: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Windows moved by whole cells to their points; probability beyond an end goes into the last cell but one there."""
    shift = np.rint(drift).astype(np.int64)
    size, points = window.shape
    room = int(np.abs(shift).max())
    padded = np.zeros((size + 2 * room, points))
    padded[room : room + size] = window
    moved = padded.ravel()[((np.arange(size) + room) * points)[:, None] + (shift * points + np.arange(points))]
    moved[moved < _NOTHING] = 0.0
    beyond = np.maximum(window.sum(axis=0) - moved.sum(axis=0), 0.0)
    moved[1] += np.where(shift > 0, beyond, 0.0)
    moved[-2] += np.where(shift < 0, beyond, 0.0)
    return moved, left + shift, drift - shift


def _step(p: np.ndarray, c: np.ndarray, limiter: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
    """One step, in place, of the windows p (W, n) with Courant numbers c (n,); no flux leaves the two end cells."""
    speed = np.abs(c)
    jump = p[1:] - p[:-1]
    size = np.abs(jump)
    flow = limiter(size[:-1], size[1:])
    size += _NOTHING
    jump /= size
    flow *= jump[:-1] + jump[1:]
    flow *= 0.25 * np.sign(c) * (1.0 - speed)
    flow += p[1:-1]
    flow *= speed
    flow[[0, -1]] = 0.0
    p[1:-1] -= flow
    up = flow * (c > 0.0).astype(float)
    p[2:] += up
    flow -= up
    p[:-2] += flow
