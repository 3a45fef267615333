"""Planned runs and their ids, the effect of a changed setting, the tables that YADE reads, and the predicted cost."""

import ast
import csv
import math
import re
import subprocess
from dataclasses import fields, replace

import h5py
import laptop_plan
import numpy as np
import pytest
import synthetic_runs

from analysis.points import RepresentativePoints
from analysis.quantities import FULL_RATE, FULL_RATE_FRICTION, effective_inertial_number
from campaign.config import ROOT, parse_config, read_config
from campaign.config_keys import SECTIONS
from campaign.plan import (
    STAGES,
    collapsing,
    make_rows,
    predicted_cost,
    predicted_steps,
    table_line,
    write_plan,
    yade_table,
)
from campaign.prepare import PlanError, prepare, read_planned_points
from campaign.run_one import read_task

POINTS = RepresentativePoints([(0.1 + 0.05 * k, (50 - 5 * k) * 1e9) for k in range(6)], [1 / 6] * 6)


#: One packing for all points.
ONE = "[assembly]\npackings = [1]\n"


def rows_of(text=""):
    """Rows of a campaign with one packing, unless the text names others."""
    if "packings" not in text:
        text = text.replace("[assembly]\n", ONE) if "[assembly]" in text else ONE + text
    return make_rows(parse_config(text), POINTS)


def ids(text=""):
    return {row.run_id for row in rows_of(text)}


def test_one_consolidation_per_density_and_one_probe_and_one_shear_run_per_point():
    rows = rows_of()
    count = {stage: sum(r.stage == stage for r in rows) for stage in ("consolidate", "probe", "shear")}
    assert count == {"consolidate": 3, "probe": 18, "shear": 18}
    assert sum(r.stage == "consolidate" for r in rows_of("[consolidation]\nper_point = true")) == 18


def test_chain_leads_from_shear_over_probe_to_consolidation():
    rows = {r.run_id: r for r in rows_of()}
    for row in rows.values():
        if row.stage == "shear":
            probe = rows[row.start]
            first = rows[probe.start]
            assert (probe.stage, first.stage, first.start) == ("probe", "consolidate", "")
            assert (probe.mu_s, probe.G_p, first.mu_iso) == (row.mu_s, row.G_p, row.mu_iso)
            assert row.values["start"] == probe.product


def test_second_family_shares_the_consolidations_and_fixes_mu_s():
    rows = rows_of("[families]\nG_p_only = true\nmu_s_fixed = 0.3")
    second = [r for r in rows if r.family == "G_p"]
    assert len(second) == 36 and {r.mu_s for r in second} == {0.3}
    assert sum(r.stage == "consolidate" for r in rows) == 3


def test_second_family_of_few_points_is_spread_over_G_p():
    rows = rows_of("[families]\nG_p_only = true\nG_p_points = 2")
    second = [r for r in rows if r.family == "G_p" and r.stage == "shear"]
    ranked = sorted({r.G_p for r in rows if r.family == "coupled"})
    assert {r.G_p for r in second} == {ranked[1], ranked[4]} and len(second) == 6


def test_a_point_has_one_packing_at_every_density_and_in_every_family():
    rows = rows_of("[families]\nG_p_only = true\n[assembly]\npackings = [7, 8]")
    packing = {point: {r.packing for r in rows if r.point == point} for point in range(6)}
    assert all(len(seeds) == 1 for seeds in packing.values())
    assert sorted(seed for seeds in packing.values() for seed in seeds) == [7, 7, 7, 8, 8, 8]
    assert sum(r.stage == "consolidate" for r in rows) == 2 * 3
    assert {r.values["seed"] for r in rows if r.packing == 8} == {8}


def test_there_are_at_most_as_many_packings_as_points():
    rows = rows_of("[assembly]\npackings = 20")
    assert {r.packing for r in rows} == set(range(1, 7))
    assert sum(r.stage == "consolidate" for r in rows) == 6 * 3


