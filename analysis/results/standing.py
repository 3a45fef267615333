"""Standing of a state: whether the test reached what is called its peak or its critical state.

A single run cannot prove that its critical state is steady, because its scatter hides such a drift.  The points of a
density together can: the drift is pooled over all of them, and its error includes what they share through their
packing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..pdem import weighted
from ..quantities import CRITICAL_BLOCK, CRITICAL_FROM, DRAINED, Loading

PROVEN, NOT_PROVEN, NOT_REACHED = "proven", "not proven at this size", "not reached"
#: Axial strain from which on critical states are judged, and the strain over which a drift is stated: from it to 40 %.
JUDGED_FROM, DRIFT_STRAIN = CRITICAL_FROM, 0.15
#: Standard errors beyond which a drift is shown: with two, 10 to 19 % of synthetic campaigns in a steady state would be
#: withheld, since eta and e are both judged; with three at most 5 % (tests/benchmarks/bench_standing.py).
SHOWN_AT = 3.0
#: Standard deviation of the drift that all runs of one packing share, over that of a single run's drift: root mean
#: square over eta and e at three densities of the laptop campaign (0.19, 0.49, 0.32 and 0.48, 0, 0.13; 20 packings).
SHARED = 0.3


@dataclass(frozen=True)
class Standing:
    """`status`: PROVEN, NOT_PROVEN or NOT_REACHED; `reason`: one sentence with the numbers behind it."""

    status: str
    reason: str

    @property
    def shown(self) -> bool:
        """Whether values of the state are shown: a state that was not reached is withheld."""
        return self.status != NOT_REACHED


class DensityCurve(NamedTuple):
    """A response of a density along strain: values (T, Q), probability (Q,), extended (T, Q), packing (Q,)."""

    values: np.ndarray
    probability: np.ndarray
    extended: np.ndarray
    packing: np.ndarray


def curves_standing(state: str, strain: np.ndarray, curves: Mapping[str, Any], loading: Loading = DRAINED) -> Standing:
    """Standing of "peak" or "critical" from the curves of a density along strain (T,).

    curves: symbol -> a `DensityCurve`, or a `reader.Response`, which has the same fields, for eta and what else must be
    steady in this test (`Loading.steady`).  Tests that ended early do not count, as those without a run.
    """
    eta = curves["eta"]
    if state == "peak":
        return peak_standing(strain, loading.sign * eta.values, eta.probability)
    values = {symbol: curve.values for symbol, curve in curves.items()}
    return critical_standing(strain, values, eta.probability, eta.extended, eta.packing, loading.steady)


def critical_standing(
    strain: np.ndarray,
    values: Mapping[str, np.ndarray],
    probability: np.ndarray,
    extended: np.ndarray,
    packing: np.ndarray | None = None,
    steady: Mapping[str, float] = DRAINED.steady,
) -> Standing:
    """Standing of the critical state of a density from the curves of all its points.

    strain (T,); values: those of `steady` (T, Q), NaN where a run is missing or has ended; probability (Q,);
    extended (T, Q): rows that continue a run which stopped because its critical state was proven.  packing (Q,): that
    of each point; None or all equal: one for all points, and the error of the pooled drift then contains SHARED of a
    single run's.

    Not reached: the test ends before strain 0.28, or a drift beyond the tolerance is shown (it exceeds SHOWN_AT
    standard errors).  Proven: the drift and twice its error are within the tolerance.  Not proven at this size:
    neither.  steady: symbol -> largest relative drift over DRIFT_STRAIN of a steady state.
    """
    end = float(strain[-1])
    least = JUDGED_FROM + CRITICAL_BLOCK
    if end < least * (1.0 - 1e-9):
        return Standing(
            NOT_REACHED,
            f"the test ends at {100 * end:.3g} % axial strain; critical states are averaged from "
            f"{100 * JUDGED_FROM:g} % to an end of at least {100 * least:g} %",
        )
    part = strain > JUDGED_FROM * (1.0 + 1e-9)
    running = ~extended[part].any(axis=0)
    known = {symbol: running & np.isfinite(values[symbol]).all(axis=0) for symbol in steady if symbol in values}
    if not any(np.isfinite(curve).all(axis=0).any() for curve in values.values()):
        return Standing(NOT_REACHED, "no test reached it")
    if not running.any():
        return Standing(PROVEN, "every run stopped after it had proven its critical state by itself")
    words, status = [], PROVEN
    for symbol, points in known.items():
        if points.sum() < 2:
            return Standing(NOT_PROVEN, f"one run cannot prove that {symbol} is steady")
        of_points = None if packing is None else packing[points]
        drift, error = pooled_drift(strain[part], values[symbol][part][:, points], probability[points], of_points)
        limit = steady[symbol]
        name = "p'" if symbol == "p" else symbol
        words.append(f"{name} {100 * drift:+.2g} ± {200 * error:.2g} % (limit {100 * limit:g} %)")
        if abs(drift) > max(limit, SHOWN_AT * error):
            status = NOT_REACHED
        elif abs(drift) + 2 * error > limit and status == PROVEN:
            status = NOT_PROVEN
    return Standing(
        status,
        f"drift over {100 * DRIFT_STRAIN:g} % of strain, pooled over the points, with 95 % half width: "
        f"{', '.join(words)}",
    )


def pooled_drift(
    strain: np.ndarray, values: np.ndarray, probability: np.ndarray, packing: np.ndarray | None = None
) -> tuple[float, float]:
    """Relative drift over DRIFT_STRAIN of values (T, Q), pooled over the points, and its standard error.

    packing (Q,): that of each point.  The points of one packing may share part of their drift; with R > 1 packings the
    error is that of R clusters, sqrt(R / (R - 1) sum_r (sum_q w_q (d_q - d))^2), widened by Student's t.
    """
    drifts = _drifts(strain, values)
    share = weighted.normalised(probability)
    mean = float(share @ drifts)
    cluster = np.unique(packing, return_inverse=True)[1] if packing is not None else np.zeros(len(drifts), int)
    count = cluster.max() + 1
    if count == 1:
        return mean, float(drifts.std(ddof=1) * np.sqrt(np.sum(share**2) + SHARED**2))
    from scipy import stats

    factor = stats.t.ppf(0.975, count - 1) / stats.norm.ppf(0.975)
    sums = np.bincount(cluster, share * (drifts - mean), count)
    return mean, float(factor * np.sqrt(count / (count - 1) * np.sum(sums**2)))


def peak_standing(strain: np.ndarray, eta: np.ndarray, probability: np.ndarray) -> Standing:
    """Standing of the peak of a density from the stress ratios eta (T, Q) of its points; -eta in extension.

    The mean curve is smoothed as a run's is.  A maximum at the last strain where a peak may lie is no peak: in a test
    that ends before critical states are judged the peak is not reached, otherwise it is not proven.
    """
    from ..runs import peak_critical  # with scipy, which a reader of results needs for this only

    known = np.isfinite(eta)
    whole = known.all(axis=0)
    ended = known.any(axis=0) & ~whole
    if ended.any() and not whole.any():
        return Standing(NOT_PROVEN, "every test ended early; the peaks are those of the tests that passed one before")
    mean = weighted.mean(np.where(ended, np.nan, eta), probability)
    if not np.isfinite(mean).all():
        return Standing(NOT_REACHED, "no run is left")
    row, first, last = peak_critical.peak_row(strain, mean)
    at = f"{100 * strain[row]:.3g} % axial strain"
    if row in (first, last):
        place = "first" if row == first else "last"
        words = f"the mean stress ratio is largest at the {place} strain where a peak may lie, {at}"
        return Standing(NOT_REACHED if strain[-1] < JUDGED_FROM else NOT_PROVEN, words)
    return Standing(PROVEN, f"the mean stress ratio is largest at {at}")


def _drifts(strain: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Fitted relative changes (..., Q) over DRIFT_STRAIN of values (..., T, Q)."""
    x = strain - strain.mean()
    slope = np.tensordot(x, np.moveaxis(values, -2, 0), axes=1) / (x @ x)
    mean = values.mean(axis=-2)
    return slope * DRIFT_STRAIN / np.where(mean != 0, np.abs(mean), np.nan)
