"""Do the tests of copulas and marginals hold their level on rounded data, and does rounding bias the estimates?

    /usr/bin/python3 tests/benchmarks/bench_ties.py        (fifteen minutes; resumes where it stopped)

Writes data/benchmarks/ties_copula.csv: samples of the Gaussian copula with lognormal marginals (the paper's Tables 1
and 2), rounded, ranked, fitted and tested with 19 replicates, the fewest that have a level of 5 %: S must exceed all of
them.  `rejected` is the rate of the test with its 95 % interval (Clopper and Pearson), where `ties` is "of the sample",
and the rate of a test whose replicates have no ties where it is "none".  `mean_rho` and `sd_rho` are the mean and the
scatter of the estimates; the true value is -0.738.

And ties_marginal.csv: rates of both tests of a marginal, of both together, and the bias of its two parameters in
standard deviations of the estimate, for samples of mu_s that are rounded (200 simulated samples per test).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from bench_copulas_goodness import interval
from bench_rows import append, finished

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis import copulas  # noqa: E402
from analysis.copulas import goodness  # noqa: E402
from analysis.inputs import marginals  # noqa: E402

COPULA, MARGINAL = (ROOT / "data" / "benchmarks" / name for name in ("ties_copula.csv", "ties_marginal.csv"))
COLUMNS = ("n", "mu_s_step", "G_p_step_GPa", "ties", "trials", "rejected", "rejected_low", "rejected_high", "mean_rho",
           "sd_rho")  # fmt: skip
OF_MARGINAL = ("family", "n", "step", "trials", "rejected_ks", "rejected_ad", "rejected_both", "bias_1", "bias_2")
STEPS = ((0.0, 0.0), (0.01, 1.0), (0.02, 2.0), (0.05, 5.0))
#: 4,000 trials give a level of 5 % to 0.7 %, 2,000 to 1 %, 1,000 to 1.4 %.
TRIALS = {30: 2000, 94: 4000, 500: 1000}
REPLICATES, SIMULATED = 19, 200
RHO, MEDIANS, SIGMAS = -0.738, (0.214, 25.7), (0.469, 0.354)


def main() -> None:
    """Measure what is not in the tables yet."""
    done = finished(COPULA, ("n", "mu_s_step", "ties"))
    cases = [(n, steps, "of the sample", TRIALS[n]) for n in TRIALS for steps in STEPS]
    cases += [(94, steps, "none", 300) for steps in STEPS[1:]]
    for n, steps, ties, trials in cases:
        if (str(n), f"{steps[0]:.6g}", ties) not in done:
            append(COPULA, COLUMNS, of_copula(n, steps, ties, trials))
    done = finished(MARGINAL, ("family", "n", "step"))
    for family in ("lognormal", "weibull"):
        for n in TRIALS:
            for step in (0.0, 0.01, 0.02, 0.05):
                if (family, str(n), f"{step:.6g}") not in done:
                    append(MARGINAL, OF_MARGINAL, of_marginal(family, n, step, 1000))


def of_copula(n: int, steps: tuple[float, float], ties: str, trials: int) -> dict:
    """A row on the test of the copula."""
    rng = np.random.default_rng([n, *(int(100 * step) for step in steps)])
    p, rho = np.empty(trials), np.empty(trials)
    for k in range(trials):
        z = copulas.Copula("gaussian", (RHO,)).sample(n, rng)
        x = np.stack([rounded(marginals.Marginal("lognormal", {"median": m, "sigma_ln": s}).ppf(u), h)
                      for u, m, s, h in zip(z.T, MEDIANS, SIGMAS, steps, strict=True)])  # fmt: skip
        pairs = copulas.pseudo_observations(x).T
        estimate = copulas.fit_rows(pairs[None, :, 0], pairs[None, :, 1], "gaussian")[0]
        rho[k] = estimate[0]
        if ties == "none":
            S = goodness.statistic(pairs[None], "gaussian", estimate[None])[0]
            table = goodness.without_ties(n)
            simulated = goodness.simulate_statistics("gaussian", estimate, table, REPLICATES, rng)
            p[k] = (0.5 + np.sum(simulated >= S)) / (REPLICATES + 1)
        else:
            p[k] = goodness.bootstrap_test(pairs, "gaussian", estimate, REPLICATES, rng)[1]
    rejected = int(np.sum(p <= 0.05))
    low, high = interval(rejected, trials)
    values = (n, *steps, ties, trials, rejected / trials, low, high, float(rho.mean()), float(rho.std()))
    return dict(zip(COLUMNS, values, strict=True))


def of_marginal(family: str, n: int, step: float, trials: int) -> dict:
    """A row on the tests of a marginal: the family is the true one, with the mean and scatter of mu_s."""
    rng = np.random.default_rng([n, int(1000 * step), len(family)])
    params = {"lognormal": {"median": 0.214, "sigma_ln": 0.469}, "weibull": {"shape": 2.1, "scale": 0.27}}[family]
    truth = marginals.Marginal(family, params)
    ks, ad, estimates = np.empty(trials), np.empty(trials), np.empty((trials, 2))
    for k in range(trials):
        x = rounded(truth.sample(n, rng), step)
        fitted = marginals.fit(x, family, SIMULATED, seed=k)
        ks[k], ad[k], estimates[k] = fitted.ks_p_fitted, fitted.ad_p_fitted, list(fitted.params.values())
    both = np.mean((ks <= 0.05) & (ad <= 0.05))
    bias = (estimates.mean(axis=0) - list(params.values())) / estimates.std(axis=0)
    values = (family, n, step, trials, float(np.mean(ks <= 0.05)), float(np.mean(ad <= 0.05)), float(both),
              *map(float, bias))  # fmt: skip
    return dict(zip(OF_MARGINAL, values, strict=True))


def rounded(x: np.ndarray, step: float) -> np.ndarray:
    """Values rounded to multiples of the step, at least one step; 0 leaves them."""
    return np.maximum(np.round(x / step), 1.0) * step if step else x


if __name__ == "__main__":
    main()
