"""The table of a sweep: the moments of every campaign beside the value of the key, and the figure that shows them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from analysis.figures import style
from analysis.figures.sweep import along_key
from analysis.tables.sweep import COLUMNS, sweep_table


def moments(mean: float, states=("peak", "critical"), densities=(0.1, 0.04)) -> pd.DataFrame:
    """Moments as `tables.moments` gives them: mean of the state, an interval of -1 and +2, sd 0.5."""
    return pd.DataFrame([
        {"mu_iso": mu_iso, "state": state, "quantity": "eta", "unit": "1", "kind": kind, "mean": mean + k,
         "mean_low": mean + k - 1.0, "mean_high": mean + k + 2.0, "sd": 0.5, "sd_low": 0.4, "sd_high": 0.7, "q05": 9.0,
         "packings": 3}
        for mu_iso in densities for k, state in enumerate(states) for kind in ("denoised", "as simulated")
    ])  # fmt: skip


def test_rows_of_one_state_stand_together_in_the_order_of_the_values():
    table = sweep_table("a.b", [("200", moments(3.0)), ("50", moments(1.0))])
    assert table.columns.tolist() == ["key", "value", *COLUMNS] and len(table) == 16 and set(table.key) == {"a.b"}
    assert (
        table.value.tolist() == ["200", "50"] * 8
        and table["mean"].tolist() == [3.0, 1.0, 3.0, 1.0, 4.0, 2.0, 4.0, 2.0] * 2
    )
    assert table.mu_iso.tolist() == [0.1] * 8 + [0.04] * 8 and table.kind.tolist()[:4:2] == ["denoised", "as simulated"]


def test_a_state_that_one_campaign_lacks_is_there_for_the_others():
    table = sweep_table("a.b", [("1", moments(1.0, states=("peak",))), ("2", moments(2.0))])
    assert table[table.state == "critical"].value.unique().tolist() == ["2"] and len(table) == 12
    assert sweep_table("a.b", [("1", moments(1.0)[:0])]).empty and sweep_table("a.b", []).empty


@pytest.mark.parametrize("values, x, scale", [
    (("200", "50"), [50.0, 200.0], "log"), (("2", "3"), [2.0, 3.0], "linear"), (("0", "-7"), [-7.0, 0.0], "linear"),
    (("tvd", "exact"), [0.0, 1.0], "linear"), (("true", "1"), [0.0, 1.0], "linear"),
])  # fmt: skip
@pytest.mark.parametrize("narrow", [False, True])
def test_the_figure_shows_mean_interval_and_standard_deviation_over_the_values(values, x, scale, narrow):
    means = {values[0]: 3.0, values[1]: 1.0}
    with style.one_column(narrow):
        figure = along_key(sweep_table("a.b", [(value, moments(mean)) for value, mean in means.items()]))
    axes = [axis for axis in figure.axes if axis.get_title(loc="left")]
    assert [axis.get_title(loc="left") for axis in axes] == ["(a) peak state", "(b) critical state"]
    assert {axis.get_xlabel() for axis in axes} == {"a.b"} and {axis.get_xscale() for axis in axes} == {scale}
    numeric = sorted(values, key=float) if x[0] not in (0.0,) else list(values)
    for k, axis in enumerate(axes):
        for container, band in zip(axis.containers, axis.collections[1::2], strict=True):
            line, _, (bars,) = container.lines
            expected = np.array([means[value] + k for value in numeric])
            assert line.get_xdata().tolist() == x and line.get_ydata() == pytest.approx(expected)
            for segment, mean in zip(bars.get_segments(), expected, strict=True):
                assert segment[:, 1] == pytest.approx([mean - 1.0, mean + 2.0])
            path = band.get_paths()[0].vertices
            assert path[:, 1].min() == pytest.approx(expected.min() - 0.5)
            assert path[:, 1].max() == pytest.approx(expected.max() + 0.5)
