"""Runs of every path and direction: signs, states in closed form, early ends, and what the gate refuses."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import synthetic_paths
import synthetic_results as synthetic

from analysis.errors_and_files import RunFileError
from analysis.quantities import DRAINED, Loading, responses_of
from analysis.runs import undrained
from analysis.runs.archive import Archive, run_summary, write_archive
from analysis.runs.peak_critical import dilatancy, off_axis
from analysis.runs.run_file import read_run

TESTS = [Loading(path, direction) for path in ("drained", "constant_p", "undrained")
         for direction in ("compression", "extension")]  # fmt: skip


def run_of(tmp_path, loading, mu_iso=0.001, change=None, **options):
    """The product of one run, `change` made to its open file."""
    plan = synthetic.plan_rows(tmp_path, synthetic.representative_points(2), densities=(mu_iso,))
    row = next(row for row in plan.itertuples() if row.stage == "shear")
    synthetic_paths.write_shear(row, loading, **options)
    if change:
        with h5py.File(row.product, "r+") as file:
            change(file)
    return row, read_run(row.product)


@pytest.mark.parametrize("loading", TESTS, ids=lambda loading: loading.words)
def test_every_test_gives_its_closed_forms_with_the_signs_of_a_laboratory(tmp_path, loading):
    row, run = run_of(tmp_path, loading)
    found = run_summary(run).states
    assert found.loading == loading and found.end == "" and list(found.responses) == list(responses_of(loading.path))
    assert np.all(np.diff(found.eps_a) > 0) and found.eps_a[-1] == pytest.approx(0.4)
    exact = synthetic_paths.eta(found.eps_a, row.mu_s, row.mu_iso, loading)
    assert found.responses["eta"] == pytest.approx(exact)
    peak, critical = found.states["peak"], found.states["critical"]
    assert peak["eta"] * loading.sign == pytest.approx(np.abs(exact).max(), rel=0.01)
    assert critical["eta"] == pytest.approx(exact[-1], rel=0.01) and critical["eta"] * loading.sign > 0
    assert critical["q"] == pytest.approx(critical["eta"] * critical["p"], rel=1e-3)
    p = {"constant_p": 1e5, "undrained": synthetic_paths.critical_pressure(row.mu_s, row.mu_iso)}.get(
        loading.path, 1e5 / (1 - exact[-1] / 3)
    )
    assert critical["p"] == pytest.approx(p, rel=0.01)
    assert ("D_p" in peak) == ("transformation" not in found.states) == (not loading.is_undrained)


def test_drained_compression_is_what_a_product_without_a_word_of_it_is(tmp_path):
    row, run = run_of(tmp_path, DRAINED)
    with h5py.File(row.product, "r+") as file:
        for name in ("path", "direction", "stiff_cap"):
            del file["parameters"].attrs[name]
    older = read_run(row.product)
    assert older.loading == DRAINED == run.loading
    new, old = run_summary(run), run_summary(older)
    assert new.facts == old.facts and "path" not in new.facts and new.states.states == old.states.states


def test_pore_pressure_transformation_and_strength_have_known_values():
    sigma = np.array([np.diag([80e3, 60e3, 130e3])])
    assert undrained.pore_pressure(sigma, 100e3)["u"] == pytest.approx([30e3])
    assert undrained.pore_pressure(sigma, 100e3)["r_u"] == pytest.approx([0.3])
    strain = np.linspace(0, 0.4, 401)
    p = 1e5 * (0.6 + 40 * (strain - 0.1) ** 2)  # a parabola, which the fit follows
    found = undrained.transformation(strain, p, 2 * strain)
    assert found == pytest.approx({"eps_pt": 0.1, "p": 0.6e5, "eta": 0.2}, rel=1e-6)
    for monotonic in (1e5 * np.exp(-strain), 1e5 * np.exp(strain), np.full(401, 1e5)):
        assert all(np.isnan(value) for value in undrained.transformation(strain, monotonic, strain).values())
    steady = 1e5 * np.exp(-strain / 0.02) + 2e4 * (1 + 0.02 * np.sin(300 * strain))  # no rise after it
    assert np.isnan(undrained.transformation(strain, steady, strain)["p"])
    curves = {"q": 1e6 * strain, "p": 2e6 * strain**2, "eta": 5 * strain, "u": -3e5 * strain}
    found = undrained.strength(strain, curves, 1.0)
    assert found == pytest.approx({"q": 1e5, "p": 2e4, "eta": 0.5, "u": -3e4, "s_u": 5e4})
    below = undrained.strength(strain, curves | {"q": -curves["q"]}, -1.0)
    assert (below["q"], below["s_u"]) == (pytest.approx(-1e5), pytest.approx(5e4))
    short = strain <= 0.09
    early = undrained.strength(strain[short], {name: values[short] for name, values in curves.items()}, 1.0)
    assert all(np.isnan(value) for value in early.values())


def test_dilatancy_is_positive_in_extension_where_the_sample_dilates():
    strain = np.linspace(0, 0.2, 101)
    p = q = np.zeros(101)
    down = dilatancy(strain, -0.3 * strain, p, q)
    up = dilatancy(strain, -0.3 * strain, p, q, sign=-1.0)
    assert down[50] == pytest.approx(0.3 / 1.1) and up[50] == pytest.approx(0.3 / 0.9)


def test_axes_off_the_principal_ones_raise_the_magnitude_in_both_directions():
    """A tensor turned by a small angle: the principal values differ from the axes by the same share."""
    turn = np.array([[np.cos(0.1), 0, -np.sin(0.1)], [0, 1, 0], [np.sin(0.1), 0, np.cos(0.1)]])
    for axial, sign in ((3.0, 1.0), (0.4, -1.0)):
        tensor = turn @ np.diag([1.0, 1.0, axial]) @ turn.T
        found = off_axis(tensor[None], sign)
        assert 0.0 < found["eta_mean"] < 0.05


@pytest.mark.parametrize("loading", TESTS[-2:], ids=lambda loading: loading.words)
def test_a_test_that_liquefied_ends_there_and_has_no_state_that_it_did_not_reach(tmp_path, loading):
    row, run = run_of(tmp_path, loading, 0.1, end="liquefied")
    assert not np.isfinite(run.record["e_m"]).all()
    found = run_summary(run).states
    assert (found.end, found.end_strain) == ("liquefied", synthetic_paths.LIQUEFIED_AT)
    assert found.eps_a[-1] < synthetic_paths.LIQUEFIED_AT
    assert all(np.isfinite(values).all() for values in found.responses.values())
    for state in ("critical", "transformation"):
        assert all(np.isnan(v) for name, v in found.states[state].items() if not name.startswith("I_G")), state
    assert "liquefied" in found.unsteady and np.isfinite(found.states["peak"]["eta"])


def test_a_test_that_became_stiff_keeps_what_it_passed(tmp_path):
    row, run = run_of(tmp_path, Loading("undrained"), end="stiff")
    found = run_summary(run).states
    assert found.end == "stiff" and found.end_strain == found.eps_a[-1] < 0.1
    assert found.states["initial"]["p"] == pytest.approx(1e5) and np.isnan(found.states["critical"]["eta"])
    assert np.isnan(found.states["strength"]["s_u"])


def test_an_end_within_a_few_rows_leaves_the_initial_state(tmp_path, monkeypatch):
    monkeypatch.setattr(synthetic_paths, "LIQUEFIED_AT", 0.0013)
    monkeypatch.setattr(synthetic_paths, "LIQUEFIED_END", 0.02)
    _, run = run_of(tmp_path, Loading("undrained"), 0.1, end="liquefied")
    found = run_summary(run).states
    assert found.end == "liquefied" and len(found.eps_a) == 1 and np.isnan(found.states["peak"]["eta"])


def test_contacts_may_be_missing_after_liquefaction_and_nowhere_else(tmp_path):
    def early(file):
        file["record/e_m"][3] = np.inf

    def without_ends(file):
        file.attrs["exit_reason"] = "strain_end"

    for name, change in (("e_m", early), ("e_m", without_ends)):
        _, run = run_of(tmp_path, Loading("undrained"), 0.1, change, end="liquefied")
        with pytest.raises(RunFileError, match=rf"/record/{name}\[\d+\] is not finite"):
            run.record[name]
    _, run = run_of(tmp_path, Loading("undrained"), 0.1, lambda f: f["record/e"].write_direct(np.full(25, np.nan)),
                    end="liquefied")  # fmt: skip
    with pytest.raises(RunFileError, match="/record/e.* is not finite"):
        run_summary(run)


def test_an_archive_keeps_tests_and_ends(tmp_path):
    summaries = {}
    for k, (loading, end) in enumerate([(DRAINED, ""), (TESTS[1], ""), (TESTS[4], "liquefied"), (TESTS[4], "stiff")]):
        summaries[f"run{k}"] = run_summary(run_of(tmp_path, loading, 0.1, end=end)[1])
    write_archive(tmp_path / "runs.h5", summaries)
    archive = Archive(tmp_path / "runs.h5")
    for run_id, summary in summaries.items():
        kept = archive[run_id]
        assert (kept.states.loading, kept.states.end) == (summary.states.loading, summary.states.end)
        assert np.array_equal(kept.states.eps_a, summary.states.eps_a)
        assert kept.facts.get("path", "drained") == summary.states.loading.path
    assert "end_strain" in archive["run2"].facts and "path" not in archive["run0"].facts


def at(name, index, value):
    def change(file):
        file["record"][name][index] = value

    return change


def attribute(place, **values):
    return lambda file: (file[place] if place else file).attrs.update(values)


def scaled(name, index, factor):
    def change(file):
        file["record"][name][index] = factor * file["record"][name][index]

    return change


UNDRAINED, EXTENSION, CONSTANT_P = Loading("undrained"), Loading("drained", "extension"), Loading("constant_p")
REFUSED = [
    (UNDRAINED, "", at("e", 30, 0.55), "volume over that at the start - 1 = 0.006"),
    (UNDRAINED, "", attribute("proofs", servo_max_error=2e-9), "the proof servo_max_error = 2e-09 exceeds 1e-09"),
    (UNDRAINED, "", scaled("sigma", slice(0, 1), 2.0), "p' / sigma_3 at the start = 2 is not within"),
    (UNDRAINED, "", scaled("sigma", slice(40, None), 9.0), "p' jumps by the factor"),
    (UNDRAINED, "", attribute("parameters", stiff_cap=2e5), "p' / cap = .* exceeds 1"),
    (UNDRAINED, "", attribute("parameters", stiff_cap=-1.0), "stiff_cap / sigma_3 = -1e-05 is not within"),
    (UNDRAINED, "", attribute("parameters", strain_end=0.8), "ends at strain 0.4, strain_end = 0.8 was planned"),
    (UNDRAINED, "stiff", attribute("parameters", stiff_cap=1e8), "ends as stiff at p' / sigma_3 ="),
    (UNDRAINED, "liquefied", attribute("", liquefied_from=-0.5), r"liquefied_from = -0.5 is not within \(0, 0.12"),
    (UNDRAINED, "liquefied", attribute("", liquefied_from=0.5), "/record/e_m.* is not finite"),
    (UNDRAINED, "liquefied", attribute("", liquefied_from="late"), "liquefied_from = nan|not finite"),
    (UNDRAINED, "liquefied", attribute("", liquefied_from=0.05), "p' / sigma_3 after it liquefied = .* exceeds 0.05"),
    (UNDRAINED, "", attribute("parameters", path="sideways"), "path 'sideways', direction 'compression' are no test"),
    (CONSTANT_P, "", at("servo_mean", 50, 0.01), r"mean p' / sigma_3 - 1 = 0.01 .*\(-0.002, 0.002"),
    (CONSTANT_P, "", scaled("sigma", 50, 1.5), r"[^n] p' / sigma_3 - 1 = 0.5 at strain"),
    (CONSTANT_P, "", attribute("proofs", servo_mean_error=0.003), "servo_mean_error = 0.003 exceeds 0.002"),
    (EXTENSION, "", scaled("sigma", slice(50, None), 1.05), "lateral stress / sigma_3 - 1 = 0.05"),
    (EXTENSION, "", at("sigma", (50, 2, 2), 4e5), "sigma_z / lateral stress = 4 at strain 0.25 .*0.1, 2"),
    (EXTENSION, "", at("sigma", (50, 2, 2), 1.9e5), "sigma_z jumps by the factor"),
    (EXTENSION, "", at("eps_a", 50, -0.1), "eps_a falls from .* it must increase strictly"),
]  # fmt: skip


@pytest.mark.parametrize("loading, end, change, words", REFUSED)
def test_the_gate_judges_each_test_by_its_own_rules(tmp_path, loading, end, change, words):
    _, run = run_of(tmp_path, loading, 0.1 if end == "liquefied" else 0.001, change, end=end)
    with pytest.raises(RunFileError, match=words) as told:
        run_summary(run)
    assert "\n" not in str(told.value)


def test_only_undrained_tests_end_early(tmp_path):
    _, run = run_of(tmp_path, EXTENSION, change=attribute("parameters", strain_end=0.8))
    for reason in ("stiff", "liquefied"):
        run.attrs["exit_reason"] = reason
        with pytest.raises(RunFileError, match="strain_end = 0.8 was planned"):
            run_summary(run)
