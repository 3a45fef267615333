"""Sources of the variance of every state: the two grain properties, what they share, and the noise of the packing."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..results.reader import Results
from ..surrogates import sensitivity
from .columns import unit
from .pooled_states import pooled_states

COLUMNS = ["mu_iso", "state", "quantity", "unit", "only_mu_s", "only_G_p", "shared", "noise", "loo_error"]


def variance_sources(results: Results, power: int = 12) -> pd.DataFrame:
    """Shares of the variance of every state, per density.

    The two properties depend on each other, so each explains most of what the other explains: `shared` is explained by
    either, `only_mu_s` and `only_G_p` by one in addition to the other (independent total indices), `noise` is left over
    by the response surface.  From 2^power samples of the joint distribution; a density with fewer than 12 runs has no
    rows.  `loo_error` is the leave-one-out error of the surface over the standard deviation of the points.
    """
    rows = []
    for mu_iso, state, symbol, surface, samples, spread in pooled_states(results, power):
        shares = sensitivity.from_surrogate(surface, samples)
        noise = min(float(surface.noise[0]) ** 2 / spread**2, 1.0)
        parts = (1 - noise) * np.array([*shares.alone[0], shares.shared[0]])
        rows.append((mu_iso, state, symbol, unit(symbol), *parts, noise, float(surface.loo_error[0]) / spread))
    return pd.DataFrame(rows, columns=COLUMNS)
