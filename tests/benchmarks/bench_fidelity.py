"""The fidelity ladder: five points of the laptop campaign's kind run again with more spheres and at lower rates.

    python3 tests/benchmarks/bench_fidelity.py --cost               what each rung would cost, nothing is run
    python3 tests/benchmarks/bench_fidelity.py [--rungs NAME ...]   what is missing, rung by rung (hours; resumable)
    python3 tests/benchmarks/bench_fidelity.py --table              only the table of errors from the rows there are

The lowest rung has the settings of campaign/laptop.toml.  Rows go to data/benchmarks/fidelity.csv as they finish, each
with the inertial number it was sheared at (above mu_s = 0.3 the scripts limit it) and a hash of its rung's settings:
rows of other settings are not used.  data/laptop/fidelity.csv, which the report shows, has for every other rung the
laptop's bias against it with its 95 % half width, the scatter of either between packings, and whether the bias stays
within what the accuracy setting promises.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys

import numpy as np
import pandas as pd
from bench_rows import finished
from chain_rows import MEASURED, NAMES, Chain, cpu_seconds, fill
from dem_runs import ROOT, assembly, row_digest
from scipy import stats

from analysis.quantities import effective_inertial_number
from campaign.config import Config, read_config

ROWS = ROOT / "data" / "benchmarks" / "fidelity.csv"
TABLE = ROOT / "data" / "laptop" / "fidelity.csv"
#: Along the ridge of the measured pairs, from the 4th to the 96th percentile of mu_s: name -> (mu_s, G_p in Pa).
POINTS = {"p04": (0.095, 43e9), "p25": (0.155, 32e9), "p50": (0.214, 25.7e9), "p75": (0.295, 20.5e9),
          "p96": (0.48, 14.5e9)}  # fmt: skip
CASE = ("packing", "mu_iso", "point")
COLUMNS = ("scripts", "rung", "settings", "N", "inertial_number", *CASE, "mu_s", "G_p", *MEASURED)
KEY = ("scripts", "rung", "settings", *CASE)
BASE = "laptop"


def main() -> None:
    config = read_config(ROOT / "campaign" / "laptop.toml")
    ladder = rungs(config)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cost", action="store_true", help="predict the CPU time of what is missing, and stop")
    parser.add_argument("--table", action="store_true", help="only the table from the rows there are")
    parser.add_argument("--rungs", nargs="*", metavar="NAME", choices=ladder, help="only these rungs (default: all)")
    parser.add_argument("--mu-iso", nargs="*", type=float, default=[0.04], help="densities (default: 0.04)")
    args = parser.parse_args()
    wanted = {name: ladder[name] for name in args.rungs or ladder}
    missing = {} if args.table else {name: cases(name, *rung, args.mu_iso) for name, rung in wanted.items()}
    if args.cost:
        for name, some in missing.items():
            minutes = cpu_seconds([chain for _, chain in some]) / 60
            print(f"{name:16} {len(some):3d} chains missing, {minutes:7.1f} CPU-minutes predicted")
        total = cpu_seconds([chain for some in missing.values() for _, chain in some])
        count = sum(map(len, missing.values()))
        print(f"{'all':16} {count:3d} chains missing, {total / 60:7.1f} CPU-minutes predicted")
        return
    crashed = sum(fill(ROWS, COLUMNS, some) for some in missing.values())
    if not ROWS.exists():
        sys.exit(f"{ROWS} is missing: no rung has been run")
    rows = pd.read_csv(ROWS, dtype={"scripts": str, "settings": str})
    used = current(rows, ladder)
    if len(used) < len(rows):
        print(f"{len(rows) - len(used)} of {len(rows)} rows left out, of other scripts or settings")
    if not ((used.rung == BASE) & used.failure.isna()).any():
        sys.exit(f"{ROWS}: no finished chain of the rung {BASE!r} to compare with (--rungs {BASE})")
    table = errors(used, promise(config))
    if not len(table):
        sys.exit(f"{ROWS}: no rung but {BASE!r} has rows yet, so there is no table")
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(TABLE, index=False, float_format="%.4g")
    print(table.to_string(index=False, float_format=lambda v: f"{v:.2f}"))
    if crashed:
        sys.exit(f"{crashed} chains crashed and have no row")


def rungs(config: Config) -> dict[str, tuple[dict, tuple[int, ...]]]:
    """Rung -> (its settings, its packings), the lowest and cheapest first; `rate`: share of the laptop's at a point."""
    base = {"N": config.assembly.N, "inertial_number": config.shear.inertial_number,
            "strain_end": config.shear.strain_end, "timestep_factor": config.dem.timestep_factor,
            "damping": config.dem.damping, "stiffness_scale": config.dem.stiffness_scale,
            "density_scaling": int(config.dem.density_scaling), "rate": 1.0}  # fmt: skip
    out = {BASE: (base, (1, 2, 3, 4))}
    if base["stiffness_scale"] < 1.0:
        out["full stiffness"] = (base | {"stiffness_scale": 1.0}, (1, 2))
    finer = {"density_scaling": 0, "timestep_factor": base["timestep_factor"] / 2}
    out["own inertia, half the step"] = (base | finer, (1, 2))
    out["rate / 2"] = (base | {"rate": 1 / 2}, (1, 2))
    for N, packings in ((2000, (1, 2)), (4000, (1,)), (8000, (1,))):
        if base["N"] < N:
            out[f"N = {N}"] = (base | {"N": N}, packings)
    out["rate / 4"] = (base | {"rate": 1 / 4}, (1,))
    return out


