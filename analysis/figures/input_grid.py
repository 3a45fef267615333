"""Figures 2 and 3 for any number of random inputs: each two of them in a grid of panels, and the points they have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..inputs.joint import Joint
from ..results.reader import Results
from . import panels, style

#: Probabilities of a marginal at the ends of an axis.
ENDS = (0.002, 0.998)
_NODES = 80


@style.styled
def marginals_and_pairs(results: Results) -> Figure:
    """Figure 2: marginal PDFs on the diagonal, the joint PDF of each two inputs below it, with the measured values.

    Without measurements the representative points stand in their place.
    """
    joint, names = Joint.from_dict(results.inputs["joint"]), results.points.names
    values = results.pairs if len(results.pairs) else results.points.x
    reach = _reach(joint, values)
    figure, axes = _grid(len(names))
    for k, name in enumerate(names):
        _marginal(axes[k][k], joint, k, name, values[:, k], reach[k], measured=len(results.pairs) > 0)
        for i in range(k):
            _pair(axes[k][i], joint, (i, k), names, reach, filled=True)
            axes[k][i].plot(style.shown(names[i], values[:, i]), style.shown(name, values[:, k]), "o", ms=2.5,
                            mfc="white", mec="k", mew=0.5)  # fmt: skip
    _outer_labels(axes, names)
    return figure


@style.styled
def points(results: Results) -> Figure:
    """Figure 3: the points in each two inputs, area by probability, and the distribution functions that they carry."""
    joint, chosen = Joint.from_dict(results.inputs["joint"]), results.points
    names = chosen.names
    reach = _reach(joint, chosen.x)
    figure, axes = _grid(len(names))
    for k, name in enumerate(names):
        _distribution_functions(axes[k][k], joint, results, k)
        for i in range(k):
            _pair(axes[k][i], joint, (i, k), names, reach, filled=False)
            axes[k][i].scatter(style.shown(names[i], chosen.x[:, i]), style.shown(name, chosen.x[:, k]),
                               s=500 * chosen.probability / len(names) + 3, color=panels.CONTOUR_MAP(0.85), alpha=0.8,
                               edgecolor="white", linewidth=0.4)  # fmt: skip
    _outer_labels(axes, names)
    return figure


def _grid(d: int) -> tuple[Figure, list[list[Axes]]]:
    """A figure with d x d panels of which those above the diagonal are left out."""
    size = 4.2 if d == 1 else min(7.6, 2.6 * d)
    figure = style.new_figure(size, 0.75 * size if d == 1 else 0.9 * size, narrow_height=3.4 if d > 1 else 2.6)
    axes = figure.subplots(d, d, squeeze=False)
    for k in range(d):
        for i in range(k + 1, d):
            axes[k][i].set_visible(False)
    return figure, axes.tolist()


def _reach(joint: Joint, values: np.ndarray) -> list[tuple[float, float]]:
    """Ends (SI units) of the axis of every input: nearly all of its distribution, and all values (n, d)."""
    ends = [marginal.ppf(np.array(ENDS)) for marginal in joint.marginals]
    return [(float(min(e[0], v.min())), float(max(e[1], v.max()))) for e, v in zip(ends, values.T, strict=True)]


def _marginal(
    axis: Axes, joint: Joint, k: int, name: str, values: np.ndarray, reach: tuple[float, float], measured: bool
) -> None:
    """The PDF of one input, over a histogram of its measurements or ticks for the points."""
    factor = panels.pdf_factor(name)
    x = np.linspace(*reach, 300)
    if measured:
        axis.hist(values * factor, bins=16, density=True, color="0.85", edgecolor="white", lw=0.5)
    axis.plot(x * factor, joint.marginals[k].pdf(x) / factor, color=panels.CONTOUR_MAP(0.95))
    axis.plot(values * factor, np.zeros(len(values)), "|", color="0.3", ms=5, transform=axis.get_xaxis_transform())
    axis.set(xlim=np.array(reach) * factor, ylim=(0, None), ylabel=style.pdf_label(name))
    panels.panel_title(axis, "abcdef"[k], joint.marginals[k].family.replace("_", " "))


def _pair(
    axis: Axes, joint: Joint, which: tuple[int, int], names: Sequence[str], reach: Sequence[tuple[float, float]],
    filled: bool,
) -> None:  # fmt: skip
    """Contours of the joint PDF of the inputs i < k."""
    i, k = which
    x, y = np.meshgrid(np.linspace(*reach[i], _NODES), np.linspace(*reach[k], _NODES), indexing="ij")
    factors = panels.pdf_factor(names[i]), panels.pdf_factor(names[k])
    height = joint.pair(i, k).pdf(np.stack([x, y], axis=-1)) / (factors[0] * factors[1])
    place, levels = (x * factors[0], y * factors[1], height), panels.pdf_levels(height.max())
    if filled:
        axis.contourf(*place, levels=levels, cmap=panels.CONTOUR_MAP, extend="max")
    else:
        axis.contour(*place, levels=levels[::3], colors="0.7", linewidths=0.7)
    axis.set(xlim=np.array(reach[i]) * factors[0], ylim=np.array(reach[k]) * factors[1])


def _distribution_functions(axis: Axes, joint: Joint, results: Results, k: int) -> None:
    """Step function of the points in one input, and the exact distribution function."""
    chosen, marginal = results.points, joint.marginals[k]
    name = chosen.names[k]
    low, high = marginal.ppf(np.array(ENDS)).tolist()
    x = np.linspace(low, high, 300)
    order = np.argsort(chosen.x[:, k], kind="stable")
    axis.plot(style.shown(name, x), marginal.cdf(x), color="0.5", lw=1.0, label="exact")
    axis.step(style.shown(name, chosen.x[order, k]), np.cumsum(chosen.probability[order]), where="post",
              color=panels.CONTOUR_MAP(0.95), label="points")  # fmt: skip
    axis.set(ylim=(0, 1.02), ylabel="Probability" if len(chosen.names) > 2 else "Probability not exceeded")
    panels.panel_title(axis, "abcdef"[k], "")
    if k == 0:
        axis.legend()


def _outer_labels(axes: Sequence[Sequence[Axes]], names: Sequence[str]) -> None:
    """Names of the inputs below the last row and left of the first column; axes between them have no numbers."""
    last = len(names) - 1
    label = style.label if len(names) == 1 else style.short_label
    for k, row in enumerate(axes):
        for i in range(k + 1):
            row[i].set_xlabel(label(names[i]) if k == last or i == k else "")
            if i < k:
                row[i].set_ylabel(label(names[k]) if i == 0 else "")
                row[i].tick_params(labelleft=i == 0, labelbottom=k == last)
