"""How well n representative points stand for the joint distribution: discrepancy, moments, integrals, weights, cost.

    /usr/bin/python3 tests/benchmarks/bench_points.py                     (a few minutes)
    /usr/bin/python3 tests/benchmarks/bench_points.py --dimensions        (two minutes)

Writes data/benchmarks/points.csv (a row for each method and n: 20 seeds; discrepancies of mu_s and G_p; largest errors
of means, standard deviations and correlation; root-mean-square errors of five integrals over their standard deviation),
points_convergence.csv and .png there (those errors against n, and their slopes) and points_cost.csv.  With --dimensions
it writes points_dimensions.csv only: the same for two and for three variables, for which the points' cells are sampled.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy import special

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.copulas.multivariate import GaussianCopula  # noqa: E402
from analysis.inputs.joint import Joint, fit_joint  # noqa: E402
from analysis.inputs.marginals import Marginal  # noqa: E402
from analysis.inputs.pairs import read_pairs  # noqa: E402
from analysis.points import selection, voronoi  # noqa: E402
from analysis.points.discrepancy import moment_errors  # noqa: E402

FOLDER = ROOT / "data" / "benchmarks"
SIZES = (25, 50, 100, 200, 400)
SEEDS = range(20)
METHODS = {
    "gf": {"method": "gf"},
    "gf-nested": {"method": "gf", "nested": True},
    "gf-published": {"method": "gf-published"},
    "sobol": {"method": "sobol"},
    "lhs": {"method": "lhs"},
    "mc": {"method": "mc"},
}
INTEGRALS = ("saturating_strength", "stiffness_power", "strength_over_stiffness", "smooth_exceedance", "gaussian_bump")


def functions(x: np.ndarray) -> np.ndarray:
    """Five smooth functions (m, 5) of mu_s and G_p shaped like responses; none is among the moments made exact."""
    mu_s, g = x[:, 0], x[:, 1] / 25.7e9
    strength = 0.82 * (1.0 - np.exp(-mu_s / 0.1))
    bump = np.exp(-(np.log(mu_s / 0.214) ** 2 + np.log(g) ** 2))
    exceedance = special.ndtr((strength - 0.65) / 0.08)
    return np.stack([strength, g ** (2 / 3) * (1.0 - 0.3 * mu_s), strength / g, exceedance, bump], axis=1)


def functions_of_three(x: np.ndarray) -> np.ndarray:
    """The same five (m, 5) of mu_s, G_p and nu: nu changes stiffness and strength as it does with Hertzian contacts."""
    two = functions(x[:, :2])
    softer = 0.8 / (1.0 - x[:, 2])
    strength, stiffness = two[:, 0] * softer**0.1, two[:, 1] * softer ** (2 / 3)
    bump = two[:, 4] * np.exp(-((np.log(x[:, 2] / 0.2) / 0.5) ** 2))
    exceedance = special.ndtr((strength - 0.65) / 0.08)
    return np.stack([strength, stiffness, two[:, 2] / softer, exceedance, bump], axis=1)


def dimensions() -> None:
    """Write points_dimensions.csv."""
    two = fit_joint(read_pairs(ROOT / "data" / "pairs_reconstructed.csv"), n_boot=0).joint
    rho = two.copula.parameters[0]
    matrix = ((1.0, rho, 0.3), (rho, 1.0, -0.1), (0.3, -0.1, 1.0))
    nu = Marginal("lognormal", {"median": 0.2, "sigma_ln": 0.15})
    three = Joint((*two.marginals, nu), GaussianCopula(matrix))
    header = "variables,method,n,D_median,D_worst,mean_error_worst,std_error_worst,correlation_error_worst,"
    header += "P_min_times_n,P_max_times_n," + ",".join(f"rms_{name}" for name in INTEGRALS)
    rows = []
    for joint, integrands, nodes in ((two, functions, 300), (three, functions_of_three, 90)):
        exact = joint.expectation(integrands, nodes=nodes)
        scale = np.sqrt(joint.expectation(lambda x, f=integrands, e=exact: (f(x) - e) ** 2, nodes=nodes))
        for n in (50, 100, 200):
            for name in ("gf", "sobol", "lhs"):
                found = [quality(joint, integrands, name, n, seed, exact, scale) for seed in SEEDS]
                D, moments, shares, integrals = (np.array(part) for part in zip(*found, strict=True))
                row = [np.median(D), D.max(), *moments.max(axis=0), shares[:, 0].min(), shares[:, 1].max()]
                row += np.sqrt(np.mean(integrals**2, axis=0)).tolist()
                rows.append(f"{joint.dimension},{name},{n}," + numbers(row))
    write("points_dimensions.csv", header, rows)


def quality(joint: Joint, integrands, name: str, n: int, seed: int, exact: np.ndarray, scale: np.ndarray):
    """Largest discrepancy of a marginal, errors of the moments, least and largest n P, errors of the integrals."""
    chosen = selection.select_points(joint, n, seed=seed, **METHODS[name])
    found = moment_errors(chosen.x, chosen.probability, joint)
    P = chosen.probability
    moments = [np.abs(found[key]).max() for key in ("mean", "std", "correlation")]
    return max(chosen.discrepancy), moments, (n * P.min(), n * P.max()), (P @ integrands(chosen.x) - exact) / scale


def main() -> None:
    """Measure everything and write the three tables."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    joint = fit_joint(read_pairs(ROOT / "data" / "pairs_reconstructed.csv"), n_boot=0).joint
    exact = joint.expectation(functions, nodes=300)
    scale = np.sqrt(joint.expectation(lambda x: (functions(x) - exact) ** 2, nodes=300))
    table = {(name, n): measure(joint, name, n, exact, scale) for n in SIZES for name in METHODS}
    header = "method,n,D_mu_s_median,D_G_p_median,D_mu_s_worst,D_G_p_worst,mean_error_worst,std_error_worst,"
    header += "correlation_error_worst,sum_error_worst,P_min_times_n,P_max_times_n,largest_P_minus_exact_Voronoi,"
    header += "exact_minus_sampled_Voronoi," + ",".join(f"rms_{name}" for name in INTEGRALS)
    write("points.csv", header, [f"{name},{n}," + numbers(row) for (name, n), row in table.items()])
    rows = []
    for name in METHODS:
        errors = np.maximum([table[name, n][-len(INTEGRALS) :] for n in SIZES], 1e-16)
        rows.append(f"{name}," + numbers(-np.polyfit(np.log(SIZES), np.log(errors), 1)[0]))
    write("points_convergence.csv", "method," + ",".join(f"order_{name}" for name in INTEGRALS), rows)
    write("points_cost.csv", "what,cpu_seconds,over_a_million_samples", cost(joint))
    draw()


