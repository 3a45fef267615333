"""Probability density evolution: the PDF of a response along strain from its values at the representative points.

Generalised density evolution equation (Li & Chen 2009), one equation a point q:
dp_q/d eps + h'_q dp_q/dx = 0, p_q(x, 0) = P_q delta(x - h_q(0)); p = sum of p_q.  h'_q does not depend on x, so the
exact solution is a translation; the TVD scheme solves the same equation on a mesh.  Moments and quantiles of the points
come from sum P_q h_q^k directly; the density is for showing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import fft

from analysis import tvd
from analysis.density import Density

RULES = ("silverman", "spacing", "mesh")
_SHARP = 1.1  # cells: the part of a kernel that is put down at its point


class PdemError(ValueError):
    """A response, its probabilities or a setting that PDEM can't use."""


def evolve(
    h,
    probability,
    strain,
    method: str = "exact",
    bandwidth=None,
    cells: int = 400,
    limiter: str = "superbee",
    rule: str | None = None,
    max_lost: float = 0.5,
    keep_spread: bool = False,
) -> Density:
    """PDF surface of a response along strain from its values at representative points.

    h (T, Q) values in the response's unit, probability (Q,) summing to one, strain (T,) increasing.
    method "exact": translated kernels, cell averages; "tvd": flux-limited Lax-Wendroff (superbee, vanleer, minmod).
    bandwidth: standard deviation of the kernel, a number or (T,) (exact only); by default from the data by `rule`
    (`kernel_width`): "silverman" at each strain for "exact", the mesh itself for "tvd", where another rule gives the
    median over the strains.  A kernel is never narrower than 0.6 cells.
    A value that is not finite makes its point's probability `lost_probability` at that strain; the others are
    renormalised, and above `max_lost` the density is refused.
    keep_spread ("exact" only) draws the points towards their mean by sqrt(1 - b^2/s^2), so that the shown density has
    the points' own standard deviation s in spite of its kernel b (Silverman 1986, section 6.4).
    Returns a Density on one common grid of `cells` equal cells placed by the data.  Raises PdemError.
    """
    h, probability, strain = _checked(h, probability, strain, cells, max_lost)
    weight, lost = _weights(h, probability, strain, max_lost)
    if method not in ("exact", "tvd"):
        raise PdemError(f"method {method!r} is not one of exact, tvd")
    width = _asked_width(h, weight, bandwidth, rule, constant=method == "tvd")
    lo, dx, width = _grid(h, weight, width, cells)
    mean, std = moments(h, weight)
    path = (_filled(h) - lo) / dx
    if keep_spread:
        if method == "tvd":
            raise PdemError("keep_spread needs the method exact")
        path = (mean[:, None] - lo) / dx + shrinkage(width, std)[:, None] * (path - (mean[:, None] - lo) / dx)
    if method == "exact":
        mass = translate(path, weight, width / dx, cells)
        added = np.zeros(len(h))
    else:
        mass, variance = tvd.transport(path, weight, width[0] / dx, cells, limiter)
        added = dx * np.sqrt(np.maximum(variance - variance[0], 0.0))
    return Density(
        strain=strain,
        x=lo + dx * (np.arange(cells) + 0.5),
        p=mass / dx,
        mean=mean,
        std=std,
        bandwidth=width,
        method=f"pdem-{method}" + (f"-{limiter}" if method == "tvd" else ""),
        lost_probability=lost,
        numerical_width=added,
        spacing=point_spacing(h, weight),
    )


def state_density(values, probability, strain: float = np.nan, **options) -> Density:
    """PDF of a quantity known once a run (peak, critical state, G_0 ...): a Density with T = 1.

    values (Q,), probability (Q,); options as in `evolve`.  States are functionals of the path and need no evolution
    equation, so the method is always the translated kernel.
    """
    values = np.asarray(values, float)
    if values.ndim != 1:
        raise PdemError(f"state values have the shape {values.shape}, expected one value a point")
    density = evolve(values[None, :], probability, np.zeros(1), method="exact", **options)
    return replace(density, strain=np.array([strain]))


