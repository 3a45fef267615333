"""Coverage of the interval of a quantile of mu_s when few pairs are behind it, and why it is too low.

    /usr/bin/python3 tests/benchmarks/bench_few_pairs.py            (about three minutes; begins anew)
    /usr/bin/python3 tests/benchmarks/bench_few_pairs.py --table

400 samples of 12 or 30 values of the paper's lognormal mu_s.  few_pairs.csv: `covers`, and the share of samples in
which the true quantile lies below or above the interval.  The interval comes from refits to resampled values; it is
widened by Student's t and sqrt(n / (n - 1)), and symmetric about the estimate.  `method`: the true family; the family
with the smallest AIC; the family chosen anew for each resample; families drawn with their AIC weights; and the last two
with intervals that are symmetric in the logarithm.  "scaled": the deviation of each refit is scaled by its own scatter;
"chosen anew, scaled" is what a campaign does (`analysis.surrogates.distribution`).  `other_family`: share of samples
for which AIC chooses another family than the true one.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT)]

from analysis.inputs import marginals  # noqa: E402
from analysis.surrogates.distribution import error_of_inputs  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "few_pairs.csv"
SAMPLES, RESAMPLES, TRUE = 400, 100, "lognormal"
MEDIAN, SIGMA = 0.214, 0.469
LEVELS = (0.05, 0.95)
FAMILIES = tuple(marginals.FAMILIES)
#: Middles of as many equally probable parts of a distribution, for its mean and standard deviation.
MIDDLES = (np.arange(200) + 0.5) / 200


def statistics_and_aic(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Statistics (families, 2 + levels, R) and AIC (families, R) of each family, fitted to samples (R, n).

    The statistics are the mean, the logarithm of the standard deviation, and the quantiles.
    """
    found, aic = [], []
    for name in FAMILIES:
        family, fitted = marginals.family_of(name), marginals.fit_rows(samples, name)
        columns = [fitted[:, [j]] for j in range(fitted.shape[1])]
        values = family.ppf(MIDDLES, *columns)
        moments = [values.mean(axis=1), np.log(values.std(axis=1))]
        found.append([*moments, *(family.ppf(level, *fitted.T) for level in LEVELS)])
        aic.append(2 * fitted.shape[1] - 2 * family.logpdf(samples, *columns).sum(axis=1))
    return np.array(found), np.nan_to_num(np.array(aic), nan=np.inf)


def interval(refits: np.ndarray, estimate: float, n: int, in_logarithm: bool) -> tuple[float, float]:
    """The 95 % interval about an estimate, from refits (R,) to resamples of n values."""
    if in_logarithm:
        low, high = interval(np.log(np.maximum(refits, 1e-9)), np.log(max(estimate, 1e-9)), n, False)
        return float(np.exp(low)), float(np.exp(high))
    wide = stats.t.ppf(0.975, n - 1) / stats.norm.ppf(0.975) * np.sqrt(n / (n - 1))
    return about(estimate, wide * (refits - refits.mean()))


def about(estimate: float, off: np.ndarray) -> tuple[float, float]:
    """The 95 % interval about an estimate, from deviations (R,)."""
    half = np.abs(np.quantile(off, [0.025, 0.975])).max()
    return estimate - half, estimate + half


def intervals(values: np.ndarray, rng: np.random.Generator) -> tuple[dict[tuple[str, float], tuple], bool]:
    """(method, level) -> interval from values (n,), and whether AIC chooses another family than the true one."""
    n = len(values)
    every, aic = statistics_and_aic(np.stack([values, *values[rng.integers(0, n, (RESAMPLES, n))]]))
    best = aic.argmin(axis=0)
    weights = np.exp(-0.5 * (aic[:, 0] - aic[:, 0].min()))
    drawn = rng.choice(len(FAMILIES), RESAMPLES, p=weights / weights.sum())
    each, found = np.arange(1, RESAMPLES + 1), {}
    of_true = every[FAMILIES.index(TRUE)].T  # (1 + R, 2 + levels)
    scaled = {"true family, scaled": error_of_inputs(of_true[1:], of_true[0], n),
              "chosen anew, scaled": error_of_inputs(every[best[1:], :, each], every[best[0], :, 0], n)}  # fmt: skip
    for k, level in enumerate(LEVELS):
        of_level = every[:, 2 + k]
        true, chosen = of_level[FAMILIES.index(TRUE)], of_level[best[0]]
        cases = {"true family": (true[1:], true[0]), "smallest AIC": (chosen[1:], chosen[0]),
                 "chosen anew": (of_level[best[1:], each], chosen[0]),
                 "AIC weights": (of_level[drawn, each], chosen[0])}  # fmt: skip
        for method, (refits, estimate) in cases.items():
            found[method, level] = interval(refits, estimate, n, False)
            if method in ("chosen anew", "AIC weights"):
                found[f"{method}, logarithm", level] = interval(refits, estimate, n, True)
        for method, off in scaled.items():
            found[method, level] = about(true[0] if "true" in method else chosen[0], off[:, 2 + k])
    return found, FAMILIES[best[0]] != TRUE


def rows_of(n: int) -> list[dict]:
    """All rows for samples of n values."""
    rng = np.random.default_rng([1, n])
    hits: dict[tuple[str, float], list] = {}
    others = 0
    for _ in range(SAMPLES):
        found, other = intervals(MEDIAN * np.exp(SIGMA * rng.normal(size=n)), rng)
        others += other
        for (method, level), (low, high) in found.items():
            truth = MEDIAN * np.exp(SIGMA * stats.norm.ppf(level))
            hits.setdefault((method, level), []).append((truth < low, truth > high))
    rows = []
    for (method, level), outside in hits.items():
        below, above = np.mean(outside, axis=0)
        rows.append({"pairs": n, "level": level, "method": method, "covers": 1 - below - above, "truth_below": below,
                     "truth_above": above, "other_family": others / SAMPLES})  # fmt: skip
    return rows


def main() -> None:
    if "--table" not in sys.argv:
        pd.DataFrame([row for n in (12, 30) for row in rows_of(n)]).to_csv(TABLE, index=False, float_format="%.4g")
    print(pd.read_csv(TABLE).to_string(index=False))


if __name__ == "__main__":
    main()
