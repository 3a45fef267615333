"""Bias of the peak stress ratio on synthetic campaigns whose truth is known: peaks of single runs and pooled peaks.

    python3 tests/benchmarks/bench_peaks.py            200 or 600 campaigns per case, a quarter of an hour,
                                                       writes data/benchmarks/peaks.csv; can be stopped and
                                                       continued
    python3 tests/benchmarks/bench_peaks.py --table    prints it
    python3 tests/benchmarks/bench_peaks.py --noise    prints the noise of the laptop campaign beside the model here

A campaign has n points at one density, in one packing or in several in rotation (4 for 8 points, 20 for 100).  Its
curves are smooth functions of (mu_s, G_p) like those of the laptop campaign, times one plus noise.  The own noise of a
run grows with strain; the noise that the points of a packing share is larger than it at small strains and decays.  Both
have about the size and the correlation that the laptop campaign has (--noise, from the mixed model of all its runs);
"absent" and "doubled" change the shared noise, of which the estimate knows nothing.

Columns: bias of the mean peak stress ratio over the points, with its 95 % half width, of the peaks of single runs
(`single`), of the pooled peaks before anything is subtracted (`located`) and as they are stored (`pooled`).  What the
noise adds at the true strains of the peaks has no bias; it is taken out of each campaign, because it hides the rest.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bench_rows  # noqa: E402

from analysis.results import peaks, read_results  # noqa: E402
from analysis.runs.peak_critical import admissible, local_fits  # noqa: E402
from analysis.surrogates import surrogate  # noqa: E402
from analysis.surrogates.rotation import deal  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "peaks.csv"
#: Campaigns per case; more of 8 points or one packing with the noise as measured: 200 give the bias to 0.004 only.
CAMPAIGNS, MORE_CAMPAIGNS = 200, 600
#: Strains at which runs of a campaign are recorded: dense at the start, as in `yade_scripts`.
STRAIN = np.concatenate([np.linspace(0, 0.01, 11), np.linspace(0.0125, 0.05, 16), np.linspace(0.055, 0.4, 70)])
#: Density -> the curve (crit, a, b, h, c, g) at the median pair, the powers of mu_s in crit, h and c, and the standard
#: deviation of a run's own noise at 1,000 spheres: at zero strain and far from it (it changes over OWN_DECAY).
DENSITIES = {
    "dense": ((0.640, 0.0005, 1.3, 0.265, 0.034, 0.46), (0.17, 0.45, -0.35), (0.005, 0.070)),
    "medium": ((0.641, 0.0005, 0.5, 0.084, 0.058, 0.90), (0.15, 0.50, -0.60), (0.024, 0.066)),
    "loose": ((0.640, 0.0040, 0.4, 0.035, 0.140, 3.00), (0.17, 0.20, -0.30), (0.029, 0.066)),
}  # fmt: skip
OWN_DECAY = 0.19
#: Factor on the shared noise.
NOISES = {"measured": 1.0, "absent": 0.0, "doubled": 2.0}
#: Points -> numbers of packings.
PACKINGS = {8: (1, 4), 100: (1, 20)}
KEYS = ("noise", "points", "packings", "spheres", "density")
COLUMNS = (*KEYS, "campaigns", "single", "single_ci95", "located", "located_ci95", "pooled", "pooled_ci95")


class Campaign(NamedTuple):
    """Inputs (n, 2) and packing (n,) of the points, true and noisy stress ratios (T, n), and probability (n,)."""

    inputs: np.ndarray
    packing: np.ndarray
    true: np.ndarray
    noisy: np.ndarray
    probability: np.ndarray


def truth(density: str, strain: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Stress ratio (T, n): crit (1 - exp(-(s/a)^b)) + h (s/c)^g exp(g (1 - s/c)); the rise is faster with G_p."""
    (crit, a, b, h, c, g), (of_crit, of_h, of_c), _ = DENSITIES[density]
    friction, modulus = inputs[:, 0] / 0.214, inputs[:, 1] / 25.7e9
    s = strain[:, None]
    u = s / (c * friction**of_c)
    rise = crit * friction**of_crit * -np.expm1(-((s / (a * modulus ** (-2 / 3))) ** b))
    return rise + h * friction**of_h * u**g * np.exp(g * (1.0 - u))


def own_noise(density: str, strain: np.ndarray) -> np.ndarray:
    """Relative standard deviation (T,) of a run's own noise at 1,000 spheres."""
    start, end = DENSITIES[density][2]
    return end - (end - start) * np.exp(-strain / OWN_DECAY)


def campaign(
    density: str, n: int, spheres: int, rng: np.random.Generator, factor: float = 1.0, packings: int = 1
) -> Campaign:
    """A synthetic campaign of n points; `factor` is that on the shared noise."""
    z = rng.normal(size=(n, 2))
    z[:, 1] = -0.738 * z[:, 0] + np.sqrt(1 - 0.738**2) * z[:, 1]
    inputs = np.column_stack([0.214 * np.exp(0.469 * z[:, 0]), 25.7e9 * np.exp(0.354 * z[:, 1])])
    own = peaks.correlation_root(STRAIN, peaks.OWN_CORRELATION) @ rng.normal(size=(len(STRAIN), n))
    shared = peaks.correlation_root(STRAIN, peaks.SHARED_CORRELATION) @ rng.normal(size=(len(STRAIN), packings))
    packing = deal(inputs, packings)
    share = factor * peaks.SHARED_RATIO * np.exp(-STRAIN / peaks.SHARED_DECAY)
    scale = np.sqrt(1000 / spheres) * own_noise(density, STRAIN)[:, None]
    relative = scale * (own + share[:, None] * shared[:, packing])
    true = truth(density, STRAIN, inputs)
    return Campaign(inputs, packing, true, true * (1 + relative), rng.dirichlet(np.full(n, 4.0)))


