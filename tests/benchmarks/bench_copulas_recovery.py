"""Does maximum pseudo-likelihood find the parameter again?  Bias, scatter and coverage of the 95 % interval, per
family.

    /usr/bin/python3 tests/benchmarks/bench_copulas_recovery.py        (about half an hour; resumes where it stopped)

Writes data/benchmarks/copulas_recovery.csv: a row for each family, sample size and parameter.
`bias_over_sd` is the mean error over the standard deviation of the estimates, on the scale on which the interval is
made.  And copulas_ranks.csv: the same for 1/nu of Student's copula on 300 samples of 500 pairs, fitted to their ranks
and to the probabilities themselves, with the difference and its standard error: what the ranks add to the bias.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from bench_rows import append

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis import copulas  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "copulas_recovery.csv"
RANKS = TABLE.with_name("copulas_ranks.csv")
HEADER = "family,parameter,true,n,samples,mean,sd,mean_se,bias_over_sd,coverage_95"
TRUTHS = {
    "gaussian": (-0.738,),
    "student": (-0.722, 6.05),
    "frank": (-6.0,),
    "plackett": (0.09,),
    "clayton90": (2.0,),
    "clayton": (2.0,),
    "gumbel270": (2.0,),
    "gumbel": (2.0,),
    "joe90": (2.8,),
    "joe": (2.8,),
}
SAMPLES = {94: 1000, 2000: 1000}


def main() -> None:
    """Measure what is not in the table yet."""
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    done = set()
    if TABLE.exists():
        done = {tuple(line.split(",")[i] for i in (0, 3)) for line in TABLE.read_text().splitlines()[1:]}
    else:
        TABLE.write_text(HEADER + "\n")
    for n, samples in SAMPLES.items():
        for family, truth in TRUTHS.items():
            if (family, str(n)) not in done:
                rows = measure(family, truth, n, samples)
                with TABLE.open("a") as table:
                    table.writelines(row + "\n" for row in rows)
                print(*rows, sep="\n", flush=True)
    if not RANKS.exists():
        row = ranks_against_probabilities(n=500, samples=300)
        append(RANKS, tuple(row), row)


def measure(family: str, truth: tuple[float, ...], n: int, samples: int) -> list[str]:
    """Rows of the table for one family and sample size."""
    rng = np.random.default_rng([n, list(TRUTHS).index(family)])
    copula = copulas.Copula(family, truth)
    fits = [copulas.fit(*copula.sample(n, rng).T, family) for _ in range(samples)]
    kind = copulas.FAMILIES[family]
    rows = []
    for j, (name, value) in enumerate(zip(kind.names, truth, strict=True)):
        estimates = np.array([one.parameters[j] for one in fits])
        inside = [one.interval[j][0] <= value <= one.interval[j][1] for one in fits]
        columns = [np.array([one.parameters[k] for one in fits]) for k in range(len(truth))]
        free, target = kind.to_free(*columns)[j], kind.to_free(*truth)[j]
        bias = (free.mean() - target) / free.std()
        se = np.mean([one.se[j] for one in fits])
        rows.append(
            f"{family},{name},{value:g},{n},{samples},{estimates.mean():.5g},{estimates.std():.4g},{se:.4g},"
            f"{bias:.4f},{np.mean(inside):.4f}"
        )
    return rows


def ranks_against_probabilities(n: int, samples: int) -> dict:
    """Bias of Student's 1/nu over its standard deviation, from ranks and from known margins, on the same samples."""
    rng = np.random.default_rng([n, samples])
    copula = copulas.Copula("student", TRUTHS["student"])
    ranks, known = np.empty(samples), np.empty(samples)
    for k in range(samples):
        u, v = copula.sample(n, rng).T
        known[k] = 1.0 / copulas.fit_rows(u[None], v[None], "student")[0, 1]
        ranks[k] = 1.0 / copulas.fit_rows(*map(copulas.pseudo_observations, (u[None], v[None])), "student")[0, 1]
    target, sd = 1.0 / copula.parameters[1], ranks.std()
    return {
        "family": "student", "parameter": "1/nu", "n": n, "samples": samples, "sd": float(sd),
        "bias_over_sd_ranks": float((ranks.mean() - target) / sd),
        "bias_over_sd_known_margins": float((known.mean() - target) / sd),
        "difference": float((ranks - known).mean() / sd),
        "standard_error": float((ranks - known).std() / sd / np.sqrt(samples)),
    }  # fmt: skip


if __name__ == "__main__":
    main()
