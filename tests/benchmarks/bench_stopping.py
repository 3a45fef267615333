"""Does the stopping rule stop early, and does the error it claims hold?  200 synthetic campaigns a setting.

    /usr/bin/python3 tests/benchmarks/bench_stopping.py        (a minute or two; resumes where it stopped)

Each campaign has 100 points and three densities (300 shear runs), in the order and the batches of a campaign with
`pdem.stop_when`; responses are the peak and the critical stress ratio, smooth in (mu_s, G_p) plus packing noise (sd
0.006 goes with 23,000 spheres, 0.015 with 2,000).  The error is the Wasserstein-1 distance between the PDF of the final
response surface and the true one, over the true standard deviation.
Writes data/benchmarks/stopping.csv: a row a campaign; prints the summary of every setting.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import analytic_cases as cases  # noqa: E402

from analysis.surrogates import stopping, surrogate  # noqa: E402

OUT = ROOT / "data" / "benchmarks" / "stopping.csv"
DENSITIES = (0.001, 0.04, 0.1)
SETTINGS = ((0.006, "5%"), (0.015, "10%"))
CAMPAIGNS = 200
SAMPLES = cases.joint_inputs(cases.sobol_normals(1024, 5))
FINE = cases.joint_inputs(cases.sobol_normals(2**13, 6))


def states(inputs) -> dict[str, np.ndarray]:
    """Peak and critical stress ratio of all three densities."""
    return {f"{name} {mu}": v for mu in DENSITIES for name, v in cases.dem_like_states(inputs, mu).items()}


def assessments(inputs, values: dict, samples, target) -> list[stopping.Assessment]:
    """What is said after each batch of points (Q, 2), with the values {name: (Q,)} of their runs, up to the last."""
    used, out = stopping.first_batch(len(inputs)), []
    while True:
        out.append(stopping.assess(inputs[:used], {k: v[:used] for k, v in values.items()}, samples, target))
        if out[-1].reached or used == len(inputs):
            return out
        used = stopping.next_batch(used, len(inputs))


def campaign(noise: float, target: str, seed: int) -> dict:
    """One synthetic campaign: runs made, largest claimed and true error, and how many responses' claims hold."""
    rng = np.random.default_rng(9000 + seed)
    inputs = cases.joint_inputs(cases.sobol_normals(100, 9000 + seed))
    inputs = inputs[stopping.nested_order(inputs)]
    values = {name: v + noise * rng.normal(size=len(inputs)) for name, v in states(inputs).items()}
    last = assessments(inputs, values, SAMPLES, target)[-1]
    surface = surrogate.fit(inputs[: last.runs], np.stack([v[: last.runs] for v in values.values()]))
    found = np.sort(surface.predict(FINE), axis=1)
    truth = np.sort(np.stack([TRUTH[name] for name in values]), axis=1)
    error = np.mean(np.abs(found - truth), axis=1) / truth.std(axis=1)
    claimed = np.array([last.claimed[name] for name in values])
    row = {"noise": noise, "target": target, "campaign": seed, "shear_runs": len(DENSITIES) * last.runs}
    row |= {"reached": int(last.reached), "claimed_worst": claimed.max(), "error_worst": error.max()}
    return row | {"holds": int(error.max() <= claimed.max()), "responses_holding": np.mean(error <= claimed)}


TRUTH = states(FINE)


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """What each setting shows."""
    rows = []
    for (noise, target), part in table.groupby(["noise", "target"]):
        rows.append({"noise": noise, "target": target, "campaigns": len(part), "runs_mean": part.shear_runs.mean()})
        rows[-1] |= {"runs_95%": part.shear_runs.quantile(0.95), "reached": part.reached.mean()}
        rows[-1] |= {"error_median": part.error_worst.median(), "error_95%": part.error_worst.quantile(0.95)}
        rows[-1]["error<=target"] = np.mean(part.error_worst <= stopping.parse_target(target))
        rows[-1] |= {"claim_holds": part.holds.mean(), "each_response": part.responses_holding.mean()}
    return pd.DataFrame(rows)


if __name__ == "__main__":
    OUT.parent.mkdir(parents=True, exist_ok=True)
    old = pd.read_csv(OUT) if OUT.exists() else pd.DataFrame(columns=["noise", "target", "campaign"])
    known = set(zip(old["noise"], old["target"], old["campaign"], strict=True))
    for noise, target in SETTINGS:
        for seed in range(CAMPAIGNS):
            if (noise, target, seed) not in known:
                row = pd.DataFrame([campaign(noise, target, seed)])
                row.to_csv(OUT, mode="a", header=not OUT.exists(), index=False, float_format="%.4g")
    print(summary(pd.read_csv(OUT)).to_string(index=False, float_format="%.3g"))
