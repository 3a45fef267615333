"""Packings in rotation on synthetic campaigns whose truth is known: errors, coverage of intervals, stopping rule.

    /usr/bin/python3 tests/benchmarks/bench_rotation.py [errors | coverage | pairs | stopping ...]    (about 40 minutes)
    /usr/bin/python3 tests/benchmarks/bench_rotation.py --table

Resumes row by row; without a name it does all four.  400 campaigns per row unless stated otherwise (100 with 200
points; the column `campaigns` has the number).  A campaign has n
representative points of the inputs fitted to data/pairs_reconstructed.csv, which are dealt to R packings; a run is
surface + packing + own noise, both in units of the standard deviation of the surface over the inputs (the laptop
campaign: own 0.11 to 0.23 for peak eta, 0.3 for critical eta, 0.25 for e, 0.45 for Phi_dev; packing 0 to 0.26).
Surfaces: smooth (the laptop's peak eta), kinked (constant below a friction, straight above), plateau (saturating on
both sides).  Own noise: normal, t5 (Student, 5 degrees of freedom), growing (proportional to mu_s^1.07), autocorrelated
(correlation 0.8 between the four strains of 100 campaigns).

rotation_errors.csv: root mean square errors over the true standard deviation, of the weighted points (`_raw`) and of
the model (denoised), against the true distribution of the surface; W1 is the mean Wasserstein-1 error.  Design "old":
100 points with one packing and 4 more at 5 of them, whose offsets are levelled; its denoised columns use the new model.
rotation_coverage.csv: share of campaigns in which the 95 % interval contains the truth; `_sim` as simulated.
rotation_pairs.csv: the same if the inputs are fitted to 12 or 30 pairs; 200 campaigns, one sample of pairs each.  As in
a campaign, every resample of the pairs chooses its families again.
rotation_stopping.csv: the rule with batches of up to 100 points, 100 campaigns: points used, mean claim and error when
it stops, and share of campaigns whose error is within the claim then (`holds`), and after every batch (`holds_always`).
rotation.png: error of the mean and W1 against core-hours (costs of data/laptop/tables/runs.csv, three densities).
"""

from __future__ import annotations

import sys
from functools import cache
from itertools import product
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.stats import qmc

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support"), str(Path(__file__).parent)]

import analytic_cases  # noqa: E402
import bench_rows  # noqa: E402

from analysis import fit_joint, read_pairs, select_points  # noqa: E402
from analysis.inputs.joint import bootstrap_joints  # noqa: E402
from analysis.inputs.refits import Candidates  # noqa: E402
from analysis.pdem import weighted  # noqa: E402
from analysis.surrogates import rotation, stopping, surrogate  # noqa: E402
from analysis.surrogates.distribution import moments_and_quantiles  # noqa: E402

FOLDER = ROOT / "data" / "benchmarks"
CAMPAIGNS, FEW, REPLAYED, OF_PAIRS, DENSITIES = 400, 100, 100, 200, 3
JOINT = fit_joint(read_pairs(ROOT / "data" / "pairs_reconstructed.csv"), n_boot=0).joint
FINE = JOINT.inverse_rosenblatt(qmc.Sobol(2, seed=3).random_base2(12))
COARSE = JOINT.inverse_rosenblatt(qmc.Sobol(2, seed=1).random_base2(9))
LEVELS = (0.05, 0.95)
NAMES = ("mean", "sd", "q05", "q95")
#: Response -> surface and standard deviation of the own noise.
RESPONSES = {"peak eta": ("smooth", 0.17), "e": ("kinked", 0.25), "Phi_dev": ("plateau", 0.45)}
SHARED = (0.1, 0.0, 0.3)
DESIGNS = [(n, R) for n in (100, 50, 25, 200) for R in (20, 10, 5, 1, 100) if n >= R]
SHOWN = ("peak eta", "Phi_dev")
OLD_PACKINGS, OLD_POINTS = 4, 5


def standardised(x: np.ndarray) -> np.ndarray:
    """Standardised logarithms (2, n) of the inputs (n, 2)."""
    logs = np.log(FINE)
    return ((np.log(x) - logs.mean(axis=0)) / logs.std(axis=0)).T