def test_packings_are_a_number_or_a_list_of_seeds():
    assert parse_config("[assembly]\npackings = 3").assembly.packings == (1, 2, 3)
    assert parse_config("[assembly]\npackings = [5, 9]").assembly.packings == (5, 9)


def test_ids_say_what_the_run_is_and_are_stable():
    row = next(r for r in rows_of() if r.stage == "shear" and r.point == 0 and r.mu_iso == 0.04)
    assert row.run_id.startswith("shear_mu0.100_G50.0_iso0.040_s1_") and len(row.run_id.split("_")[-1]) == 8
    assert ids() == ids() and len(ids()) == 39


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("[shear]\nstrain_end = 0.3", 21),
        ("[shear]\nsnapshots = [0.1]", 21),
        ("[shear]\nenergy_strain = 0.0", 39),
        ("[shear]\nenergy_strain = 0.4", 21),
        ("[probe]\nstrain = 1e-5", 3),
        ("[dem]\ndamping = 0.2", 3),
        ("[assembly]\nN = 2000", 0),
        ("[consolidation]\nsigma_3_kPa = 200", 0),
        ("[material]\nheterogeneity = 'grain'", 3),
        ("[dem]\nstiffness_scale = 0.1", 21),
        ("[pdem]\ncells = 200", 39),
        ("[run]\njobs = 7", 39),
        ("[failures]\nretry = false", 39),
    ],
)
def test_changed_setting_makes_new_ids_only_where_it_is_used(text, kept):
    assert len(ids() & ids(text)) == kept


def test_costliest_rows_come_first_in_each_stage():
    rows = [r for r in rows_of() if r.stage == "shear"]
    assert [r.particle_steps for r in rows] == sorted((r.particle_steps for r in rows), reverse=True)
    assert rows[0].G_p == max(POINTS.G_p)


def test_predicted_steps_follow_the_cost_law():
    values = {"G_p": 25.7e9, "sigma_3": 1e5, "stiffness_scale": 1.0, "timestep_factor": 0.8, "strain_end": 0.4,
              "inertial_number": 1e-4, "density_scaling": 0, "mu_s": 0.25}  # fmt: skip
    assert predicted_steps("shear", values) == pytest.approx(2.03e6, rel=0.01)
    assert predicted_steps("shear", values | {"inertial_number": 1e-3}) == pytest.approx(2.03e5, rel=0.01)
    assert predicted_steps("shear", values | {"G_p": 8 * 25.7e9}) == pytest.approx(4.07e6, rel=0.01)
    assert predicted_steps("shear", values | {"timestep_factor": 1.6}) == pytest.approx(1.02e6, rel=0.01)
    assert predicted_steps("shear", values | {"mu_s": 0.6}) == predicted_steps("shear", values)
    fast = values | {"inertial_number": 2.4e-3}
    assert predicted_steps("shear", fast | {"mu_s": 0.6}) == pytest.approx(2 * predicted_steps("shear", fast))
    assert predicted_steps("shear", values | {"density_scaling": 1}) == pytest.approx(1.10e6, rel=0.01)


def test_constants_of_the_cost_law_are_those_of_the_laptop_campaign():
    """Steps of all runs of a stage, over the predictions for the same runs; probes are predicted 13 % too long."""
    plan = laptop_plan.planned()
    predicted, taken = dict.fromkeys(STAGES, 0.0), dict.fromkeys(STAGES, 0.0)
    with open(ROOT / "data" / "laptop" / "tables" / "runs.csv", newline="") as file:
        for run in csv.DictReader(file):
            stage = run["stage"]
            predicted[stage] += plan[stage, run["family"], float(run["mu_iso"]), int(run["point"])].steps
            taken[stage] += float(run["steps"])
    assert {stage: taken[stage] / predicted[stage] for stage in STAGES} == pytest.approx(
        {"consolidate": 1.00, "probe": 0.89, "shear": 0.98}, abs=0.02
    )


def test_cost_adds_up():
    rows = rows_of()
    cost = predicted_cost(rows)
    for what in ("runs", "particle_steps", "core_hours"):
        assert cost["total"][what] == pytest.approx(sum(cost[s][what] for s in ("consolidate", "probe", "shear")))
    assert cost["total"]["runs"] == len(rows)


