"""PDFs, tail probabilities and their intervals from n points, against 10^6 samples of responses that are known.

    /usr/bin/python3 tests/benchmarks/bench_tails.py        (about ten minutes)
    /usr/bin/python3 tests/benchmarks/bench_tails.py --few  (half a minute)

Points of `select_points` with 200 seeds (n = 50, 100, 200; 4,096 Sobol' points with equal probabilities and 100 seeds
as an example of many), through a smooth response, one with two humps, one that saturates, one with a plateau, one with
a heavy tail, and the smooth one with an own noise of every run (0.28 of its standard deviation).  Writes
data/benchmarks/tails.csv, one row per response, n and way to estimate, and tails.png:

- `l1`: distance of the shown PDF to the true one in 100 bins, mean over 20 seeds; `sd_error`: relative error of the
  standard deviation of the shown PDF;
- `ratio_1%`, `ratio_5%`: mean estimate over the true probability beyond the 1 % and the 5 % quantile, both tails;
  `rms_1%`, `rms_5%`: root mean square of the relative error;
- `covered_1%` ... : share of seeds whose 95 % interval covers the true probability, and the true quantile (`q`);
  `least_covered` is the least of all thresholds, and `half_width` half the interval over the true probability.

With --few: the shown PDFs alone for n = 8, 16 and 25, into tails_few.csv.  `l1` is the mean and `worst_l1` the largest
of 20 seeds; `highest` is the largest value of the shown PDFs over that of the true one in its bins.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.inputs.joint import fit_joint  # noqa: E402
from analysis.inputs.pairs import read_pairs  # noqa: E402
from analysis.pdem import evolution, widths  # noqa: E402
from analysis.points import select_points  # noqa: E402

FOLDER = ROOT / "data" / "benchmarks"
SIZES, SEEDS, SHOWN = (50, 100, 200), 200, 20
FEW = (8, 16, 25)
MANY, MANY_SEEDS = 4096, 100
MEDIAN, SIGMA_LN = np.array([0.214, 25.7e9]), np.array([0.469, 0.354])
NOISE = {"noisy": 0.05}
TAILS, BINS = (0.01, 0.05), 100
#: Strains of the paths, which rise to their state.
STRAIN = np.linspace(0.0, 0.4, 101)
STATES = {
    "quarter (default)": {},
    "silverman (before)": {"rule": "silverman", "keep_spread": False},
    "silverman sharpened": {"rule": "silverman"},
    "spacing": {"rule": "spacing", "keep_spread": False},
    "quarter not sharpened": {"keep_spread": False},
}
PATHS = {
    "exact (default)": {},
    "tvd minmod (default)": {"method": "tvd"},
    "tvd vanleer": {"method": "tvd", "limiter": "vanleer"},
    "tvd superbee (before)": {"method": "tvd", "limiter": "superbee"},
}


def responses(x: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The responses (n,) at inputs x (n, 2)."""
    u, v = (np.log(x / MEDIAN) / SIGMA_LN).T
    smooth = np.exp(0.25 * u + 0.15 * v)
    return {
        "smooth": smooth,
        "two humps": np.tanh(3 * (u - 0.1)) + 0.15 * u + 0.2 * v,
        "saturating": 0.82 * (1 - np.exp(-x[:, 0] / 0.1)) * (1 + 0.01 * SIGMA_LN[1] * v),
        "plateau": np.minimum(u + 0.4 * v, 0.3),
        "heavy tail": np.exp(0.9 * u + 0.5 * v),
        "noisy": smooth + NOISE["noisy"] * rng.normal(size=len(x)),
    }


