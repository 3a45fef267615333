"""Sources of the variance of every state: the two grain properties, what they share, packings, and single runs."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..results.reader import Results
from ..surrogates import sensitivity
from ..surrogates.distribution import moments_and_quantiles
from .columns import unit, with_interval
from .pooled_states import pooled_states

COLUMNS = ["mu_iso", "state", "quantity", "unit", "only_mu_s", "only_G_p", "shared", *with_interval("packing"),
           *with_interval("own"), "noise", "loo_error"]  # fmt: skip


def variance_sources(results: Results, power: int = 12) -> pd.DataFrame:
    """Shares of the variance of every state as simulated, per density.

    The two properties depend on each other, so each explains most of what the other explains: `shared` is explained by
    either, `only_mu_s` and `only_G_p` by one in addition to the other (independent total indices).  `noise` is the
    rest, `packing` its part that all runs of a packing share and `own` that of a single run, with 95 % intervals; both
    are NaN with one packing or one run per packing.  From 2^power samples of the joint distribution; a density with
    fewer than 12 runs has no rows.  `loo_error` is the leave-one-out error of the model over the standard deviation.
    """
    rows = []
    for mu_iso, state, symbol, model, samples in pooled_states(results, power):
        shares = sensitivity.from_surrogate(model, samples)
        found = moments_and_quantiles(model, samples[: 2**9])
        inputs, packing, own = np.stack([found.shares.value[0], found.shares.low[0], found.shares.high[0]], axis=1)
        parts = inputs[0] * np.array([*shares.alone[0], shares.shared[0]])
        spread = float(found.as_simulated.value[0, 1])
        rows.append((mu_iso, state, symbol, unit(symbol), *parts, *packing, *own, 1 - inputs[0],
                     float(model.loo_error[0]) / spread))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)
