"""Cost of fitting and testing copulas beside pyvinecopulib and OpenTURNS, as ratios of CPU times in one run.

PYTHON tests/benchmarks/bench_copulas_cost.py       (three minutes; PYTHON with the libraries installed)

Writes data/benchmarks/copulas_cost.csv. The work: fit the family to the 94 reconstructed pairs, then 1,000 times
draw 94 pairs from the fit, rank them and fit again; here the test's statistic S is computed as well, there it is not.
The libraries get pairs that were turned to the family without rotation, so that neither tries other rotations.
OpenTURNS has no bootstrap of a copula: its fits are put into the same loop, 30 times and scaled to 1,000.  It fits in
two ways: `openturns` by its general maximum likelihood, the estimator of the two others, and `openturns_moments` by the
factories' default, for most families a parameter matched to Kendall's tau.  Its threads are off.  `estimate` is the
first parameter fitted to the pairs, to show whose estimators are the same.  The last row sums the families that all of
them have.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from bench_rows import append

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis import copulas  # noqa: E402
from analysis.copulas import goodness  # noqa: E402
from analysis.inputs.pairs import read_pairs  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "copulas_cost.csv"
REPLICATES, SCALED = 1000, 30
FAMILIES = ("gaussian", "student", "frank", "plackett", "clayton90", "gumbel270", "joe90")
OTHERS = ("pyvinecopulib", "openturns", "openturns_moments")
COLUMNS = ("family", "replicates", "estimate", "cpu_seconds",
           *(f"{kind}_{name}" for name in OTHERS for kind in ("estimate", "cpu_seconds", "ratio")))  # fmt: skip


def main() -> None:
    """Time every family in every library and write the table anew."""
    x, y = read_pairs(ROOT / "data" / "pairs_reconstructed.csv").T
    u = np.stack([copulas.pseudo_observations(x), copulas.pseudo_observations(y)], axis=1)
    TABLE.unlink(missing_ok=True)
    rows = []
    for family in FAMILIES:
        estimate, ours = timed(ours_once, u, family)
        row = {"family": family, "replicates": REPLICATES, "estimate": estimate, "cpu_seconds": ours}
        for name in OTHERS:
            fitter = FITTERS[name](family)
            if fitter is not None:
                count = REPLICATES if name == OTHERS[0] else SCALED
                estimate, theirs = timed(theirs_once, turned(u, family), fitter, count)
                theirs *= (REPLICATES + 1) / (count + 1)
                row |= {f"estimate_{name}": estimate, f"cpu_seconds_{name}": theirs, f"ratio_{name}": ours / theirs}
        rows.append(row)
        append(TABLE, COLUMNS, row)
    common = [row for row in rows if all(f"ratio_{name}" in row for name in OTHERS)]
    if common:
        sums = {key: sum(row[key] for row in common) for key in COLUMNS if key.startswith("cpu_seconds")}
        ratios = {f"ratio_{name}": sums["cpu_seconds"] / sums[f"cpu_seconds_{name}"] for name in OTHERS}
        append(TABLE, COLUMNS, {"family": f"{len(common)} common", "replicates": REPLICATES} | sums | ratios)


def ours_once(u: np.ndarray, family: str) -> float:
    """Fit, bootstrap and test with this project; the first parameter."""
    fit = copulas.fit(*u.T, family)
    goodness.bootstrap_test(u, family, fit.parameters, REPLICATES, np.random.default_rng(1))
    return fit.parameters[0]


def theirs_once(u: np.ndarray, fitter, replicates: int) -> float:
    """Fit and bootstrap with a library's fitter; the first parameter."""
    estimate, draw = fitter(u)
    for seed in range(replicates):
        drawn = draw(len(u), seed + 1)
        fitter(np.stack([copulas.pseudo_observations(column) for column in drawn.T], axis=1))
    return estimate


def turned(u: np.ndarray, family: str) -> np.ndarray:
    """Pairs turned back to the family without rotation: 90 degrees in u, 270 in v."""
    return np.stack([1 - u[:, 0] if "90" in family else u[:, 0], 1 - u[:, 1] if "270" in family else u[:, 1]], axis=1)


def pyvinecopulib(family: str):
    """pairs -> (first parameter, function that draws), or None where the library or the family is not there."""
    try:
        import pyvinecopulib as pv
    except ImportError:
        return None
    kind = getattr(pv.BicopFamily, family.rstrip("0123456789"), None)
    if kind is None:
        return None

    def fit(u):
        fitted = pv.Bicop(family=kind)
        fitted.fit(u)
        draw = fitted.sample if hasattr(fitted, "sample") else fitted.simulate
        return float(np.ravel(fitted.parameters)[0]), lambda n, seed: draw(n, seeds=[seed])

    return fit


def openturns(family: str, moments: bool = False):
    """As `pyvinecopulib`; OpenTURNS' Joe copula is another, three-parameter one, so it is left out."""
    try:
        import openturns as ot
    except ImportError:
        return None
    name = {"gaussian": "Normal"}.get(family, family.rstrip("0123456789").capitalize()) + "Copula"
    if family.startswith("joe"):
        return None
    ot.TBB.Disable()
    factory = getattr(ot, f"{name}Factory")() if moments else ot.MaximumLikelihoodFactory(getattr(ot, name)())

    def fit(u):
        fitted = factory.build(ot.Sample(u))
        parameters = list(fitted.getParameter())
        return parameters[1 if family == "student" else 0], lambda n, _: np.asarray(fitted.getSample(n))

    return fit


FITTERS = {
    "pyvinecopulib": pyvinecopulib,
    "openturns": openturns,
    "openturns_moments": lambda family: openturns(family, moments=True),
}


def timed(function, *arguments) -> tuple[float, float]:
    """What a call returns, and its CPU seconds."""
    start = time.process_time()
    value = function(*arguments)
    return value, time.process_time() - start


if __name__ == "__main__":
    main()
