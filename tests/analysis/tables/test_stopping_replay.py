"""The stopping rule replayed: what a campaign with the rule would have done, from the results of one without."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis.inputs.joint import Joint
from analysis.pdem import weighted
from analysis.results.build import build_results
from analysis.results.reader import read_results
from analysis.surrogates import stopping, surrogate
from analysis.surrogates.rotation import nested_order
from analysis.tables.stopping_replay import stopping_replay


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Thirty-six points in six packings at one density, with 2 % noise."""
    folder = tmp_path_factory.mktemp("replay")
    points = synthetic.representative_points(36)
    plan = synthetic.plan_rows(folder, points, densities=(0.04,), packings=(1, 2, 3, 4, 5, 6))
    for row in plan.itertuples():
        synthetic.write_run(row, noise=0.02, windows=30)
    return read_results(build_results(folder, plan, points, synthetic.campaign_info()))


@pytest.fixture(scope="module")
def table(results):
    return stopping_replay(results, ("60%", "20%", "0.1%")).set_index("target")


def test_it_stops_where_the_rule_would_have_stopped(results, table):
    inputs = results.family_points().x
    samples = stopping.judged_samples(Joint.from_dict(results.inputs["joint"]))
    values = {k: results.state(*k, 0.04) for k in stopping.JUDGED}
    order, used, packing = nested_order(inputs), stopping.first_batch(36), results.packing(0.04)
    while True:
        part = order[:used]
        some = {str(k): v[part] for k, v in values.items()}
        found = stopping.assess(inputs[part], some, samples, "20%", packing[part])
        if found.reached or used == 36:
            break
        used = stopping.next_batch(used, 36)
    assert table.loc["20%", "points"] == table.loc["20%", "shear_runs"] == used
    assert table.loc["20%", "claimed"] == pytest.approx(max(found.claimed.values()))


def test_a_smaller_error_takes_more_runs_and_one_out_of_reach_all(table):
    assert list(table["points"]) == sorted(table["points"]) and table.loc["60%", "points"] == 12
    last = table.loc["0.1%"]
    assert last["points"] == 36 and last["verdict"] == "not reached" and last["error_all_runs"] == 0


def test_the_true_error_is_the_distance_of_filled_points_to_all(results, table):
    inputs, weight = results.family_points().x, results.probability(0.04)
    part = nested_order(inputs)[:12]
    every = np.stack([results.state(*k, 0.04) for k in stopping.JUDGED])
    some = np.full_like(every, np.nan)
    some[:, part] = every[:, part]
    filled, missing = surrogate.fill(inputs, some, results.packing(0.04))
    assert missing.sum() == 3 * 24
    off = [weighted.wasserstein(a, b, weight, weight) / weighted.std(b, weight)
           for a, b in zip(filled, every, strict=True)]  # fmt: skip
    assert table.loc["60%", "error_all_runs"] == pytest.approx(max(off))


def test_too_few_points_give_no_row():
    assert not len(stopping_replay(read_results(synthetic.example())))


def test_the_rule_claims_nothing_with_one_packing(tmp_path):
    plan, points, info = synthetic.make_campaign(tmp_path, n=14, noise=0.02)
    table = stopping_replay(read_results(build_results(tmp_path, plan, points, info)), ("50%",))
    assert np.isinf(table["claimed"]).all() and set(table["verdict"]) == {"not reached"}