def measure(joint: Joint, name: str, n: int, exact: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """One row of points.csv."""
    D, moments, integrals, rest = [], [], [], []
    for seed in SEEDS:
        chosen = selection.select_points(joint, n, seed=seed, **METHODS[name])
        D.append(chosen.discrepancy)
        found = moment_errors(chosen.x, chosen.probability, joint)
        moments.append([np.abs(found[key]).max() for key in ("mean", "std", "correlation")])
        integrals.append((chosen.probability @ functions(chosen.x) - exact) / scale)
        z = joint.to_normal(chosen.x)
        cells = voronoi.cell_probabilities(z)
        sampled = np.abs(voronoi.sampled_cell_probabilities(z, 2**17) - cells).max() if seed < 2 else 0.0
        sum_error = abs(math.fsum(chosen.probability) - 1.0)
        P = chosen.probability
        rest.append([sum_error, P.min() * n, P.max() * n, np.abs(P - cells).max(), sampled])
    rest = np.array(rest)
    return np.concatenate(
        [
            np.median(D, axis=0),
            np.max(D, axis=0),
            np.max(moments, axis=0),
            [rest[:, 0].max(), rest[:, 1].min(), rest[:, 2].max(), rest[:, 3].max(), rest[:, 4].max()],
            np.sqrt(np.mean(np.square(integrals), axis=0)),
        ]
    )


def cost(joint: Joint) -> list[str]:
    """CPU time of choosing points beside that of a million plain samples of the joint distribution, in one run."""
    cases = {
        "a million samples": lambda: joint.sample(1_000_000, np.random.default_rng(1)),
        "n = 100, gf": lambda: selection.select_points(joint, 100, seed=99),
        "n = 100, gf, nested": lambda: selection.select_points(joint, 100, seed=99, nested=True),
        "n = 100, gf-published": lambda: selection.select_points(joint, 100, "gf-published", seed=99),
        "n = 400, gf": lambda: selection.select_points(joint, 400, seed=99),
        "reweighting 100 points": lambda: selection.reweight(selection.select_points(joint, 100, "sobol"), joint),
    }
    seconds = {}
    for name, run in cases.items():
        run()
        times = []
        for _ in range(3):
            start = time.process_time()
            run()
            times.append(time.process_time() - start)
        seconds[name] = min(times)
    return [f'"{name}",{value:.4f},{value / seconds["a million samples"]:.4f}' for name, value in seconds.items()]


def draw() -> None:
    """Draw the errors of the five integrals against n from points.csv, as points_convergence.png."""
    table = pd.read_csv(FOLDER / "points.csv")
    figure, axes = plt.subplots(1, len(INTEGRALS), figsize=(15, 3.4), sharey=True, layout="constrained")
    for axis, integral in zip(axes, INTEGRALS, strict=True):
        for name in METHODS:
            rows = table[table.method == name]
            axis.loglog(rows.n, rows[f"rms_{integral}"].clip(lower=1e-7), marker="o", ms=3, label=name)
        axis.set(title=integral.replace("_", " "), xlabel="points n")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("rms error / standard deviation")
    axes[-1].legend(fontsize=7)
    figure.savefig(FOLDER / "points_convergence.png", dpi=110)
    plt.close(figure)


def numbers(row) -> str:
    """Comma-separated values, four digits each."""
    return ",".join(f"{value:.4g}" for value in row)


def write(name: str, header: str, rows: list[str]) -> None:
    """Write one table and show it."""
    (FOLDER / name).write_text("\n".join([header, *rows]) + "\n")
    print(header, *rows, sep="\n", flush=True)


if __name__ == "__main__":
    dimensions() if "--dimensions" in sys.argv[1:] else main()