def kernel_width(h, weight, rule: str = "silverman") -> np.ndarray:
    """Kernel width (T,) for values h (T, Q) with weights (T, Q), from the data.

    "silverman": 0.9 min(std, IQR/1.349) n_eff^(-1/5), n_eff = 1 / sum P^2.
    "mesh": nothing, so that the mesh sets the width.
    "spacing": 1.5 times the typical distance between neighbouring points: for smooth responses at regular points,
    whose scatter about the distribution is far below that of random samples.
    """
    if rule not in RULES:
        raise PdemError(f"bandwidth rule {rule!r} is not one of {', '.join(RULES)}")
    if rule == "spacing":
        return 1.5 * point_spacing(h, weight)
    if rule == "mesh":
        return np.zeros(len(h))
    std = moments(h, weight)[1]
    low, high = quantiles(h, weight, [0.25, 0.75]).T
    scale = np.where(high > low, np.minimum(std, (high - low) / 1.349), std)
    return 0.9 * scale * np.sum(weight**2, axis=1) ** 0.2


def moments(h, weight) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (T,) of the points, sum of P_q h_q^k; weights (T, Q) or (Q,)."""
    weight = np.broadcast_to(weight, np.shape(h))
    known = np.where(weight > 0, h, 0.0)
    mean = np.sum(weight * known, axis=-1)
    return mean, np.sqrt(np.sum(weight * (known - mean[..., None]) ** 2, axis=-1))


def quantiles(h, weight, levels) -> np.ndarray:
    """Weighted quantiles (T, n) of the points: the CDF runs linearly between the middles of the points' steps."""
    h = np.asarray(h, float)
    weight = np.broadcast_to(weight, h.shape)
    order = np.argsort(np.where(weight > 0, h, np.inf), axis=1)
    value, share = np.take_along_axis(h, order, axis=1), np.take_along_axis(weight, order, axis=1)
    middle = np.cumsum(share, axis=1) - 0.5 * share
    last = np.count_nonzero(share, axis=1) - 1
    rows = np.arange(len(h))
    found = np.empty((len(h), len(levels)))
    for k, level in enumerate(levels):
        right = np.minimum(np.count_nonzero((middle < level) & (share > 0), axis=1), last)
        left = np.maximum(right - 1, 0)
        gap = middle[rows, right] - middle[rows, left]
        part = np.clip((level - middle[rows, left]) / np.where(gap > 0, gap, 1.0), 0.0, 1.0)
        found[:, k] = value[rows, left] + part * (value[rows, right] - value[rows, left])
    return found


def shrinkage(width, std) -> np.ndarray:
    """Factor towards the mean that makes points of the scatter `std` under kernels of the width `width` keep it."""
    varying = std > 0
    return np.sqrt(np.maximum(1.0 - np.where(varying, width / np.where(varying, std, 1.0), 0.0) ** 2, 0.0))


def point_spacing(h, weight) -> np.ndarray:
    """Typical distance (T,) between neighbouring points: the central 90 % of the probability over its points."""
    low, high = quantiles(h, weight, [0.05, 0.95]).T
    return (high - low) / (0.9 * np.maximum(np.count_nonzero(weight, axis=1), 1))


def translate(path, weight, width, cells: int) -> np.ndarray:
    """Probability of each cell (T, cells) from Gaussian kernels at path (T, Q), all lengths in cells; rows sum to one.

    weight (T, Q), width (T,) >= 0.5.  A Gaussian is the convolution of two: 1.1 cells of it are put down at the point,
    the rest and the average over a cell follow by Fourier transform, on finer cells where the kernel is narrower than
    2.2; exact to about 1e-9.
    """
    mass = np.empty((len(path), cells))
    finer = np.ceil(2 * _SHARP / width).astype(int)
    for n in np.unique(finer):
        rows = np.flatnonzero(finer == n)
        sharp = _spread(n * path[rows], weight[rows], n * cells)
        size = fft.next_fast_len(n * cells + 16, real=True)
        wave = fft.rfftfreq(size) * 2 * np.pi
        rest = np.exp(-0.5 * wave**2 * ((n * width[rows, None]) ** 2 - _SHARP**2)) * np.sinc(wave / (2 * np.pi))
        smooth = fft.irfft(fft.rfft(sharp, size, axis=1) * rest, size, axis=1)[:, : n * cells]
        mass[rows] = np.maximum(smooth, 0.0).reshape(len(rows), cells, n).sum(axis=2)
    return mass / mass.sum(axis=1, keepdims=True)


