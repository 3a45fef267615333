"""The states of several campaigns against the key in whose value they differ."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from . import panels, style

#: A key whose positive values span more than this factor has a logarithmic axis.
WIDE = 3.9


@style.styled
def along_key(table: pd.DataFrame) -> Figure:
    """One panel per state and quantity: the mean with its 95 % interval, and a band of one standard deviation.

    table: `tables.sweep.sweep_table`, not empty; its denoised rows are shown.  Values that are no numbers are shown at
    equal distances.
    """
    rows = table[table["kind"] == "denoised"]
    key, states = rows["key"].iloc[0], list(dict.fromkeys(zip(rows["state"], rows["quantity"], strict=True)))
    densities = sorted(rows["mu_iso"].unique())
    looks, markers = style.density_style(densities), style.density_markers(densities)
    values = list(dict.fromkeys(rows["value"]))
    x = pd.to_numeric(pd.Series(values), errors="coerce").to_numpy(float)
    numbers = bool(np.isfinite(x).all())
    x = x if numbers else np.arange(len(values), dtype=float)
    columns = min(3, len(states))
    lines = -(-len(states) // columns)
    figure = style.new_figure(2.6 * columns + 0.4, 2.6 * lines + 0.2, narrow_height=2.6 * len(states))
    panes = (len(states), 1) if style.is_narrow() else (lines, columns)
    axes = figure.subplots(*panes, squeeze=False).ravel()
    spare = axes[len(states) :]
    for axis in spare:
        axis.set_axis_off()
    for k, (axis, (state, symbol)) in enumerate(zip(axes, states, strict=False)):
        of_panel = rows[(rows["state"] == state) & (rows["quantity"] == symbol)]
        for mu_iso in densities:
            some = of_panel[of_panel["mu_iso"] == mu_iso]
            place = np.array([x[values.index(value)] for value in some["value"]])
            order = np.argsort(place)
            place, some = place[order], some.iloc[order]
            mean, sd, low, high = (some[name].to_numpy(float) for name in ("mean", "sd", "mean_low", "mean_high"))
            axis.errorbar(place, mean, np.maximum([mean - low, high - mean], 0.0), marker=markers[mu_iso], ms=4,
                          mfc="none", capsize=2, lw=1.2, **looks[mu_iso])  # fmt: skip
            axis.fill_between(place, mean - sd, mean + sd, color=looks[mu_iso]["color"], alpha=0.12, lw=0)
        axis.set(xlabel=style.wrapped(key), ylabel=style.label(symbol))
        if numbers and x.min() > 0.0 and x.max() > WIDE * x.min():
            axis.set_xscale("log")
            axis.minorticks_off()
        if not numbers or len(values) <= 6:
            axis.set_xticks(x, values, rotation=0 if numbers else 20)
        panels.panel_title(
            axis, "abcdefghijklmnopqrstuvwxyz"[k], "small strain" if state == "probe" else f"{state} state"
        )
    if len(densities) > 1:
        place = spare[0] if len(spare) else axes[0]
        place.legend(*axes[0].get_legend_handles_labels(), loc="center" if len(spare) else "best",
                     frameon=not len(spare), framealpha=0.75)  # fmt: skip
    return figure
