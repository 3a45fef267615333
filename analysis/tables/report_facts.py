"""Single numbers that the report's sentences need, in one row."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..inputs.measurements import measurements_behind
from ..results.models import runs_needed
from ..results.reader import Results
from . import published
from .states import initial_state

#: Scatter of the stress ratio of one run of 1,000 spheres, in %; it falls with the root of the number of spheres
#: (noise of packing and run at the critical state of the laptop campaign).
SCATTER_OF_1000 = 3.0


def report_facts(results: Results) -> pd.DataFrame:
    """One row.

    `refitted`: resamples of the pairs behind the bands.  `spheres_least`, `spheres_most` of the runs; `scatter_pct` of
    one run's stress ratio at the least size; `rough`: whether the campaign is much smaller than the paper's.
    `worst_quantity`, `worst_mu_iso`, `worst_difference_pct`: the largest difference from the paper's Table 3
    (NaN without).  `measurements`: number of measurements behind the inputs, 0 if it is not known.  `filled`: points
    that were not run at any density.  `runs_needed`: runs of a density from which on errors are claimed from its model.
    """
    refitted = results.bootstrap_probability(results.family_densities()[0])
    sizes = results.runs.loc[results.runs["N"] > 0, "N"]
    least, most = (int(sizes.min()), int(sizes.max())) if len(sizes) else (0, 0)
    row: dict[str, Any] = {
        "refitted": 0 if refitted is None else len(refitted),
        "spheres_least": least,
        "spheres_most": most,
        "scatter_pct": SCATTER_OF_1000 * np.sqrt(1000 / least) if least else np.nan,
        "rough": 0 < most < 0.5 * published.PARTICLES or len(results.points) < published.POINTS,
        "measurements": measurements_behind(results.inputs, results.pairs),
        "runs_needed": runs_needed(results),
        "filled": max(int(results.filled(mu_iso).sum()) for mu_iso in results.family_densities()),
    }
    initial = initial_state(results)
    differences = initial["difference_pct"].abs()
    worst = initial.loc[differences.idxmax()] if differences.notna().any() else None
    row["worst_quantity"] = "" if worst is None else worst["quantity"]
    row["worst_mu_iso"] = np.nan if worst is None else worst["mu_iso"]
    row["worst_difference_pct"] = np.nan if worst is None else worst["difference_pct"]
    return pd.DataFrame([row])
