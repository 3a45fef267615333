"""The states of several campaigns that differ in the value of one key, in one table."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from .columns import with_interval

#: Columns of `moments` that the table has, after the key and its value.
COLUMNS = ("mu_iso", "state", "quantity", "unit", "kind", *with_interval("mean"), *with_interval("sd"), "packings")


def sweep_table(key: str, campaigns: Sequence[tuple[str, pd.DataFrame]]) -> pd.DataFrame:
    """Mean and standard deviation of every state with 95 % intervals, by value of the key.

    campaigns: the value in words and the table `moments` of each campaign, in the order of the values.  The rows are in
    the order of density, state, quantity and kind of the first campaign, and within them in the order of the values.
    A state that only some of the campaigns have is there for these only.
    """
    parts = [frame.reindex(columns=list(COLUMNS)).assign(key=key, value=value) for value, frame in campaigns]
    table = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=["key", "value", *COLUMNS])
    names = ["mu_iso", "state", "quantity", "kind"]
    order = {group: k for k, group in enumerate(dict.fromkeys(map(tuple, table[names].to_numpy())))}
    place = [order[tuple(row)] for row in table[names].to_numpy()]
    return table.iloc[pd.Series(place, dtype=int).argsort(kind="stable")][["key", "value", *COLUMNS]]
