"""The regression over all rows of the DEM benchmark finds effects that are put in, and its intervals cover them."""

import numpy as np
import pandas as pd
import pytest
from bench_dem import BASE, NAMED, SETTINGS, presets
from dem_errors import RESPONSES
from dem_regression import EFFECTS, LIMIT, biases, coordinates, fitted
from paths import ROOT

MERGED = {name: BASE | values for name, values in SETTINGS.items()}
POINTS, DENSITIES = ("low", "middle", "high"), (0.001, 0.04, 0.1)


def rows(rng, effects, of_case=0.02, scatter=0.01, exponent=1.0, point=None):
    """Rows of every setting in fifteen cases; `effects` act at all points, or at one."""
    out = []
    for packing in range(1, 6):
        for k, name in enumerate(POINTS):
            mu_iso, offset = DENSITIES[(packing + k) % 3], of_case * rng.normal(size=len(RESPONSES))
            for setting, values in MERGED.items():
                at = coordinates(values, exponent)
                change = sum(effects.get(e, 0.0) * (at[e] - LIMIT[e]) for e in EFFECTS)
                change = change if point in (None, name) else 0.0
                y = (1 + k) * (1 + change + offset + scatter * rng.normal(size=len(RESPONSES)))
                out.append({"setting": setting, "packing": packing, "mu_iso": mu_iso, "point": name, "failure": np.nan}
                           | dict(zip(RESPONSES, y, strict=True)))  # fmt: skip
    return pd.DataFrame(out)


def test_effects_without_scatter_are_found_exactly():
    effects = {"rate": -0.03, "own inertia": 0.01, "softness": 0.05, "size": 0.002}
    table = biases(rows(np.random.default_rng(1), effects, 0.0, 1e-9), MERGED, ["base", "N = 500"], 1.0)
    level = 1 - 0.03
    of_all = table[(table["of"] == "all") & (table.response == "Z_critical")].set_index("setting")
    assert of_all.loc["base", "bias"] == pytest.approx(-0.03 / level, abs=1e-6)
    assert of_all.loc["N = 500", "bias"] == pytest.approx((-0.03 + 0.002) / level, abs=1e-6)


def test_a_setting_without_rows_may_have_a_rate_of_its_own_at_each_point():
    asked = {"mine": BASE | {"rate": {"low": 0.5, "middle": 0.5, "high": 1.0}}}
    for point, all_points in ((None, -0.04 / 0.96 * 2 / 3), ("low", -0.02 / 0.96 / 3)):
        some = rows(np.random.default_rng(6), {"rate": -0.04}, 0.0, 1e-9, point=point)
        table = biases(some, MERGED | asked, ["mine"], 1.0)
        found = table[table.response == "Z_critical"].set_index("of").bias
        assert found["all"] == pytest.approx(all_points, abs=1e-3)
        assert found["low"] == pytest.approx(-0.02 / 0.96, abs=1e-4) if point else found["high"] < -0.025


def test_no_preset_is_shown_to_exceed_its_limit_and_its_mean_biases_are_within():
    """The table of the rows there are; presets that change must be looked up anew (`bench_dem.py --table`)."""
    table = pd.read_csv(ROOT / "data" / "benchmarks" / "dem_limit.csv").query("exponent == 1")
    table = table[table.response.isin(NAMED)]
    for preset in set(presets()) - {"laptop"}:
        of_preset = table[table.setting == preset]
        assert len(of_preset) == 4 * len(NAMED), preset
        assert not (of_preset.within == "no").any()
        assert (abs(of_preset[of_preset["of"] == "all"].bias) <= of_preset.limit.iloc[0]).all()


def test_an_effect_of_one_point_is_found_there_only():
    table = biases(rows(np.random.default_rng(2), {"rate": -0.05}, point="low"), MERGED, ["base"], 1.0)
    some = table[table.response == "Z_critical"].set_index("of")
    assert some.interactions.all() and some.loc["low", "bias"] == pytest.approx(-0.05, abs=0.02)
    assert abs(some.loc["high", "bias"]) < some.loc["high", "bias_half_width"] + 0.01


@pytest.mark.parametrize(("of_case", "scatter"), [(0.0, 0.02), (0.03, 0.01)])
def test_intervals_cover_what_was_put_in(of_case, scatter):
    """Where cases differ and where they do not; ten responses in five tables."""
    rng, covered = np.random.default_rng(3), []
    for _ in range(5):
        table = biases(rows(rng, {"rate": -0.02}, of_case, scatter), MERGED, ["base"], 1.0)
        some = table[table["of"] == "all"]
        covered += list(abs(some.bias + 0.02 / 0.98) <= some.bias_half_width)
    assert 0.86 < np.mean(covered) <= 1.0


def test_offsets_of_cases_are_taken_out_as_pairs_do():
    """With large offsets the half width is that of paired differences; without any it is smaller than theirs."""
    rng = np.random.default_rng(4)
    case, x = np.repeat(np.arange(15), 2), np.tile([0.0, 1.0], 15)
    columns = np.column_stack([np.ones(30), x])
    for of_case in (0.0, 50.0):
        y = of_case * rng.normal(size=15)[case] + rng.normal(size=30)
        fit = fitted(columns, y, case)
        paired = np.std(np.diff(y.reshape(15, 2), axis=1), ddof=1) / np.sqrt(15)
        assert np.sqrt(fit["covariance"][1, 1]) == pytest.approx(paired, rel=0.25)
    assert fit["ratio"] > 100.0


def test_the_exponent_of_the_rate_has_the_smaller_aic():
    some = rows(np.random.default_rng(5), {"rate": -0.2}, 0.0, 0.005, exponent=0.5)
    table = pd.concat([biases(some, MERGED, ["base"], e) for e in (0.5, 1.0)])
    aic = table.groupby(["response", "exponent"]).aic.first().unstack()
    assert (aic[0.5] < aic[1.0]).mean() > 0.8
