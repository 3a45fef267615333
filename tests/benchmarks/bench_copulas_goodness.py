"""Does the bootstrap test hold its level, and what does it see?  Rejection rates at 5 % for true and wrong families.

    /usr/bin/python3 tests/benchmarks/bench_copulas_goodness.py        (ten minutes; resumes where it stopped)

Writes data/benchmarks/copulas_goodness.csv: a row for each family drawn from and family tested, n = 94, Kendall's tau
of the paper's Gaussian copula. `rejected_low` and `rejected_high` are the 95 % interval (Clopper and Pearson) of the
bootstrap's rate, `rejected_paper` is the test of the paper's Eq. 4 on the same samples, with S of the given order.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from bench_rows import append, finished
from scipy import stats

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis import copulas  # noqa: E402
from analysis.copulas import goodness  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "copulas_goodness.csv"
COLUMNS = (
    "drawn_from", "tested", "n", "trials", "replicates", "rejected_bootstrap", "rejected_low", "rejected_high",
    "rejected_paper", "median_S", "S_critical_5pct_paper",
)  # fmt: skip
N = 94
#: Trials and replicates of each.  19 replicates are the fewest that have a level of 5 %; 2,000 trials give it to 1 %.
OF_LEVEL, OF_POWER = (2000, 19), (300, 99)
TRUTHS = {
    "gaussian": (-0.738,),
    "student": (-0.738, 6.05),
    "frank": (-6.2,),
    "plackett": (0.094,),
    "clayton90": (2.24,),
    "gumbel270": (2.12,),
    "joe90": (3.03,),
}
PAPER = copulas.PAPER_FAMILIES


def main() -> None:
    """Measure what is not in the table yet: the level of every family, then the power among the paper's four."""
    done = finished(TABLE, ("drawn_from", "tested"))
    reference = np.sort(goodness.independent_reference(N, 20_000, np.random.default_rng(1)))
    cases = [(family, family, OF_LEVEL) for family in TRUTHS]
    cases += [(a, b, OF_POWER) for a in PAPER for b in PAPER if a != b]
    cases += [("clayton90", "gaussian", OF_POWER), ("gaussian", "clayton90", OF_POWER)]
    for source, tested, (trials, replicates) in cases:
        if (source, tested) not in done:
            append(TABLE, COLUMNS, measure(source, tested, trials, replicates, reference))


def measure(source: str, tested: str, trials: int, replicates: int, reference: np.ndarray) -> dict:
    """One row of the table."""
    rng = np.random.default_rng([list(TRUTHS).index(source), list(TRUTHS).index(tested)])
    copula = copulas.Copula(source, TRUTHS[source])
    S, p = np.empty(trials), np.empty(trials)
    for k in range(trials):
        pairs = np.stack([copulas.pseudo_observations(column) for column in copula.sample(N, rng).T], axis=1)
        parameters = copulas.fit_rows(pairs[None, :, 0], pairs[None, :, 1], tested)[0]
        S[k] = goodness.statistic_of_one_order(pairs[None], tested, parameters[None])[0]
        p[k] = goodness.bootstrap_test(pairs, tested, parameters, replicates, rng)[1]
    critical = np.quantile(reference, 0.95)
    rejected = int(np.sum(p <= 0.05))
    low, high = interval(rejected, trials)
    values = (
        source, tested, N, trials, replicates, rejected / trials, low, high,
        float(np.mean(critical <= S)), float(np.median(S)), float(critical),
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))


def interval(rejected: int, trials: int) -> tuple[float, float]:
    """The 95 % interval of a rate (Clopper and Pearson 1934)."""
    found = stats.binomtest(rejected, trials).proportion_ci(0.95)
    return float(found.low), float(found.high)


if __name__ == "__main__":
    main()
