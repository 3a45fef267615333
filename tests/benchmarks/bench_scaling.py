"""Only G_p / sigma_3 matters: a sweep of sigma_3 beside the equivalent sweep of G_p, by the `sweep` command.

    python3 tests/benchmarks/bench_scaling.py            about 15 minutes of CPU; resumable
    python3 tests/benchmarks/bench_scaling.py --table    compares the tables that are there

sigma_3 is 25, 100 and 400 kPa with G_p as measured. In the other sweep G_p is 4, 1 and 1/4 times as large at 100 kPa,
and so is the modulus of the consolidation, consolidation.G_ref_GPa. Both sweeps lie in one folder, build/bench/scaling,
so that the campaign that both have is run once. With these powers of four no rounding differs in the consolidations.

States are compared in their own units: G_0 is divided by sigma_3. data/benchmarks/scaling.csv has both means and
standard deviations per state with their 95 % intervals, and the difference of the means over its own 95 % half width.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from dem_runs import BUILD, ROOT

ROWS = ROOT / "data" / "benchmarks" / "scaling.csv"
FOLDER = BUILD / "scaling"
FACTORS = (4.0, 1.0, 0.25)
SIGMA_3, G_REF = 100.0, 25.7
STRESS, STIFFNESS = "consolidation.sigma_3_kPa", "inputs.pairs"
TOML = """
name = "scaling"

[points]
n = 8

[assembly]
N = 400
packings = 4

[consolidation]
mu_iso = [0.04]

[shear]
strain_end = 0.4
inertial_number = 2.4e-3
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="store_true")
    if not parser.parse_args().table:
        sweep()
    table = compare(pd.read_csv(FOLDER / f"{STRESS}.csv"), pd.read_csv(FOLDER / f"{STIFFNESS}.csv"))
    table.to_csv(ROWS, index=False, float_format="%.6g", lineterminator="\n")
    print(table.to_string(index=False))
    used = table[table.factor != 1.0]
    worst = used.mean_over_half_width.abs().max()
    print(f"largest difference of two means over its 95 % half width: {worst:.2f}, of {len(used)} states")


def sweep() -> None:
    """Run both sweeps; each goes on where it was stopped."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    toml = FOLDER / "scaling.toml"
    toml.write_text(TOML)
    stresses = ",".join(f"{SIGMA_3 / factor:g}" for factor in FACTORS)
    moduli = ",".join(f"{G_REF * factor:g}" for factor in FACTORS)
    pairs = ",".join(str(scaled_pairs(factor)) for factor in FACTORS)
    for words in ((f"{STRESS}={stresses}",), (f"{STIFFNESS}={pairs}", "--with", f"consolidation.G_ref_GPa={moduli}")):
        command = [sys.executable, "-m", "campaign", "sweep", str(toml), "--folder", str(FOLDER), "--jobs", "1"]
        subprocess.run([*command, "--quiet", "--set", *words], cwd=ROOT, check=True)


def scaled_pairs(factor: float) -> Path:
    """The reconstructed pairs with G_p multiplied; the file."""
    pairs = pd.read_csv(ROOT / "data" / "pairs_reconstructed.csv", comment="#")
    path = FOLDER / f"G_times_{factor:g}.csv"
    pairs.assign(G_p_GPa=pairs.G_p_GPa * factor).to_csv(path, index=False)
    return path


def compare(stress: pd.DataFrame, stiffness: pd.DataFrame) -> pd.DataFrame:
    """Every denoised state of a sweep of sigma_3 beside that of the same G_p / sigma_3 in a sweep of G_p."""
    keys = ["factor", "mu_iso", "state", "quantity"]
    numbers = ["mean", "mean_low", "mean_high", "sd", "sd_low", "sd_high"]
    tables = []
    for table, factor in (
        (stress, SIGMA_3 / stress.value.astype(float)),
        (stiffness, stiffness.value.map(lambda text: float(Path(text).stem.removeprefix("G_times_")))),
    ):
        one = table.assign(factor=factor)[table.kind == "denoised"].copy()
        sigma_3 = SIGMA_3 / one.factor if table is stress else SIGMA_3
        own = np.where(one.quantity == "G_0", 1e3 / sigma_3, 1.0)  # MPa over kPa
        tables.append(one.assign(**{name: one[name] * own for name in numbers})[keys + numbers])
    both = tables[0].merge(tables[1], on=keys, suffixes=("_stress", "_stiffness"), validate="one_to_one")
    half = np.hypot(*(both[f"mean_high_{k}"] - both[f"mean_low_{k}"] for k in ("stress", "stiffness"))) / 2.0
    difference = both.mean_stiffness - both.mean_stress
    return both.assign(
        mean_difference=difference, mean_over_half_width=difference / half, sd_ratio=both.sd_stiffness / both.sd_stress
    )


if __name__ == "__main__":
    main()
