"""Do bands hold if the families are not known?  Coverage of 95 % bands, with families fixed and chosen again.

    /usr/bin/python3 tests/benchmarks/bench_input_choice.py        (ten minutes; resumes where it stopped)

Writes data/benchmarks/input_choice.csv, 200 samples per row: pairs are drawn from a known joint distribution, fitted as
`fit_joint` does by AIC alone, and refitted to 100 bootstrap samples, once with the families of the fit (`families` =
"fixed") and once with families that each sample chooses again ("chosen again").  The response is f = tanh(mu_s / 0.3) +
0.3 ln(G_p / 25 GPa).  `mean`, `sd` and `q95` are the shares of bands of its mean, standard deviation and 95 % quantile
that contain the true value, made as the tables make them (`analysis.surrogates.distribution`); `width_*` their median
half width in standard deviations of f.  `right_copula` is the share of samples whose fit has the true copula.
And input_choice_cost.csv: CPU-s of 200 refits of n pairs, as in a campaign.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from bench_rows import append, finished
from scipy.stats import qmc

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis import copulas  # noqa: E402
from analysis.inputs.joint import Joint, bootstrap_joints  # noqa: E402
from analysis.inputs.marginals import FAMILIES, Marginal, fit_all  # noqa: E402
from analysis.inputs.refits import Candidates  # noqa: E402
from analysis.surrogates.distribution import error_of_inputs  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "input_choice.csv"
COST = TABLE.with_name("input_choice_cost.csv")
NUMBERS = ("mean", "sd", "q95")
COLUMNS = ("truth", "n", "samples", "families", *NUMBERS, *(f"width_{name}" for name in NUMBERS), "right_copula")
SAMPLES, REFITS, POWER = 200, 100, 8
LOGNORMALS = (
    Marginal("lognormal", {"median": 0.214, "sigma_ln": 0.469}),
    Marginal("lognormal", {"median": 25.7e9, "sigma_ln": 0.354}),
)
OTHERS = (Marginal("weibull", {"shape": 2.1, "scale": 0.27}), Marginal("gumbel", {"location": 2.3e10, "scale": 7e9}))
TRUTHS = {
    "gaussian, lognormal": Joint(LOGNORMALS, copulas.Copula("gaussian", (-0.738,))),
    "student, lognormal": Joint(LOGNORMALS, copulas.Copula("student", (-0.7, 4.0))),
    "frank, weibull and gumbel": Joint(OTHERS, copulas.Copula("frank", (-6.0,))),
}


def main() -> None:
    """Measure what is not in the tables yet."""
    done = finished(TABLE, ("truth", "n"))
    for n in (94, 30):
        for truth in TRUTHS:
            if (truth, str(n)) not in done:
                for row in coverage(truth, n):
                    append(TABLE, COLUMNS, row)
    done = finished(COST, ("n",))
    for n in (94, 500, 2000):
        if (str(n),) not in done:
            row = cost(n)
            append(COST, tuple(row), row)


def coverage(truth: str, n: int) -> list[dict]:
    """The two rows of one truth and number of pairs."""
    joint, uniforms = TRUTHS[truth], qmc.Sobol(2, seed=1).random_base2(POWER)
    exact = statistics(joint.inverse_rosenblatt(qmc.Sobol(2, seed=2).random_base2(18)))
    offset = statistics(joint.inverse_rosenblatt(uniforms)) - exact  # error of the few samples, taken out below
    inside, widths = np.zeros((2, SAMPLES, 3), dtype=bool), np.zeros((2, SAMPLES, 3))
    right = 0
    for k in range(SAMPLES):
        rng = np.random.default_rng([n, k, list(TRUTHS).index(truth)])
        pairs = joint.sample(n, rng)
        fitted, candidates = fit(pairs)
        right += fitted.copula.family == joint.copula.family
        centre = statistics(fitted.inverse_rosenblatt(uniforms)) - offset
        for i, families in enumerate((None, candidates)):
            refits = bootstrap_joints(pairs, REFITS, np.random.default_rng(k), fitted, families)
            found = np.stack([statistics(one.inverse_rosenblatt(uniforms)) for one in refits])
            off = error_of_inputs(found, statistics(fitted.inverse_rosenblatt(uniforms)), n)
            half = np.abs(np.quantile(off, [0.025, 0.975], axis=0)).max(axis=0)
            inside[i, k], widths[i, k] = np.abs(centre - exact) <= half, half
    sd = float(np.exp(exact[1]))
    scale = np.array([sd, 1.0, sd])
    rows = []
    for i, families in enumerate(("fixed", "chosen again")):
        numbers = [*inside[i].mean(axis=0), *np.median(widths[i], axis=0) / scale]
        values = (truth, n, SAMPLES, families, *map(float, numbers), right / SAMPLES)
        rows.append(dict(zip(COLUMNS, values, strict=True)))
    return rows


def statistics(x: np.ndarray) -> np.ndarray:
    """Mean, log of the standard deviation and 95 % quantile of the response at inputs x (m, 2)."""
    f = np.tanh(x[:, 0] / 0.3) + 0.3 * np.log(np.maximum(x[:, 1], 1e8) / 25e9)
    return np.array([f.mean(), np.log(f.std()), np.quantile(f, 0.95)])


def fit(pairs: np.ndarray, families: tuple[str, ...] = tuple(FAMILIES)) -> tuple[Joint, Candidates | None]:
    """The joint distribution that `fit_joint` chooses by AIC alone, without its tests, and the families tried."""
    tables = [fit_all(column, families, n_sim=0) for column in pairs.T]
    fits = copulas.select(*pairs.T, families=copulas.PAPER_FAMILIES, n_boot=0)
    joint = Joint(tuple(table[0] for table in tables), fits[0].copula)
    return joint, Candidates.tried(dict(zip(("mu_s", "G_p"), tables, strict=True)), fits)


def cost(n: int) -> dict:
    """CPU-s of 200 refits of n pairs with fixed families, with families chosen again, and of a kernel density."""
    pairs = TRUTHS["gaussian, lognormal"].sample(n, np.random.default_rng(n))
    row: dict = {"n": n, "refits": 200}
    for name, marginals in (("", tuple(FAMILIES)), ("_kernel", ("kernel",))):
        joint, tried = fit(pairs, marginals)
        for families, candidates in (("fixed", None), ("chosen_again", tried)):
            start = time.process_time()
            bootstrap_joints(pairs, 200, np.random.default_rng(1), joint, candidates)
            row[f"cpu_seconds_{families}{name}"] = time.process_time() - start
    return row


if __name__ == "__main__":
    main()
