"""The stopping rule applied in hindsight to a campaign whose runs are all there: its runs, its claim and its error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ..inputs.joint import Joint
from ..pdem import weighted
from ..results.models import runs_needed
from ..results.reader import Results
from ..surrogates import stopping, surrogate
from ..surrogates.rotation import nested_order

#: Share of the points beyond which kept and full surface are too much alike to test a claim.
MOST = 0.7
TARGETS = ("20%", "10%", "5%", "2%")
COLUMNS = ("target", "points", "shear_runs", "share_of_runs", "claimed", "claimed_for", "error_all_runs", "worst_in",
           "error_surface", "verdict")  # fmt: skip


def stopping_replay(results: Results, targets: Sequence[str] = TARGETS) -> pd.DataFrame:
    """One row per target: where the rule would have stopped, the error it claims, and the true error.

    Batches, order of the points, samples and responses are those of a campaign with `pdem.stop_when`.  Errors are
    Wasserstein-1 distances over the standard deviation, the worst of all judged responses.  `error_all_runs`: between
    the points, those not run filled by regression, and the points all run; it contains the noise of every run.
    `error_surface`: between the two response surfaces over the joint inputs, which the claim is about.  The verdict
    states whether the latter is within the claim; where most runs were used, both surfaces rest on the same runs and
    agree anyway.  No rows where points were spared, or too few were run for a surface, and none of undrained tests, of
    which some may end early.
    """
    densities, points = results.family_densities(), results.family_points()
    inputs = points.x
    if (
        len(points) < runs_needed(results)
        or not results.inputs["joint"]
        or results.loading.is_undrained
        or any(results.filled(m).any() for m in densities)
    ):
        return pd.DataFrame(columns=COLUMNS)
    probability = {m: results.probability(m) for m in densities}
    judged = {stopping.judged_name(state, symbol, m): (results.shown_state(state, symbol, m), probability[m])
              for state, symbol in stopping.JUDGED for m in densities}  # fmt: skip
    samples = stopping.judged_samples(Joint.from_dict(results.inputs["joint"]))
    order, packing = nested_order(inputs), results.packing(densities[0])
    history: dict[int, stopping.Assessment] = {}
    used, rows = 0, []
    for target in targets:
        limit = stopping.parse_target(target)
        assessment, used = _first_within(inputs, packing, judged, samples, order, limit, history)
        whole, surface = _true_errors(inputs, packing, judged, samples, order[:used])
        claim, worst = max(assessment.claimed.values()), max(assessment.claimed, key=assessment.claimed.get)
        at = max(whole, key=whole.get)
        verdict = "within the claim" if max(surface.values()) <= claim else "beyond the claim"
        if used == len(points) and claim > limit:
            verdict = "not reached"
        elif used > MOST * len(points):
            verdict += ", mostly by the same runs"
        rows.append((target, used, used * len(densities), used / len(points), claim, worst, whole[at], at,
                     max(surface.values()), verdict))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)


def _first_within(inputs, packing, judged, samples, order, target, history):
    """The assessment after the first batch that claims no more than the target, or after the last, and its points."""
    used, total = stopping.first_batch(*inputs.shape), len(inputs)
    while True:
        if used not in history:
            part = order[:used]
            values = {name: states[part] for name, (states, _) in judged.items()}
            history[used] = stopping.assess(inputs[part], values, samples, target, packing[part])
        if max(history[used].claimed.values()) <= target or used == total:
            return history[used], used
        used = stopping.next_batch(used, total)


def _true_errors(inputs, packing, judged, samples, part):
    """Errors of every response with only these points run: of the weighted points, and of the response surface."""
    run = np.zeros(len(inputs), bool)
    run[part] = True
    names = list(judged)
    every = np.stack([states for states, _ in judged.values()])
    some = np.where(run, every, np.nan)
    filled, _ = surrogate.fill(inputs, some, packing)
    kept = surrogate.fit(inputs, some, packing).predict(samples)
    full = surrogate.fit(inputs, every, packing).predict(samples)
    whole, surface = {}, {}
    for k, name in enumerate(names):
        probability = judged[name][1]
        known = np.where(np.isfinite(every[k]), filled[k], np.nan)
        whole[name] = weighted.wasserstein(known, every[k], probability, probability) / float(
            weighted.std(every[k], probability)
        )
        surface[name] = float(np.mean(np.abs(np.sort(kept[k]) - np.sort(full[k]))) / full[k].std())
    return whole, surface
