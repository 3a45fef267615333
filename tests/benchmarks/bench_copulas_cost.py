"""Cost of fitting and testing copulas beside the same work done with pyvinecopulib, as a ratio of CPU times in one run.

PYTHON tests/benchmarks/bench_copulas_cost.py       (a minute; PYTHON with pyvinecopulib installed for the comparison)

Writes data/benchmarks/copulas_cost.csv. The work: fit the family to the 94 reconstructed pairs, then 1,000 times
draw 94 pairs from the fit, rank them and fit again; here the test's statistic S is computed as well, there it is not.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis import copulas, goodness  # noqa: E402
from analysis.inputs import read_pairs  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "copulas_cost.csv"
REPLICATES = 1000
FAMILIES = ("gaussian", "student", "frank", "plackett", "clayton90", "gumbel270", "joe90")


def main() -> None:
    """Time every family both ways and write the table."""
    x, y = read_pairs(ROOT / "data" / "pairs_reconstructed.csv").T
    u = np.stack([copulas.pseudo_observations(x), copulas.pseudo_observations(y)], axis=1)
    rows = ["family,replicates,cpu_seconds,cpu_seconds_pyvinecopulib,ratio"]
    for family in FAMILIES:
        ours, theirs = timed(ours_once, u, family), timed(theirs_once, u, family)
        ratio = f"{ours / theirs:.2f}" if theirs else ""
        rows.append(f"{family},{REPLICATES},{ours:.2f},{f'{theirs:.2f}' if theirs else ''},{ratio}")
        print(rows[-1], flush=True)
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    TABLE.write_text("\n".join(rows) + "\n")


def ours_once(u: np.ndarray, family: str) -> bool:
    """Fit, bootstrap and test with this project."""
    fit = copulas.fit(*u.T, family)
    goodness.bootstrap_test(u, family, fit.parameters, REPLICATES, np.random.default_rng(1))
    return True


def theirs_once(u: np.ndarray, family: str) -> bool:
    """Fit and bootstrap with pyvinecopulib, where it is installed and has the family."""
    try:
        import pyvinecopulib as pv
    except ImportError:
        return False
    name = family.rstrip("0123456789")
    if not hasattr(pv.BicopFamily, name):
        return False
    controls = pv.FitControlsBicop(family_set=[getattr(pv.BicopFamily, name)])
    fitted = pv.Bicop.from_data(u, controls=controls)
    for seed in range(REPLICATES):
        draw = fitted.sample if hasattr(fitted, "sample") else fitted.simulate
        drawn = draw(len(u), seeds=[seed + 1])
        ranks = np.stack([copulas.pseudo_observations(column) for column in drawn.T], axis=1)
        pv.Bicop.from_data(ranks, controls=controls)
    return True


def timed(function, *arguments) -> float:
    """CPU seconds of one call, 0 if it could not be made."""
    start = time.process_time()
    return time.process_time() - start if function(*arguments) else 0.0


if __name__ == "__main__":
    main()