def biases(density: str, made: Campaign) -> list[float]:
    """Errors of the mean peak of one campaign: single runs, pooled before and after the subtraction."""
    inputs, packing, true, noisy, probability = made
    fits, half = local_fits(STRAIN)
    local, rows = fits[:, 0], np.flatnonzero(admissible(STRAIN, half))
    fine = np.linspace(STRAIN[rows[0]], STRAIN[rows[-1]], 3001)
    at_truth = local[rows[np.argmax(true[rows], axis=0)]].T
    unbiased = truth(density, fine, inputs).max(axis=0) + np.sum(at_truth * (noisy - true), axis=0)
    pooled = peaks.pool_peaks(STRAIN, noisy, inputs, packing)
    located = np.sum(local[pooled.row].T * noisy, axis=0)
    estimates = ((local @ noisy)[rows].max(axis=0), located, located - pooled.bias)
    return [float(probability @ (estimate - unbiased)) for estimate in estimates]


def case(noise: str, n: int, packings: int, spheres: int, density: str, count: int, seed: int = 1) -> dict:
    """One row: mean errors over `count` campaigns, with their 95 % half widths."""
    names = ("single", "located", "pooled")
    of_case = [n, packings, spheres, list(DENSITIES).index(density), list(NOISES).index(noise)]
    rng = np.random.default_rng([seed, *of_case])
    campaigns = (campaign(density, n, spheres, rng, NOISES[noise], packings) for _ in range(count))
    errors = np.array([biases(density, made) for made in campaigns])
    half = 1.96 * errors.std(axis=0, ddof=1) / np.sqrt(count)
    row = dict(zip(KEYS, (noise, n, packings, spheres, density), strict=True)) | {"campaigns": count}
    row |= {name: float(value) for name, value in zip(names, errors.mean(axis=0), strict=True)}
    return row | {f"{name}_ci95": float(value) for name, value in zip(names, half, strict=True)}


def measured_noise() -> None:
    """Print own and shared noise of the laptop campaign, over the mean curve, with intervals, beside the model."""
    results = read_results(ROOT / "data" / "laptop" / "results.h5")
    strain = results.strain
    bands = ((0.01, 0.03), (0.03, 0.06), (0.06, 0.12), (0.12, 0.2), (0.2, 0.3), (0.3, 0.4))
    gaps = (0.005, 0.01, 0.02, 0.03, 0.04, 0.06)
    correlations: dict[str, list] = {"own": [], "shared": []}
    for density, mu_iso in zip(DENSITIES, results.family_densities(), strict=True):
        runs = results.runs_along("eta", mu_iso)
        inputs = results.family_points().x[runs.place]
        model = surrogate.fit(inputs, runs.values, runs.packing)
        level = np.maximum(results.response("eta", mu_iso).mean, 1e-9)
        _, packing = np.unique(runs.packing, return_inverse=True)
        of_packing = np.eye(packing.max() + 1)[packing]
        rest = (runs.values - model.predict(inputs)) / level[:, None]
        shared = rest @ of_packing / of_packing.sum(axis=0)
        late = strain > 0.1
        gap = np.abs(strain[late][:, None] - strain[late])
        for name, deviation in (("own", rest - shared[:, packing]), ("shared", shared)):
            product = deviation[late] @ deviation[late].T
            scale = np.diag(product).mean()
            correlations[name].append([product[np.abs(gap - g) < 0.0026].mean() / scale for g in gaps])
        for low, high in bands:
            rows = (strain >= low) & (strain < high)
            noise, model_noise = (np.sqrt(np.mean(sd[rows] ** 2)) for sd in
                                  (model.noise_own / level, own_noise(density, strain)))  # fmt: skip
            ratio, *ends = (np.mean(sd[rows] / model.noise_own[rows])
                            for sd in (model.noise_packing, *model.packing_interval.T))  # fmt: skip
            assumed = peaks.SHARED_RATIO * np.exp(-strain[rows].mean() / peaks.SHARED_DECAY)
            print(f"{density:7s} strain {low:.2f}-{high:.2f}: own sd of a run {noise:.3f}, model {model_noise:.3f}; "
                  f"shared over own {ratio:.2f} ({ends[0]:.2f} to {ends[1]:.2f}), model {assumed:.2f}")  # fmt: skip
    for name, length in (("own", peaks.OWN_CORRELATION), ("shared", peaks.SHARED_CORRELATION)):
        for g, value in zip(gaps, np.mean(correlations[name], axis=0), strict=True):
            print(f"correlation of the {name} noise at a gap of {g:.3f}: {value:.2f}, model {np.exp(-g / length):.2f}")


def main() -> None:
    if "--noise" in sys.argv:
        measured_noise()
        return
    if "--table" not in sys.argv:
        done = bench_rows.finished(TABLE, KEYS)
        for key in [(noise, n, packings, spheres, density) for noise in NOISES for n in PACKINGS
                    for packings in PACKINGS[n] for spheres in (1000, 400) for density in DENSITIES]:  # fmt: skip
            if tuple(map(str, key)) not in done:
                count = MORE_CAMPAIGNS if key[0] == "measured" and key[1:3] != (100, 20) else CAMPAIGNS
                bench_rows.append(TABLE, COLUMNS, case(*key, count))
    print(pd.read_csv(TABLE).to_string(index=False))


if __name__ == "__main__":
    main()
