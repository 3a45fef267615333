"""Plans of campaigns with other random inputs than pairs of mu_s and G_p: rows, files, refusals, digests."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import laptop_plan
import numpy as np
import pytest
from paths import ROOT

from analysis.inputs.variables import VARIABLES
from campaign import batches
from campaign.cell import check_cell
from campaign.choice import PlanError, choose
from campaign.config import ConfigError, parse_config, read_config
from campaign.evaluate import plan_frame
from campaign.files import read_json
from campaign.plan import make_rows, write_plan
from campaign.prepare import describe_inputs, inputs_digest, prepare, read_planned_points

STATED = {
    "mu_s": '[variables.mu_s]\nfamily = "lognormal"\nmean = 0.25\ncov = 0.3\n',
    "G_p": '[variables.G_p_GPa]\nfamily = "lognormal"\nmean = 29.0\ncov = 0.25\n',
    "nu": '[variables.nu]\nfamily = "uniform"\nlow = 0.1\nhigh = 0.35\n',
    "sigma_ln": '[variables.sigma_ln]\nfamily = "uniform"\nlow = 0.1\nhigh = 0.2\n',
    "sigma_3": '[variables.sigma_3_kPa]\nfamily = "lognormal"\nmean = 100.0\ncov = 0.3\n',
    "d50": '[variables.d50_mm]\nfamily = "lognormal"\nmean = 0.25\ncov = 0.2\n',
}
SMALL = """
[points]
n = 8
[assembly]
N = 80
packings = [1, 2]
[consolidation]
mu_iso = [0.04]
[shear]
strain_end = 0.1
inertial_number = 2.5e-3
"""


def config_of(*names, more="", small=SMALL):
    constant = "" if "G_p" in names else "[variables.G_p_GPa]\nvalue = 29.0\n"
    return parse_config(small + "".join(STATED[name] for name in names) + constant + more, "mine.toml")


def rows_of(config):
    points, _ = choose(config)
    rows = make_rows(config, points)
    return points, {stage: [row for row in rows if row.stage == stage] for stage in ("consolidate", "probe", "shear")}


def test_campaigns_of_pairs_keep_their_run_ids_and_their_digest():
    ids = sorted(row.run_id for row in laptop_plan.rows())
    assert hashlib.sha256("\n".join(ids).encode()).hexdigest()[:16] == "3e5022a188285211"
    assert inputs_digest(read_config(ROOT / "campaign" / "laptop.toml")) == "a5f4522bee57f2f3"
    assert all(not row.further for row in laptop_plan.rows())


def test_a_random_nu_changes_probe_and_shear_of_a_shared_consolidation():
    points, rows = rows_of(config_of("mu_s", "G_p", "nu"))
    assert points.names == ("mu_s", "G_p", "nu") and len(rows["consolidate"]) == 2
    assert {row.values["nu"] for row in rows["consolidate"]} == {0.2} and not rows["consolidate"][0].further
    for row in rows["probe"] + rows["shear"]:
        assert row.values["nu"] == row.further["nu"] == points["nu"][row.point]
        assert row.start.startswith("consolidate" if row.stage == "probe" else "probe")
    assert len({row.run_id for row in rows["shear"]}) == 8


def test_a_constant_modulus_is_that_of_every_run():
    points, rows = rows_of(config_of("mu_s"))
    assert points.names == ("mu_s",) and {row.G_p for row in rows["shear"]} == {29e9}
    assert [row.mu_s for row in sorted(rows["shear"], key=lambda row: row.point)] == points.mu_s.tolist()


@pytest.mark.parametrize("name", ["sigma_ln", "sigma_3", "d50"])
def test_a_random_grading_or_stress_gives_each_point_a_consolidation_of_its_own(name):
    points, rows = rows_of(config_of("mu_s", name))
    assert sorted(row.point for row in rows["consolidate"]) == list(range(8))
    own = name in ("sigma_ln", "d50")
    for row in (row for part in rows.values() for row in part):
        assert row.values["assembly"] == f"assembly_{row.packing}{f'_point_{row.point}' if own else ''}.h5"
        assert row.values.get(name, row.further[name]) == points[name][row.point]
    assert {row.G_p for row in rows["consolidate"]} == {29e9}


def test_the_width_of_the_grading_is_part_of_the_id():
    config = config_of("mu_s", "sigma_ln")
    points, _ = choose(config)
    moved = replace(points, x=points.x * [1.0, 1.01])
    assert not {row.run_id for row in make_rows(config, points)} & {row.run_id for row in make_rows(config, moved)}


def test_a_plan_is_written_with_all_columns_and_kept(tmp_path):
    config, folder = config_of("mu_s", "nu", "sigma_ln"), tmp_path / "mine"
    points, outcome = prepare(config, folder)
    rows = make_rows(config, points)
    write_plan(rows, folder)
    assert outcome == "chosen" and prepare(config, folder)[1] == "kept"
    again = read_planned_points(config, folder)
    assert np.array_equal(again.x, points.x) and (again.names, again.constants) == (points.names, {"G_p": 29e9})
    assert len(list(folder.glob("assembly_*_point_*.h5"))) == 8 and not (folder / "assembly_1.h5").exists()
    header = (folder / "tables" / "plan.csv").read_text().splitlines()[0].split(",")
    assert header[header.index("G_p") + 1 :][:2] == ["nu", "sigma_ln"]
    frame = plan_frame(folder, rows)
    shear = frame[frame["stage"] == "shear"].set_index("point")
    assert shear.loc[range(8), "nu"].tolist() == points["nu"].tolist()
    lines, warnings = describe_inputs(folder, points)
    assert (
        "inputs.pairs_behind" in lines[0] and lines[-1].startswith("points: mu_s 0.1") and "sigma_ln 0.1" in lines[-1]
    )
    assert len(lines) > 4 and all("x1" not in warning for warning in warnings)


def test_what_the_points_depend_on_changes_the_digest():
    base, known = config_of("mu_s"), config_of("mu_s", more="[inputs]\npairs_behind = 40\n")
    other = config_of("mu_s", more="[variables.nu]\nvalue = 0.3\n")
    assert len({inputs_digest(config) for config in (base, known, other)}) == 3
    ids = [{row.run_id for row in make_rows(config, choose(config)[0])} for config in (base, known, other)]
    assert ids[0] == ids[1] and not ids[0] & ids[2]


def test_constants_settle_the_keys_of_the_file():
    more = "[variables.nu]\nvalue = 0.3\n[variables.sigma_3_kPa]\nvalue = 50.0\n[variables.d50_mm]\nvalue = 0.5\n"
    config = config_of("mu_s", more=more)
    assert (config.material.nu, config.consolidation.sigma_3_kPa, config.assembly.d50_mm) == (0.3, 50.0, 0.5)
    points, rows = rows_of(config)
    assert points.constants == {"G_p": 29e9} and rows["consolidate"][0].values["sigma_3"] == 50e3
    assert len(rows["consolidate"]) == 2


@pytest.mark.parametrize(("names", "more", "words"), [
    (("mu_s", "G_p", "nu"), "[families]\nG_p_only = true\n", "needs mu_s and G_p as the two random variables"),
    (("mu_s",), "[families]\nG_p_only = true\n", "random are mu_s"),
    (("mu_s", "nu"), '[material]\nheterogeneity = "grain"\n', "but nu is random, too"),
])  # fmt: skip
def test_settings_that_do_not_go_with_the_inputs_are_refused(names, more, words):
    with pytest.raises(PlanError, match=words) as caught:
        choose(config_of(*names, more=more))
    assert "\n" not in str(caught.value) and str(caught.value).startswith("mine.toml: ")


def test_values_that_no_specimen_has_are_refused_with_the_limit():
    nu = '[variables.nu]\nfamily = "normal"\nmean = 0.3\nsd = 0.08\n'
    config = config_of("mu_s", more=nu, small=SMALL.replace("n = 8", 'n = 400\nmethod = "sobol"'))
    with pytest.raises(PlanError, match=r"mine.toml: the normal distribution of nu puts \d of the 400 points outside "
                                        r"nu = 0 to 0.49 \(such as 0.5"):  # fmt: skip
        choose(config)


def test_grains_of_their_own_take_the_constant_with_them(tmp_path):
    import h5py

    config = config_of("mu_s", more='[material]\nheterogeneity = "grain"\n')
    prepare(config, tmp_path / "mine")
    with h5py.File(next((tmp_path / "mine").glob("grains_0_*.h5"))) as file:
        assert np.array_equal(file["G_p"][()], np.full(80, 29e9)) and np.ptp(file["mu_s"][()]) > 0.1


def test_the_widest_grading_decides_whether_the_cell_is_too_thin():
    config = config_of("mu_s", "sigma_ln")
    points, _ = choose(config)
    check_cell(config, points)
    wide = replace(points, x=np.column_stack([points.mu_s, np.linspace(0.1, 0.6, 8)]))
    with pytest.raises(ConfigError, match=r"sigma_ln = 0.6.*too thin a cell"):
        check_cell(config, wide)


def test_every_variable_can_be_random():
    points, rows = rows_of(config_of(*VARIABLES))
    assert points.names == tuple(VARIABLES) and len(points.moment_warnings()) == 1
    assert len(rows["shear"]) == 8 and {*rows["shear"][0].further} == {"nu", "sigma_ln", "sigma_3", "d50"}


def test_batches_of_points_are_chosen_and_judged_by_all_random_variables(tmp_path):
    config = config_of("mu_s", "nu", more='[pdem]\nstop_when = "10%"\n')
    points, _ = prepare(config, tmp_path)
    inputs = batches._inputs(make_rows(config, points), batches._names(tmp_path))
    assert [inputs[k] for k in range(8)] == [tuple(row) for row in points.x.tolist()]
    step = batches.next_step(config, tmp_path, make_rows(config, points))
    note = read_json(tmp_path / batches.NOTE)
    assert not step.last and sorted(note["order"]) == list(range(8)) and note["used"] == 8