class Truth:
    """A response as 10^6 sorted samples, with its bins and the thresholds (name, level, value) of its tails."""

    def __init__(self, samples: np.ndarray):
        self.samples, self.std = np.sort(samples), samples.std()
        low, high = np.quantile(samples, [0.0005, 0.9995])
        reach = 0.1 * (high - low)
        self.edges = np.linspace(low - reach, high + reach, BINS + 1)
        self.mass = np.diff(self.below(self.edges))
        self.thresholds = []
        for tail in TAILS:
            for level in (tail, 1 - tail):
                value = self.samples[int(level * len(samples))]
                if abs(self.below(value) - level) < 0.02 * tail:  # not where a plateau takes the tail
                    self.thresholds.append((tail, level, value))

    def below(self, x) -> np.ndarray:
        """Distribution function."""
        return np.searchsorted(self.samples, x, side="right") / len(self.samples)


def shown(truth: Truth, pdfs: list) -> dict:
    """Errors of shown PDFs (T = 1) of one response."""
    row = {"l1": np.mean([np.abs(np.diff(pdf.cdf(truth.edges)[0]) - truth.mass).sum() for pdf in pdfs])}
    spread = []
    for pdf in pdfs:
        mass = pdf.p[0] * pdf.dx[0]
        spread.append(np.sqrt(mass @ (pdf.x - mass @ pdf.x) ** 2))
    row["sd_error"] = np.mean(spread) / truth.std - 1
    return row | tail_errors(truth, [[pdf.cdf(value)[0, 0] for _, _, value in truth.thresholds] for pdf in pdfs])


def tail_errors(truth: Truth, below) -> dict:
    """Ratio and relative error of the estimated distribution function `below` (seeds, thresholds) in the tails."""
    below, row = np.asarray(below), {}
    for tail in TAILS:
        chosen = [(k, level) for k, (of, level, _) in enumerate(truth.thresholds) if of == tail]
        share = np.array([below[:, k] if level < 0.5 else 1 - below[:, k] for k, level in chosen]) / tail
        row |= {f"ratio_{tail:.0%}": share.mean(), f"rms_{tail:.0%}": np.sqrt(np.mean((share - 1) ** 2))}
    return row


def by_points(truth: Truth, pdfs: list, noise: float) -> dict:
    """Errors and coverage of exceedance probabilities and quantiles from the points."""
    values = [value for _, _, value in truth.thresholds]
    levels = np.array([level for _, level, _ in truth.thresholds])
    row = tail_errors(truth, [1 - pdf.exceedance(values)[0] for pdf in pdfs])
    low, high = np.stack([pdf.exceedance_interval(values, noise) for pdf in pdfs], axis=1)[:, :, 0]
    q_low, q_high = np.stack([pdf.quantile_interval(levels, noise) for pdf in pdfs], axis=1)[:, :, 0]
    covered = ((low <= 1 - levels) & (1 - levels <= high)).mean(axis=0)
    q_covered = ((q_low <= values) & (values <= q_high)).mean(axis=0)
    for tail in TAILS:
        chosen = [k for k, (of, _, _) in enumerate(truth.thresholds) if of == tail]
        row |= {f"covered_{tail:.0%}": covered[chosen].mean(), f"covered_q{tail:.0%}": q_covered[chosen].mean()}
        row[f"half_width_{tail:.0%}"] = 0.5 * np.mean((high - low)[:, chosen]) / tail
    return row | {"least_covered": min(covered.min(), q_covered.min())}


