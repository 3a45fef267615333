"""A DEM-like case: raw and denoised PDEM of noisy stress ratios against Monte Carlo with 10^6 samples of the truth.

    /usr/bin/python3 tests/benchmarks/bench_pdem_noise.py

100 points of equal probability; smooth responses through trial results plus packing noise of known size (0.006
corresponds to 23,000 spheres, 0.015 to 2,000, 0.03 to 1,000).  Errors of mean, standard deviation, 5 % and 95 %
quantile over the true standard deviation, mean over 20 repetitions, at the peak and the critical state and along
strain.  Writes data/benchmarks/pdem_noise.csv; `variance_removed` is the share of the noise variance that the
model removes from the values of the points, `noise_share` its estimate of the share of noise in their variance.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import analytic_cases as cases  # noqa: E402

from analysis.pdem import weighted  # noqa: E402
from analysis.surrogates import monte_carlo, surrogate  # noqa: E402

OUT = ROOT / "data" / "benchmarks" / "pdem_noise.csv"
STRAIN = np.array([0.005, 0.02, 0.1, 0.4])
ROWS = ("peak", "critical", "eta at 0.5 %", "eta at 2 %", "eta at 10 %", "eta at 40 %")
POINTS, REPEATS = 100, 20


def responses(inputs) -> np.ndarray:
    """Peak, critical and the stress ratio at four strains (6, n), dense."""
    state = cases.dem_like_states(inputs)
    return np.vstack([state["peak"], state["critical"], cases.dem_like_paths(inputs, STRAIN)])


class Truth:
    """The smooth responses themselves in the place of a fitted surface."""

    coefficients = np.zeros((len(ROWS), 1))
    predict = staticmethod(responses)


def errors(h, probability, truth) -> dict[str, np.ndarray]:
    """Absolute errors (6,) over the true standard deviation."""
    mean, std = weighted.moments(h, probability)
    low, high = weighted.quantiles(h, probability, [0.05, 0.95]).T
    exact = {"mean": truth.mean, "std": truth.std, "q05": truth.quantile(0.05), "q95": truth.quantile(0.95)}
    return {k: np.abs(v - exact[k]) / truth.std for k, v in zip(exact, (mean, std, low, high), strict=True)}


if __name__ == "__main__":
    rng = np.random.default_rng(1)
    samples = cases.joint_inputs(rng.normal(size=(1_000_000, 2)))
    truth = monte_carlo.monte_carlo(Truth, samples, np.arange(len(ROWS)), cells=2000)
    probability = np.full(POINTS, 1 / POINTS)
    rows = []
    for noise in (0.0, 0.006, 0.015, 0.03):
        for repeat in range(REPEATS):
            inputs = cases.joint_inputs(cases.sobol_normals(POINTS, repeat))
            smooth = responses(inputs)
            raw = smooth + noise * rng.normal(size=smooth.shape)
            model = surrogate.fit(inputs, raw)
            fitted, share = model.predict(inputs), model.noise**2 / raw.var(axis=1)
            left = np.mean((fitted - smooth) ** 2, axis=1)
            for name, h in (("raw", raw), ("denoised", fitted)):
                found = errors(h, probability, truth)
                for k, response in enumerate(ROWS):
                    row = {"noise": noise, "response": response, "kind": name}
                    row |= {key: value[k] for key, value in found.items()}
                    denoised = noise > 0 and name == "denoised"
                    row["variance_removed"] = 1 - left[k] / noise**2 if denoised else np.nan
                    row["noise_share"] = share[k]
                    rows.append(row)
    table = pd.DataFrame(rows).groupby(["noise", "response", "kind"], sort=False).mean().reset_index()
    OUT.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT, index=False, float_format="%.4g")
    print(table.to_string(index=False, float_format="%.3g"))
