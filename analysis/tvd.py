"""Transport of many narrow densities on one grid: Lax-Wendroff with a flux limiter, all points at once.

Each point's density lives in a window of a few dozen cells that moves along with it, so that no time is spent on the
empty rest of the grid.  Every point goes through its own steps without waiting for the others at the outputs.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

COURANT = 0.9
_DRIFT = 6  # cells a point may stray from the middle of its window before that is centred again
_SPILL = 1e-11  # probability near a window's end at which it is made wider
_BATCH = 512  # windows collected before they are added to the result
_NOTHING = 1e-40  # probability set to zero now and then, or the slow arithmetic of denormal numbers sets in


def transport(path, weight, start: float, cells: int, limiter: str = "superbee") -> tuple[np.ndarray, np.ndarray]:
    """Move one density per point along its path and add them up at every output.

    path (T, Q) positions in *cells* from the left edge of cell 0, finite; weight (T, Q), each row summing to one;
    start: width of the initial kernels in cells; limiter superbee, vanleer or minmod.
    Per output interval a point takes n = ceil(|move| / 0.9) steps of the Courant number c = move / n, so it arrives
    exactly and no step is wasted.  Out of cell j flows |c| p_j +- (|c| - c^2)/2 phi(r) (p_{j+1} - p_j), the flux of Li
    & Chen (2009) with the symmetric limiter phi.  Returns p (T, cells), rows summing to one, and the weighted mean
    variance (T,) of the points' own densities in cells^2.
    """
    if limiter not in LIMITERS:
        raise ValueError(f"limiter {limiter!r} is not one of {', '.join(LIMITERS)}")
    move = np.diff(path, axis=0)
    steps = np.maximum(np.ceil(np.abs(move) / COURANT), 1).astype(np.int32)
    order = np.argsort(-steps.sum(axis=0), kind="stable")
    result = _Result(np.zeros((len(path), cells)), np.zeros(len(path)), weight[:, order])
    _march(path[0, order], (move / steps)[:, order], steps[:, order], start, LIMITERS[limiter], result)
    return result.p, result.variance


def kernel_cells(position, width, left, size: int) -> np.ndarray:
    """Gaussian cell averages (size, Q) of the given positions and widths (Q,), all in cells; each column sums to one.

    The kernel is cut at six widths and normalised, which moves 2e-9 of the probability.
    """
    edge = (np.arange(size + 1)[:, None] + (left - position)) / width
    np.clip(edge, -6.0, 6.0, out=edge)
    cdf = ndtr(edge, out=edge)
    mass = cdf[1:] - cdf[:-1]
    return mass / mass.sum(axis=0)


def half_window(width: float) -> int:
    """Cells that hold half of a kernel (its width in cells) and what numerical diffusion usually adds."""
    return int(np.ceil(6 * np.hypot(width, 1.5))) + 1


def _superbee(one, two):
    small = np.minimum(one, two)
    small += small
    return np.minimum(small, np.maximum(one, two), out=small)


def _minmod(one, two):
    return np.minimum(one, two)


def _vanleer(one, two):
    mean = one * two
    mean /= one + two + 1e-300
    mean += mean
    return mean


#: phi(r) * |jump| from the upwind and the local |jump|, of equal sign; all three are symmetric in the two.
LIMITERS = {"superbee": _superbee, "vanleer": _vanleer, "minmod": _minmod}


class _Result:
    """Adds the points' windows to the rows of the result, many at a time."""

    def __init__(self, p, variance, weight):
        self.p, self.variance, self.weight = p, variance, weight
        self.held, self.size = [], 0

    def add(self, window, left, row, point):
        self.held.append((window, left, row, point))
        self.size += len(row)
        if self.size >= _BATCH:
            self.flush()

    def flush(self):
        if not self.size:
            return
        window, left, row, point = (np.concatenate(part, axis=-1) for part in zip(*self.held, strict=True))
        self.held, self.size = [], 0
        place = np.arange(len(window))
        share = self.weight[row, point]
        spread = (place**2.0) @ window - (place @ window) ** 2
        self.variance += np.bincount(row, share * spread, minlength=len(self.p))
        cells = self.p.shape[1]
        first, last = row.min(), row.max() + 1
        index = np.clip(left + place[:, None], 0, cells - 1) + (row - first) * cells
        added = np.bincount(index.ravel(), (window * share).ravel(), minlength=(last - first) * cells)
        self.p[first:last] += added.reshape(-1, cells)


def _march(position, courant, steps, width, limiter, result):
    """All steps of all points; courant, steps (T - 1, Q) with the points in the order of falling numbers of steps."""
    points = np.arange(len(position))
    half = half_window(width) + _DRIFT
    left = np.floor(position).astype(np.int64) - half
    window = kernel_cells(position, width, left, 2 * half + 1)
    result.add(window.copy(), left, np.zeros_like(points), points)
    if not len(steps):
        return result.flush()
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
            over = done[interval[done] == len(steps)]
            done = done[interval[done] < len(steps)]
            todo[done], c[done] = steps[interval[done], done], courant[interval[done], done]
            todo[over], c[over] = -1, 0.0
            active -= len(over)
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
    return result.flush()


def _centred(window, left, drift):
    """Windows moved by whole cells to where their points are; what would fall off an end is put into its last cell."""
    shift = np.rint(drift).astype(np.int64)
    size, points = window.shape
    room = int(np.abs(shift).max())
    padded = np.zeros((size + 2 * room, points))
    padded[room : room + size] = window
    moved = padded.ravel()[((np.arange(size) + room) * points)[:, None] + (shift * points + np.arange(points))]
    moved[moved < _NOTHING] = 0.0
    fallen = np.maximum(window.sum(axis=0) - moved.sum(axis=0), 0.0)
    moved[1] += np.where(shift > 0, fallen, 0.0)
    moved[-2] += np.where(shift < 0, fallen, 0.0)
    return moved, left + shift, drift - shift


def _step(p, c, limiter):
    """One step in place of the windows p (W, n), Courant numbers c (n,); nothing leaves the two end cells."""
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
