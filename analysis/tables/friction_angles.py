"""Friction angles for design: means and characteristic 5 % values at the peak and at the critical state."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ..pdem import weighted
from ..results.reader import Results
from .columns import with_interval
from .packing_noise import common_error, values_drawn

#: Probability of the characteristic value.
CHARACTERISTIC = 0.05
#: Columns of the table: the mean and the characteristic value of the points, in degrees.
NUMBERS = ("mean_deg", "q05_points_deg")


def friction_angle_table(results: Results, n_boot: int = 200, seed: int = 1, family: str = "coupled") -> pd.DataFrame:
    """Mean and characteristic (5 %) friction angles in degrees, per density and state, with 95 % bands.

    The characteristic value is a quantile of the points, which cannot be less than their lowest value.  Bands come from
    n_boot resamples of the points.  Each adds an error that all points of a density share
    (`packing_noise.common_error`; NaN where it is not known), draws the values at points that were not run, and uses
    the probabilities under inputs refitted to resampled pairs where these exist.  The angles carry the uncertainty of
    the mean grain properties of a population; scatter within one deposit is not included.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for k, mu_iso in enumerate(results.family_densities(family)):
        for state in ("peak", "critical"):
            eta, probability = results.shown_state(state, "eta", mu_iso, family), results.probability(mu_iso, family)
            known = np.isfinite(eta)
            standing = results.standing(state, mu_iso, family)
            if not known.any():
                empty = dict.fromkeys((column for name in NUMBERS for column in with_interval(name)), np.nan)
                where: dict[str, Any] = {"mu_iso": mu_iso, "state": state, "standing": standing.status}
                rows.append(where | {"points": 0, "filled": 0} | empty)
                continue
            eta, probability = eta[known], probability[known]
            index = rng.integers(len(eta), size=(n_boot, len(eta)))
            values = values_drawn(results, state, "eta", mu_iso, family, n_boot)[:, known]
            shift = common_error(results, state, "eta", family)[0][k] * rng.normal(size=n_boot)
            refitted = results.bootstrap_probability(mu_iso, family)
            sets = probability[None] if refitted is None else refitted[:, known]
            sets = np.resize(sets, (n_boot, len(eta)))
            drawn = [_numbers(friction_angle(v[i] + s), p[i])
                     for v, i, s, p in zip(values, index, shift, sets, strict=True)]  # fmt: skip
            ends = np.quantile(drawn, [0.025, 0.975], axis=0)
            row: dict[str, Any] = {"mu_iso": mu_iso, "state": state, "standing": standing.status, "points": len(eta)}
            row["filled"] = int(results.filled(mu_iso, family, state)[known].sum())
            for name, value, low, high in zip(NUMBERS, _numbers(friction_angle(eta), probability), *ends, strict=True):
                row |= dict(zip(with_interval(name), (value, low, high), strict=True))
            rows.append(row)
    return pd.DataFrame(rows)


def friction_angle(eta: ArrayLike) -> np.ndarray:
    """Friction angle in degrees that is mobilised in triaxial compression, sin phi = 3 eta / (6 + eta).

    Stress ratios are limited to the range of possible stresses, -1.5 (extension) to 3: a wide error may leave it.
    """
    ratio = np.clip(np.asarray(eta, float), -1.5, 3.0)
    return np.degrees(np.arcsin(3 * ratio / (6 + ratio)))


def _numbers(angle: np.ndarray, probability: np.ndarray) -> tuple[float, float]:
    probability = weighted.normalised(probability)
    return float(weighted.mean(angle, probability)), float(weighted.quantile(angle, probability, CHARACTERISTIC))
