"""Friction angles for design: moments and characteristic 5 % values at the peak and at the critical state."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ..results.models import model_of, runs_with_moments
from ..results.reader import Results
from .columns import with_interval
from .moments import AS_SIMULATED, DENOISED, NUMBERS, POWER, kinds, with_refits
from .pooled_states import joint_samples


def friction_angle_table(results: Results) -> pd.DataFrame:
    """Friction angles in degrees per density and state: moments and quantiles with 95 % intervals, as in `moments`.

    q05 is the characteristic value of design.  The denoised one is that of a large volume of soil whose grain
    properties are uncertain, the one as simulated that of a specimen of the simulated size.  Scatter within one deposit
    is not included.  A density with fewer than 8 runs has no numbers.
    """
    rows = []
    for mu_iso in results.family_densities():
        for state in ("peak", "critical"):
            runs = results.runs_at(state, "eta", mu_iso)
            known = int(np.isfinite(results.measured(state, "eta", mu_iso)).sum())
            model = None
            if known >= runs_with_moments(results) and results.inputs["joint"]:
                model = model_of(results, runs._replace(values=friction_angle(runs.values)))
            numbers = dict.fromkeys((DENOISED, AS_SIMULATED), np.full(3 * len(NUMBERS), np.nan))
            if model is not None:
                numbers = dict(kinds(with_refits(results, model, joint_samples(results, POWER))[0]))
            standing = results.standing(state, mu_iso).status
            rows += [(mu_iso, state, standing, known, kind, *values) for kind, values in numbers.items()]
    columns = [column for name in NUMBERS for column in with_interval(f"{name}_deg")]
    return pd.DataFrame(rows, columns=["mu_iso", "state", "standing", "points", "kind", *columns])


def friction_angle(eta: ArrayLike) -> np.ndarray:
    """Friction angle in degrees that is mobilised in triaxial compression, sin phi = 3 eta / (6 + eta).

    Stress ratios are limited to the range of possible stresses, -1.5 (extension) to 3.
    """
    ratio = np.clip(np.asarray(eta, float), -1.5, 3.0)
    return np.degrees(np.arcsin(3 * ratio / (6 + ratio)))