SURFACES = {
    "smooth": lambda x: analytic_cases.dem_like_states(x)["peak"],
    "kinked": lambda x: np.maximum(standardised(x)[0], -0.4) + 0.1 * standardised(x)[1],
    "plateau": lambda x: np.tanh(1.5 * standardised(x)[0] + 0.75) + 0.1 * standardised(x)[1],
}


@cache
def truth(surface: str) -> tuple[np.ndarray, float, np.ndarray]:
    """Mean, sd and quantiles (4,), sd, and sorted values of a surface over the inputs."""
    values = SURFACES[surface](FINE)
    return np.array([values.mean(), values.std(), *hazen(values)]), values.std(), np.sort(values)


def hazen(values: np.ndarray) -> np.ndarray:
    """Quantiles (..., 2) at LEVELS."""
    return np.moveaxis(np.quantile(values, LEVELS, axis=-1, method="hazen"), 0, -1)


@cache
def points(n: int) -> tuple[np.ndarray, np.ndarray]:
    """n points (n, 2) in the order in which a campaign runs them, and their probabilities."""
    chosen = select_points(JOINT, n)
    order = rotation.nested_order(chosen.x)
    return chosen.x[order], chosen.probability[order]


@cache
def packings(n: int, count: int) -> np.ndarray:
    """Packing (n,) of each point."""
    return rotation.deal(points(n)[0], count)


