"""Coverage of the intervals of differences between two campaigns that differ in their packings only.

    /usr/bin/python3 tests/benchmarks/bench_compare.py     (a few CPU minutes; writes data/benchmarks/compare.csv)

Each repetition simulates two campaigns with the same points: y = f(mu_s) + packing + own noise, with f the critical
stress ratio of the laptop campaign and noise as found there. The true difference of every number is zero.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
import synthetic_results  # noqa: E402
from scipy.stats import qmc  # noqa: E402

from analysis.inputs.joint import fit_joint  # noqa: E402
from analysis.inputs.pairs import read_pairs  # noqa: E402
from analysis.points.selection import select_points  # noqa: E402
from analysis.results.models import POWER  # noqa: E402
from analysis.surrogates import distribution, surrogate  # noqa: E402
from analysis.surrogates.rotation import deal  # noqa: E402
from analysis.tables.moments import AS_SIMULATED, DENOISED, NUMBERS  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "compare.csv"
#: Points and packings: the default campaign and one of the laptop's size; and how often each is repeated.
DESIGNS = {"default": (8, 4), "laptop": (100, 20)}
REPETITIONS = {"default": 150, "laptop": 75}
PACKING, OWN = 0.010, 0.018


def differences(design: tuple[int, int], repetitions: int) -> np.ndarray:
    """Estimate, low and high (repetitions, 3, 2, S) of the differences, denoised and as simulated."""
    n, packings = design
    joint = fit_joint(read_pairs(ROOT / "data" / "pairs_reconstructed.csv"), n_boot=0).joint
    points = select_points(joint, n, seed=1)
    samples = joint.inverse_rosenblatt(qmc.Sobol(2, seed=1).random_base2(POWER))
    dealt, truth = deal(points.x, packings), synthetic_results.critical_eta(points.mu_s)
    found = []
    for repetition in range(repetitions):
        rng = np.random.default_rng([repetition, n])
        parts = []
        for _ in range(2):
            values = truth + PACKING * rng.normal(size=packings)[dealt] + OWN * rng.normal(size=n)
            model = surrogate.fit(points.x, values, dealt)
            parts.append(distribution.sampled(model, samples, rng=rng))
        pair = distribution.difference(*parts, same_inputs=True)
        found.append([[part[0] for part in (e.value, e.low, e.high)] for e in pair])
    return np.swapaxes(np.array(found), 1, 2)


def main() -> None:
    rows = []
    for name, design in DESIGNS.items():
        value, low, high = np.moveaxis(differences(design, REPETITIONS[name]), 1, 0)
        covered = ((low <= 0) & (high >= 0)).mean(axis=0)
        for kind, of_kind, off, half in zip((DENOISED, AS_SIMULATED), covered, value.std(axis=0),
                                            ((high - low) / 2).mean(axis=0), strict=True):  # fmt: skip
            for k, number in enumerate(NUMBERS):
                rows.append({"design": name, "points": design[0], "packings": design[1], "kind": kind,
                             "number": number, "repetitions": REPETITIONS[name], "coverage": of_kind[k],
                             "scatter": off[k], "half_width": half[k]})  # fmt: skip
    frame = pd.DataFrame(rows)
    frame.to_csv(TABLE, index=False, float_format="%.4g")
    print(frame.to_string(index=False))


if __name__ == "__main__":
    main()
