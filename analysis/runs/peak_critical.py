"""Evaluation of a triaxial record: stress ratio, strains, peak state, critical state with its proof, dilatancy.

Compression is positive and the axis of loading is z.  Records are averages over output windows.  The peak comes from a
smoothed curve and the critical state from averages over blocks, because a single window of a small packing scatters by
a few percent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.special import stdtrit

from ..errors_and_files import GrainScatterError
from ..quantities import CRITICAL_BLOCK, CRITICAL_FROM

#: Correlation strain of the stress ratio at the critical state, and so about the length of a block.
CORRELATION_STRAIN = CRITICAL_BLOCK
#: Largest half-width of a local fit; near the start it is half the strain.  It is wide because the largest of many
#: scattered values is too large: for a flat curve the peak of 1,000 grains is 4 % too high with it, 6 % with 0.02.
SMOOTHING = 0.08
#: Half-width in ln strain over which the mean of many runs is smoothed to find its peak.
LOG_SMOOTHING = 1.75
#: Below this strain a dense packing of rough grains responds elastically, up to a stress ratio that it may not reach
#: again; the peak state belongs to plastic flow.
ELASTIC = 0.01


class TriaxialError(GrainScatterError):
    """A record from which the requested state cannot be computed."""


@dataclass(frozen=True)
class PeakState:
    """The largest smoothed stress ratio eta, its row and strain, its standard error, other smoothed `values` there."""

    index: int
    eps_a: float
    eta: float
    eta_error: float
    values: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class CriticalState:
    """Averages over the last part of a test, from eps_from to eps_to, and the proof that the state is steady.

    mean, error, drift, drift_error and scatter are dicts by symbol.  `error` is the standard error of the mean from
    block averages with `blocks` - 2 degrees of freedom.  `drift` is the fitted change over the part, `drift_error` its
    standard error, widened for the few blocks, `scatter` the standard deviation of the rows about the fitted line;
    these three are relative to the mean.  `reason` states why the state is not steady; it is empty if `steady`.
    """

    eps_from: float
    eps_to: float
    blocks: int
    mean: dict[str, float]
    error: dict[str, float]
    drift: dict[str, float]
    drift_error: dict[str, float]
    scatter: dict[str, float]
    steady: bool
    reason: str


def mean_stress(sigma: np.ndarray) -> np.ndarray:
    """p' = (sigma_1 + 2 sigma_3) / 3 (...,) Pa of stress tensors (..., 3, 3) Pa."""
    return np.trace(sigma, axis1=-2, axis2=-1) / 3.0


def deviator_stress(sigma: np.ndarray) -> np.ndarray:
    """q = sigma_1 - sigma_3 (...,) Pa of stress tensors (..., 3, 3) Pa; sigma_1 along z, sigma_3 the mean across."""
    return sigma[..., 2, 2] - 0.5 * (sigma[..., 0, 0] + sigma[..., 1, 1])


def stress_ratio(sigma: np.ndarray) -> np.ndarray:
    """eta = q / p' (...,) of stress tensors (..., 3, 3) Pa."""
    return deviator_stress(sigma) / mean_stress(sigma)


def principal_stress_ratio(sigma: np.ndarray, sign: float = 1.0) -> np.ndarray:
    """eta (...,) from the principal values of stress tensors (..., 3, 3) Pa: (s_1 - (s_2 + s_3) / 2) / p'.

    sign = -1, in extension: (s_3 - (s_1 + s_2) / 2) / p', because the axial stress is the least one.
    """
    values = np.linalg.eigvalsh(sigma)
    axial, others = (2, (0, 1)) if sign > 0 else (0, (1, 2))
    return (values[..., axial] - 0.5 * (values[..., others[0]] + values[..., others[1]])) / mean_stress(sigma)


