"""The stopping rule: targets, nested order, when it stops, what it fills in."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import dem_like_states, joint_inputs, sobol_normals
from bench_stopping import assessments

from analysis.surrogates import stopping, surrogate

SAMPLES = joint_inputs(sobol_normals(512, 5))


@pytest.mark.parametrize(("given", "share"), [("2%", 0.02), (" 5 %", 0.05), (0.1, 0.1), ("0.03", 0.03)])
def test_targets_are_read(given, share):
    assert stopping.parse_target(given) == pytest.approx(share)


@pytest.mark.parametrize("given", ["soon", "-2%", 0, 2, "150%", None])
def test_other_targets_are_refused(given):
    with pytest.raises(ValueError, match="stop_when = .*expected a share"):
        stopping.parse_target(given)


def test_every_beginning_of_the_nested_order_covers_the_range():
    inputs = joint_inputs(sobol_normals(100, 1))
    order = stopping.nested_order(inputs)
    assert sorted(order) == list(range(100))
    first = np.log(inputs[order[:12]])
    assert np.all(np.ptp(first, axis=0) > 0.85 * np.ptp(np.log(inputs), axis=0))


def test_points_of_replicate_packings_come_first_and_the_rest_stays_in_its_order():
    inputs = np.exp(np.random.default_rng(1).normal(size=(40, 2)))
    first = np.zeros(40, bool)
    first[[7, 11, 30]] = True
    order, plain = stopping.nested_order(inputs, first), stopping.nested_order(inputs)
    assert set(order[:3]) == {7, 11, 30}
    assert [k for k in plain if not first[k]] == list(order[3:])


def campaign(noise: float, seed: int = 1):
    """Points in nested order and a function that makes their runs."""
    rng = np.random.default_rng(seed)
    inputs = joint_inputs(sobol_normals(100, seed))
    inputs = inputs[stopping.nested_order(inputs)]

    def evaluate(at):
        return {k: v + noise * rng.normal(size=len(at)) for k, v in dem_like_states(inputs[at]).items()}

    return inputs, evaluate


def test_quiet_runs_stop_early_and_noisy_ones_later():
    counts = []
    for noise in (0.002, 0.006, 0.02):
        inputs, evaluate = campaign(noise)
        history = assessments(inputs, evaluate(np.arange(100)), SAMPLES, "5%")
        counts.append(history[-1].runs)
        assert [h.runs for h in history] == [13, 21, 29, 37, 45, 53, 61, 69, 77, 85, 93, 100][: len(history)]
        assert not any(h.reached for h in history[:-1])
        assert history[-1].reached == (max(history[-1].claimed.values()) <= 0.05)
    assert counts[0] < counts[1] < counts[2] <= 100 and counts[1] < 45
    assert "5.0% asked" in history[-1].sentence()


def test_the_claim_is_above_the_true_error_and_shrinks_with_the_runs():
    inputs, evaluate = campaign(0.006)
    truth = np.sort(dem_like_states(SAMPLES)["critical"])
    claims = []
    for n in (15, 60):
        runs = evaluate(np.arange(n))
        claims.append(stopping.assess(inputs[:n], runs, SAMPLES, "1%").claimed["critical"])
        surface = stopping.surrogate.fit(inputs[:n], runs["critical"])
        error = np.mean(np.abs(np.sort(surface.predict(SAMPLES)[0]) - truth)) / truth.std()
        assert error < claims[-1]
    assert claims[1] < 0.7 * claims[0]


def test_below_twelve_usable_runs_nothing_is_claimed():
    inputs, evaluate = campaign(0.006)
    values = evaluate(np.arange(14))
    values["peak"][:4] = np.nan
    judged = stopping.assess(inputs[:14], values, SAMPLES, "50%")
    assert judged.claimed["peak"] == float("inf") and np.isfinite(judged.claimed["critical"]) and not judged.reached


def test_missing_points_are_filled_and_marked():
    inputs, evaluate = campaign(0.002)
    values = np.stack(list(evaluate(np.arange(100)).values()))
    known = values.copy()
    known[:, 40:] = np.nan
    filled, marked = surrogate.fill(inputs, known)
    assert np.array_equal(marked, np.isnan(known)) and np.array_equal(filled[:, :40], values[:, :40])
    assert np.max(np.abs(filled - values)) < 0.02
