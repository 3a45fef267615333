"""Friction angles for design: moments and characteristic 5 % values at the peak and at the critical state."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..results.models import ANGLE, state_moments
from ..results.reader import JUDGED_STATES, Results
from .columns import with_interval
from .moments import AS_SIMULATED, DENOISED, NUMBERS, kinds


def friction_angle_table(results: Results) -> pd.DataFrame:
    """Friction angles in degrees per density and state: moments and quantiles with 95 % intervals, as in `moments`.

    q05 is the characteristic value of design.  The denoised one is that of a large volume of soil whose grain
    properties are uncertain, the one as simulated that of a specimen of the simulated size.  Scatter within one deposit
    is not included.  A density with too few runs (8 for up to three inputs) has no numbers.
    """
    rows = []
    for mu_iso in results.family_densities():
        for state in JUDGED_STATES:
            known = int(np.isfinite(results.measured(state, "eta", mu_iso)).sum())
            found = state_moments(results, state, ANGLE, mu_iso)
            numbers = dict.fromkeys((DENOISED, AS_SIMULATED), np.full(3 * len(NUMBERS), np.nan))
            if found is not None:
                numbers = dict(kinds(found.distribution))
            standing = results.standing(state, mu_iso).status
            rows += [(mu_iso, state, standing, known, kind, *values) for kind, values in numbers.items()]
    columns = [column for name in NUMBERS for column in with_interval(f"{name}_deg")]
    return pd.DataFrame(rows, columns=["mu_iso", "state", "standing", "points", "kind", *columns])
