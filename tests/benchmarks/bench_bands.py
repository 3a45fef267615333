"""Do the bands cover?  200 synthetic campaigns, each with its own 94 pairs, refitted inputs, points and noisy runs.

    /usr/bin/python3 tests/benchmarks/bench_bands.py        (minutes; resumes where it stopped)

The truth is the mean and the standard deviation of the smooth responses (peak and critical stress ratio) under the true
inputs.  A campaign fits lognormals and a Gaussian copula to its pairs, runs 40 points with packing noise 0.015 and
makes 95 % bands from the response surface and 200 bootstrap samples of the pairs.  Writes data/benchmarks/bands.csv, a
row a campaign: 1 where the band covers.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import analytic_cases as cases  # noqa: E402
from pdf_checks import with_surface_band  # noqa: E402

from analysis.pdem import bands, evolution  # noqa: E402
from analysis.surrogates import surrogate  # noqa: E402

OUT = ROOT / "data" / "benchmarks" / "bands.csv"
CAMPAIGNS, PAIRS, POINTS, BOOTSTRAPS, NOISE = 200, 94, 40, 200, 0.015
NAMES = ("peak", "critical")
NORMALS = cases.sobol_normals(512, 77)
FINE = cases.dem_like_states(cases.joint_inputs(cases.sobol_normals(2**15, 3)))
TRUTH = np.stack([FINE[name] for name in NAMES])


def fitted(pairs) -> tuple:
    """Lognormals and the Gaussian copula's correlation, by the moments of the logarithms."""
    logs = np.log(pairs)
    return logs.mean(axis=0), logs.std(axis=0, ddof=1), np.corrcoef(logs.T)[0, 1]


def sample(parameters, normals) -> np.ndarray:
    """Inputs (n, 2) of fitted parameters from independent standard normals."""
    centre, scale, rho = parameters
    second = rho * normals[:, 0] + np.sqrt(1 - rho**2) * normals[:, 1]
    return np.exp(centre + scale * np.stack([normals[:, 0], second], axis=1))


def campaign(seed: int) -> dict:
    """One campaign: whether each band covers, and the share of the PDF (through its kernel) that its band covers."""
    rng = np.random.default_rng(seed)
    pairs = cases.joint_inputs(rng.normal(size=(PAIRS, 2)))
    parameters = fitted(pairs)
    bootstrap = np.stack([sample(fitted(pairs[rng.integers(PAIRS, size=PAIRS)]), NORMALS) for _ in range(BOOTSTRAPS)])
    inputs = sample(parameters, cases.sobol_normals(POINTS, seed))
    runs = cases.dem_like_states(inputs)
    surface = surrogate.fit(inputs, np.stack([runs[n] for n in NAMES]) + NOISE * rng.normal(size=(2, POINTS)))
    own = sample(parameters, NORMALS)
    found = bands.surface_moment_bands(surface, own, bootstrap, rng)
    row = {"campaign": seed}
    for k, name in enumerate(NAMES):
        mean, std = TRUTH[k].mean(), TRUTH[k].std()
        row[f"mean_{name}"] = int(found.mean_low[k] <= mean <= found.mean_high[k])
        row[f"std_{name}"] = int(found.std_low[k] <= std <= found.std_high[k])
        row[f"noise_part_{name}"] = found.noise_part[k]
    pdf = evolution.evolve(surface.predict(own), np.full(len(own), 1 / len(own)), [0.0, 1.0])
    shown = with_surface_band(pdf, surface, bootstrap, rng)
    width = pdf.bandwidth / pdf.dx[0]
    path = np.clip((TRUTH[:, :4096] - pdf.edges[0, 0]) / pdf.dx[0], 0, 399.9)
    true = evolution.translate(path, np.full(path.shape, 1 / path.shape[1]), width, 400) / pdf.dx[0]
    inside = (shown.low <= true) & (true <= shown.high)
    for k, name in enumerate(NAMES):
        body = true[k] > 0.05 * true[k].max()
        row[f"pdf_{name}"] = inside[k][body].mean()
    return row


if __name__ == "__main__":
    OUT.parent.mkdir(parents=True, exist_ok=True)
    known = set(pd.read_csv(OUT)["campaign"]) if OUT.exists() else set()
    for seed in range(CAMPAIGNS):
        if seed not in known:
            row = pd.DataFrame([campaign(seed)])
            row.to_csv(OUT, mode="a", header=not OUT.exists(), index=False, float_format="%.4g")
    table = pd.read_csv(OUT)
    print(f"{len(table)} campaigns, coverage of the 95 % bands:")
    print(table.drop(columns="campaign").mean().to_string(float_format="%.3f"))