def measure() -> pd.DataFrame:
    """All rows of tails.csv; draws the picture on the way."""
    joint = fit_joint(read_pairs(ROOT / "data" / "pairs_reconstructed.csv"), n_boot=0).joint
    rng = np.random.default_rng(1)
    truths = {name: Truth(values) for name, values in responses(joint.sample(1_000_000, rng), rng).items()}
    rows, pictures = [], {}
    rise = -np.expm1(-STRAIN / 0.05)[:, None]
    at_end = {name: Truth(truth.samples * rise[-1, 0]) for name, truth in truths.items()}
    for n in (*SIZES, MANY):
        method, seeds = ("sobol", MANY_SEEDS) if n == MANY else ("gf", SEEDS)
        sets = [select_points(joint, n, method, seed) for seed in range(1, seeds + 1)]
        found = [responses(points.x, rng) for points in sets]
        for name, truth in truths.items():
            runs = [(values[name], points.probability) for values, points in zip(found, sets, strict=True)]
            estimates = {}
            for way, options in STATES.items():
                pdfs = [evolution.state_pdf(*run, **options) for run in runs[:SHOWN]]
                estimates[way] = shown(truth, pdfs)
                pictures[name, n, way] = pdfs[0]
            for way, options in PATHS.items() if n in SIZES else ():
                pdfs = [evolution.evolve(rise * h, p, STRAIN, **options).at(-1) for h, p in runs[:SHOWN]]
                estimates[f"along strain: {way}"] = shown(at_end[name], pdfs)
            pdfs, noise = [evolution.state_pdf(*run) for run in runs], NOISE.get(name, 0.0)
            estimates["points (default)"] = by_points(truth, pdfs, noise)
            if noise:
                estimates["points without the noise"] = by_points(truth, pdfs, 0.0)
            rows += [{"response": name, "n": n, "estimate": way} | row for way, row in estimates.items()]
    draw(truths, pictures)
    return pd.DataFrame(rows)


def of_few() -> pd.DataFrame:
    """All rows of tails_few.csv."""
    joint = fit_joint(read_pairs(ROOT / "data" / "pairs_reconstructed.csv"), n_boot=0).joint
    rng = np.random.default_rng(1)
    truths = {name: Truth(values) for name, values in responses(joint.sample(200_000, rng), rng).items()}
    rows, least = [], widths._IN_QUARTER
    for n in FEW:
        sets = [select_points(joint, n, seed=seed) for seed in range(1, SHOWN + 1)]
        found = [responses(points.x, rng) for points in sets]
        for name, truth in truths.items():
            height = (truth.mass / np.diff(truth.edges)).max()
            for way, points_in_quarter in (("quarter (default)", least), ("quarter of any number (before)", 0)):
                widths._IN_QUARTER = points_in_quarter
                pdfs = [evolution.state_pdf(values[name], p.probability) for values, p in zip(found, sets, strict=True)]
                l1 = [np.abs(np.diff(pdf.cdf(truth.edges)[0]) - truth.mass).sum() for pdf in pdfs]
                rows.append({"response": name, "n": n, "estimate": way, "l1": np.mean(l1), "worst_l1": max(l1),
                             "highest": max(pdf.p.max() for pdf in pdfs) / height})  # fmt: skip
    widths._IN_QUARTER = least
    return pd.DataFrame(rows)


def draw(truths: dict, pictures: dict) -> None:
    """True PDF, and those of the default and of the rule before, from one set of 100 points."""
    fig, axes = plt.subplots(2, 3, figsize=(10, 5.2), constrained_layout=True)
    for axis, (name, truth) in zip(axes.ravel(), truths.items(), strict=True):
        width = np.diff(truth.edges)
        axis.fill_between(truth.edges[:-1], truth.mass / width, step="post", color="0.85", label="10$^6$ samples")
        for way, style in (("silverman (before)", "C1--"), ("quarter (default)", "C0-")):
            pdf = pictures[name, 100, way]
            axis.plot(pdf.x, pdf.p[0], style, lw=1.3, label=way)
        axis.set(title=name, xlim=(truth.edges[0], truth.edges[-1]), ylim=(0, 1.3 * np.sort(truth.mass / width)[-2]))
    axes[0, 0].legend(frameon=False, fontsize=8)
    fig.suptitle("Shown PDF of 100 points", fontsize=10)
    fig.savefig(FOLDER / "tails.png", dpi=100)


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    few = sys.argv[1:] == ["--few"]
    table = of_few() if few else measure()
    table.to_csv(FOLDER / f"tails{'_few' * few}.csv", index=False, float_format="%.4g")
    print(table.to_string(index=False, float_format="%.3g"))