def _spread(path, weight, cells):
    """Gaussians of the width _SHARP at their points, sampled at the centres of the cells within seven of them."""
    rows, points = path.shape
    home = np.floor(path).astype(np.int64)
    off = ((home + 0.5 - path) / _SHARP).ravel()
    start = (home + cells * np.arange(rows)[:, None]).ravel()
    weight = weight.ravel()
    total = np.zeros(rows * cells)
    for step in range(-7, 8):
        value = np.exp(-0.5 * (off + step / _SHARP) ** 2) * weight
        total += np.bincount(np.clip(start + step, 0, len(total) - 1), value, minlength=len(total))
    return total.reshape(rows, cells)


def _checked(h, probability, strain, cells, max_lost):
    h, probability, strain = (np.array(a, float) for a in (h, probability, strain))
    if h.ndim != 2 or h.shape != (len(strain), len(probability)):
        expected = f"({len(strain)} strains, {len(probability)} points)"
        raise PdemError(f"response has the shape {h.shape}, expected {expected}")
    if np.any(np.diff(strain) <= 0):
        raise PdemError(f"strain does not increase after entry {int(np.argmax(np.diff(strain) <= 0))}")
    if not np.all(probability >= 0) or abs(probability.sum() - 1) > 1e-9:
        least, total = probability.min(), probability.sum()
        raise PdemError(f"probabilities: least {least:g}, sum {total:.12g}; expected >= 0 and 1")
    if cells < 64:
        raise PdemError(f"cells = {cells} is below 64")
    if not 0 <= max_lost < 1:
        raise PdemError(f"max_lost = {max_lost} is not within 0 ... 1")
    h[~np.isfinite(h)] = np.nan
    return h, probability / probability.sum(), strain


def _weights(h, probability, strain, max_lost):
    known = np.where(np.isfinite(h), probability, 0.0)
    lost = np.where(np.isfinite(h), 0.0, probability).sum(axis=1)
    worst = int(np.argmax(lost))
    if lost[worst] > max_lost or not np.all(known.sum(axis=1) > 0):
        raise PdemError(
            f"probability {lost[worst]:.3g} of points has no value at strain {strain[worst]:g}, limit {max_lost:g}"
        )
    return known / known.sum(axis=1, keepdims=True), lost


def _filled(h):
    """Missing values take the point's last known one (the first known one before that): nothing moves while unseen."""
    if np.all(np.isfinite(h)):
        return h
    known = np.isfinite(h)
    rows = np.arange(len(h))[:, None]
    last = np.maximum.accumulate(np.where(known, rows, -1), axis=0)
    source = np.where(last >= 0, last, np.argmax(known, axis=0))
    filled = np.take_along_axis(h, source, axis=0)
    return np.where(known.any(axis=0), filled, np.nanmin(h))


def _asked_width(h, weight, bandwidth, rule, constant):
    if bandwidth is None:
        width = kernel_width(h, weight, rule or ("mesh" if constant else "silverman"))
        return np.full(len(h), np.median(width)) if constant else width
    width = np.asarray(bandwidth, float)
    if not np.all(np.isfinite(width)) or not np.all(width >= 0) or width.shape not in ((), (len(h),)):
        raise PdemError(f"bandwidth {bandwidth!r} is neither a number >= 0 nor one a strain")
    if constant and width.ndim:
        raise PdemError("the TVD scheme starts from one bandwidth, not one a strain")
    return np.broadcast_to(width, (len(h),)).copy()


def _grid(h, weight, width, cells):
    """Left edge, cell width and the kernel widths used: at least 0.6 cells, and resolvable in floating point."""
    low, high = np.nanmin(h), np.nanmax(h)
    scale = max(abs(low), abs(high))
    span = high - low
    if span == 0 and not np.any(width > 0):
        width = np.full(len(h), 1e-3 * scale or 1.0)
    inner = cells - 2 * (tvd.half_window(0.0) + 2)
    dx = max((span + 12 * width.max()) / inner, span / (inner - 8), 1e-8 * scale)
    return 0.5 * (low + high) - 0.5 * cells * dx, dx, np.maximum(width, 0.6 * dx)
