"""Probability density evolution: the PDF of a response along strain from its values at the representative points.

Generalised density evolution equation (Li & Chen 2009), one equation per point q:
dp_q/d eps + h'_q dp_q/dx = 0, p_q(x, 0) = P_q delta(x - h_q(0)); p = sum of p_q.  h'_q does not depend on x, so the
exact solution is a translation; the TVD scheme solves the same equation on a mesh.  Moments, quantiles and exceedance
probabilities come from the points directly (sum of P_q h_q^k, see `weighted` and `tails`); the PDF is for showing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from . import tvd
from .pdf import PDF, PdemError
from .weighted import moments, normalised
from .widths import kernel_width, point_spacing

_SHARP = 1.1  # cells: width of the part of a kernel that is sampled at its point; the rest follows by convolution
#: Kernel widths kept free between the outermost points and the ends of the grid, both sides together: a normal kernel
#: cut at six widths loses 2e-9 of its probability.
_MARGIN = 12
_NARROWEST = 0.6  # cells: a narrower kernel is not resolved by cell averages
#: Points with one and the same value, to `_SAME` of the range, are an atom if they are at least so many and have at
#: least so much probability.
_ATOM_POINTS, _ATOM, _SAME = 3, 0.05, 1e-9


def evolve(
    h: ArrayLike,
    probability: ArrayLike,
    strain: ArrayLike,
    method: str = "exact",
    bandwidth: ArrayLike | None = None,
    cells: int = 400,
    limiter: str = "minmod",
    rule: str | None = None,
    max_lost: float = 0.5,
    keep_spread: bool | None = None,
) -> PDF:
    """PDF of a response along strain from its values at representative points.

    The generalised density evolution equation of Li & Chen (2009), solved for every point.

    Parameters
    ----------
    h : array (T, Q)
        Values at T strains and Q points, in the unit of the response.  Where a value is not finite, the probability of
        its point is lost at that strain, and the other probabilities are normalised.
    probability : array (Q,)
        Probabilities of the points, with the sum 1.
    strain : array (T,)
        Axial strain, increasing.
    method : {"exact", "tvd"}
        Translated kernels as cell averages, or the flux-limited Lax-Wendroff scheme.
    bandwidth : float or array (T,), optional
        Standard deviation of the kernel ("tvd": a single number), by default from the data by `rule`.  A kernel is
        never narrower than 0.6 cells.
    cells : int
        Number of equal cells of the grid, which the data define; at least 64.
    limiter : {"minmod", "vanleer", "superbee"}
        Limiter of the method "tvd".
    rule : {"quarter", "silverman", "spacing", "mesh"}, optional
        See `widths.kernel_width`.  By default "quarter" for "exact", and "mesh" for "tvd", which with another rule uses
        the median over the strains.  With "quarter", points that share one value (a plateau of the response) get the
        narrowest kernel, and the others determine the width.
    max_lost : float
        Largest probability that may be lost at a strain.
    keep_spread : bool, optional
        Move the points towards their neighbours before the kernels widen them (`sharpened`), so that the PDF keeps the
        standard deviation of the points nearly.  Only with "exact", where it is the default.

    Returns
    -------
    PDF
        Cell averages p (T, cells), with the mean and the standard deviation of the points and the points themselves.

    Raises
    ------
    PdemError
        For arrays that do not match, probabilities without the sum 1, an unknown option or too much lost probability.

    Examples
    --------
    >>> strain = [0.0, 0.1, 0.2]
    >>> h = [[0.0, 0.0, 0.0], [0.7, 0.8, 0.9], [0.5, 0.6, 0.7]]
    >>> pdf = evolve(h, [0.25, 0.5, 0.25], strain)
    >>> pdf.p.shape
    (3, 400)
    >>> pdf.mean.round(3).tolist()
    [0.0, 0.8, 0.6]
    """
    h, probability, strain = _checked(h, probability, strain, cells, max_lost)
    probability, lost = _known_probability(h, probability, strain, max_lost)
    if method not in ("exact", "tvd"):
        raise PdemError(f"method {method!r} is not one of exact, tvd")
    if keep_spread and method == "tvd":
        raise PdemError("keep_spread needs the method exact")
    own_width = method == "exact" and bandwidth is None and rule in (None, "quarter")
    atom = _atoms(h, probability) if own_width else np.zeros_like(h, bool)
    spread = _without(probability, atom)
    width = _initial_width(h, spread, bandwidth, rule, constant=method == "tvd")
    only_atoms = np.all(atom | (probability == 0), axis=1)
    width[only_atoms] = 0.0
    left, dx, width = _grid(h, width, cells)
    mean, std = moments(h, probability)
    path = (_filled(h) - left) / dx
    if method == "exact":
        if keep_spread is not False:
            path = np.where(atom, path, sharpened(path, spread, width / dx, cells))
        mass = translate(path, spread, width / dx, cells)
        if len(rows := np.flatnonzero(atom.any(axis=1) & ~only_atoms)):
            share = np.where(atom, probability, 0.0)[rows]
            peaks = translate(path[rows], normalised(share), np.full(len(rows), _NARROWEST), cells)
            mass[rows] += share.sum(axis=1, keepdims=True) * (peaks - mass[rows])
        added = np.zeros(len(h))
    else:
        mass, variance = tvd.transport(path, probability, width[0] / dx, cells, limiter)
        added = dx * np.sqrt(np.maximum(variance - variance[0], 0.0))
    return PDF(
        strain=strain,
        x=left + dx * (np.arange(cells) + 0.5),
        p=mass / dx,
        mean=mean,
        std=std,
        bandwidth=width,
        method=f"pdem-{method}" + (f"-{limiter}" if method == "tvd" else ""),
        lost_probability=lost,
        numerical_width=added,
        spacing=point_spacing(h, probability),
        values=h,
        probability=probability,
    )


def state_pdf(values: ArrayLike, probability: ArrayLike, strain: float = np.nan, **options: Any) -> PDF:
    """PDF of a quantity with one value per run (at the peak or the critical state, G_0, ...): a PDF with T = 1.

    values (Q,), probability (Q,); options as in `evolve`.  States are functionals of the path and need no evolution
    equation, so the method is always "exact".  Raises PdemError.
    """
    values = np.asarray(values, float)
    if values.ndim != 1:
        raise PdemError(f"state values have the shape {values.shape}, expected one value per point")
    pdf = evolve(values[None, :], probability, np.zeros(1), method="exact", **options)
    return replace(pdf, strain=np.array([strain]))


def sharpened(path: np.ndarray, probability: np.ndarray, width: np.ndarray, cells: int) -> np.ndarray:
    """Points (T, Q) moved by width^2/2 times the slope of ln p, where p is their PDF with kernels of this width.

    Lengths are in cells.  Kernels around the moved points have a bias of the order of width^4 in place of width^2 (Choi
    and Hall 1999).  The mean is kept.  path (T, Q), probability (T, Q) normalised, width (T,) >= 0.5.
    """
    slope = np.gradient(np.log(translate(path, probability, width, cells) + 1e-300), axis=1)
    at = np.clip(path - 0.5, 0.0, cells - 1.0)
    home = np.minimum(at.astype(np.int64), cells - 2)
    one, two = (np.take_along_axis(slope, home + side, axis=1) for side in (0, 1))
    width = width[:, None]
    shift = np.clip(0.5 * width**2 * (one + (at - home) * (two - one)), -width, width)
    return path + shift - np.sum(probability * shift, axis=1, keepdims=True)


def translate(path: np.ndarray, probability: np.ndarray, width: np.ndarray, cells: int) -> np.ndarray:
    """Probability of each cell (T, cells) from Gaussian kernels at path (T, Q), all lengths in cells; rows sum to 1.

    probability (T, Q), width (T,) >= 0.5.  A Gaussian is the convolution of two narrower ones: one of 1.1 cells is
    sampled at its point; the other one and the average over a cell follow by Fourier transform.  Kernels narrower than
    2.2 cells use finer cells.  The error is about 1e-9.
    """
    mass = np.empty((len(path), cells))
    finer = np.ceil(2 * _SHARP / width).astype(int)
    for n in np.unique(finer):
        rows = np.flatnonzero(finer == n)
        sharp = _spread(n * path[rows], probability[rows], n * cells)
        size = fft.next_fast_len(n * cells + 16, real=True)
        wave = fft.rfftfreq(size) * 2 * np.pi
        rest = np.exp(-0.5 * wave**2 * ((n * width[rows, None]) ** 2 - _SHARP**2)) * np.sinc(wave / (2 * np.pi))
        smooth = fft.irfft(fft.rfft(sharp, size, axis=1) * rest, size, axis=1)[:, : n * cells]
        mass[rows] = np.maximum(smooth, 0.0).reshape(len(rows), cells, n).sum(axis=2)
    return mass / mass.sum(axis=1, keepdims=True)


def _atoms(h: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """True (T, Q) for points whose value is that of several others which together have a notable probability."""
    known = np.where(probability > 0, h, np.inf)
    order = np.argsort(known, axis=1)
    ranked = np.take_along_axis(known, order, axis=1)
    span = np.nanmax(np.where(probability > 0, h, np.nan), axis=1) - ranked[:, 0]
    with np.errstate(invalid="ignore"):
        step = ~(np.diff(ranked, axis=1) <= _SAME * span[:, None])
    group = np.cumsum(np.concatenate([np.ones((len(h), 1), bool), step], axis=1), axis=1)
    group += (h.shape[1] + 1) * np.arange(len(h))[:, None]
    weight = np.take_along_axis(probability, order, axis=1)
    share = np.bincount(group.ravel(), weight.ravel())[group]
    count = np.bincount(group.ravel(), (weight > 0).ravel())[group]
    atom = np.empty_like(step, shape=h.shape)
    np.put_along_axis(atom, order, (share >= _ATOM) & (count >= _ATOM_POINTS) & (weight > 0), axis=1)
    return atom


def _without(probability: np.ndarray, atom: np.ndarray) -> np.ndarray:
    """Probabilities (T, Q) normalised over the points outside atoms, or as they are where there is no such point."""
    rest = np.where(atom, 0.0, probability)
    return normalised(np.where(rest.sum(axis=1, keepdims=True) > 0, rest, probability))


def _spread(path: np.ndarray, probability: np.ndarray, cells: int) -> np.ndarray:
    """Gaussians of width _SHARP at their points (rows, Q), sampled at the centres of the cells within seven of them."""
    rows, points = path.shape
    home = np.floor(path).astype(np.int64)
    off = ((home + 0.5 - path) / _SHARP).ravel()
    start = (home + cells * np.arange(rows)[:, None]).ravel()
    probability = probability.ravel()
    total = np.zeros(rows * cells)
    for step in range(-7, 8):
        value = np.exp(-0.5 * (off + step / _SHARP) ** 2) * probability
        total += np.bincount(np.clip(start + step, 0, len(total) - 1), value, minlength=len(total))
    return total.reshape(rows, cells)


def _checked(
    h: ArrayLike, probability: ArrayLike, strain: ArrayLike, cells: int, max_lost: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
    return h, normalised(probability), strain


def _known_probability(
    h: np.ndarray, probability: np.ndarray, strain: np.ndarray, max_lost: float
) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities (T, Q) normalised over the points that have a value at each strain, and the lost ones (T,)."""
    known = np.isfinite(h)
    lost = np.where(known, 0.0, probability).sum(axis=1)
    worst = int(np.argmax(lost))
    if lost[worst] > max_lost or not np.all(np.where(known, probability, 0.0).sum(axis=1) > 0):
        raise PdemError(
            f"probability {lost[worst]:.3g} of points has no value at strain {strain[worst]:g}, limit {max_lost:g}"
        )
    return normalised(probability, known), lost