def test_points_whose_friction_is_below_that_of_consolidation_are_counted():
    rows = rows_of("[consolidation]\nmu_iso = [0.0, 0.2, 1.0]")
    points = {r.point: r.mu_s for r in rows if r.stage == "shear"}
    lower = {mu_iso: sum(mu_s < mu_iso for mu_s in points.values()) for mu_iso in (0.2, 1.0)}
    assert collapsing(rows) == {mu_iso: count for mu_iso, count in lower.items() if count} and lower[1.0] == len(points)


def test_table_gives_every_value_back_in_full(tmp_path):
    rows = [r for r in rows_of("[shear]\nsnapshots = [0.1, 0.2]") if r.stage == "shear"]
    path = tmp_path / "shear.table"
    path.write_text(yade_table(rows, "a note"))
    assert path.read_text().endswith("\n")
    for k, row in enumerate(rows):
        task = read_task(path, table_line(k))
        assert (task.text("description"), task.text("product")) == (row.run_id, row.product)
        assert {name: eval(task.cells[name]) for name in row.values} == row.values
        assert task.predicted == pytest.approx(row.cpu_seconds, abs=0.51)


def assigned(script, name):
    """The literal that a script of yade_scripts, which can be imported inside YADE only, assigns to a name."""
    tree = ast.parse((ROOT / "yade_scripts" / f"{script}.py").read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                if ast.unparse(target) in (name, f"({name})"):
                    return ast.literal_eval(node.value)
    raise AssertionError(f"{script}.py assigns nothing to {name}")


def test_the_rate_law_of_the_plan_is_that_of_the_scripts():
    assert assigned("rve", "FULL_RATE_FRICTION, FULL_RATE") == (FULL_RATE_FRICTION, FULL_RATE)
    assert effective_inertial_number(2.4e-3, 0.3) == 2.4e-3 and effective_inertial_number(1e-3, 0.65) == 1e-3
    assert effective_inertial_number(2.4e-3, 0.6) == pytest.approx(1.2e-3)


#: Parameters of the scripts (defaults in stage.py) that no key of the campaign file sets.
SCRIPTS_ONLY = {"checkpoint_seconds", "servo_mass", "servo_damping"}
#: Parameter -> the key of the campaign file that sets it, where both have a default.
KEYS = {
    "mu_iso": ("consolidation", "mu_iso"), "sigma_3": ("consolidation", "sigma_3_kPa"), "nu": ("material", "nu"),
    "rho": ("material", "rho"), "d50": ("assembly", "d50_mm"), "seed": ("assembly", "packings"),
    "timestep_factor": ("dem", "timestep_factor"), "damping": ("dem", "damping"),
    "stiffness_scale": ("dem", "stiffness_scale"), "density_scaling": ("dem", "density_scaling"),
    "heterogeneity": ("material", "heterogeneity"), "inertial_number": ("shear", "inertial_number"),
    "strain_end": ("shear", "strain_end"), "windows": ("shear", "windows"), "snapshots": ("shear", "snapshots"),
    "probe_strain": ("probe", "strain"), "stop_when_steady": ("shear", "stop_when_steady"),
    "energy_strain": ("shear", "energy_strain"), "G_p": ("consolidation", "G_ref_GPa"),
    "mu_s": ("families", "mu_s_fixed"), "path": ("shear", "path"), "direction": ("shear", "direction"),
    "stiff_cap": ("shear", "stiff_cap_MPa"),
}  # fmt: skip
#: Stage -> parameters that its table leaves out: the stage does not use them, or its default is what is meant.
LEFT_OUT = {
    "consolidate": {"mu_s", "damping", "heterogeneity", "grains", "probe_strain"},
    "probe": {"inertial_number", "strain_end", "windows", "snapshots", "stop_when_steady", "energy_strain"},
    "shear": {"probe_strain", "path", "direction", "stiff_cap"},
}
LEFT_OUT["probe"] |= LEFT_OUT["shear"] - {"probe_strain"}
LEFT_OUT["consolidate"] |= LEFT_OUT["probe"]
#: Defaults that are meant: all grains of a consolidation have the same properties, it ends without damping, and a table
#: of shear runs names the path only where it is not drained compression.
MEANT = {"heterogeneity": "specimen", "damping": 0.0, "path": "drained", "direction": "compression", "stiff_cap": 10e6}


@pytest.mark.parametrize("preset", ["", "5%", "3%", "2%"])
def test_no_default_of_the_scripts_applies_to_a_planned_run(preset):
    """Every parameter with a default in stage.py is in the tables, or is one that the stage leaves out for a reason."""
    defaults = assigned("stage", "COMMON")
    assert MEANT.items() <= defaults.items()
    rows = rows_of(f'[dem]\naccuracy = "{preset}"\n[shear]\nenergy_strain = 0.06\n[material]\nheterogeneity = "grain"')
    for row in rows:
        assert set(defaults) - {"product", *row.values} <= SCRIPTS_ONLY | LEFT_OUT[row.stage], row.stage
    assert set(KEYS) == set(defaults) - SCRIPTS_ONLY - {"product", "assembly", "start", "grains"}
    assert all(key in {f.name for f in fields(SECTIONS[section])} for section, key in KEYS.values())


@pytest.mark.parametrize(
    "keys, given",
    [
        ('path = "drained"\ndirection = "compression"', {}),
        ('path = "constant_p"', {"path": "constant_p"}),
        ('direction = "extension"', {"direction": "extension"}),
        ('path = "undrained"\nstiff_cap_MPa = 5', {"path": "undrained", "stiff_cap": 5e6}),
        ("stiff_cap_MPa = 5", {}),
    ],
)
def test_the_path_is_a_parameter_of_shear_runs_and_changes_only_their_ids(keys, given):
    drained, other = rows_of(), rows_of(f"[shear]\n{keys}")
    ids = {row.run_id for row in drained if row.stage != "shear"}
    assert ids == {row.run_id for row in other if row.stage != "shear"}
    shear = [row for row in other if row.stage == "shear"]
    assert all(
        {k: v for k, v in row.values.items() if k in ("path", "direction", "stiff_cap")} == given for row in shear
    )
    same = {row.run_id for row in shear} & {row.run_id for row in drained}
    assert len(same) == (0 if given else len(shear))


@pytest.mark.parametrize(
    "keys, measured",
    [
        # Steps over those of drained compression; 0.30 strain, mu_iso 0.001 and 0.1 (undrained: campaign of 24 runs).
        ('path = "constant_p"', (1.10, 1.10)),
        ('direction = "extension"', (1.17, 1.17)),
        ('path = "undrained"', (0.078, 0.19)),
    ],
)
def test_steps_of_every_path_are_predicted_as_measured(keys, measured):
    end = "strain_end = 0.3"
    drained, other = ({row.mu_iso: row.steps for row in rows_of(text) if row.stage == "shear"}
                      for text in (f"[shear]\n{end}", f"[shear]\n{end}\n{keys}"))  # fmt: skip
    for mu_iso, ratio in zip((0.001, 0.1), measured, strict=True):
        assert other[mu_iso] / drained[mu_iso] == pytest.approx(ratio, rel=0.1)


def test_without_energy_strain_the_scripts_default_applies_as_the_key_says():
    """The only default of the scripts that a planned run uses, of which the key's own text states the value."""
    assert all("energy_strain" not in row.values for row in rows_of())
    (key,) = (key for key in fields(SECTIONS["shear"]) if key.name == "energy_strain")
    (per_cent,) = re.findall(r"script default \(([\d.]+) %\)", key.metadata["doc"])
    assert float(per_cent) / 100 == assigned("stage", "COMMON")["energy_strain"]


def test_defaults_that_differ_from_the_scripts_are_columns_of_the_tables():
    """The key of the campaign file and the script may have other defaults only where the table has the value."""
    defaults = assigned("stage", "COMMON")
    tables = {row.stage: set(row.values) for row in rows_of()}
    shear = next(row for row in rows_of() if row.stage == "shear")
    differ = {name for name in KEYS if name in shear.values and shear.values[name] != defaults[name]}
    assert differ - {"mu_iso", "mu_s", "G_p"} == {"inertial_number"}
    for name in differ:
        users = [stage for stage in STAGES if name not in LEFT_OUT[stage]]
        assert all(name in tables[stage] for stage in users), name


@pytest.mark.yade
def test_yade_reads_the_table_as_written(tmp_path):
    rows = [r for r in rows_of("[shear]\nsnapshots = [0.1, 0.2]") if r.stage == "shear"][:3]
    (tmp_path / "shear.table").write_text(yade_table(rows, "a note"))
    (tmp_path / "read.py").write_text(
        "from yade import utils\n"
        f"utils.readParamsFromTable({str(tmp_path / 'shear.table')!r} + ':4', unknownOk=True)\n"
        "from yade.params import table\n"
        "print('READ', repr((O.tags['description'], table.mu_s, table.start, table.snapshots, table.windows)))\n"
    )
    done = subprocess.run(["yade", "-n", "-x", "-j1", str(tmp_path / "read.py")], capture_output=True, text=True)
    row = rows[1]
    written = (row.run_id, row.mu_s, row.values["start"], "0.1,0.2", "default")
    assert f"READ {written!r}" in done.stdout, done.stdout + done.stderr


def test_a_line_without_a_run_is_refused(tmp_path):
    path = tmp_path / "t.table"
    path.write_text("# note\na b\n1 2\n3\n")
    assert read_task(path, 3).cells == {"a": "1", "b": "2"}
    for line, reason in ((1, "holds no run"), (2, "holds no run"), (9, "holds no run"), (4, "1 values, the heading 2")):
        with pytest.raises(ValueError, match=reason):
            read_task(path, line)


def test_points_are_chosen_once_and_kept(tmp_path):
    path = synthetic_runs.write_config(tmp_path, n=8)
    config, folder = read_config(path), tmp_path / "run"
    points, outcome = prepare(config, folder)
    assert outcome == "chosen" and len(points) == 8
    assert math.fsum(points.probability) == pytest.approx(1.0, abs=1e-12) and (points.probability > 0).all()
    stamp = (folder / "points.csv").stat().st_mtime_ns
    again, outcome = prepare(config, folder)
    assert outcome == "kept" and list(again) == list(points)
    assert (folder / "points.csv").stat().st_mtime_ns == stamp
    assert (folder / "config.toml").read_text() == path.read_text()
    assert list(read_planned_points(config, folder)) == list(points)


def test_changed_inputs_are_reported_and_never_used_by_accident(tmp_path):
    path = synthetic_runs.write_config(tmp_path, n=8)
    config, folder = read_config(path), tmp_path / "run"
    synthetic_runs.planned(config, folder, 8)
    more = replace(config, points=replace(config.points, n=9))
    with pytest.raises(PlanError, match="changed since the points were chosen"):
        read_planned_points(more, folder)
    points, outcome = prepare(more, folder)
    assert (len(points), outcome) == (9, "chosen anew")


def test_plan_csv_has_one_line_per_run(tmp_path):
    pandas = pytest.importorskip("pandas")
    rows = rows_of()
    assert write_plan(rows, tmp_path) == []
    frame = pandas.read_csv(tmp_path / "tables" / "plan.csv")
    assert list(frame.run_id) == [r.run_id for r in rows]
    assert frame.particle_steps.sum() == pytest.approx(sum(r.particle_steps for r in rows), rel=1e-5)
    assert frame.G_p.dropna().tolist() == [r.G_p for r in rows]
    assert write_plan(rows, tmp_path) == []


def test_points_of_negative_friction_are_refused_in_one_line(tmp_path):
    """A normal distribution of so much scatter has its 100 points below zero, too."""
    rng = np.random.default_rng(1)
    lines = [f"{mu:.4f},{G:.3f}" for mu, G in zip(np.abs(rng.normal(0.2, 0.1, 60)), rng.normal(30, 5, 60), strict=True)]
    (tmp_path / "pairs.csv").write_text("mu_s,G_p_GPa\n" + "\n".join(lines) + "\n")
    text = '[inputs]\npairs = "pairs.csv"\nbootstrap = 19\nmarginals = ["normal"]\n[points]\nn = 40\n'
    config = parse_config(text, tmp_path / "wide.toml")
    with pytest.raises(PlanError, match=r"normal .* mu_s puts \d+ of the 40 points at or below .*\"lognormal\""):
        prepare(config, tmp_path / "run")
    assert not (tmp_path / "run" / "points.csv").exists()


def test_measured_youngs_modulus_becomes_G_p_with_the_materials_poisson_ratio(tmp_path):
    rng = np.random.default_rng(2)
    lines = [f"{mu:.4f},{E:.3f}" for mu, E in np.exp(rng.normal((-1.5, 4.0), 0.2, (30, 2)))]
    (tmp_path / "pairs.csv").write_text("mu_s,E_p_GPa\n" + "\n".join(lines) + "\n")
    text = '[inputs]\npairs = "pairs.csv"\nbootstrap = 19\n[points]\nn = 8\n[material]\nnu = '
    stiff, soft = (prepare(parse_config(text + nu, tmp_path / "t.toml"), tmp_path / "run") for nu in ("0.2", "0.4"))
    assert soft[1] == "chosen anew"
    ratio = [b.G_p / a.G_p for a, b in zip(stiff[0], soft[0], strict=True)]
    assert ratio == pytest.approx([1.2 / 1.4] * 8)


def test_properties_of_grains_are_drawn_anew_when_their_number_or_distribution_changes(tmp_path):
    text = synthetic_runs.write_config(tmp_path, n=8).read_text() + "[material]\nheterogeneity = 'grain'\n"
    config, folder = parse_config(text, tmp_path / "t.toml"), tmp_path / "run"

    def drawn(N=64, **inputs):
        changed = replace(config, inputs=replace(config.inputs, **inputs), assembly=replace(config.assembly, N=N))
        points, _ = prepare(changed, folder)
        shear = next(r for r in make_rows(changed, points) if r.stage == "shear" and r.point == 3)
        with h5py.File(folder / shear.values["grains"]) as file:
            return file["mu_s"][()], shear.run_id

    first, run_id = drawn()
    assert len(first) == 64 and np.array_equal(drawn()[0], first) and drawn()[1] == run_id
    assert len(drawn(N=65)[0]) == 65
    for other in ({"marginals": ("gamma",)}, {"seed": 2}):
        grains, other_id = drawn(**other)
        assert not np.array_equal(grains, first) and other_id != run_id
    assert np.array_equal(drawn()[0], first)


def test_grains_of_negative_friction_are_refused_and_nothing_is_written(tmp_path):
    """Eight points may all be positive where a few of many grains are not."""
    rng = np.random.default_rng(1)
    pairs = zip(np.abs(rng.normal(0.3, 0.1, 60)), rng.normal(30, 5, 60), strict=True)
    (tmp_path / "pairs.csv").write_text("mu_s,G_p_GPa\n" + "\n".join(f"{mu:.4f},{G:.3f}" for mu, G in pairs) + "\n")
    text = '[inputs]\npairs = "pairs.csv"\nbootstrap = 19\nmarginals = ["normal"]\n[points]\nn = 8\n'
    prepare(parse_config(text, tmp_path / "t.toml"), tmp_path / "specimen")
    grain = text + "[assembly]\nN = 2000\n[material]\nheterogeneity = 'grain'\n"
    with pytest.raises(PlanError, match=r"of the 2000 grains of point \d at or below zero"):
        prepare(parse_config(grain, tmp_path / "t.toml"), tmp_path / "run")
    assert not (tmp_path / "run").exists()
