"""What a response does along interparticle friction: values and errors at given mu_s, and what the densities differ by.

The properties of a grain go together, so a grain of friction mu_s has the shear modulus that its like have: the points'
own regression of ln G_p on ln mu_s.  Values come from the response surface through all points of a density, so that
single runs' noise averages out; what packings add to all points alike, and along friction, is in the error.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import stats

from analysis import packings, surrogate
from analysis.packing_noise import common_error
from analysis.quantities import QUANTITIES
from analysis.results import read_results
from analysis.stopping import LEAST, SAFETY

#: Frictions that are tabled, as far as the runs reach.
FRICTIONS = (0.065, 0.10, 0.15, 0.25, 0.40, 0.50, 0.65)
RESPONSES = (("peak", "eta"), ("critical", "eta"), ("critical", "e"), ("critical", "Z"))
LEVEL = 0.95
COLUMNS = ["state", "quantity", "mu_s", "G_p (GPa)", "mu_iso", "value", "± (95 %)", "from the mean of densities",
           "± (95 %) of that", "differs"]  # fmt: skip


def modulus_along(results, mu_s) -> np.ndarray:
    """Median G_p (n,) in Pa of grains of friction mu_s (n,): regression of the logarithms over the weighted points."""
    points = read_results(results).family_points()
    x, y, weight = np.log(points["mu_s"]), np.log(points["G_p"]), np.sqrt(points["probability"])
    return np.exp(np.polyval(np.polyfit(x, y, 1, w=weight), np.log(mu_s)))


def along_friction(results, state, symbol, mu_s) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """mu_iso -> values and 95 % half widths (n,) of a state's quantity at the frictions mu_s (n,), in SI units.

    The half width has the response surface's own error (with the margin of `stopping.SAFETY`, since its terms were
    chosen from the data) and what packings add: the error that all points share, and a slope along ln mu_s, which one
    packing for all points gives the surface too.  Without replicate packings the former is a single run's error and the
    latter is not known.  Densities of fewer than 12 runs, or without the quantity, are left out.
    """
    results = read_results(results)
    densities = [m for m in results.family_densities() if symbol in results.state_symbols(state, m)]
    if len(densities) < len(results.family_densities()):
        return {}
    points = results.family_points()[["mu_s", "G_p"]].to_numpy()
    asked = np.column_stack([mu_s, modulus_along(results, mu_s)])
    shared, _ = common_error(results, state, symbol)
    slope, centre = packing_slope(results, state, symbol)
    tilt = slope * (np.log(mu_s) - centre) if slope > 0 else np.zeros(len(asked))
    out = {}
    for mu_iso, common in zip(densities, shared, strict=True):
        values = results.measured(state, symbol, mu_iso)
        if np.isfinite(values).sum() < LEAST:
            continue
        surface = surrogate.fit(points, values)
        basis = surface.basis(asked)
        own = surface.noise[0] * np.sqrt(np.einsum("nm,mk,nk->n", basis, surface.covariance[0], basis))
        wide = SAFETY * stats.t.ppf(0.5 + LEVEL / 2, surface.dof[0])
        packing = stats.norm.ppf(0.5 + LEVEL / 2) * np.hypot(common, tilt)
        out[mu_iso] = surface.predict(asked)[0], np.hypot(wide * own, packing)
    return out


def packing_slope(results, state, symbol) -> tuple[float, float]:
    """Standard deviation between packings of the slope along ln mu_s, and the ln mu_s about which it turns.

    From the points that several packings serve: variance of the packings' slopes less what single runs' scatter gives
    them, averaged over the densities, at least zero.  0 and NaN where fewer than two packings share three points.
    """
    results, found, centres = read_results(results), [], []
    x = np.log(results.family_points()["mu_s"].to_numpy())
    for mu_iso in results.family_densities():
        sets = results.state_replicates(state, symbol, mu_iso)
        if sets is None or packings.compared(sets).shape[0] < 2 or packings.compared(sets).shape[1] < 3:
            continue
        both, at = packings.compared(sets), x[packings.shared(sets)[1]]
        rest = both - both.mean(axis=1, keepdims=True) - both.mean(axis=0) + both.mean()
        from_centre = at - at.mean()
        slopes = rest @ from_centre / (from_centre @ from_centre)
        rest = rest - slopes[:, None] * from_centre
        own = np.sum(rest**2) / ((len(both) - 1) * (both.shape[1] - 2))
        found.append(slopes @ slopes / (len(both) - 1) - own / (from_centre @ from_centre))
        centres.append(at.mean())
    return (float(np.sqrt(max(np.mean(found), 0.0))), float(np.mean(centres))) if found else (0.0, float("nan"))


def friction_table(results) -> pd.DataFrame:
    """Peak and critical states at seven frictions and every density, in shown units, each against the densities' mean.

    `differs`: "yes" where a value is off the mean over the densities at its friction by more than its 95 % half width,
    in which the densities' errors count as independent; "not shown" else; empty where replicate packings do not tell
    what packings add, or where there is one density.  Frictions beyond the runs of some density are left out.
    """
    results, rows = read_results(results), []
    points, densities = results.family_points()["mu_s"].to_numpy(), results.family_densities()
    for state, symbol in RESPONSES:
        if any(symbol not in results.state_symbols(state, m) for m in densities):
            continue
        run = np.all([np.isfinite(results.measured(state, symbol, m)) for m in densities], axis=0)
        mu_s = np.array([mu for mu in FRICTIONS if run.any() and points[run].min() <= mu <= points[run].max()])
        found, factor = along_friction(results, state, symbol, mu_s), QUANTITIES[symbol].shown_factor
        modulus = modulus_along(results, mu_s) * QUANTITIES["G_p"].shown_factor
        told = len(found) > 1 and 0 < common_error(results, state, symbol)[1] < np.inf
        for (mu_iso, (value, half)), off, wide in zip(found.items(), *_differences(found), strict=True):
            for k, mu in enumerate(mu_s):
                differs = "" if not told else "yes" if abs(off[k]) > wide[k] else "not shown"
                rows.append((state, QUANTITIES[symbol].heading, mu, modulus[k], mu_iso, factor * value[k],
                             factor * half[k], factor * off[k], factor * wide[k], differs))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)


def _differences(found):
    """What each density (D, n) differs by from the mean of all, and the half widths of that; NaN with one density."""
    values, halves = (np.array([pair[k] for pair in found.values()]) for k in (0, 1))
    count = len(values)
    if count < 2:
        return np.full_like(values, np.nan), np.full_like(values, np.nan)
    rest = (halves**2).sum(axis=0) - halves**2
    return values - values.mean(axis=0), np.sqrt(halves**2 * (1 - 1 / count) ** 2 + rest / count**2)
