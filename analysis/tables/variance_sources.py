"""Sources of the variance of every state: the random inputs, what they share, packings, and single runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ..results.reader import Results
from ..surrogates import sensitivity
from ..surrogates.distribution import moments_and_quantiles
from .columns import unit, with_interval
from .pooled_states import pooled_states


def share_columns(names: Sequence[str]) -> list[str]:
    """Columns of the parts that the inputs explain: only_<name> of each, shared, and from three inputs on
    shapley_<name>.

    A single input shares nothing.
    """
    several = ["shared", *(f"shapley_{name}" for name in names if len(names) > 2)]
    return [*(f"only_{name}" for name in names), *(several if len(names) > 1 else [])]


def variance_sources(results: Results, power: int = 12) -> pd.DataFrame:
    """Shares of the variance of every state as simulated, per density.

    The inputs depend on each other, so one explains part of what another explains: `shared` is explained by several of
    them, `only_<name>` by one in addition to all others (independent total indices).  From three inputs on,
    `shapley_<name>` are their Shapley effects, which add up to what all inputs explain.  `noise` is the rest, `packing`
    its part that all runs of a packing share and `own` that of a single run, with 95 % intervals; both are NaN with one
    packing or one run per packing.  From 2^power samples of the joint distribution; a density with too few runs (fewer
    than 12 for two inputs) has no rows.  `loo_error` is the leave-one-out error of the model over the standard
    deviation.
    """
    rows, names = [], results.points.names
    for mu_iso, state, symbol, model, samples in pooled_states(results, power):
        shares = sensitivity.from_surrogate(model, samples)
        found = moments_and_quantiles(model, samples[: 2**9])
        inputs, packing, own = np.stack([found.shares.value[0], found.shares.low[0], found.shares.high[0]], axis=1)
        explained = [*shares.alone[0], shares.shared[0], *shares.shapley[0]][: len(share_columns(names))]
        parts = inputs[0] * np.array(explained)
        spread = float(found.as_simulated.value[0, 1])
        rows.append((mu_iso, state, symbol, unit(symbol), *parts, *packing, *own, 1 - inputs[0],
                     float(model.loo_error[0]) / spread))  # fmt: skip
    noise = [*with_interval("packing"), *with_interval("own"), "noise", "loo_error"]
    return pd.DataFrame(rows, columns=["mu_iso", "state", "quantity", "unit", *share_columns(names), *noise])
