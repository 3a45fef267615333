"""The numbers to quote, the names of the densities, and what `Results` computes from its states."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
import synthetic_results as synthetic

from analysis.inputs.joint import Joint
from analysis.quantities import QUANTITIES, rounded
from analysis.results import models
from analysis.results.build import build_results
from analysis.results.densities import density_names
from analysis.results.friction_angle import friction_angle
from analysis.results.quote import OF_MODEL, OF_POINTS, QUOTED, WITHHELD
from analysis.results.reader import NotReachedError, ResultsError, read_results
from analysis.results.standing import NOT_REACHED, Standing
from analysis.tables.friction_angles import friction_angle_table
from analysis.tables.moments import moments


@pytest.fixture(scope="module")
def few():
    """Five points, three densities, noise."""
    return read_results(synthetic.example(noise=0.02))


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """Twelve points without noise at one density."""
    folder = tmp_path_factory.mktemp("one")
    points = synthetic.representative_points(12)
    plan = synthetic.plan_rows(folder, points, densities=(0.04,))
    for row in plan.itertuples():
        synthetic.write_run(row, windows=40)
    return read_results(build_results(folder, plan, points, synthetic.campaign_info()))


@pytest.fixture(scope="module")
def quoted(one):
    """The numbers of the one density, with fewer draws and refits."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(models, "REFITS", 5)
        patch.setattr(models, "moments_and_quantiles", partial(models.moments_and_quantiles, n=40))
        return one.quote().set_index(["state", "quantity"])


def test_the_numbers_are_those_of_the_closed_form(one, quoted):
    inputs = Joint.from_dict(one.inputs["joint"]).sample(100_000, np.random.default_rng(1))
    eta = synthetic.critical_eta(inputs[:, 0])
    stiffness = synthetic.stiffness(inputs[:, 1], 0.04) * 1e-6
    for key, exact in ((("critical", "phi"), friction_angle(eta)), (("critical", "eta"), eta),
                       (("probe", "G_0"), stiffness)):  # fmt: skip
        row = quoted.loc[key]
        wanted = {
            "mean": exact.mean(),
            "sd": exact.std(),
            "q05": np.quantile(exact, 0.05),
            "q95": np.quantile(exact, 0.95),
        }
        for name, value in wanted.items():
            if key != ("probe", "G_0") or name == "mean":  # its tails are beyond twelve points
                assert abs(row[name] - value) <= row[f"{name}_pm"], (key, name)
            assert 0 < row[f"{name}_pm"] < 0.25 * exact.mean()
    assert set(quoted["basis"]) == {OF_MODEL} and list(quoted.index) == list(QUOTED)
    assert set(quoted["density"]) == {"one density"} and set(quoted["void_ratio"]) == {synthetic.E_0[0.04]}


def test_they_are_rounded_together_and_the_same_as_in_the_other_tables(one, quoted):
    for row in quoted.to_dict("records"):
        for name in ("mean", "sd", "q05", "q95"):
            texts = rounded(row[name], row[f"{name}_pm"])
            assert (float(texts[0]), float(texts[1])) == (row[name], row[f"{name}_pm"])
    frame = moments(one).query("kind == 'denoised'").set_index(["state", "quantity"])
    angles = friction_angle_table(one).query("kind == 'denoised'").set_index("state")
    for (state, symbol), row in quoted.iterrows():
        other = angles.loc[state] if symbol == "phi" else frame.loc[(state, symbol)]
        end = "_deg" if symbol == "phi" else ""
        for name in ("mean", "sd", "q05", "q95"):
            value, low, high = (other[f"{name}{end}{part}"] for part in ("", "_low", "_high"))
            assert row[name] == float(rounded(value, max(high - value, value - low))[0])


def test_few_runs_have_the_numbers_of_the_points_and_no_uncertainty(few):
    frame = few.quote()
    assert set(frame["basis"]) == {OF_POINTS} and len(frame) == 30 and frame.filter(regex="_pm$").isna().all(axis=None)
    row = frame.set_index(["density", "state", "quantity"]).loc[("medium", "peak", "phi")]
    angles, p = friction_angle(few.state("peak", "eta", 0.04)), few.probability(0.04)
    assert row["mean"] == pytest.approx(angles @ p, rel=5e-3) and row["unit"] == "deg"
    assert list(frame["density"].unique()) == ["dense", "medium", "loose"]
    frame.loc[:, "mean"] = 0.0
    assert few.quote()["mean"].abs().min() > 0  # a copy


