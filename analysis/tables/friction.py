"""Responses along interparticle friction: values and errors at given mu_s, and the differences between densities.

The two grain properties depend on each other, so G_p is set to its regression on mu_s over the representative points,
in logarithms.  Values come from the response surface through all points of a density, so that the noise of single runs
averages out; the error includes the noise that a packing adds to all points, also as a slope along friction.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import stats

from ..quantities import QUANTITIES
from ..results import replicates
from ..results.reader import Results
from ..surrogates import surrogate
from ..surrogates.surrogate import FEWEST_RUNS, SAFETY
from .columns import unit
from .packing_noise import common_error

#: Frictions that are tabled, as far as the runs reach.
FRICTIONS = (0.065, 0.10, 0.15, 0.25, 0.40, 0.50, 0.65)
RESPONSES = (("peak", "eta"), ("critical", "eta"), ("critical", "e"), ("critical", "Z"))
LEVEL = 0.95
COLUMNS = ["state", "quantity", "unit", "mu_s", "G_p_GPa", "mu_iso", "value", "ci95", "diff_from_mean", "diff_ci95",
           "differs"]  # fmt: skip


def modulus_along(results: Results, mu_s: np.ndarray) -> np.ndarray:
    """Median G_p (n,) in Pa of grains of friction mu_s (n,): regression of the logarithms over the weighted points."""
    points = results.family_points()
    line = np.polyfit(np.log(points.mu_s), np.log(points.G_p), 1, w=np.sqrt(points.probability))
    return np.exp(np.polyval(line, np.log(mu_s)))


def along_friction(
    results: Results, state: str, symbol: str, mu_s: np.ndarray
) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """mu_iso -> values and 95 % half widths (n,) of a state's quantity at the frictions mu_s (n,), in SI units.

    The half width contains the error of the response surface (times `surrogate.SAFETY`, because its terms were chosen
    from the data) and the noise of packings: an error that all points share, and a slope along ln mu_s, which one
    packing for all points also gives the surface.  Without replicate packings the former is the error of one run and
    the latter is not known.  Densities of fewer than 12 runs, or without the quantity, are left out.
    """
    densities = [m for m in results.family_densities() if symbol in results.state_symbols(state, m)]
    if len(densities) < len(results.family_densities()):
        return {}
    points = results.family_points().x
    asked = np.column_stack([mu_s, modulus_along(results, mu_s)])
    shared, _ = common_error(results, state, symbol)
    slope, centre = packing_slope(results, state, symbol)
    tilt = slope * (np.log(mu_s) - centre) if slope > 0 else np.zeros(len(asked))
    out = {}
    for mu_iso, common in zip(densities, shared, strict=True):
        values = results.measured(state, symbol, mu_iso)
        if np.isfinite(values).sum() < FEWEST_RUNS:
            continue
        surface = surrogate.fit(points, values)
        basis = surface.basis(asked)
        own = surface.noise[0] * np.sqrt(np.einsum("nm,mk,nk->n", basis, surface.covariance[0], basis))
        wide = SAFETY * stats.t.ppf(0.5 + LEVEL / 2, surface.dof[0])
        packing = stats.norm.ppf(0.5 + LEVEL / 2) * np.hypot(common, tilt)
        out[mu_iso] = surface.predict(asked)[0], np.hypot(wide * own, packing)
    return out


def packing_slope(results: Results, state: str, symbol: str) -> tuple[float, float]:
    """Standard deviation between packings of the slope along ln mu_s, and the ln mu_s about which it turns.

    From the points that several packings serve: the variance of the packings' slopes less that due to the scatter of
    single runs, averaged over the densities, at least zero.  0 and NaN where fewer than two packings share three
    points.
    """
    variances, centres = [], []
    x = np.log(results.family_points().mu_s)
    for mu_iso in results.family_densities():
        sets = results.state_replicates(state, symbol, mu_iso)
        if sets is None or replicates.compared(sets).shape[0] < 2 or replicates.compared(sets).shape[1] < 3:
            continue
        both, at = replicates.compared(sets), x[replicates.shared(sets)[1]]
        rest = both - both.mean(axis=1, keepdims=True) - both.mean(axis=0) + both.mean()
        from_centre = at - at.mean()
        slopes = rest @ from_centre / (from_centre @ from_centre)
        rest = rest - slopes[:, None] * from_centre
        own = np.sum(rest**2) / ((len(both) - 1) * (both.shape[1] - 2))
        variances.append(slopes @ slopes / (len(both) - 1) - own / (from_centre @ from_centre))
        centres.append(at.mean())
    return (float(np.sqrt(max(np.mean(variances), 0.0))), float(np.mean(centres))) if variances else (0.0, float("nan"))


def friction_table(results: Results) -> pd.DataFrame:
    """Peak and critical states at seven frictions and every density, in displayed units, beside the densities' mean.

    `ci95` is the 95 % half width of `value`.  `differs`: "yes" where a value differs from the mean over the densities
    at its friction by more than the 95 % half width of the difference, which takes the densities' errors as
    independent; "not shown" otherwise; empty where the noise of packings is not known, or with one density.  Frictions
    beyond the runs of some density are left out.
    """
    rows = []
    points, densities = results.family_points().mu_s, results.family_densities()
    for state, symbol in RESPONSES:
        if any(symbol not in results.state_symbols(state, m) for m in densities):
            continue
        run = np.all([np.isfinite(results.measured(state, symbol, m)) for m in densities], axis=0)
        mu_s = np.array([mu for mu in FRICTIONS if run.any() and points[run].min() <= mu <= points[run].max()])
        by_density, factor = along_friction(results, state, symbol, mu_s), QUANTITIES[symbol].shown_factor
        modulus = modulus_along(results, mu_s) * QUANTITIES["G_p"].shown_factor
        noise_is_known = len(by_density) > 1 and 0 < common_error(results, state, symbol)[1] < np.inf
        for (mu_iso, (value, half)), off, wide in zip(by_density.items(), *_differences(by_density), strict=True):
            for k, mu in enumerate(mu_s):
                differs = "" if not noise_is_known else "yes" if abs(off[k]) > wide[k] else "not shown"
                rows.append((state, symbol, unit(symbol), mu, modulus[k], mu_iso, factor * value[k],
                             factor * half[k], factor * off[k], factor * wide[k], differs))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)


def friction_curves(results: Results, count: int = 60) -> pd.DataFrame:
    """States along friction for a picture: `count` values of mu_s over the range of the points, in displayed units.

    Columns state, quantity, unit, mu_iso, mu_s, value and its 95 % half width ci95 (`along_friction`).
    """
    points = results.family_points()
    mu_s = np.geomspace(points.mu_s.min(), points.mu_s.max(), count)
    parts = []
    for state, symbol in RESPONSES:
        factor = QUANTITIES[symbol].shown_factor
        for mu_iso, (value, half) in along_friction(results, state, symbol, mu_s).items():
            columns = {"state": state, "quantity": symbol, "unit": unit(symbol), "mu_iso": mu_iso, "mu_s": mu_s}
            parts.append(pd.DataFrame(columns | {"value": value * factor, "ci95": half * factor}))
    empty = pd.DataFrame(columns=["state", "quantity", "unit", "mu_iso", "mu_s", "value", "ci95"])
    return pd.concat(parts, ignore_index=True) if parts else empty


def density_differences(table: pd.DataFrame) -> pd.DataFrame:
    """One row: how much the critical stress ratio at a given friction differs between densities, from `friction_table`.

    `densities`; `differences` that can be decided; `largest_pct` of them and the widest 95 % half width
    `widest_ci95_pct`, in % of the densities' mean; how many lie `outside` their interval.
    """
    critical = table[(table["state"] == "critical") & (table["quantity"] == "eta")]
    decided = critical[critical["differs"].isin(["yes", "not shown"])]
    mean = decided["value"] - decided["diff_from_mean"]
    return pd.DataFrame([{
        "densities": critical["mu_iso"].nunique(),
        "differences": len(decided),
        "outside": int((decided["differs"] == "yes").sum()),
        "largest_pct": 100 * (decided["diff_from_mean"] / mean).abs().max(),
        "widest_ci95_pct": 100 * (decided["diff_ci95"] / mean).max(),
    }])  # fmt: skip


def _differences(by_density):
    """Differences (D, n) of each density from the mean of all, and their half widths; NaN with one density."""
    values, halves = (np.array([pair[k] for pair in by_density.values()]) for k in (0, 1))
    count = len(values)
    if count < 2:
        return np.full_like(values, np.nan), np.full_like(values, np.nan)
    rest = (halves**2).sum(axis=0) - halves**2
    return values - values.mean(axis=0), np.sqrt(halves**2 * (1 - 1 / count) ** 2 + rest / count**2)
