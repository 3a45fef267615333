"""Beyond the paper: other gradings, and grains that each have properties of their own, at a few points.

    python3 tests/benchmarks/bench_beyond.py --cost     what it would cost, nothing is run
    python3 tests/benchmarks/bench_beyond.py            what is missing (some 25 minutes of CPU; resumable)
    python3 tests/benchmarks/bench_beyond.py --table    only the table from the rows there are

1,000 spheres, medium density (mu_iso = 0.04).  Gradings: the standard one against a
well-graded one (Fuller, largest over smallest 4) and a gap-graded one (a quarter fines, medians 2.2 apart), at two
points, one packing each.  Properties: three specimens in one packing whose grains draw their own pairs from the fitted
joint distribution, against the specimen of that packing that has one pair, the medians; two more packings of it show
how packings scatter.  Rows go to data/benchmarks/beyond.csv as they finish; data/laptop/beyond.csv, which the report
shows, compares them.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
from bench_rows import finished
from chain_rows import MEASURED, NAMES, RESPONSES, Chain, cpu_seconds, fill
from dem_runs import BUILD, D50, ROOT, SIGMA_LN, row_digest

from analysis.assembly import diameters, make_assembly, write_assembly
from analysis.inputs.joint import fit_joint
from analysis.inputs.pairs import read_pairs
from analysis.quantities import QUANTITIES
from campaign.config import read_config

ROWS = ROOT / "data" / "benchmarks" / "beyond.csv"
TABLE = ROOT / "data" / "laptop" / "beyond.csv"
N, MU_ISO = 1000, 0.04
SHEAR = {"inertial_number": 2.4e-3, "strain_end": 0.30, "timestep_factor": 1.0}
POINTS = {"median": (0.214, 25.7e9), "rough": (0.38, 18e9)}
STANDARD = "standard grading"
GRADINGS = {STANDARD: ("lognormal", {}), "well graded": ("well_graded", {"size_ratio": 4.0}),
            "gap graded": ("gap_graded", {"size_ratio": 2.2})}  # fmt: skip
ONE_PAIR, OWN_PAIRS = "one pair a specimen", "own pair a grain"
COLUMNS = ("scripts", "case", "point", "packing", "draw", "mu_s", "G_p", *MEASURED)
KEY = ("scripts", "case", "point", "packing", "draw")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cost", action="store_true", help="predict the CPU time of what is missing, and stop")
    parser.add_argument("--table", action="store_true", help="only the table from the rows there are")
    args = parser.parse_args()
    done = finished(ROWS, KEY)
    missing = [] if args.table else [(case, chain) for case, chain in cases() if _key(case) not in done]
    if args.cost:
        minutes = cpu_seconds([chain for _, chain in missing]) / 60
        print(f"{len(missing)} chains missing, {minutes:.1f} CPU-minutes predicted")
        return
    crashed = fill(ROWS, COLUMNS, missing)
    if not ROWS.exists():
        sys.exit(f"{ROWS} is missing: no case has been run")
    rows = pd.read_csv(ROWS)
    table = compared(rows[rows.scripts == rows.scripts.iloc[-1]])
    if not len(table):
        sys.exit(f"{ROWS}: nothing to compare has rows yet, so there is no table")
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(TABLE, index=False, float_format="%.4g")
    print(table.to_string(index=False, float_format=lambda v: f"{v:.3g}"))
    if crashed:
        sys.exit(f"{crashed} chains crashed and have no row")


def cases():
    """(columns of the row, chain) of every case, the cheapest first."""
    for name, (distribution, shape) in GRADINGS.items():
        for point in POINTS:
            yield _case(name, point, 1, 0, _assembly(distribution, shape, 1), finer=_finer(distribution, shape))
    for packing in (1, 2, 3):
        yield _case(ONE_PAIR, "median", packing, 0, _assembly(*GRADINGS[STANDARD], packing))
    for draw in (1, 2, 3):
        swapped = {"heterogeneity": "grain", "grains": _grains(draw)}
        yield _case(OWN_PAIRS, "median", 1, draw, _assembly(*GRADINGS[STANDARD], 1), swapped=swapped)


def compared(rows: pd.DataFrame) -> pd.DataFrame:
    """Per case and response: means over the runs, their difference in %, and what draws and packings scatter by.

    Gradings are compared with the standard one, own pairs with one pair, each at the points and packings that both
    have: the difference is the mean of the ratios there, the draws of a packing averaged first.  The scatter between
    packings is that of all specimens of one pair.  In shown units.
    """
    good, out = rows[rows.failure.isna()], []
    one, failed = good[good.case == ONE_PAIR], rows.failure.notna().groupby(rows.case).sum()
    for name in dict.fromkeys(rows.case):
        if name in (STANDARD, ONE_PAIR):
            continue
        against = ONE_PAIR if name == OWN_PAIRS else STANDARD
        own, other = (good[good.case == case].groupby(["point", "packing"]) for case in (name, against))
        both = own.size().index.intersection(other.size().index)
        runs = own.size().loc[both].sum()
        for (symbol, state), response in zip(RESPONSES, NAMES, strict=True):
            mine, its = (part[response].mean().loc[both] for part in (own, other))
            draws = own[response].std().loc[both] / mine
            factor = QUANTITIES[symbol].shown_factor
            out.append({"case": name, "against": against, "state": state,
                        "response": QUANTITIES[symbol].heading,
                        "runs": runs, "mean": factor * mine.mean(), "mean of the other": factor * its.mean(),
                        "difference (%)": 100 * (mine / its - 1).mean(),
                        "scatter between draws (%)": 100 * draws.mean(),
                        "scatter between packings (%)": 100 * one[response].std() / one[response].mean(),
                        "failed": int(failed[name]), "failed of the other": int(failed.get(against, 0))})  # fmt: skip
    return pd.DataFrame(out)


def _case(name, point, packing, draw, assembly, swapped=None, finer=1.0):
    mu_s, G_p = POINTS[point]
    case = {"case": name, "point": point, "packing": packing, "draw": draw, "mu_s": mu_s, "G_p": G_p}
    return case, Chain(assembly, N, packing, MU_ISO, mu_s, G_p, SHEAR, swapped or {}, finer)


def _key(case):
    return (row_digest(), case["case"], case["point"], str(case["packing"]), str(case["draw"]))


def _assembly(distribution, shape, seed) -> Path:
    """The assembly file of a grading and seed, made when missing."""
    words = "_".join([distribution, *(f"{value:g}" for value in shape.values())])
    path = BUILD / f"beyond_{words}_{N}_{seed}.h5"
    if not path.exists():
        attrs = {"N": N, "seed": seed, "sigma_ln": SIGMA_LN}
        write_assembly(path, make_assembly(N, D50, SIGMA_LN, seed, distribution, **shape), attrs)
    return path


def _finer(distribution, shape) -> float:
    """How many times smaller than in the standard grading the smallest grain is: the time step goes with it."""
    return diameters(N, D50, SIGMA_LN)[0] / diameters(N, D50, SIGMA_LN, distribution, **shape)[0]


def _grains(draw: int) -> Path:
    """A file with one pair (mu_s, G_p) a grain, drawn from the joint distribution that the laptop's pairs give."""
    path = BUILD / f"beyond_grains_{N}_{draw}.h5"
    if not path.exists():
        config = read_config(ROOT / "campaign" / "laptop.toml")
        pairs = read_pairs(config.pairs_path)
        fitted = fit_joint(pairs, copula_families=config.inputs.copulas, n_boot=19, seed=config.inputs.seed).joint
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        with h5py.File(part, "w") as file:
            file["mu_s"], file["G_p"] = fitted.sample(N, np.random.default_rng([draw, N])).T
        part.replace(path)
    return path


if __name__ == "__main__":
    main()