def test_a_state_that_was_not_reached_is_withheld(few, monkeypatch):
    short = Standing(NOT_REACHED, "the test ends too early")
    real = type(few).standing
    monkeypatch.setattr(type(few), "standing", lambda self, state, *rest: short if state == "critical" else
                        real(self, state, *rest))  # fmt: skip
    frame = replace(few, _cache={}).quote().set_index(["mu_iso", "state", "quantity"])
    critical = frame.xs("critical", level="state")
    assert set(critical["basis"]) == {WITHHELD} and critical[["mean", "sd", "q05", "q95"]].isna().all(axis=None)
    assert set(critical["standing"]) == {NOT_REACHED} and frame.xs("peak", level="state")["mean"].notna().all()
    with pytest.raises(NotReachedError, match="critical state of coupled, 'dense'"):
        few.friction_angle("critical", "dense")
    with pytest.raises(NotReachedError, match="mu_iso = 0.1"):
        few.joint("eta", "e", mu_iso=0.1)


@pytest.mark.parametrize("count, names", [
    (1, ["one density"]), (2, ["dense", "loose"]), (4, ["dense", "medium dense", "medium loose", "loose"]),
    (5, ["very dense", "dense", "medium", "loose", "very loose"]),
    (6, [f"density {k}" for k in range(1, 7)]),
])  # fmt: skip
def test_densities_have_names_in_the_order_of_mu_iso(count, names):
    frictions = np.linspace(0.3, 0.01, count)
    assert list(density_names(frictions).values()) == names and list(density_names(frictions)) == sorted(frictions)
    assert density_names(()) == {}


def test_a_density_is_given_by_its_name_or_by_mu_iso(few):
    assert few.density_names() == {0.001: "dense", 0.04: "medium", 0.1: "loose"}
    for ask in (few.symbols, few.probability, few.packing, few.filled):
        np.testing.assert_array_equal(ask("loose"), ask(0.1))
    assert few.counts("loose") == few.counts(0.1)
    np.testing.assert_array_equal(few.response("eta", "loose").values, few.response("eta", 0.1).values)
    for ask in (few.state, few.measured, few.shown_state, few.state_error):
        np.testing.assert_array_equal(ask("peak", "eta", "loose"), ask("peak", "eta", 0.1))
    assert few.standing("peak", "dense") is few.standing("peak", 0.001)
    np.testing.assert_array_equal(few.consolidated("e", "medium")[0], few.consolidated("e", 0.04)[0])
    for wrong in ("denser", 0.5, None, "0.04"):
        with pytest.raises(ResultsError, match=r"no density .*, only 0.001 .dense., 0.04 .medium., 0.1 .loose."):
            few.state("peak", "eta", wrong)


def test_states_give_angles_and_pdfs_with_scalars(few):
    eta, p = few.state("critical", "eta", "dense"), few.probability("dense")
    assert few.friction_angle("critical", "dense") == pytest.approx(np.degrees(np.arcsin(3 * eta / (6 + eta))))
    pdf = few.state_pdf("critical", "eta", "dense")
    for number, exact in ((pdf.mean, eta @ p), (pdf.std, np.sqrt(p @ (eta - eta @ p) ** 2))):
        assert type(number) is float and number == pytest.approx(exact)
    assert type(pdf.exceedance(0.6)) is float and 0 < pdf.exceedance(0.6) < 1
    assert pdf.quantile(0.05) < pdf.mean < pdf.quantile(0.95)
    assert pdf.x.shape == pdf.p.shape and pdf.p.sum() * (pdf.x[1] - pdf.x[0]) == pytest.approx(1)


def test_the_joint_pdf_is_that_of_one_density_or_of_all(few):
    eta, e, p = few.state("critical", "eta", "loose"), few.state("critical", "e", "loose"), few.probability("loose")
    joint = few.joint("eta", "e", mu_iso="loose")
    covariance = p @ ((eta - eta @ p) * (e - e @ p))
    assert joint.correlation == pytest.approx(covariance / np.sqrt(p @ (eta - eta @ p) ** 2 * (p @ (e - e @ p) ** 2)))
    together = few.joint("eta", "e")
    assert len(together.values1) == 15 and together.probability.sum() == pytest.approx(1)


def test_strains_have_the_unit_of_their_label(few):
    response = few.response("eta", "dense")
    assert QUANTITIES["eps_a"].label.endswith("(%)") and response.strain_pct[-1] == pytest.approx(40.0)
    assert isinstance(few.quote(), pd.DataFrame)
