"""Points of stated distributions against what was stated: every family, every sufficient set of figures, every copula.

    python3 tests/benchmarks/bench_stated.py            writes data/benchmarks/stated.csv; two minutes
    python3 tests/benchmarks/bench_stated.py --table    prints the worst of each family

mu_s has a distribution of the family, stated by a set of figures (examples of tests/support/stated_cases.py). G_p is
lognormal (median 29 GPa, sigma_ln 0.25). `solved`: largest relative difference between a stated figure and that of the
distribution found. `mean`, `cov` (relative) and `pearson` (absolute) are the errors of 100 points. Rows with `asked`
state a Pearson correlation of a copula, with mu_s lognormal (mean 0.25, cov 0.3). `low` and `high` are the attainable
range, and `range_error` is its difference from adaptive quadrature in u (scipy).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import integrate

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

from stated_cases import EXAMPLES, stated_sets  # noqa: E402

from analysis.inputs.association import attainable  # noqa: E402
from analysis.inputs.family import MarginalError  # noqa: E402
from analysis.inputs.figures_stated import figure  # noqa: E402
from analysis.inputs.specified import joint_from_distributions  # noqa: E402
from analysis.points.selection import select_points  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "stated.csv"
MODULUS = {"family": "lognormal", "median": 29.0, "sigma_ln": 0.25}
FRICTION = {"family": "lognormal", "mean": 0.25, "cov": 0.30}
POINTS = 100
#: Copula -> Pearson correlations to ask for.
ASKED = {
    "gaussian": (-0.9, -0.5, 0.5), "student": (-0.5, 0.5), "frank": (-0.5, 0.5), "plackett": (-0.5, 0.5),
    "clayton": (0.5,), "clayton180": (0.5,), "clayton90": (-0.5,), "clayton270": (-0.5,), "gumbel": (0.5,),
    "gumbel180": (0.5,), "gumbel90": (-0.5,), "gumbel270": (-0.5,), "joe": (0.5,), "joe180": (0.5,), "joe90": (-0.5,),
    "joe270": (-0.5,),
}  # fmt: skip


def errors(friction: dict, copula: dict, asked: float) -> dict[str, float]:
    """Errors of the points of one stated input."""
    dependence = {"measure": "pearson", "mu_s": {"G_p_GPa": asked}} | copula
    joint = joint_from_distributions({"mu_s": friction, "G_p_GPa": MODULUS}, dependence).joint
    points = select_points(joint, POINTS)
    w, x = points.probability, points.x
    mean = w @ x
    sd = np.sqrt(w @ (x - mean) ** 2)
    first = joint.marginals[0]
    stated = {name: value for name, value in friction.items() if name != "family"}
    exact = np.array([m.mean for m in joint.marginals]), np.array([m.std / m.mean for m in joint.marginals])
    return {
        "solved": max(abs(figure(first, name) / value - 1) for name, value in stated.items() if value),
        "mean": float(np.abs(mean / exact[0] - 1).max()),
        "cov": float(np.abs(sd / mean / exact[1] - 1).max()),
        "pearson": float(abs(w @ ((x - mean) / sd).prod(axis=1) - asked)),
    }


def attainable_row(family: str) -> dict[str, float]:
    """The attainable range with a family, and its largest difference from scipy's quadrature."""
    first = EXAMPLES[family]
    second = joint_from_distributions({"mu_s": FRICTION, "G_p_GPa": MODULUS}).joint.marginals[1]
    found = attainable(first, second)
    exact = []
    for same in (False, True):

        def product(u: float, same: bool = same) -> float:
            v = u if same else 1.0 - u
            return float((first.ppf(u) - first.mean) * (second.ppf(v) - second.mean)) / (first.std * second.std)

        exact.append(integrate.quad(product, 0.0, 1.0, limit=500, epsabs=1e-11)[0])
    return {"low": found[0], "high": found[1], "range_error": float(np.abs(np.array(found) - exact).max())}


def rows() -> list[dict[str, object]]:
    """All rows of the table; sets that do not determine a distribution are noted without figures."""
    table: list[dict[str, object]] = []
    for family in EXAMPLES:
        limits = attainable_row(family)
        for figures in stated_sets(family):
            row: dict[str, object] = {"family": family, "figures": " ".join(figures), "copula": "gaussian"}
            try:
                row |= errors({"family": family} | figures, {}, -0.5) | limits
            except MarginalError as error:
                row["refused"] = str(error).split(":")[1].split(" have ")[0].strip()
            table.append(row)
    for copula, values in ASKED.items():
        for asked in values:
            extra = {"degrees_of_freedom": 5} if copula == "student" else {}
            found = errors(FRICTION, {"copula": copula} | extra, asked)
            table.append({"family": "lognormal", "figures": "mean cov", "copula": copula, "asked": asked} | found)
    return table


def main() -> None:
    if "--table" not in sys.argv:
        pd.DataFrame(rows()).to_csv(TABLE, index=False)
    table = pd.read_csv(TABLE)
    of_families, of_copulas = table[table.asked.isna()], table[table.asked.notna()]
    worst = of_families.groupby("family", sort=False)[
        ["solved", "mean", "cov", "pearson", "low", "high", "range_error"]
    ]
    counts = of_families.groupby("family", sort=False).agg(sets=("figures", "count"), refused=("refused", "count"))
    print(counts.join(worst.max()).to_string(float_format=lambda value: f"{value:.3g}"))
    print(of_copulas[["copula", "asked", "mean", "cov", "pearson"]].to_string(index=False))


if __name__ == "__main__":
    main()
