"""One response of several campaigns along strain, and the differences of their moments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.figure import Figure

from ..quantities import QUANTITIES
from . import style


@style.styled
def responses(
    frame: pd.DataFrame, symbol: str, names: Sequence[str], strain_label: str = QUANTITIES["eps_a"].label
) -> Figure:
    """Mean and one standard deviation of a response along strain, one panel per density, one colour per campaign.

    frame: the table `responses` of a comparison; names: all campaigns, so that each keeps its colour.
    """
    frame = frame[frame["quantity"] == symbol]
    densities = sorted(set(frame["mu_iso"]))
    rows, columns = style.grid(-(-len(densities) // 3), min(len(densities), 3))
    figure = style.new_figure(max(3.2 * columns, 4.2), 2.9 * rows + 0.5, 2.6 * rows)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for panel, mu_iso in zip(panels, densities, strict=False):
        for k, name in enumerate(names):
            curve = frame[(frame["mu_iso"] == mu_iso) & (frame["campaign"] == name)]
            look = {"color": _colour(k, len(names)), "linestyle": style.LINES[k % len(style.LINES)]}
            panel.plot(curve["eps_a_pct"], curve["mean"], label=name, **look)
            low, high = curve["mean"] - curve["sd"], curve["mean"] + curve["sd"]
            panel.fill_between(curve["eps_a_pct"], low, high, color=look["color"], alpha=0.15, linewidth=0)
        panel.set(title=rf"$\mu_{{iso}}$ = {mu_iso:g}", xlabel=strain_label)
    for panel in panels[len(densities) :]:
        panel.set_visible(False)
    for panel in panels[::columns]:
        panel.set_ylabel(style.label(symbol))
    panels[0].legend()
    return figure


@style.styled
def differences(frame: pd.DataFrame, names: Sequence[str]) -> Figure:
    """Differences of the denoised means from the reference, over the reference's standard deviation, with intervals.

    frame: the table `differences` of a comparison; names: all campaigns, the reference first.
    """
    chosen = frame[frame["kind"] == "denoised"]
    spread = chosen[chosen["number"] == "sd"].set_index(["campaign", "mu_iso", "state", "quantity"])["reference"]
    means = chosen[chosen["number"] == "mean"]
    labels = list(dict.fromkeys(zip(means["mu_iso"], means["state"], means["quantity"], strict=True)))
    others = [name for name in names[1:] if name in set(means["campaign"])]
    figure = style.new_figure(6.4, 1.3 + 0.24 * len(labels) * max(len(others), 1))
    axes = figure.subplots()
    for k, name in enumerate(others):
        rows = means[means["campaign"] == name]
        place = [labels.index(key) for key in zip(rows["mu_iso"], rows["state"], rows["quantity"], strict=True)]
        at = np.array(place) + 0.7 * ((k + 0.5) / len(others) - 0.5)
        scale = spread.loc[list(zip(rows["campaign"], rows["mu_iso"], rows["state"], rows["quantity"], strict=True))]
        value, low, high = (rows[c].to_numpy() / scale.to_numpy() for c in
                            ("difference", "difference_low", "difference_high"))  # fmt: skip
        colour = _colour(names.index(name), len(names))
        axes.errorbar(value, at, xerr=[value - low, high - value], fmt=style.MARKERS[k % len(style.MARKERS)],
                      color=colour, markersize=4, linewidth=1.2, label=name)  # fmt: skip
    axes.axvline(0, color="0.4", linewidth=0.8)
    axes.set_yticks(range(len(labels)), [_words(*label) for label in labels])
    axes.set(
        xlabel=f"Difference of the mean from {names[0]}, in its standard deviations", ylim=(len(labels) - 0.4, -1.4)
    )
    axes.legend()
    return figure


def _words(mu_iso: float, state: str, symbol: str) -> str:
    tex = QUANTITIES[symbol].tex or symbol
    words = "small-strain" if state == "probe" else state
    return rf"{words} ${tex}$, $\mu_{{iso}}$ = {mu_iso:g}"


def _colour(k: int, count: int) -> tuple:
    return colormaps[style.COLOURS](0.82 * k / max(count - 1, 1))