def cases(name: str, values: dict, packings: tuple[int, ...], densities: list[float]) -> list[tuple[dict, Chain]]:
    """The chains of a rung that have no row of today's scripts, each with the row's own columns."""
    done, out = finished(ROWS, KEY), []
    shear = {k: v for k, v in values.items() if k not in ("N", "rate")}
    for packing in packings:
        for mu_iso in densities:
            for point, (mu_s, G_p) in POINTS.items():
                if (row_digest(), name, hashed(values), str(packing), f"{mu_iso:g}", point) not in done:
                    start = assembly(values["N"], packing)
                    rate = values["rate"] * effective_inertial_number(values["inertial_number"], mu_s)
                    case = {"rung": name, "settings": hashed(values), "N": values["N"], "inertial_number": rate,
                            "packing": packing, "mu_iso": mu_iso, "point": point, "mu_s": mu_s, "G_p": G_p}  # fmt: skip
                    rated = shear | {"inertial_number": rate}
                    out.append((case, Chain(start, values["N"], packing, mu_iso, mu_s, G_p, rated)))
    return out


def hashed(values: dict) -> str:
    """First figures of a sha256 over the settings of a rung."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:8]


def current(rows: pd.DataFrame, ladder: dict) -> pd.DataFrame:
    """The rows of the scripts that wrote last whose rung has the settings that it has in the ladder."""
    settings = rows.rung.map({name: hashed(values) for name, (values, _) in ladder.items()})
    return rows[(rows.scripts == rows.scripts.iloc[-1]) & (rows.settings == settings)]


def promise(config: Config) -> float:
    """Largest error of a response that the laptop campaign's accuracy setting stands for; NaN if it names none."""
    return float(config.dem.accuracy.rstrip("%")) / 100 if config.dem.accuracy else float("nan")


def errors(rows: pd.DataFrame, promised: float) -> pd.DataFrame:
    """Per rung and response, in %: the laptop's bias against it, its 95 % half width, scatters between packings.

    A case is a point at a density; where both rungs have the same number of spheres only the packings that both have of
    it are compared, so that their common noise cancels.  The half width has the spread of the cases' differences and,
    for different packings, the noise that all points share (from the laptop's packings, as N^-1/2).
    """
    good = rows[rows.failure.isna()]
    base, out = good[good.rung == BASE], []
    N, failed = rows.groupby("rung").N.first(), rows.failure.notna().groupby(rows.rung).sum()
    packings = base.packing.nunique()
    for name in (name for name in dict.fromkeys(rows.rung) if name != BASE):
        other, same = good[good.rung == name], N[name] == N[BASE]
        own, against = _in_common(base, other) if same else (base, other)
        for response in NAMES:
            a, b = (part.groupby(["mu_iso", "point"])[response].mean() for part in (own, against))
            off = (a / b - 1).dropna()
            half = stats.t.ppf(0.975, len(off) - 1) * off.std() / np.sqrt(len(off)) if len(off) > 1 else np.nan
            if not same and len(other):
                noise = np.sqrt(1 / packings + N[BASE] / N[name] / other.packing.nunique()) * _shared(base, response)
                half = float(np.hypot(half, stats.t.ppf(0.975, packings - 1) * noise))
            bias = float(off.mean())
            inside = "yes" if abs(bias) + half <= promised else "no" if abs(bias) - half > promised else "open"
            out.append({"against": name, "response": response, "cases": len(off), "bias (%)": 100 * bias,
                        "± (%)": 100 * half, "scatter, laptop (%)": 100 * scatter(base, response),
                        "scatter, rung (%)": 100 * scatter(other, response), "promised (%)": 100 * promised,
                        "bias within": inside, "failed": int(failed[name]),
                        "failed, laptop": int(failed[BASE])})  # fmt: skip
    return pd.DataFrame(out)


def _in_common(one, two):
    """The rows of either whose packing, density and point the other has too."""
    keys = [pd.MultiIndex.from_frame(part[list(CASE)]) for part in (one, two)]
    return one[keys[0].isin(keys[1])], two[keys[1].isin(keys[0])]


def scatter(rows: pd.DataFrame, response: str) -> float:
    """Relative standard deviation between packings at the same point, pooled over the cases; NaN with one packing."""
    groups = rows.groupby(["mu_iso", "point"])[response]
    return float(np.sqrt((groups.std() / groups.mean()).pow(2).mean()))


def _shared(rows, response):
    """Relative standard deviation between packings of the mean over the points."""
    relative = rows[response] / rows.groupby(["mu_iso", "point"])[response].transform("mean")
    return float(relative.groupby(rows.packing).mean().std())


if __name__ == "__main__":
    main()
