"""Standing of the critical state on synthetic campaigns whose truth is known: false "reached" and false "withheld".

    python3 tests/benchmarks/bench_standing.py            2,000 campaigns per case, writes data/benchmarks/standing.csv
    python3 tests/benchmarks/bench_standing.py --table    prints it

A campaign has n points at one density, in one packing or in several in rotation.  eta and e approach their critical
values exponentially; what a run fluctuates by is autocorrelated over 3 % of strain, partly shared by the points of its
packing, with the amplitudes of the laptop campaign (a run's drift over 15 % of strain scatters by 10 % in eta and 1.2 %
in e at 1,000 spheres).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.results.standing import NOT_PROVEN, NOT_REACHED, PROVEN, critical_standing  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "standing.csv"
#: Case -> (end of the test, strain over which the approach falls by e, excess of eta and of e at the start).
CASES = {
    "too short": (0.03, 0.10, 0.40, 0.10), "too short, 20 %": (0.20, 0.10, 0.40, 0.10),
    "too short, 27 %": (0.27, 0.05, 0.40, 0.10), "just long enough": (0.28, 0.04, 0.40, 0.10),
    "long": (0.40, 0.04, 0.40, 0.10), "long, still moving": (0.40, 0.40, 0.60, 0.20),
}  # fmt: skip
KEYS, COUNT = ("case", "points", "packings", "spheres"), 2000
#: Points -> numbers of packings.
PACKINGS = {8: (1, 4), 25: (1, 8), 100: (1, 20)}
#: Standard deviation of the fluctuation of eta and e of a run, relative, at 1,000 spheres; share that is common.
AMPLITUDE, COMMON, CORRELATION = {"eta": 0.056, "e": 0.0067}, 0.3, 0.03


def campaign(case: str, n: int, packings: int, spheres: int, rng: np.random.Generator):
    """Strain (T,), values {eta, e} (T, n), probability (n,) and packing (n,) of one synthetic campaign."""
    end, decay, *excess = CASES[case]
    strain = np.linspace(0.0, end, max(20, round(end / 0.005)) + 1)
    gap = np.abs(strain[:, None] - strain)
    root = np.linalg.cholesky(np.exp(-gap / (0.5 * CORRELATION)) + 1e-10 * np.eye(len(strain)))
    values, packing = {}, np.arange(n) % packings
    for (symbol, amplitude), more, level in zip(AMPLITUDE.items(), excess, (0.65, 0.63), strict=True):
        own = root @ rng.normal(size=(len(strain), n))
        common = (root @ rng.normal(size=(len(strain), packings)))[:, packing]
        noise = amplitude * np.sqrt(1000 / spheres) * (np.sqrt(1 - COMMON**2) * own + COMMON * common)
        values[symbol] = level * (1 + more * np.exp(-strain / decay))[:, None] * (1 + noise)
    probability = rng.dirichlet(np.full(n, 4.0))
    return strain, values, probability, packing


def standings(case: str, n: int, packings: int, spheres: int, count: int, seed: int = 1) -> dict[str, float]:
    """Shares of the standings over `count` campaigns."""
    rng = np.random.default_rng([seed, n, packings, spheres, list(CASES).index(case)])
    found = []
    for _ in range(count):
        strain, values, probability, packing = campaign(case, n, packings, spheres, rng)
        extended = np.zeros_like(values["eta"], bool)
        found.append(critical_standing(strain, values, probability, extended, packing).status)
    return {status: found.count(status) / count for status in (PROVEN, NOT_PROVEN, NOT_REACHED)}


def main() -> None:
    if "--table" not in sys.argv:
        keys = [(case, n, packings, spheres) for case in CASES for n in PACKINGS for packings in PACKINGS[n]
                for spheres in (300, 1000, 4000)]  # fmt: skip
        rows = [dict(zip(KEYS, key, strict=True)) | {"campaigns": COUNT} | standings(*key, COUNT) for key in keys]
        pd.DataFrame(rows).to_csv(TABLE, index=False)
    print(pd.read_csv(TABLE).to_string(index=False))


if __name__ == "__main__":
    main()
