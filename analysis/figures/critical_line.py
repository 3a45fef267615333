"""Figure 19: critical void ratio against ln p' with the fitted line, and critical stress ratio by direction."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import panels, style

MARKERS = {"drained": "o", "constant_p": "s", "undrained": "^"}
PATHS = {"drained": "drained", "constant_p": "constant $p'$", "undrained": "undrained"}


@style.styled
def critical_line(points: pd.DataFrame, lines: pd.DataFrame, predicted: Mapping[str, float] | None = None) -> Figure:
    """Critical states of all points of one campaign or several.

    points, lines: `tables.critical_line.critical_points` and `critical_lines`; predicted: name of a surface -> mean
    critical eta in extension that it gives for compression, drawn as lines.
    """
    groups = list(points.groupby(["campaign", "path", "direction", "mu_iso"], sort=False))
    entries = len(groups) + len(lines) + len(predicted or {})
    columns = 1 if style.is_narrow() else 2
    room = 0.14 * -(-entries // columns) + 0.15
    figure = style.new_figure(7.6, 3.4 + room, narrow_height=5.4 + room)
    upper, lower = figure.subfigures(2, 1, height_ratios=[5.4 if style.is_narrow() else 3.4, room])
    left, right = upper.subplots(*style.grid(1, 2))
    colours = {key: colormaps[style.COLOURS](0.85 * k / max(len(groups) - 1, 1)) for k, (key, _) in enumerate(groups)}
    for key, of in groups:
        campaign, path, direction, mu_iso = key
        label = f"{campaign}, {PATHS[path]} {direction}, $\\mu_{{iso}}$ = {mu_iso:g}"
        for axis, symbol in ((left, "e"), (right, "eta")):
            axis.plot(of["p_kPa"], of[symbol], MARKERS[path], ms=3.5, mew=0.7, color=colours[key],
                      mfc="none" if direction == "compression" else colours[key], label=label)  # fmt: skip
    if len(lines):
        _lines(left, lines)
    for axis, symbol, letter, title in ((left, "e", "a", "critical void ratio"), (right, "eta", "b", "by direction")):
        axis.set(xscale="log", xlabel=style.label("p"), ylabel=style.label(symbol))
        panels.panel_title(axis, letter, title)
    for direction, of in points.groupby("direction", sort=False):
        share = of["probability"] / of["probability"].sum()
        right.axhline(float(of["eta"] @ share), color="k", lw=1.0)
        right.annotate(f"{direction}: {float(of['eta'] @ share):.3f}", (0.99, float(of["eta"] @ share)), fontsize=7,
                       xycoords=("axes fraction", "data"), ha="right", va="bottom",
                       bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.6})  # fmt: skip
    for (name, value), look in zip((predicted or {}).items(), ("--", ":", "-."), strict=False):
        right.axhline(value, color="#b00040", lw=1.0, ls=look, label=f"{name} from compression: {value:.3f}")
    handles = {
        text: line for axis in (left, right) for line, text in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    lower.legend(handles.values(), handles.keys(), loc="center", ncols=columns, fontsize=6.5)
    return figure


def _lines(axis: Axes, lines: pd.DataFrame) -> None:
    """The fitted lines, each with one standard deviation of its scatter."""
    for (_, line), look in zip(lines.iterrows(), ("-", "--", ":", "-."), strict=False):
        p = np.geomspace(line["p_low_kPa"], line["p_high_kPa"], 50)
        e = line["e_100"] - line["slope"] * np.log(p / 100.0)
        axis.plot(p, e, color="#b00040", lw=1.1, ls=look, label=f"fitted to {line['fitted_to']} (± scatter)")
        axis.fill_between(p, e - line["scatter"], e + line["scatter"], color="#b00040", alpha=0.08, lw=0)
