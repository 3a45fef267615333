"""The physical gate: sound runs pass, and what cannot be true is one line with run, quantity, value and limit."""

from __future__ import annotations

import ast
import shutil
from types import SimpleNamespace

import h5py
import numpy as np
import path_limits
import pytest
import synthetic_results as synthetic
from paths import DATA, ROOT

from analysis.quantities import PATHS, Loading
from analysis.results.build import build_results
from analysis.runs import gate
from analysis.runs.archive import Archive, run_summary
from analysis.runs.run_file import RunFileError, read_run
from analysis.tables.run_quality import PROOFS

EXAMPLES = {path.name.split("_")[0]: path for path in sorted((DATA / "laptop" / "example_runs").glob("*.h5"))}


def changed(tmp_path, stage, change):
    """An example run with `change` made to its open file."""
    path = tmp_path / EXAMPLES[stage].name
    shutil.copy(EXAMPLES[stage], path)
    with h5py.File(path, "r+") as file:
        change(file)
    return read_run(path)


def setting(name, index, value):
    def change(file):
        file["record"][name][index] = value(file["record"][name][index]) if callable(value) else value

    return change


def attribute(group, name, value):
    def change(file):
        if value is None:
            del file[group].attrs[name]
        else:
            file[group].attrs[name] = value

    return change


def half(file):
    """The record up to half the strain, with the proofs as they were."""
    count = int((file["record/eps_a"][()] <= 0.2).sum())
    for name, values in {name: data[()] for name, data in file["record"].items()}.items():
        del file["record"][name]
        file["record"][name] = values[:count]


AXIAL = (slice(60, None), 2, 2)
CASES = [
    ("shear", setting("sigma", AXIAL, lambda v: 1.5 * v), "sigma_z jumps by the factor 1.[45].* limit 1.4"),
    ("shear", setting("sigma", AXIAL, lambda v: 0.5 * v), "sigma_z jumps by the factor 0.[45].* limit 1.4"),
    ("shear", setting("sigma", (50, 2, 2), lambda v: 1.5 * v), "sigma_z jumps by the factor"),
    (
        "shear",
        setting("sigma", slice(60, None), lambda v: 1.5 * v),
        r"lateral stress / sigma_3 - 1 = 0.5.*\(-0.01, 0.01",
    ),
    ("shear", setting("sigma", slice(None), lambda v: 1000 * v), r"sigma_z / sigma_3 = 1000 at strain 0 .*\(0.5, 10\)"),
    ("shear", setting("e", 40, -0.1), r"e = -0.1 in row 40 is not within \(0, 5\)"),
    ("shear", setting("e", slice(None), 1e6), r"e = 1e\+06 in row 0 is not within \(0, 5\)"),
    ("shear", setting("Z", 96, 21.0), r"Z = 21 in row 96 is not within .*20\)"),
    ("shear", setting("eps_a", 50, 0.0), "eps_a falls from .* in row 50, it must increase strictly"),
    ("shear", half, "ends at strain 0.19.*, strain_end = 0.4 was planned"),
    ("shear", attribute("parameters", "strain_end", 0.8), "ends at strain 0.39.*, strain_end = 0.8 was planned"),
    ("shear", attribute("proofs", "servo_mean_error", None), "the proof servo_mean_error is missing"),
    ("shear", attribute("proofs", "max_inertial_number", 2.6e-3), "max_inertial_number = 0.0026 exceeds 0.0025"),
    ("shear", attribute("proofs", "servo_max_error", 0.06), "servo_max_error = 0.06 exceeds 0.05"),
    ("shear", attribute("proofs", "energy_error", np.nan), "energy_error = nan is not finite"),
    ("shear", attribute("proofs", "F_unb", "good"), "F_unb = nan is not finite"),
    ("shear", attribute("parameters", "sigma_3", -1e5), r"sigma_3 = -1e\+05 is not within \(0, inf\)"),
    ("shear", attribute("parameters", "N", "many"), r"N = 'many' is not within \(0, inf\)"),
    ("shear", attribute("timing", "cpu_seconds", "long"), "cpu_seconds = 'long' is not within"),
    ("probe", attribute("probe", "G_0", np.nan), r"G_0 = nan is not within \(0, 2.04.*e\+10\)"),
    ("probe", attribute("probe", "G_0", -1.5e8), r"G_0 = -1.5e\+08 is not within \(0"),
    ("probe", attribute("probe", "K_0", None), "K_0 = missing is not within"),
    ("probe", attribute("probe", "K_0", 1e12), r"K_0 = 1e\+12 is not within \(0, 2.04.*e\+10\)"),
    ("probe", attribute("proofs", "stress_error", 0.02), "stress_error = 0.02 exceeds 0.005"),
    ("consolidate", attribute("proofs", "F_unb", None), "the proof F_unb is missing"),
    ("consolidate", setting("e", -1, 7.0), r"e = 7 in row 0 is not within \(0, 5\)"),
    (
        "consolidate",
        setting("sigma", -1, lambda v: 1.5 * v),
        "error of the last stress over sigma_3 = 0.5 exceeds 0.05",
    ),
]