def _filled(h: np.ndarray) -> np.ndarray:
    """Values (T, Q) whose gaps take the point's last known value (the first one before that), so that nothing moves."""
    if np.all(np.isfinite(h)):
        return h
    known = np.isfinite(h)
    rows = np.arange(len(h))[:, None]
    last = np.maximum.accumulate(np.where(known, rows, -1), axis=0)
    source = np.where(last >= 0, last, np.argmax(known, axis=0))
    return np.where(known.any(axis=0), np.take_along_axis(h, source, axis=0), np.nanmin(h))


def _initial_width(
    h: np.ndarray, probability: np.ndarray, bandwidth: ArrayLike | None, rule: str | None, constant: bool
) -> np.ndarray:
    """Kernel width (T,) as given, or by the rule; with `constant` one number for all strains."""
    if bandwidth is None:
        width = kernel_width(h, probability, rule or ("mesh" if constant else "quarter"))
        return np.full(len(h), np.median(width)) if constant else width
    width = np.asarray(bandwidth, float)
    if not np.all(np.isfinite(width)) or not np.all(width >= 0) or width.shape not in ((), (len(h),)):
        raise PdemError(f"bandwidth {bandwidth!r} is neither a number >= 0 nor one per strain")
    if constant and width.ndim:
        raise PdemError("the TVD scheme starts from one bandwidth, not one per strain")
    return np.broadcast_to(width, (len(h),)).copy()


def _grid(h: np.ndarray, width: np.ndarray, cells: int) -> tuple[float, float, np.ndarray]:
    """Left edge, cell width and kernel widths (T,), which are at least _NARROWEST cells.

    The cells are wide enough for floating point; half a window of the TVD scheme and at least four cells are free at
    each end.
    """
    low, high = np.nanmin(h), np.nanmax(h)
    scale = max(abs(low), abs(high))
    span = high - low
    if span == 0 and not np.any(width > 0):
        width = np.full(len(h), 1e-3 * scale or 1.0)
    inner = cells - 2 * (tvd.half_window(0.0) + 2)
    dx = max((span + _MARGIN * width.max()) / inner, span / (inner - 8), 1e-8 * scale)
    return 0.5 * (low + high) - 0.5 * cells * dx, dx, np.maximum(width, _NARROWEST * dx)
