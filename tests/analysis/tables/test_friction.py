"""Responses along friction: closed forms found again within intervals that cover, densities told apart."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis.figures.friction import along
from analysis.quantities import QUANTITIES
from analysis.report.friction import density_words
from analysis.report.friction import friction as friction_html
from analysis.results.build import build_results
from analysis.results.reader import Results, Runs, read_results
from analysis.tables import evaluate, friction

FRICTION = ("friction", "published_shear", "density_differences")


def built(folder, **options):
    plan, points, info = synthetic.make_campaign(folder, **options)
    return read_results(build_results(folder, plan, points, info))


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Thirty-two points in eight packings, 2 % noise."""
    return built(tmp_path_factory.mktemp("friction"), n=32, noise=0.02, packings=tuple(range(1, 9)))


def critical_eta(results):
    frame = friction.friction_table(results)
    return frame[(frame["state"] == "critical") & (frame["quantity"] == "eta")]


def test_the_critical_stress_ratio_is_its_closed_form_within_the_interval(campaign):
    frame = critical_eta(campaign)
    assert len(frame) >= 9 and set(frame["mu_iso"]) == set(synthetic.DENSITIES)
    off = (frame["value"] - synthetic.critical_eta(frame["mu_s"])).abs()
    assert np.all(off < 1.5 * frame["ci95"]) and np.all(frame["ci95"] < 0.05 * frame["value"])


def test_densities_differ_at_the_peak_and_are_not_shown_to_at_the_critical_state(campaign):
    frame = friction.friction_table(campaign)
    eta = frame[frame["quantity"] == "eta"].set_index(["state", "mu_s", "mu_iso"])
    extreme = eta.loc["peak"].query("mu_iso in (0.001, 0.1)")
    assert set(extreme["differs"]) == {"yes"} and (eta.loc["critical"]["differs"] == "yes").mean() < 0.2
    words = density_words(friction.density_differences(frame))
    off = eta.loc["critical"]["diff_from_mean"].abs().max() / eta.loc["critical"]["value"].mean()
    assert float(words.split("within ")[1].split(" %")[0]) == pytest.approx(100 * off, rel=0.5)
    assert f"of {len(eta.loc['critical'])} differences" in words


@pytest.mark.parametrize(("between", "own"), [(0.03, 0.01), (0.0, 0.03), (0.03, 0.03)])
def test_the_interval_covers_what_packings_and_runs_do(campaign, between, own, monkeypatch):
    """A response that rises with ln mu_s, but for packings that differ at every density, and runs that scatter."""
    rng, covered, differences = np.random.default_rng(7), [], []
    x, packing = np.log(campaign.family_points().mu_s), campaign.packing(0.04)
    ends = np.exp(np.quantile(x, [0.1, 0.5, 0.9]))
    for _ in range(16):
        campaign._cache.clear()
        of_packing = {m: between * rng.normal(size=9)[packing] for m in synthetic.DENSITIES}
        values = {m: x + off + own * rng.normal(size=len(x)) for m, off in of_packing.items()}
        monkeypatch.setattr(Results, "runs_at", lambda _, s, q, m, f="coupled", values=values: Runs(
            values[m], packing, np.arange(len(x))))  # fmt: skip
        found = friction.along_friction(campaign, "critical", "e", ends)
        covered += [np.abs(value - np.log(ends)) < half for value, half in found.values()]
        found = friction.differences_along(campaign, "critical", "e", ends)
        differences += [np.abs(value) < half for value, half in found.values()]
    campaign._cache.clear()
    assert np.mean(covered) > 0.9 and np.mean(differences) > 0.9


def test_the_modulus_is_that_of_the_points_of_that_friction(campaign):
    points = campaign.family_points()
    rest = np.log(friction.variable_along(campaign, "G_p", points.mu_s) / points.G_p)
    assert rest @ points.probability == pytest.approx(0, abs=1e-9)
    assert (rest * np.log(points.mu_s)) @ points.probability == pytest.approx(0, abs=1e-9)


def test_the_report_has_the_table_and_the_figure_its_curves(campaign):
    html = friction_html(evaluate(campaign, FRICTION), campaign.density_names())
    assert (
        "<th>Stress ratio η, medium</th>" in html and html.count("<tr") == 1 + critical_eta(campaign)["mu_s"].nunique()
    )
    figure = along(campaign, friction.friction_curves(campaign))
    for axis in figure.axes:
        assert len(axis.lines) == 6 and len(axis.collections) == 3
        assert axis.get_xlabel() == QUANTITIES["mu_s"].label
    assert len(figure.axes[0].get_legend().get_texts()) == 3


def test_few_points_one_packing_and_one_density_make_no_false_statement(tmp_path):
    few = read_results(synthetic.example())
    assert not len(friction.friction_table(few)) and "no table" in friction_html(
        evaluate(few, (*FRICTION, "report_facts")), few.density_names()
    )
    assert all(len(axis.lines) == 3 for axis in along(few, friction.friction_curves(few)).axes)
    frame = critical_eta(built(tmp_path / "packing", n=12, noise=0.02))
    assert (
        len(frame)
        and set(frame["differs"]) == {""}
        and "fewer than three packings" in density_words(friction.density_differences(frame))
    )
    alone = frame[frame["mu_iso"] == 0.04]
    assert "With one density" in density_words(friction.density_differences(alone))
