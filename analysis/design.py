"""Design-ready numbers: friction angles at the peak and at the critical state with their characteristic 5 % values."""

from __future__ import annotations

import numpy as np
import pandas as pd

from analysis import pdem, weighted
from analysis.packing_noise import common_error
from analysis.results import read_results
from analysis.unrun import values_drawn

LEVEL = 0.05


def design_table(results, n_boot=200, seed=1, family="coupled") -> pd.DataFrame:
    """Mean and characteristic (5 %) friction angles, degrees, per density and state, with 95 % bands.

    The characteristic value is taken twice: straight from the points, which cannot say more than their lowest, and from
    the shown density, whose kernel makes it lower and so safer.  Bands come from resampling the points, each time with
    an error that all points of a density share (`packing_noise.common_error`; NaN where it is not known), with another
    surface for points that were not run and, where they were made, with the probabilities under inputs refitted to
    resampled pairs.  The angles carry the uncertainty of the
    population's mean grain properties; scatter within one deposit is not in them.
    """
    results = read_results(results)
    rng = np.random.default_rng(seed)
    rows = []
    for k, mu_iso in enumerate(results.family_densities(family)):
        for state in ("peak", "critical"):
            eta, weight = results.state(state, "eta", mu_iso, family), results.weights(mu_iso, family)
            known = np.isfinite(eta)
            eta, weight = eta[known], weight[known]
            index = rng.integers(len(eta), size=(n_boot, len(eta)))
            drawn = values_drawn(results, state, "eta", mu_iso, family, n_boot)[:, known]
            shift = common_error(results, state, "eta", family)[0][k] * rng.normal(size=n_boot)
            refitted = results.bootstrap_weights(mu_iso, family)
            sets = weight[None] if refitted is None else refitted[:, known]
            sets = np.resize(sets, (n_boot, len(eta)))
            drawn = [_numbers(friction_angle(values[i] + s), w[i])
                     for values, i, s, w in zip(drawn, index, shift, sets, strict=True)]  # fmt: skip
            low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
            row = {"mu_iso": mu_iso, "state": state, "points": len(eta),
                   "filled": int(results.filled(mu_iso, family, state)[known].sum())}  # fmt: skip
            for name, value, a, b in zip(NUMBERS, _numbers(friction_angle(eta), weight), low, high, strict=True):
                row |= {name: value, f"{name}, from": a, f"{name}, to": b}
            rows.append(row)
    return pd.DataFrame(rows)


NUMBERS = ("mean (deg)", "characteristic 5 % from the points (deg)", "characteristic 5 % from the density (deg)")


def friction_angle(eta):
    """Friction angle in degrees mobilised in triaxial compression, sin phi = 3 eta / (6 + eta).

    A stress ratio beyond what stresses can be, -1.5 (extension) to 3, as a wide error may make it, counts as the bound.
    """
    eta = np.clip(np.asarray(eta, float), -1.5, 3.0)
    return np.degrees(np.arcsin(3 * eta / (6 + eta)))


def _numbers(angle, weight):
    weight = weight / weight.sum()
    shown = pdem.state_density(angle, weight, cells=160).quantile(LEVEL)[0]
    return float(weighted.mean(angle, weight)), float(weighted.quantile(angle, weight, LEVEL)), float(shown)
