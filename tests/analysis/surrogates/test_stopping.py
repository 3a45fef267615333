"""The stopping rule: targets, when it stops, and what it cannot judge."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_cases import dem_like_states, joint_inputs, sobol_normals

from analysis.surrogates import stopping, surrogate
from analysis.surrogates.rotation import deal, nested_order

SAMPLES = joint_inputs(sobol_normals(512, 5))


@pytest.mark.parametrize(("given", "share"), [("2%", 0.02), (" 5 %", 0.05), (0.1, 0.1), ("0.03", 0.03)])
def test_targets_are_read(given, share):
    assert stopping.parse_target(given) == pytest.approx(share)


@pytest.mark.parametrize("given", ["soon", "-2%", 0, 2, "150%", None])
def test_other_targets_are_refused(given):
    with pytest.raises(ValueError, match="stop_when = .*expected a share"):
        stopping.parse_target(given)


def campaign(noise: float, seed: int = 1):
    """Points in nested order, their packings, and the values of their runs."""
    rng = np.random.default_rng(seed)
    inputs = joint_inputs(sobol_normals(100, seed))
    inputs = inputs[nested_order(inputs)]
    packing = deal(inputs, 20)
    return inputs, packing, {k: v + noise * rng.normal(size=100) for k, v in dem_like_states(inputs).items()}


def assessments(inputs, packing, values, target):
    """What is said after each batch, up to the last."""
    used, out = stopping.first_batch(len(inputs)), []
    while True:
        part = {k: v[:used] for k, v in values.items()}
        out.append(stopping.assess(inputs[:used], part, SAMPLES, target, packing[:used]))
        if out[-1].reached or used == len(inputs):
            return out
        used = stopping.next_batch(used, len(inputs))


def test_quiet_runs_stop_early_and_noisy_ones_later():
    counts = []
    for noise in (0.002, 0.008, 0.025):
        history = assessments(*campaign(noise), "8%")
        counts.append(history[-1].runs)
        assert [h.runs for h in history] == [13, 21, 29, 37, 45, 53, 61, 69, 77, 85, 93, 100][: len(history)]
        assert not any(h.reached or h.unknown for h in history[:-1])
        assert history[-1].reached == (max(history[-1].claimed.values()) <= 0.08)
    assert counts[0] < counts[1] < counts[2] <= 100 and counts[0] < 45
    assert "8.0% asked" in history[-1].sentence()


@pytest.mark.parametrize("kind", ["smooth", "kinked", "flat in half of the range"])
def test_the_claim_is_above_the_true_error_and_shrinks_with_the_runs(kind):
    def response(x):
        u = np.log(x[:, 0] / 0.2)
        return {
            "smooth": dem_like_states(x)["critical"],
            "kinked": np.abs(u),
            "flat in half of the range": np.minimum(u, 0),
        }[kind]

    inputs, packing, _ = campaign(0.0)
    truth = np.sort(response(SAMPLES))
    noise = 0.1 * truth.std() * np.random.default_rng(4).normal(size=(30, 100))
    claims = []
    for n in (21, 61):
        values = {str(k): response(inputs[:n]) + row[:n] for k, row in enumerate(noise)}
        claimed = np.array(list(stopping.assess(inputs[:n], values, SAMPLES, "1%", packing[:n]).claimed.values()))
        model = surrogate.fit(inputs[:n], np.stack(list(values.values())), packing[:n])
        error = np.mean(np.abs(np.sort(model.predict(SAMPLES), axis=1) - truth), axis=1) / truth.std()
        assert np.mean(error <= claimed) >= 0.9
        claims.append(claimed.mean())
    assert claims[1] < 0.8 * claims[0]


def test_a_shared_effect_of_the_packings_is_part_of_the_claim():
    inputs, packing, values = campaign(0.005)
    rng = np.random.default_rng(2)
    shaken = {k: v + 0.05 * rng.normal(size=20)[packing] for k, v in values.items()}
    quiet, loud = (stopping.assess(inputs, v, SAMPLES, "1%", packing).claimed for v in (values, shaken))
    assert all(loud[k] > 2 * quiet[k] for k in values)


def test_below_twelve_usable_runs_nothing_is_claimed():
    inputs, packing, values = campaign(0.006)
    part = {k: v[:14].copy() for k, v in values.items()}
    part["peak"][:4] = np.nan
    judged = stopping.assess(inputs[:14], part, SAMPLES, "50%", packing[:14])
    assert judged.claimed["peak"] == float("inf") and np.isfinite(judged.claimed["critical"]) and not judged.reached
    assert "peak has 10 runs, and 12 are needed" in judged.sentence()


@pytest.mark.parametrize("packings", [None, 1, 2])
def test_with_fewer_than_three_packings_nothing_is_claimed(packings):
    inputs, _, values = campaign(0.006)
    labels = None if packings is None else np.arange(100) % packings
    judged = stopping.assess(inputs, values, SAMPLES, "50%", labels)
    assert not judged.reached and set(judged.claimed.values()) == {float("inf")}
    assert "packing" in judged.unknown and "cannot be judged" in judged.sentence()
