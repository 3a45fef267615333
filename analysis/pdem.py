"""Probability density evolution: the PDF of a response along strain from its values at the representative points.

Generalised density evolution equation (Li & Chen 2009), one equation a point q:
dp_q/d eps + h'_q dp_q/dx = 0, p_q(x, 0) = P_q delta(x - h_q(0)); p = sum of p_q.  h'_q does not depend on x, so the exact
solution is a translation; the TVD scheme solves the same equation on a mesh.  Moments and quantiles of the points come
from sum P_q h_q^k directly; the density is for showing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis import tvd
from analysis.density import Density

RULES = ("silverman", "spacing")


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
    rule: str = "silverman",
    max_lost: float = 0.5,
) -> Density:
    """PDF surface of a response along strain from its values at representative points.

    h (T, Q) values in the response's unit, probability (Q,) summing to one, strain (T,) increasing.
    method "exact": translated kernels, cell averages; "tvd": flux-limited Lax-Wendroff (superbee, vanleer, minmod).
    bandwidth: standard deviation of the kernel, a number or (T,) (exact only); by default from the data by `rule`
    (`kernel_width`), one a strain for "exact", their median for "tvd".  A kernel is never narrower than 0.6 cells.
    A value that is not finite makes its point's probability `lost_probability` at that strain; the others are
    renormalised, and above `max_lost` the density is refused.
    Returns a Density on one common grid of `cells` equal cells placed by the data.  Raises PdemError.
    """
    h, probability, strain = _checked(h, probability, strain, cells, max_lost)
    weight, lost = _weights(h, probability, strain, max_lost)
    if method not in ("exact", "tvd"):
        raise PdemError(f"method {method!r} is not one of exact, tvd")
    width = _asked_width(h, weight, bandwidth, rule, constant=method == "tvd")
    lo, dx, width = _grid(h, weight, width, cells)
    path = (_filled(h) - lo) / dx
    if method == "exact":
        mass = translate(path, weight, width / dx, cells)
        added = np.zeros(len(h))
    else:
        mass, variance = tvd.transport(path, weight, width[0] / dx, limiter)(cells)
        added = dx * np.sqrt(np.maximum(variance - variance[0], 0.0))
    mean, std = moments(h, weight)
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
    "spacing": 1.5 times the typical distance between neighbouring points: for smooth responses at regular points,
    whose scatter about the distribution is far below that of random samples.
    """
    if rule not in RULES:
        raise PdemError(f"bandwidth rule {rule!r} is not one of {', '.join(RULES)}")
    if rule == "spacing":
        return 1.5 * point_spacing(h, weight)
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
    weight = np.broadcast_to(weight, np.shape(h))
    found = np.empty((len(h), len(levels)))
    for k, (row, w) in enumerate(zip(h, weight)):
        known = np.flatnonzero(w > 0)
        order = known[np.argsort(row[known])]
        found[k] = np.interp(levels, np.cumsum(w[order]) - 0.5 * w[order], row[order])
    return found


def point_spacing(h, weight) -> np.ndarray:
    """Typical distance (T,) between neighbouring points: the central 90 % of the probability over its share of points."""
    low, high = quantiles(h, weight, [0.05, 0.95]).T
    return (high - low) / (0.9 * np.maximum(np.count_nonzero(weight, axis=1), 1))


def translate(path, weight, width, cells: int) -> np.ndarray:
    """Probability of each cell (T, cells) from Gaussian kernels, all lengths in cells; each row sums to one.

    path (T, Q), weight (T, Q), width (T,).  Kernels are cut at six widths, and only the cells they reach are computed.
    """
    mass = np.empty((len(path), cells))
    for k, (row, w) in enumerate(zip(path, weight)):
        half = int(np.ceil(6 * width[k])) + 1
        left = np.floor(row).astype(np.int64) - half
        kernel = tvd.kernel_cells(row, width[k], left, 2 * half + 1)
        index = np.clip(left + np.arange(2 * half + 1)[:, None], 0, cells - 1)
        mass[k] = np.bincount(index.ravel(), (kernel * w).ravel(), minlength=cells)
    return mass


def _checked(h, probability, strain, cells, max_lost):
    h, probability, strain = (np.array(a, float) for a in (h, probability, strain))
    if h.ndim != 2 or h.shape != (len(strain), len(probability)):
        raise PdemError(f"response has the shape {h.shape}, expected ({len(strain)} strains, {len(probability)} points)")
    if np.any(np.diff(strain) <= 0):
        raise PdemError(f"strain does not increase after entry {int(np.argmax(np.diff(strain) <= 0))}")
    if not np.all(probability >= 0) or abs(probability.sum() - 1) > 1e-9:
        raise PdemError(f"probabilities: least {probability.min():g}, sum {probability.sum():.12g}; expected >= 0 and 1")
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
        width = kernel_width(h, weight, rule)
        return np.full(len(h), np.median(width)) if constant else width
    width = np.asarray(bandwidth, float)
    if not np.all(np.isfinite(width)) or not np.all(width >= 0) or width.shape not in ((), (len(h),)):
        raise PdemError(f"bandwidth {bandwidth!r} is neither a number >= 0 nor one a strain")
    if constant and width.ndim:
        raise PdemError("the TVD scheme starts from one bandwidth, not one a strain")
    return np.broadcast_to(width, (len(h),)).copy()


def _grid(h, weight, width, cells):
    """Left edge, cell width and the kernel widths actually used (at least 0.6 cells, and resolvable in floating point)."""
    low, high = np.nanmin(h), np.nanmax(h)
    scale = max(abs(low), abs(high))
    least = 1e-3 * scale or 1.0
    span = max(high - low, 0.0)
    width = np.maximum(width, 1e-6 * scale if span > 0 or np.any(width > 0) else least)
    reach = 2 * (tvd.half_window(0.0) + 2)
    dx = (span + 12 * width.max()) / (cells - reach)
    if 0.6 * dx > width.min():
        dx = max(dx, span / (cells - reach - 12 * 0.6))
        width = np.maximum(width, 0.6 * dx)
    return 0.5 * (low + high) - 0.5 * cells * dx, dx, width
