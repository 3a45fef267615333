"""Small-strain stiffness twice: YADE's probe against the static solve of the contact network, and how both scale.

    /usr/bin/python3 tests/benchmarks/bench_stiffness.py        (about half an hour; resumes where it stopped)

Writes data/benchmarks/stiffness.csv, a row per density and particle modulus: probes with strains of 1e-5 and 1e-6 (both
signs), network solve, effective medium, all on the packing at rest with mu_s = 0.25; and stiffness_exponents.csv: the
exponents of G_0 over G_p and p'.  "frozen" ones rescale the springs of one contact network; the others compare packings
consolidated with 25.7 GPa that came to rest with another modulus, which changes the network: grains made stiffer push
each other apart and lose contacts.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.micromechanics.metrics import sliding_fraction, snapshot_metrics  # noqa: E402
from analysis.micromechanics.snapshot import Snapshot  # noqa: E402
from analysis.micromechanics.stiffness import effective_medium, network_moduli  # noqa: E402
from analysis.runs.run_file import read_run, read_snapshot  # noqa: E402
from tests.benchmarks import dem_runs  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "stiffness.csv"
EXPONENTS = TABLE.with_name("stiffness_exponents.csv")
DENSITIES, MODULI = (0.001, 0.04, 0.1), (12e9, 25.7e9, 50e9)
N, SEED, MU_S, NU = 1000, 1, 0.25, 0.2


def main() -> None:
    """Measure what is not in the table yet, then fit the exponents and say how far probe and network are apart."""
    rows = pd.read_csv(TABLE).to_dict("records") if TABLE.exists() else []
    done = {(row["mu_iso"], row["G_p"]) for row in rows}
    for mu_iso in DENSITIES:
        for G_p in MODULI:
            if (mu_iso, G_p) not in done:
                rows.append(measure(mu_iso, G_p))
                pd.DataFrame(rows).to_csv(TABLE, index=False, float_format="%.6g")
                print({k: f"{v:.5g}" for k, v in rows[-1].items()}, flush=True)
    table = pd.DataFrame(rows)
    worst = table.loc[(table.network_over_probe_1e6 - 1.0).abs().idxmax()]
    print(f"network over probe at 1e-6: worst {worst.network_over_probe_1e6:.4f} at mu_iso = {worst.mu_iso}")
    found = pd.DataFrame([{"mu_iso": mu, **probed_exponents(part)} for mu, part in table.groupby("mu_iso")])
    found.to_csv(EXPONENTS, index=False, float_format="%.6g")
    print(found.to_string(index=False))


def rest(mu_iso: float, G_p: float) -> Path:
    """Product of the 1e-5 probe: the packing at rest with this modulus."""
    first = dem_runs.run("consolidate", assembly=dem_runs.assembly(N, SEED), mu_iso=mu_iso, G_p=25.7e9, seed=SEED)
    return dem_runs.run("probe", start=first, mu_s=MU_S, G_p=G_p, probe_strain=1e-5)


def measure(mu_iso: float, G_p: float) -> dict[str, float]:
    """One row: both probes, the network solve and the effective medium of one packing at rest."""
    coarse = rest(mu_iso, G_p)
    fine = read_run(dem_runs.run("probe", start=coarse, mu_s=MU_S, G_p=G_p, probe_strain=1e-6)).probe
    s, probe = read_snapshot(coarse, "start"), read_run(coarse).probe
    m, network, affine = snapshot_metrics(s), network_moduli(s), network_moduli(s, affine=True)
    medium = effective_medium(1.0 / (1.0 + m["e"]), m["Z"], m["p"], G_p, NU)
    return {
        "mu_iso": mu_iso, "G_p": G_p, "e": m["e"], "Z": m["Z"], "Z_m": m["Z_m"], "p": m["p"],
        "sliding": sliding_fraction(s.f_n, s.f_t, MU_S),
        "G_0_probe_1e5": probe["G_0"], "G_0_minus_probe_1e5": probe["G_0_minus"], "K_0_probe_1e5": probe["K_0"],
        "G_0_probe_1e6": fine["G_0"], "G_0_minus_probe_1e6": fine["G_0_minus"], "K_0_probe_1e6": fine["K_0"],
        "G_0_network": network.G_0, "K_0_network": network.K_0, "G_0_affine": affine.G_0,
        "G_0_medium": medium[0], "K_0_medium": medium[1],
        "network_over_probe_1e5": network.G_0 / probe["G_0"], "network_over_probe_1e6": network.G_0 / fine["G_0"],
        "network_over_probe_K_1e6": network.K_0 / fine["K_0"],
    } | frozen_exponents(s)  # fmt: skip


def frozen_exponents(s: Snapshot) -> dict[str, float]:
    """Slopes of ln G_0 over ln G_p and over ln p' when the springs of one network follow Hertz's law."""
    factors = (0.5, 1.0, 2.0)
    modulus = [network_moduli(stiffened(s, f, 1.0)).G_0 for f in factors]
    pressed = [network_moduli(stiffened(s, 1.0, f)).G_0 for f in factors]
    return {"frozen_exponent_G_p": slope(factors, modulus), "frozen_exponent_p": slope(factors, pressed)}


def probed_exponents(part: pd.DataFrame) -> dict[str, float]:
    """Slopes over ln G_p of what was measured on packings that came to rest with their own modulus, at one density."""
    names = ("G_0_probe_1e6", "G_0_network", "Z")
    return {f"{name}_over_G_p": slope(part.G_p, part[name]) for name in names} | {
        name: part[name].iloc[(part.G_p - 25.7e9).abs().argmin()] for name in part.columns if name.startswith("frozen")
    }


def slope(x, y) -> float:
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def stiffened(s: Snapshot, modulus: float, pressure: float) -> Snapshot:
    """The same contacts with moduli and forces times the factors; overlaps, k_n and k_t follow Hertz's law."""
    old = np.maximum(s.overlap, 0.0)
    overlap = old * (pressure / modulus) ** (2.0 / 3.0)
    k = modulus * np.sqrt(np.divide(overlap, old, out=np.ones_like(old), where=old > 0.0))
    branch = s.branch + (old - overlap)[:, None] * s.normal
    return replace(
        s, overlap=overlap, branch=branch, f_n=pressure * s.f_n, f_t=pressure * s.f_t, k_n=k * s.k_n, k_t=k * s.k_t
    )


if __name__ == "__main__":
    main()
