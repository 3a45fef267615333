"""Error and cost of the DEM settings, from rows that are known: biases, their intervals, verdicts, core-hours."""

from __future__ import annotations

import bench_dem
import dem_cost
import dem_errors
import numpy as np
import pandas as pd
import pytest
from scipy.stats import t

from campaign.plan import PARTICLE_STEPS_PER_CPU_SECOND

LEVEL = {"low": 0.5, "middle": 0.6, "high": 0.7}


def rows(base=0.0, spread=0.0, scatter=0.0, seed=1):
    """Fifteen cases of two settings; densities differ by far, base is off by a share everywhere and in the spread."""
    rng, out = np.random.default_rng(seed), []
    args = bench_dem.argparse.Namespace(short=False, full=False)
    for packing, mu_iso, point in bench_dem.cases(args):
        value = LEVEL[point] + 3 * mu_iso
        tilt = spread * (LEVEL[point] - LEVEL["middle"])
        for setting, off in (("reference", 0.0), ("base", base * value + tilt + scatter * rng.normal())):
            case = {"setting": setting, "packing": packing, "mu_iso": mu_iso, "point": point, "failure": np.nan}
            out.append(case | {"steps": 10, "particle_steps": 1e4} | dict.fromkeys(dem_errors.RESPONSES, value + off))
    return pd.DataFrame(out)


def found(frame, of):
    table = dem_errors.errors(frame, "reference")
    return table[(table.of == of) & (table.response == "eta_critical")].iloc[0]


def test_bias_of_all_points_and_of_the_spread_are_found_apart():
    """Though no point meets every density equally often, the spread is over the means of densities."""
    flat, steep = rows(base=0.03), rows(spread=0.1)
    assert found(flat, "all").bias == pytest.approx(0.03, abs=0.003) and found(flat, "all").cases == 15
    assert found(steep, "all").bias == pytest.approx(0.0, abs=1e-12)
    assert found(steep, "high - low").bias == pytest.approx(0.1) and found(steep, "high - low").within == "no"
    assert {found(steep, of).limit for of in ("high", "high - low")} == {0.02, 0.05}


@pytest.mark.parametrize("of", ["all", "low", "high - low"])
def test_intervals_cover(of):
    """Most hold a bias that is not there; biases and half widths are as wide as the scatter of pairs makes them."""
    several = [found(rows(scatter=0.03, seed=k), of) for k in range(40)]
    assert np.mean([abs(row.bias) <= row.bias_half_width for row in several]) >= 0.85
    error, freedom = {"all": (0.03 / 15**0.5 / 0.74, 12), "low": (0.03 / 5**0.5 / 0.64, 4),
                      "high - low": (0.03 * 0.4**0.5 / 0.2, 8)}[of]  # fmt: skip
    assert np.std([row.bias for row in several]) == pytest.approx(error, rel=0.3)
    assert np.mean([row.bias_half_width for row in several]) == pytest.approx(t.ppf(0.975, freedom) * error, rel=0.3)


def test_a_setting_is_compared_over_the_cases_that_it_shares():
    """Ten per cent off in the one case that both have; the reference's other case is far larger."""
    case = {"mu_iso": 0.04, "point": "middle", "failure": np.nan, "steps": 1, "particle_steps": 1.0}
    frame = pd.DataFrame(
        [{"setting": name, "packing": packing} | case | dict.fromkeys(dem_errors.RESPONSES, value)
         for name, packing, value in (("reference", 1, 1.0), ("reference", 2, 9.0), ("base", 1, 1.1))]
    )  # fmt: skip
    assert dem_errors.errors(frame, "reference")["bias"].to_numpy() == pytest.approx(0.1)


def test_a_value_that_one_setting_lacks_drops_the_pair(tmp_path):
    frame = rows(base=0.03)
    frame.loc[(frame.setting == "base") & (frame.point == "low") & (frame.packing == 1), "eta_critical"] = np.nan
    assert found(frame, "low").cases == 4 and found(frame, "low").bias == pytest.approx(0.03, abs=0.003)
    dem_errors.summarise(frame[frame.setting == "base"], tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_campaign_costs_what_its_runs_took_over_the_plan():
    """Runs of twice the planned CPU time make a campaign of twice the plan's core-hours."""
    settings, once = {name: bench_dem.BASE | values for name, values in bench_dem.SETTINGS.items()}, []
    for setting, slow in (("base", 1.0), ("base", 2.0)):
        frame = rows()
        frame = frame[frame.setting == "base"].assign(setting=setting, N=1000, inertial_number=2.4e-3)
        for stage, columns in (("shear", ("steps", "cpu_seconds")), ("probe", ("probe_steps", "probe_cpu_seconds"))):
            steps = [dem_cost._planned(row, stage, settings[setting], bench_dem.POINTS[row.point], False)
                     for row in frame.itertuples()]  # fmt: skip
            seconds = 1.5 + 1000 * np.array(steps) / PARTICLE_STEPS_PER_CPU_SECOND[stage]
            frame = frame.assign(**{columns[0]: steps, columns[1]: slow * seconds})
        once.append(dem_cost.costs(frame, settings, bench_dem.presets(), bench_dem.POINTS).iloc[0])
    assert once[0].runs == 1203 and once[1].core_hours == pytest.approx(2 * once[0].core_hours)
    assert once[0].core_hours == pytest.approx(once[0][["consolidate", "probe", "shear"]].sum())
    assert 5 < once[0].core_hours < 25
