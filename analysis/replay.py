"""The stopping rule replayed on a campaign whose runs were all made: what it would have run, claimed and got wrong."""

from __future__ import annotations

import numpy as np
import pandas as pd

from analysis import stopping, surrogate, weighted
from analysis.joint import Joint
from analysis.results import read_results

#: Share of the points beyond which kept and full surface are too much alike to test a claim.
MOST = 0.7
TARGETS = ("20%", "10%", "5%", "2%")
COLUMNS = ("error asked for", "points", "shear runs", "share of runs", "claimed", "claimed for", "against all runs",
           "worst in", "against the surface of all", "verdict")  # fmt: skip


def stopping_replay(results, targets=TARGETS) -> pd.DataFrame:
    """One row a target: where the rule would have stopped, the error it claims, and what the error really was.

    Batches, order of the points, samples and responses are those of a campaign with `pdem.stop_when`.  Errors are
    Wasserstein-1 distances over the standard deviation, the worst over what is judged: of the points, those not run
    filled by regression, to the points all run ("against all runs", the noise of every run included), and of the two
    response surfaces over the joint inputs ("against the surface of all", of which the claim speaks).  The verdict says
    whether the latter is within the claim; where most runs were used both surfaces rest on the same and agree anyway.
    No rows where points were spared, or too few were run for a surface.
    """
    results = read_results(results)
    densities, points = results.family_densities(), results.family_points()
    inputs = points[["mu_s", "G_p"]].to_numpy()
    if len(points) < stopping.LEAST or not results.inputs["joint"] or any(results.filled(m).any() for m in densities):
        return pd.DataFrame(columns=COLUMNS)
    weights = {m: results.weights(m) for m in densities}
    judged = {stopping.judged_name(state, symbol, m): (results.state(state, symbol, m), weights[m])
              for state, symbol in stopping.JUDGED for m in densities}  # fmt: skip
    samples = stopping.judged_samples(Joint.from_dict(results.inputs["joint"]))
    order = stopping.nested_order(inputs, _replicated(results, densities[0], len(points)))
    history, used, rows = {}, 0, []
    for target in targets:
        found, used = _first_within(inputs, judged, samples, order, stopping.parse_target(target), history)
        whole, surface = _true_errors(inputs, judged, samples, order[:used])
        claim, worst = max(found.claimed.values()), max(found.claimed, key=found.claimed.get)
        at = max(whole, key=whole.get)
        verdict = "within the claim" if max(surface.values()) <= claim else "beyond the claim"
        if used == len(points) and claim > stopping.parse_target(target):
            verdict = "not reached"
        elif used > MOST * len(points):
            verdict += ", mostly by the same runs"
        rows.append((target, used, used * len(densities), used / len(points), claim, worst, whole[at], at,
                     max(surface.values()), verdict))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)


def _replicated(results, mu_iso, count):
    """Points (Q,) that several packings serve, which a campaign runs first."""
    sets = results.state_replicates("critical", "eta", mu_iso)
    return np.zeros(count, bool) if sets is None else np.isfinite(sets).sum(axis=0) > 1


def _first_within(inputs, judged, samples, order, target, history):
    """The assessment after the first batch that claims no more than the target, or after the last, and its points."""
    used, total = stopping.first_batch(len(inputs)), len(inputs)
    while True:
        if used not in history:
            part = order[:used]
            values = {name: states[part] for name, (states, _) in judged.items()}
            history[used] = stopping.assess(inputs[part], values, samples, target)
        if max(history[used].claimed.values()) <= target or used == total:
            return history[used], used
        used = stopping.next_batch(used, total)


def _true_errors(inputs, judged, samples, part):
    """Errors of every response with only these points run: of the weighted points, and of the response surface."""
    run = np.zeros(len(inputs), bool)
    run[part] = True
    names = list(judged)
    every = np.stack([states for states, _ in judged.values()])
    some = np.where(run, every, np.nan)
    filled, _ = stopping.fill(inputs, some)
    kept = surrogate.fit(inputs, some).predict(samples)
    full = surrogate.fit(inputs, every).predict(samples)
    whole, surface = {}, {}
    for k, name in enumerate(names):
        weight = judged[name][1]
        known = np.where(np.isfinite(every[k]), filled[k], np.nan)
        whole[name] = weighted.wasserstein(known, every[k], weight, weight) / float(weighted.std(every[k], weight))
        surface[name] = float(np.mean(np.abs(np.sort(kept[k]) - np.sort(full[k]))) / full[k].std())
    return whole, surface