@pytest.mark.parametrize("stage, change, words", CASES)
def test_what_cannot_be_true_of_a_sound_run_is_a_stated_failure(tmp_path, stage, change, words):
    run = changed(tmp_path, stage, change)
    with pytest.raises(RunFileError, match=f"^run {run.run_id}: .*({words})") as told:
        run_summary(run)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("stage", EXAMPLES)
def test_real_runs_pass_the_gate(stage):
    gate.check_product(read_run(EXAMPLES[stage]))


def test_no_curve_or_modulus_of_the_laptop_campaign_is_near_a_limit():
    """All shear and probe runs, from their archive; sigma_z follows from eta where sigma_3 is held."""
    archive = Archive(DATA / "laptop" / "runs.h5")
    changes, ends, shares = [], [], []
    for run_id in archive:
        if run_id.startswith("consolidate"):
            continue
        summary = archive[run_id]
        states, facts = summary.states, summary.facts
        if run_id.startswith("probe"):
            shares.append(states.states["probe"]["G_0"] / (1e9 * float(run_id.split("_")[2][1:])))
            continue
        for name, limit in gate.PROOF_LIMITS["shear"].items():
            assert np.isnan(limit) or facts[name] < 0.98 * limit
        eta = states.responses["eta"]
        axial = (3 + 2 * eta) / (3 - eta)
        ratio = axial[1:] / axial[:-1]
        changes += [ratio.min(), ratio[states.eps_a[:-1] >= gate.JUMP_FROM].max()]
        ends.append(facts["strain_end"] - states.eps_a[-1] - np.diff(states.eps_a).max())
        for symbol in ("e", "e_m", "Z", "Z_m"):
            low, high = gate.RANGES[symbol]
            assert low < states.responses[symbol].min() and states.responses[symbol].max() < 0.5 * high
        assert np.diff(states.eps_a).min() > 0 and axial.max() < 0.5 * gate.STRESS_RATIO[1]
    assert len(shares) == len(ends) == 360
    assert min(changes) > 1.05 / gate.JUMP and max(changes) < gate.JUMP / 1.05
    assert max(ends) <= 0 and min(shares) > 0 and max(shares) < 0.05


def test_the_limits_are_those_of_the_scripts_and_of_the_table_of_proofs():
    for name, (_, limit) in PROOFS.items():
        assert gate.PROOF_LIMITS["shear"][name] == pytest.approx(limit, nan_ok=True)
    assert constants("proofs.py") | constants("equilibrium.py") >= {
        "I_LIMIT": 2.5e-3, "SERVO_FROM": gate.SERVO_FROM,
        "STEADY_FROM": gate.STEADY_FROM, "STRESS_LIMIT": gate.PROOF_LIMITS["probe"]["stress_error"],
        "FORCE_LIMIT": gate.PROOF_LIMITS["consolidate"]["F_unb"],
    }.items()  # fmt: skip
    assert path_limits.held_limits() == {p: (*held, gate.ENERGY_LIMITS[p]) for p, held in gate.HELD_LIMITS.items()}
    assert path_limits.fewest() == gate.FEWEST
    assert constants("paths.py") >= {"RATE_FLOOR": gate.CARRIES, "LIQUEFIED": gate.LIQUEFIED}.items()
    assert path_limits.steady_limits() == {path: Loading(path).steady for path in PATHS}


