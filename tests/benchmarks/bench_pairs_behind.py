"""Coverage of the 95 % band of mean responses with stated figures and inputs.pairs_behind, where the truth is known.

    python3 tests/benchmarks/bench_pairs_behind.py            200 studies per missing case, writes data/benchmarks
    python3 tests/benchmarks/bench_pairs_behind.py --table    prints data/benchmarks/pairs_behind.csv

In each study n pairs are drawn from a known distribution, and mean, cov and Kendall's tau are stated as in a
publication. `bootstrap_specified` then gives refits with pairs_behind = n, and the band of the mean of a response
follows from them as in `moments_and_quantiles`. `coverage` is the share of studies whose band contains the true
mean, `width` the mean half width over the true mean, `cpu_s` the CPU time of a study.
Responses: `friction` 1 - exp(-mu_s / 0.15), `product` mu_s G_p^(1/3), `stiffness` G_p^(2/3).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.inputs.joint import Joint  # noqa: E402
from analysis.inputs.specified import bootstrap_specified, joint_from_distributions  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "pairs_behind.csv"
STUDIES, REFITS = 200, 200
#: Quadrature over two independent standard normals, 14 nodes each.
_T, _W = np.polynomial.legendre.leggauss(14)
_W = _W * np.exp(-0.5 * (5.0 * _T) ** 2)
NODES = np.stack(np.meshgrid(5.0 * _T, 5.0 * _T, indexing="ij"), axis=-1).reshape(-1, 2)
WEIGHTS = np.outer(_W, _W).ravel() / _W.sum() ** 2
#: Case -> families of mu_s and G_p, copula and Kendall's tau of the truth.
CASES = {
    "lognormal, gaussian": ("lognormal", "lognormal", "gaussian", -0.36),
    "gamma and weibull, frank": ("gamma", "weibull", "frank", -0.36),
    "truncated normal and normal, clayton90": ("truncated_normal", "normal", "clayton90", -0.36),
    "uniform and triangular, independent": ("uniform", "triangular", "independence", 0.0),
}
PAIRS = (12, 40, 94)
MEANS, COVS = {"mu_s": 0.25, "G_p_GPa": 29.0}, {"mu_s": 0.30, "G_p_GPa": 0.20}


def responses(x: np.ndarray) -> np.ndarray:
    """Three responses (m, 3) at points x (m, 2) of mu_s and G_p (Pa)."""
    friction, modulus = np.maximum(x[:, 0], 0.0), np.maximum(x[:, 1] * 1e-9, 0.0)
    return np.stack([1 - np.exp(-friction / 0.15), friction * np.cbrt(modulus), np.cbrt(modulus) ** 2], axis=1)


def means(joint: Joint) -> np.ndarray:
    """Exact means (3,) of the responses, by quadrature."""
    return WEIGHTS @ responses(joint.from_normal(NODES))


def stated(families: tuple[str, str], copula: str, figures: dict[str, dict[str, float]], tau: float):
    """The inputs that publish these figures."""
    variables = {key: {"family": family} | figures[key] for key, family in zip(MEANS, families, strict=True)}
    for section in variables.values():
        if section["family"] == "triangular":  # a symmetric one, so that mean and cov determine it
            half = section["mean"] * section.pop("cov") * np.sqrt(6.0)
            section |= {"low": section["mean"] - half, "high": section["mean"] + half}
    dependence = {"copula": copula, "measure": "kendall", "mu_s": {"G_p_GPa": tau}}
    return joint_from_distributions(variables, None if copula == "independence" else dependence)


def study(case: str, n: int, truth, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Mean (3,) of the responses and half width (3,) of its band, of one study of n pairs."""
    first, second, copula, _ = CASES[case]
    x = truth.joint.sample(n, rng) * [1.0, 1e-9]
    figures = {key: {"mean": column.mean(), "cov": column.std(ddof=1) / column.mean()}
               for key, column in zip(MEANS, x.T, strict=True)}  # fmt: skip
    tau = stats.kendalltau(*x.T)[0]
    found = stated((first, second), copula, figures, min(tau, -0.01) if copula == "clayton90" else tau)
    refits = np.array([means(joint) for joint in bootstrap_specified(found, n, REFITS, rng)])
    wide = stats.t.ppf(0.975, n - 1) / stats.norm.ppf(0.975) * np.sqrt(n / (n - 1))
    off = wide * (refits - refits.mean(axis=0))
    return means(found.joint), np.abs(np.quantile(off, [0.025, 0.975], axis=0)).max(axis=0)


def rows(done: set[tuple[str, int]], studies: int = STUDIES):
    """The rows of all cases that are not done."""
    for case, (first, second, copula, tau) in CASES.items():
        figures = {key: {"mean": MEANS[key], "cov": COVS[key]} for key in MEANS}
        truth = stated((first, second), copula, figures, tau)
        exact = means(truth.joint)
        for n in PAIRS:
            if (case, n) in done:
                continue
            begin = time.process_time()
            rng = np.random.default_rng([n, list(CASES).index(case)])
            found = [study(case, n, truth, rng) for _ in range(studies)]
            hit = np.array([np.abs(mean - exact) <= half for mean, half in found])
            width = np.mean([half for _, half in found], axis=0) / exact
            for k, name in enumerate(("friction", "product", "stiffness")):
                yield {"case": case, "pairs_behind": n, "response": name, "studies": studies,
                       "coverage": hit[:, k].mean(), "width": round(width[k], 4),
                       "cpu_s": round((time.process_time() - begin) / studies, 3)}  # fmt: skip


def main() -> None:
    if "--table" not in sys.argv:
        table = pd.read_csv(TABLE).to_dict("records") if TABLE.exists() else []
        for row in rows({(row["case"], row["pairs_behind"]) for row in table}):
            table.append(row)
            if row["response"] == "stiffness":  # the last of its case
                pd.DataFrame(table).to_csv(TABLE, index=False)
    print(pd.read_csv(TABLE).to_string(index=False))


if __name__ == "__main__":
    main()