def off_axis(sigma: np.ndarray, sign: float = 1.0) -> dict[str, float]:
    """How far the axes of stress tensors (T, 3, 3) Pa are from their principal axes.

    `off_diagonal`: mean of the largest off-diagonal stress over sigma_1; `eta_windows`: mean stress ratio of the
    principal stresses, window by window, over that of the axes, minus one; `eta_mean`: the same for the mean tensor.
    sign: that of `principal_stress_ratio`.
    """
    shear = np.abs(sigma[:, [0, 0, 1], [1, 2, 2]]).max(axis=1)
    mean = sigma.mean(axis=0)
    return {
        "off_diagonal": float(np.mean(shear / np.linalg.eigvalsh(sigma)[:, 2])),
        "eta_windows": float(principal_stress_ratio(sigma, sign).mean() / stress_ratio(sigma).mean() - 1.0),
        "eta_mean": float(principal_stress_ratio(mean, sign) / stress_ratio(mean) - 1.0),
    }


def deformation_strain(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Logarithmic strain (3, 3), compression positive, from the cell matrix `start` (columns = vectors) to `end`.

    Hencky strain -ln V with F = V R: independent of rotations of the cell, and exact at large strain.
    """
    F = end @ np.linalg.inv(start)
    stretch, axes = np.linalg.eigh(F @ F.T)
    return -0.5 * (axes * np.log(stretch)) @ axes.T


def peak_state(
    strain: np.ndarray, eta: np.ndarray, width: float = SMOOTHING, others: Mapping[str, np.ndarray] | None = None
) -> PeakState:
    """Largest smoothed stress ratio of a record of strain (T,) and eta (T,), and `others` (T, ...), by symbol, there.

    The curve is smoothed as in `smooth`, with half-width `width` in strain.  The peak is sought beyond the strain
    ELASTIC and where the fit has rows on both sides, because at an end of the record a parabola can lie above every
    row; in a record too short for that it is sought everywhere.  `eta_error` is the standard error of the smoothed
    value from the scatter of the rows, including their correlation.
    Raises TriaxialError for fewer than five rows, strains that do not increase, or values that are not finite.
    """
    strain, eta = check_record(strain, eta)
    fits, half = local_fits(strain, width)
    smoothed = fits[:, 0] @ eta
    k = _largest(smoothed, admissible(strain, half))
    weight = fits[k, 0]
    error = error_of_fit(strain, eta, fits[k], half[k], k)
    values = {name: np.tensordot(weight, np.asarray(y, float), axes=1) for name, y in (others or {}).items()}
    return PeakState(k, float(strain[k]), float(smoothed[k]), error, values)


def peak_row(strain: np.ndarray, eta: np.ndarray) -> tuple[int, int, int]:
    """Row of the peak of a mean stress ratio eta (T,) over strain (T,), first and last row where it is sought.

    The curve is smoothed by `log_smoother`; it is sought where `peak_state` seeks it.  A maximum at one of the two is
    no peak.  Raises TriaxialError as `peak_state` does.
    """
    strain, eta = check_record(strain, eta)
    inside = admissible(strain, local_fits(strain)[1])
    rows = np.flatnonzero(inside)
    loaded = strain > 0
    smoothed = np.full(len(eta), -np.inf)
    smoothed[loaded] = log_smoother(strain[loaded]) @ eta[loaded]
    return _largest(smoothed, inside), int(rows[0]), int(rows[-1])


def critical_state(
    strain: np.ndarray,
    values: Mapping[str, np.ndarray],
    start: float = CRITICAL_FROM,
    block: float = CORRELATION_STRAIN,
    tolerance: Mapping[str, float] | None = None,
) -> CriticalState:
    """Averages of `values` (T,), by symbol, over strains beyond `start`, with the proof that the state is steady.

    The state is steady if the record extends beyond `start` by at least one block of strain `block` and if, for every
    symbol in `tolerance` (relative; by default eta 0.05 and e 0.01), the drift over the part is below the tolerance or
    within two of its standard errors.  The standard error must itself be no larger than the tolerance: a drift that is
    hidden in the scatter proves nothing.  A record that ends earlier gives the averages over its last 40 % and is not
    steady.  Raises TriaxialError as `peak_state` does.
    """
    tolerance = {"eta": 0.05, "e": 0.01} if tolerance is None else tolerance
    strain = check_record(strain, *values.values())[0]
    reason = ""
    if strain[-1] - start < block * (1.0 - 1e-9):
        reason = f"the record ends at eps_a = {strain[-1]:.3g}, less than a block of {block:g} past {start:g}"
        start = 0.6 * strain[-1]
    part = strain > start * (1.0 + 1e-9)
    blocks = max(3, round((strain[-1] - start) / block))
    label = np.minimum(((strain[part] - start) / (strain[-1] - start) * blocks * (1 - 1e-12)).astype(int), blocks - 1)
    out = {name: _steadiness(strain[part], np.asarray(y, float)[part], label, blocks) for name, y in values.items()}
    for name, limit in tolerance.items():
        if not reason and name in out:
            _, _, drift, drift_error, _ = out[name]
            part_text = f"over {start:.3g}-{strain[-1]:.3g}"
            if drift_error > limit:
                reason = f"{name}'s drift {part_text} is known to {drift_error:.1%} only, {limit:.1%} are needed"
            elif abs(drift) > max(limit, 2.0 * drift_error):
                reason = f"{name} drifts by {drift:+.2%} {part_text}, limit {limit:.1%}"
    columns = (dict(zip(out, column, strict=True)) for column in zip(*out.values(), strict=True))
    means, errors, drifts, drift_errors, scatters = columns
    return CriticalState(
        eps_from=float(start),
        eps_to=float(strain[-1]),
        blocks=blocks,
        mean=means,
        error=errors,
        drift=drifts,
        drift_error=drift_errors,
        scatter=scatters,
        steady=not reason,
        reason=reason,
    )


def dilatancy(
    strain: np.ndarray,
    eps_v: np.ndarray,
    p: np.ndarray,
    q: np.ndarray,
    K: float = np.inf,
    G: float = np.inf,
    width: float = SMOOTHING,
    sign: float = 1.0,
) -> np.ndarray:
    """D_p = -d eps_v^p / d eps_q^p (T,) along a test, without the elastic parts dp'/K and dq/(3 G).

    strain (axial) and eps_v (T,); p and q (T,) Pa; K and G Pa, infinite to keep the elastic parts.  sign = -1 in
    extension: strain, which increases, is minus the axial one, and D_p is positive where the sample dilates, too.  The
    slopes come from the same local fits as in `smooth`.  Early rows, where the strain is mostly elastic, are as
    uncertain as the moduli.  Raises TriaxialError as `peak_state` does.
    """
    strain, eps_v, p, q = check_record(strain, eps_v, p, q)
    fits, half = local_fits(strain, width)
    slopes = fits[:, 1] / half[:, None]
    d_volume = slopes @ eps_v
    return -(d_volume - slopes @ p / K) / (1.0 - sign * d_volume / 3.0 - sign * (slopes @ q) / (3.0 * G))


def smooth(strain: np.ndarray, values: np.ndarray, width: float = SMOOTHING) -> np.ndarray:
    """Local quadratic fit (T, ...) of values (T, ...) over strain (T,), tricube weights of half-width `width`.

    The half-width is at most half the strain, because the curve is steep near the start, and always includes at least
    five rows.
    """
    return np.tensordot(local_fits(strain, width)[0][:, 0], np.asarray(values, float), axes=1)


def local_fits(strain: np.ndarray, width: float = SMOOTHING) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (T, 3, T) from values to the local parabola in (strain - strain_t) / half_t, and half_t (T,)."""
    return _fits(strain, np.minimum(width, 0.5 * strain))


def log_smoother(strain: np.ndarray, width: float = LOG_SMOOTHING) -> np.ndarray:
    """Matrix (T, T) that smooths values over strain (T,), all positive: local parabolas in ln strain."""
    return _fits(np.log(strain), np.full(len(strain), width))[0][:, 0]


def _fits(x: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (T, 3, T) of local parabolas over x (T,), tricube weights of half-width half (T,) or five rows."""
    gap = x[None, :] - x[:, None]
    fifth = np.sort(np.abs(gap), axis=1)[:, min(5, len(x) - 1)]
    half = np.maximum(half, fifth * (1.0 + 1e-9))
    x = gap / half[:, None]
    basis = np.stack([np.ones_like(x), x, x**2], axis=1)
    weighted = _tricube(x)[:, None, :] * basis
    return np.linalg.solve(weighted @ np.swapaxes(basis, 1, 2), weighted), half


def admissible(strain: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Rows (T,) where a peak is sought: beyond ELASTIC and with rows on both sides; all rows of a short record."""
    inside = (strain >= ELASTIC * (1.0 - 1e-6)) & (strain + half <= strain[-1] * (1.0 + 1e-6))
    return inside if inside.any() else np.ones(len(strain), bool)


def _largest(smoothed: np.ndarray, admissible: np.ndarray) -> int:
    return int(np.argmax(np.where(admissible, smoothed, -np.inf)))


def _tricube(x: np.ndarray) -> np.ndarray:
    return np.clip(1.0 - np.abs(x) ** 3, 0.0, None) ** 3


def _steadiness(strain: np.ndarray, y: np.ndarray, label: np.ndarray, blocks: int) -> tuple[float, ...]:
    """Mean, its standard error, relative drift, its standard error, relative scatter, from block averages."""
    count = np.bincount(label, minlength=blocks)
    if np.any(count == 0):
        raise TriaxialError(f"a block of the critical part holds no row: {blocks} blocks, {len(y)} rows")
    mean = float(np.mean(y))
    slope, offset = np.polyfit(strain, y, 1)
    residual = y - (slope * strain + offset)
    middle, level = (np.bincount(label, v, blocks) / count for v in (strain, residual))
    spread = np.sqrt(np.sum(level**2) / max(blocks - 2, 1))
    length = strain[-1] - strain[0]
    slope_error = spread / np.sqrt(np.sum((middle - middle.mean()) ** 2))
    # Student's factor for the few degrees of freedom of so few blocks, so that 2 * drift_error covers 95 %.
    factor = stdtrit(max(blocks - 2, 1), 0.975) / 1.96
    scale = abs(mean) if mean else 1.0
    error = float(spread / np.sqrt(blocks))
    return mean, error, slope * length / scale, factor * slope_error * length / scale, float(residual.std()) / scale


def error_of_fit(strain: np.ndarray, y: np.ndarray, fit: np.ndarray, half: float, k: int) -> float:
    """Standard error of the value of a local parabola at row k, from the scatter of the rows about it.

    The rows are correlated as exp(-gap / (CORRELATION_STRAIN / 2)).  The fit follows part of such noise, so the
    residuals are smaller than the noise by a factor that follows from the correlation.
    """
    used = np.abs(strain - strain[k]) < half
    x = (strain[used] - strain[k]) / half
    w, fit = _tricube(x), fit[:, used]
    to_residual = np.eye(len(x)) - np.vander(x, 3, increasing=True) @ fit
    R = np.exp(-np.abs(x[:, None] - x) * half / (0.5 * CORRELATION_STRAIN))
    variance = np.sum(w * (to_residual @ y[used]) ** 2) / np.sum(
        w * np.einsum("ij,jk,ik->i", to_residual, R, to_residual)
    )
    return float(np.sqrt(variance * (fit[0] @ R @ fit[0])))


def check_record(strain: np.ndarray, *values: np.ndarray) -> list[np.ndarray]:
    """Strain and values (T,) as arrays.  Raises TriaxialError as `peak_state` does."""
    arrays = [np.asarray(a, float) for a in (strain, *values)]
    rows = len(arrays[0])
    if rows < 5:
        raise TriaxialError(f"{rows} rows of record are too few for a state, 5 are needed")
    if np.any(np.diff(arrays[0]) <= 0.0):
        k = int(np.argmax(np.diff(arrays[0]) <= 0.0))
        raise TriaxialError(f"strain does not increase after row {k} (eps_a = {arrays[0][k]:.4g})")
    for a in arrays:
        if len(a) != rows or not np.isfinite(a).all():
            raise TriaxialError(f"record of {len(a)} rows against {rows} strains, {np.sum(~np.isfinite(a))} not finite")
    return arrays