def constants(name):
    """Numbers that a script assigns at its top, as pairs (name, number)."""
    pairs = set()
    for node in ast.parse((ROOT / "yade_scripts" / name).read_text("utf-8")).body:
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
            both = (target.elts, value.elts) if isinstance(target, ast.Tuple) else ([target], [value])
            pairs |= {(t.id, v.value) for t, v in zip(*both, strict=True) if isinstance(v, ast.Constant)}
    return pairs


@pytest.mark.parametrize("change, words", [
    (lambda file: file["record/e"].write_direct(np.full(81, 1e6)), "e = 1e"),
    (lambda file: file["proofs"].attrs.clear(), "the proof max_inertial_number is missing"),
    (lambda file: file["parameters"].attrs.update(strain_end=0.8), "strain_end = 0.8 was planned"),
])  # fmt: skip
def test_results_are_not_built_from_a_product_that_fails(tmp_path, change, words):
    plan, points, info = synthetic.make_campaign(tmp_path, n=3)
    row: SimpleNamespace = next(row for row in plan.itertuples() if row.stage == "shear")
    with h5py.File(row.product, "r+") as file:
        change(file)
    with pytest.raises(RunFileError, match=f"run {row.run_id}: .*{words}"):
        build_results(tmp_path, plan, points, info)
    assert not (tmp_path / "results.h5").exists()


def test_a_steady_run_may_end_early_but_not_before_steadiness_is_judged(tmp_path):
    plan = synthetic.plan_rows(tmp_path, synthetic.representative_points(3))
    row = next(row for row in plan.itertuples() if row.stage == "shear")
    for end in (0.3, 0.2):
        synthetic.write_run(row, end=end, windows=60, exit_reason="steady")
        if end > gate.STEADY_FROM:
            gate.check_product(read_run(row.product))
    with pytest.raises(RunFileError, match="ends as steady at strain 0.2 < 0.25"):
        gate.check_product(read_run(row.product))


def without_balance(file):
    """An example run as LAMMPS writes it: what the balance leaves for friction in place of the work of friction."""
    file.attrs.update(code="lammps", not_given="E_friction,energy_error")
    file["record/E_residual"] = file["record/E_friction"][()]
    file["record/E_friction"][...] = np.nan
    file["proofs"].attrs.update(energy_error=np.nan, friction_residual=0.98)


def test_a_code_that_does_not_count_friction_passes_without_an_energy_balance(tmp_path):
    run = changed(tmp_path, "shear", without_balance)
    gate.check_product(run)
    assert np.isnan(run.record["E_friction"]).all() and np.isnan(run_summary(run).facts["energy_error"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda file: file["proofs"].attrs.update(energy_error=0.02), r"claims an energy balance \(0.02\)"),
        (lambda file: file.attrs.update(not_given="E_friction"), "claims an energy balance"),
        (lambda file: file["proofs"].attrs.update(friction_residual=-0.11), "friction_residual = -0.11 is not within"),
        (lambda file: file["proofs"].attrs.update(friction_residual=np.nan), "friction_residual = nan is not within"),
        (lambda file: file["proofs"].attrs.pop("friction_residual"), "friction_residual = missing is not within"),
        (lambda file: file.attrs.pop("code"), "the proof energy_error = nan is not finite"),
    ],
)
def test_a_residual_is_no_proof_and_energy_out_of_nothing_is_refused(tmp_path, change, words):
    def both(file):
        without_balance(file)
        change(file)

    with pytest.raises(RunFileError, match=words):
        gate.check_product(changed(tmp_path, "shear", both))


def test_a_quantity_that_is_not_given_must_be_named(tmp_path):
    def unnamed(file):
        without_balance(file)
        file.attrs["not_given"] = "energy_error"

    with pytest.raises(RunFileError, match=r"/record/E_friction\[0\] is not finite"):
        _ = changed(tmp_path, "shear", unnamed).record["E_friction"]