def own_noise(kind: str, x: np.ndarray, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Noise (T, n) of unit mean variance over the inputs."""
    if kind == "t5":
        return rng.standard_t(5, shape) / np.sqrt(5 / 3)
    noise = rng.normal(size=shape)
    if kind == "autocorrelated":  # the rows are 100 campaigns, four strains each
        for k in range(1, len(noise)):
            noise[k] = noise[k] if k % 4 == 0 else 0.8 * noise[k - 1] + 0.6 * noise[k]
    if kind == "growing":
        grown = np.exp(0.5 * standardised(FINE)[0])
        noise *= np.exp(0.5 * standardised(x)[0]) / np.sqrt(np.mean(grown**2))
    return noise


def campaigns(surface: str, kind: str, own: float, shared: float, n: int, count: int, seed: int = 1) -> np.ndarray:
    """Values (CAMPAIGNS, n) of the runs of all points."""
    rng = np.random.default_rng([seed, n, count])
    (x, _), sd = points(n), truth(surface)[1]
    of_packing = rng.normal(size=(CAMPAIGNS, count))[:, packings(n, count)]
    return SURFACES[surface](x) + sd * (shared * of_packing + own * own_noise(kind, x, (CAMPAIGNS, n), rng))


def old_design(surface: str, own: float, shared: float) -> np.ndarray:
    """Values (CAMPAIGNS, 100) of the old design, averaged over the packings after their offsets are levelled."""
    rng = np.random.default_rng(2)
    (x, _), sd = points(100), truth(surface)[1]
    count = OLD_PACKINGS + 1
    sets = np.full((CAMPAIGNS, count, 100), np.nan)
    replicated = np.round(np.linspace(0, 99, OLD_POINTS)).astype(int)
    noise = shared * rng.normal(size=(CAMPAIGNS, count, 1)) + own * rng.normal(size=sets.shape)
    sets[:, 0] = noise[:, 0]
    sets[:, :, replicated] = noise[:, :, replicated]
    both = sets[:, :, replicated]
    level = both.mean(axis=2, keepdims=True)
    between = level.var(axis=1, ddof=1, keepdims=True)
    rest = both - level - both.mean(axis=1, keepdims=True) + both.mean(axis=(1, 2), keepdims=True)
    single = np.sum(rest**2, axis=(1, 2), keepdims=True) / ((count - 1) * (OLD_POINTS - 1))
    reliability = np.clip(1 - single / OLD_POINTS / between, 0, 1)
    return SURFACES[surface](x) + sd * np.nanmean(
        sets - reliability * (level - level.mean(axis=1, keepdims=True)), axis=1
    )


@cache
def core_hours(n: int, design: str | int) -> float:
    """Core-hours of a campaign: consolidations, probes and shear runs at the mean times of the laptop campaign."""
    seconds = pd.read_csv(ROOT / "data" / "laptop" / "tables" / "runs.csv").groupby("stage").cpu_seconds.mean()
    count, chains = (OLD_PACKINGS + 1, n + OLD_PACKINGS * OLD_POINTS) if design == "old" else (design, n)
    return DENSITIES * (count * seconds.consolidate + chains * (seconds.probe + seconds.shear)) / 3600


def errors() -> None:
    """Rows of rotation_errors.csv."""
    path, keys = FOLDER / "rotation_errors.csv", ("response", "shared", "n", "packings")
    columns = (
        *keys,
        "surface",
        "own",
        "campaigns",
        "core_hours",
        *(f"{name}_raw" for name in (*NAMES, "W1")),
        *NAMES,
        "W1",
    )
    known = bench_rows.finished(path, keys)
    for (n, count), shared, response in product([(100, "old"), *DESIGNS], SHARED, RESPONSES):
        if tuple(map(bench_rows.written, (response, shared, n, count))) in known:
            continue
        (surface, own), old = RESPONSES[response], count == "old"
        values = old_design(surface, own, shared) if old else campaigns(surface, "normal", own, shared, n, count)
        values = values[:FEW] if n > 100 else values
        row = {"response": response, "shared": shared, "n": n, "packings": count, "surface": surface, "own": own}
        row["campaigns"] = len(values)
        row["core_hours"] = core_hours(n, count)
        row |= errors_of(surface, values, n, None if old else packings(n, count))
        bench_rows.append(path, columns, row)


def errors_of(surface: str, values: np.ndarray, n: int, packing: np.ndarray | None) -> dict[str, float]:
    """Root mean square errors of the points and of the model through them."""
    (x, probability), (true, sd, whole) = points(n), truth(surface)
    raw = np.column_stack([*weighted.moments(values, probability), weighted.quantiles(values, probability, LEVELS)])
    fitted = surrogate.fit(x, values, packing).predict(FINE)
    model = np.column_stack([fitted.mean(axis=1), fitted.std(axis=1), hazen(fitted)])
    equal = np.full(len(whole), 1 / len(whole))
    w1_raw = [weighted.wasserstein(row, whole, probability, equal) for row in values]
    w1 = np.mean(np.abs(np.sort(fitted, axis=1) - whole), axis=1)
    rms = {f"{name}_raw": e for name, e in zip(NAMES, np.sqrt(np.mean((raw - true) ** 2, axis=0)) / sd, strict=True)}
    rms |= dict(zip(NAMES, np.sqrt(np.mean((model - true) ** 2, axis=0)) / sd, strict=True))
    return {name: float(e) for name, e in rms.items()} | {"W1_raw": np.mean(w1_raw) / sd, "W1": np.mean(w1) / sd}


@cache
def simulated_truth(surface: str, kind: str, own: float, shared: float) -> np.ndarray:
    """Mean, sd and quantiles (4,) of surface + packing + own noise over the inputs."""
    rng = np.random.default_rng(7)
    _, sd, _ = truth(surface)
    shape = (64, len(FINE))
    noise = own * own_noise("normal" if kind == "autocorrelated" else kind, FINE, shape, rng)
    values = (SURFACES[surface](FINE) + sd * (noise + shared * rng.normal(size=shape))).ravel()
    return np.array([truth(surface)[0][0], sd * np.sqrt(1 + own**2 + shared**2), *hazen(values)])


def coverage() -> None:
    """Rows of rotation_coverage.csv."""
    path, keys = FOLDER / "rotation_coverage.csv", ("surface", "noise", "shared", "n", "packings")
    columns = (*keys, "own", *NAMES, *(f"{name}_sim" for name in NAMES), "noise_packing", "noise_own")
    known = bench_rows.finished(path, keys)
    cases = [(s, kind, b, 100, 20) for kind in ("growing", "t5", "normal") for b in SHARED for s in SURFACES]
    cases += [(s, "normal", b, 8, 4) for b in SHARED for s in SURFACES]
    cases += [(s, "autocorrelated", 0.1, 100, 20) for s in SURFACES]
    for case in cases:
        if tuple(map(bench_rows.written, case)) not in known:
            bench_rows.append(path, columns, dict(zip(keys, case, strict=True)) | {"own": 0.2} | covered(*case, 0.2))


def covered(surface: str, kind: str, shared: float, n: int, count: int, own: float) -> dict[str, float]:
    """Shares of the campaigns whose intervals contain the truth."""
    values, sd = campaigns(surface, kind, own, shared, n, count, seed=3), truth(surface)[1]
    model = surrogate.fit(points(n)[0], values, packings(n, count))
    found = moments_and_quantiles(model, COARSE, levels=LEVELS, n=200, rng=np.random.default_rng(4))
    row = dict(zip(NAMES, inside(found.denoised, truth(surface)[0]), strict=True))
    simulated = inside(found.as_simulated, simulated_truth(surface, kind, own, shared))
    row |= {f"{name}_sim": share for name, share in zip(NAMES, simulated, strict=True)}
    if kind == "growing":  # the root mean square over the runs
        own *= np.sqrt(np.mean(np.exp(standardised(points(n)[0])[0])) / np.mean(np.exp(standardised(FINE)[0])))
    intervals = {"noise_packing": (model.packing_interval, shared), "noise_own": (model.own_interval, own)}
    return row | {name: float(np.mean((i[:, 0] <= v * sd) & (v * sd <= i[:, 1]))) for name, (i, v) in intervals.items()}


def inside(estimate, true: np.ndarray) -> list[float]:
    """Share of the rows whose interval contains the truth, by statistic."""
    return [float(share) for share in np.mean((estimate.low <= true) & (true <= estimate.high), axis=0)]


def pairs() -> None:
    """Rows of rotation_pairs.csv."""
    path, keys = FOLDER / "rotation_pairs.csv", ("pairs", "surface")
    columns = (*keys, "shared", "own", *NAMES, *(f"{name}_sim" for name in NAMES))
    known = bench_rows.finished(path, keys)
    own, shared, uniforms = 0.2, 0.1, qmc.Sobol(2, seed=1).random_base2(8)
    values = np.stack([campaigns(s, "normal", own, shared, 100, 20, seed=5) for s in SURFACES], axis=1)
    for count in (12, 30):
        if (str(count), list(SURFACES)[-1]) in known:
            continue
        hits = np.zeros((2, len(SURFACES), len(NAMES)))
        for k, rows in enumerate(values[:OF_PAIRS]):
            rng = np.random.default_rng([6, count, k])
            measured = JOINT.sample(count, rng)
            fit = fit_joint(measured, n_boot=0)
            fitted, families = fit.joint, Candidates.tried(dict(zip("xy", fit.marginals, strict=True)), fit.copulas)
            refits = [j.inverse_rosenblatt(uniforms) for j in bootstrap_joints(measured, 100, rng, fitted, families)]
            model = surrogate.fit(points(100)[0], rows, packings(100, 20))
            found = moments_and_quantiles(model, fitted.inverse_rosenblatt(uniforms), levels=LEVELS, n=200,
                                          refits=np.stack(refits), pairs=count, rng=rng)  # fmt: skip
            for i, estimate in enumerate((found.denoised, found.as_simulated)):
                true = np.stack(
                    [truth(s)[0] if i == 0 else simulated_truth(s, "normal", own, shared) for s in SURFACES]
                )
                hits[i] += (estimate.low <= true) & (true <= estimate.high)
        for s, surface in enumerate(SURFACES):
            row = {"pairs": count, "surface": surface, "shared": shared, "own": own}
            row |= dict(zip(NAMES, hits[0, s] / OF_PAIRS, strict=True))
            row |= {f"{name}_sim": v for name, v in zip(NAMES, hits[1, s] / OF_PAIRS, strict=True)}
            bench_rows.append(path, columns, row)


def stops() -> None:
    """Rows of rotation_stopping.csv."""
    path, keys = FOLDER / "rotation_stopping.csv", ("surface", "noise", "shared", "target")
    columns = (*keys, "own", "points", "reached", "claimed", "error", "holds", "holds_always")
    known = bench_rows.finished(path, keys)
    kinds = [("normal", shared) for shared in SHARED] + [("growing", 0.1), ("t5", 0.1)]
    cases = [
        (s, *kind) for kind in kinds for s in SURFACES if (s, kind[0], bench_rows.written(kind[1]), "10%") not in known
    ]
    sizes, claimed, error = replays(cases)
    for k, case in enumerate(cases):
        for target in ("20%", "10%"):
            within = claimed[:, k] <= stopping.parse_target(target)
            last = np.where(within.any(axis=0), np.argmax(within, axis=0), len(sizes) - 1)
            at = last, k, np.arange(REPLAYED)
            row = {**dict(zip(keys, (*case, target), strict=True)), "own": 0.17, "points": float(sizes[last].mean())}
            row |= {"reached": float(within.any(axis=0).mean()), "claimed": float(claimed[at].mean())}
            row |= {"error": float(error[at].mean()), "holds": float(np.mean(error[at] <= claimed[at]))}
            bench_rows.append(path, columns, row | {"holds_always": float(np.mean(error[:, k] <= claimed[:, k]))})


def replays(cases: list[tuple[str, str, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (B,) after each batch, and claimed and true errors (B, cases, REPLAYED) of the campaigns."""
    x, packing = points(100)[0], packings(100, 20)
    values = [campaigns(s, kind, 0.17, shared, 100, 20, seed=8)[:REPLAYED] for s, kind, shared in cases]
    used, sizes, claimed, error = stopping.first_batch(100), [], [], []
    while cases and (not sizes or sizes[-1] < 100):
        for (surface, _, _), rows in zip(cases, values, strict=True):
            (_, sd, whole), named = truth(surface), {str(k): row[:used] for k, row in enumerate(rows)}
            judged = stopping.assess(x[:used], named, COARSE[:256], 0.2, packing[:used], np.random.default_rng(9))
            fitted = np.sort(surrogate.fit(x[:used], rows[:, :used], packing[:used]).predict(FINE), axis=1)
            claimed.append([judged.claimed[name] for name in named])
            error.append(np.mean(np.abs(fitted - whole), axis=1) / sd)
        sizes.append(used)
        used = stopping.next_batch(used, 100)
    shape = (len(sizes), len(cases), REPLAYED)
    return np.array(sizes), np.array(claimed).reshape(shape), np.array(error).reshape(shape)


def picture() -> None:
    """Errors of the mean and W1 against core-hours, with a shared effect of 0.1."""
    table = pd.read_csv(FOLDER / "rotation_errors.csv")
    table = table[table.shared == 0.1]
    figure, axes = plt.subplots(2, len(SHOWN), figsize=(9, 7), sharex=True, layout="constrained")
    for column, response in zip(axes.T, SHOWN, strict=True):
        part = table[table.response == response]
        for axis, name, title in zip(column, ("mean", "W1"), ("error of the mean", "W1, denoised"), strict=True):
            for count in ("1", "5", "10", "20", "100"):
                line = part[part.packings == count].sort_values("core_hours")
                axis.plot(line.core_hours, line[name], "o-", ms=4, label=f"{count} packing{'s' * (count != '1')}")
            old = part[part.packings == "old"]
            axis.plot(old.core_hours, old[name], "k*", ms=11, label="old: 1 packing, 4 more at 5 points")
            axis.set(ylabel=f"{title} (sd)", xscale="log", yscale="log")
        column[0].set_title(f"{response}, shared effect 0.1")
        column[1].set_xlabel("core-hours, three densities")
    axes[0, 0].legend(fontsize=8)
    figure.savefig(FOLDER / "rotation.png", dpi=110)


def table() -> None:
    """Print the tables that there are."""
    for name in ("errors", "coverage", "pairs", "stopping"):
        path = FOLDER / f"rotation_{name}.csv"
        if path.exists():
            print(path.name)
            print(pd.read_csv(path).to_string(index=False, float_format="%.3f"))


if __name__ == "__main__":
    PARTS = {"stopping": stops, "coverage": coverage, "errors": errors, "pairs": pairs}
    if "--table" not in sys.argv:
        for name in [name for name in sys.argv[1:] if name in PARTS] or PARTS:
            PARTS[name]()
        if (FOLDER / "rotation_errors.csv").exists():
            picture()
    else:
        table()
