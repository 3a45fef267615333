"""What the benchmarks of the scaling law and of the width of the grading conclude from rows with known answers."""

from __future__ import annotations

import bench_grading_width as width
import bench_scaling as scaling
import pandas as pd
import pytest

from analysis.tables.published import INITIAL_STATE


def sweep(values, stiffness, eta=0.7):
    """The table of a sweep with a stress ratio that is constant, and G_0 (MPa) as given by value."""
    rows = [
        {"key": "k", "value": value, "mu_iso": 0.04, "state": state, "quantity": symbol, "kind": kind, "mean": mean,
         "mean_low": 0.9 * mean, "mean_high": 1.1 * mean, "sd": 0.2 * mean, "sd_low": 0.1 * mean, "sd_high": 0.3 * mean}
        for value, G_0 in zip(values, stiffness, strict=True) for kind in ("denoised", "as simulated")
        for state, symbol, mean in (("peak", "eta", eta), ("probe", "G_0", G_0))
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_states_are_compared_at_the_same_stiffness_over_stress_and_in_its_units():
    """G_0 = 1000 sigma_3 f(G_p / sigma_3): the same at a quarter of the stress as at four times G_p."""
    stress = sweep([25, 100, 400], [25 * 4.0, 100 * 2.0, 400 * 1.0])
    files = [f"/x/G_times_{factor}.csv" for factor in ("4", "1", "0.25")]
    table = scaling.compare(stress, sweep(files, [100 * 4.0, 100 * 2.0, 100 * 1.0], eta=0.77))
    G_0, eta = (table[table.quantity == symbol] for symbol in ("G_0", "eta"))
    assert sorted(table.factor.unique()) == [0.25, 1.0, 4.0] and len(table) == 6
    assert G_0.mean_difference.abs().max() < 1e-9 and G_0.mean_stress.tolist() == pytest.approx([4000, 2000, 1000])
    assert eta.mean_difference.tolist() == pytest.approx([0.07] * 3)
    assert eta.mean_over_half_width.tolist() == pytest.approx([0.07 / (0.07**2 + 0.077**2) ** 0.5] * 3)
    assert eta.sd_ratio.tolist() == pytest.approx([1.1] * 3)


def test_the_width_with_the_smallest_sum_of_squares_is_found():
    """All means are (1 + s) times the published ones with s = 2 (sigma_ln - 0.25) for half of them, the rest exact."""
    rows = []
    for sigma_ln in (0.1, 0.174, 0.3, 0.35):
        shift = {"e": 2.0 * (sigma_ln - 0.25), "Z": 2.0 * (sigma_ln - 0.25)}
        for mu_iso in (0.001, 0.04, 0.1):
            values = {s: INITIAL_STATE[s, mu_iso][0] * (1.0 + shift.get(s, 0.0)) for s in width.SYMBOLS}
            rows += [{"distribution": "lognormal", "sigma_ln": sigma_ln, "mu_iso": mu_iso, **values}] * 2
    table = width.deviations(pd.DataFrame(rows))
    assert table.shape == (4, 12)
    assert table.loc[("lognormal", 0.35), "e 0.04"] == pytest.approx(0.2)
    assert table.loc[("lognormal", 0.35), "Z_m 0.1"] == pytest.approx(0.0)
    best, left = width.best_width(table.droplevel(0))
    assert best == pytest.approx(0.25, abs=1e-3) and left.abs().max() < 2e-3
