"""What a response does along interparticle friction: values and errors at given mu_s, and what the densities differ by.

The properties of a grain go together, so a grain of friction mu_s has the shear modulus that its like have: the points'
own regression of ln G_p on ln mu_s.  Values come from the response surface through all points of a density, so that
single runs' noise averages out; what packings add to all points alike is in the error.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import stats

from analysis import surrogate
from analysis.packing_noise import common_error
from analysis.quantities import QUANTITIES
from analysis.results import read_results
from analysis.stopping import LEAST

#: Frictions that are tabled, as far as the points reach.
FRICTIONS = (0.065, 0.10, 0.15, 0.25, 0.40, 0.50, 0.65)
RESPONSES = (("peak", "eta"), ("critical", "eta"), ("critical", "e"), ("critical", "Z"))
COLUMNS = ["state", "quantity", "mu_s", "G_p (GPa)", "mu_iso", "value", "half width", "difference",
           "half width of difference", "differs"]  # fmt: skip
LEVEL = 0.95


def ridge(results, mu_s) -> np.ndarray:
    """Median G_p (n,) in Pa of grains of friction mu_s (n,): regression of the logarithms over the weighted points."""
    points = read_results(results).family_points()
    x, y, weight = np.log(points["mu_s"]), np.log(points["G_p"]), np.sqrt(points["probability"])
    return np.exp(np.polyval(np.polyfit(x, y, 1, w=weight), np.log(mu_s)))


def along_friction(results, state, symbol, mu_s) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """mu_iso -> values and 95 % half widths (n,) of a state's quantity at the frictions mu_s (n,), in SI units.

    The half width has the response surface's own error and the one that all points of a density share, each with the
    quantile of its degrees of freedom.  Densities of fewer than 12 runs are left out; without any error of packings
    (one packing, no estimate from within the runs) half widths are NaN.
    """
    results = read_results(results)
    points, densities = results.family_points()[["mu_s", "G_p"]].to_numpy(), results.family_densities()
    asked = np.column_stack([mu_s, ridge(results, mu_s)])
    shared, freedom = common_error(results, state, symbol)
    out = {}
    for mu_iso, common in zip(densities, shared, strict=True):
        values = results.measured(state, symbol, mu_iso)
        if np.isfinite(values).sum() < LEAST:
            continue
        surface = surrogate.fit(points, values)
        basis = surface.basis(asked)
        own = surface.noise[0] * np.sqrt(np.einsum("nm,mk,nk->n", basis, surface.covariance[0], basis))
        out[mu_iso] = surface.predict(asked)[0], np.hypot(own * _wide(surface.dof[0]), common * _wide(freedom))
    return out


def friction_table(results) -> pd.DataFrame:
    """Peak and critical states at seven frictions and every density, in shown units, each against the densities' mean.

    `difference`: value less the mean over the densities at that friction; `differs`: beyond its 95 % half width, in
    which the densities' errors count as independent.
    """
    results, rows = read_results(results), []
    points = results.family_points()["mu_s"]
    mu_s = np.array([mu for mu in FRICTIONS if points.min() <= mu <= points.max()])
    for state, symbol in RESPONSES if len(mu_s) else ():
        if any(symbol not in results.state_symbols(state, m) for m in results.family_densities()):
            continue
        found, factor = along_friction(results, state, symbol, mu_s), QUANTITIES[symbol].shown_factor
        modulus = ridge(results, mu_s) * QUANTITIES["G_p"].shown_factor
        for (mu_iso, (value, half)), off, wide in zip(found.items(), *_differences(found), strict=True):
            for k, mu in enumerate(mu_s):
                differs = "" if not np.isfinite(wide[k]) else "yes" if abs(off[k]) > wide[k] else "no"
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


def _wide(freedom):
    """Quantile that a standard error is multiplied by."""
    return stats.t.ppf(0.5 + LEVEL / 2, freedom) if np.isfinite(freedom) else stats.norm.ppf(0.5 + LEVEL / 2)
