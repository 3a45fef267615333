"""YADE and LAMMPS as engines of the same protocol: states, moduli and cost of whole chains.

    /usr/bin/python3 tests/benchmarks/bench_engines.py same [N ...]        (default 400 1000)
    /usr/bin/python3 tests/benchmarks/bench_engines.py oracle [N ...]      (default 400)
    /usr/bin/python3 tests/benchmarks/bench_engines.py chains [N ...]      (default 400)
    /usr/bin/python3 tests/benchmarks/bench_engines.py cost [N ...]        (default 400 1000 4000; hours)
    /usr/bin/python3 tests/benchmarks/bench_engines.py summary

same      the state that LAMMPS brought to rest goes to YADE with all forces of its contacts, and both probe it
oracle    the packing that YADE consolidated goes to both codes, for probe and shear: what the code alone changes
chains    consolidation, probe and shear in both codes from the same assembly: three packings x three densities x three
          points of the pairs (mu_s, G_p)
cost      CPU seconds of a chain at medium density, the codes in turn
summary   mean difference of the codes beside the scatter of packings

Resumable: each row of data/benchmarks/engines.csv is one code's chain and is written when it ends.
"""

from __future__ import annotations

import shutil
import sys
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from scipy.special import stdtrit  # noqa: E402

from analysis.runs.peak_critical import peak_state, stress_ratio  # noqa: E402
from analysis.runs.run_file import Run, read_run  # noqa: E402
from tests.benchmarks import dem_runs, lammps_runs  # noqa: E402
from tests.benchmarks.bench_rows import append, finished  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "engines.csv"
G_REF, INERTIAL_NUMBER, STRAIN_END, CRITICAL_FROM = 25.7e9, 2.4e-3, 0.40, 0.25
PACKINGS, DENSITIES = (1, 2, 3), (0.001, 0.04, 0.1)
#: mu_s and G_p (Pa) of the points: near the 10 %, 50 % and 90 % quantiles of mu_s, and G_p as the pairs go with it.
POINTS = ((0.12, 35e9), (0.214, 25.7e9), (0.39, 19e9))
SIZES = {"same": (400, 1000), "oracle": (400,), "chains": (400,), "cost": (400, 1000, 4000)}
STATES = ("G_0", "K_0", "e_initial", "Z_initial", "eta_peak", "eps_peak", "eta_critical", "e_critical", "Z_critical",
          "Z_m_critical", "f_sliding_critical")  # fmt: skip
#: Ends of the pieces of strain over which the curves of eta, e and Z are averaged.
PIECES = (0.0, 0.01, 0.03, 0.06, 0.12, 0.25)
CURVES = tuple(f"{name}_to_{end:g}" for name in ("eta", "e", "Z") for end in PIECES[1:])
KEYS = ("kind", "code", "N", "packing", "mu_iso", "mu_s", "G_p_GPa")
COSTS = ("cpu_consolidate", "cpu_probe", "cpu_shear", "steps_consolidate", "steps_probe", "steps_shear")
TAKEN_OVER = ROOT / "tests" / "yade" / "scenes" / "probe_taken_over.py"
COLUMNS = (*KEYS, "version", "scripts", *STATES, *CURVES, "servo_mean_error", "F_unb", *COSTS, "failed")


def main(kind: str, *sizes: str) -> int:
    """Run what is missing of one kind; 0, or 1 when a chain failed."""
    if kind == "summary":
        print(summary(pd.read_csv(TABLE)).to_string(index=False, float_format=lambda v: f"{v:.4g}"))
        return 0
    if shutil.which("lmp") is None:
        print("skipped: no lmp on the path (Debian's package lammps)")
        return 0
    failed = 0
    for N in map(int, sizes or SIZES[kind]):
        for case in cases(kind):
            for code in ("lammps", "yade"):
                failed += row(kind, code, N, *case)
    return int(failed > 0)


def cases(kind: str) -> list[tuple[int, float, float, float]]:
    """packing, mu_iso, mu_s and G_p (Pa) of the chains of a kind."""
    if kind == "cost":
        return [(1, 0.04, *POINTS[1])]
    densities, points = (DENSITIES, POINTS) if kind == "chains" else ((0.04,), POINTS[1:2])
    return [(packing, mu_iso, *point) for packing in PACKINGS for mu_iso in densities for point in points]


def row(kind: str, code: str, N: int, packing: int, mu_iso: float, mu_s: float, G_p: float) -> bool:
    """Add the row of one code's chain unless it is there; whether it failed."""
    keys = {"kind": kind, "code": code, "N": N, "packing": packing, "mu_iso": mu_iso, "mu_s": mu_s,
            "G_p_GPa": G_p / 1e9}  # fmt: skip
    if tuple(f"{v:.6g}" if isinstance(v, float) else str(v) for v in keys.values()) in finished(TABLE, KEYS):
        return False
    try:
        if kind == "same":
            found = moduli(probe_of_one_state(code, N, packing, mu_iso, mu_s, G_p))
        else:
            found = measured(*chain(kind, code, N, packing, mu_iso, mu_s, G_p))
    except dem_runs.RunFailed as error:
        append(TABLE, COLUMNS, keys | {"failed": str(error)})
        return True
    append(TABLE, COLUMNS, keys | found)
    return False


def probe_of_one_state(code: str, N: int, packing: int, mu_iso: float, mu_s: float, G_p: float) -> Run:
    """The probe of a state that LAMMPS brought to rest: its own, or YADE's of the same grains and forces."""
    first = lammps_runs.run("consolidate", assembly=dem_runs.assembly(N, packing), mu_iso=mu_iso, G_p=G_REF,
                            seed=packing)  # fmt: skip
    mine = lammps_runs.run("probe", start=first, mu_s=mu_s, G_p=G_p)
    if code == "lammps":
        return read_run(mine)
    return read_run(dem_runs.run("probe", scene=TAKEN_OVER, start=mine, mu_s=mu_s, G_p=G_p, seed=packing))


def moduli(probe: Run) -> dict:
    """G_0, K_0 and the cost of a probe."""
    assert probe.probe is not None
    return {
        "version": probe.attrs["yade_version"], "scripts": probe.attrs["script_digest"][:10],
        **{name: float(probe.probe[name]) for name in ("G_0", "K_0")},
        "cpu_probe": float(probe.timing["cpu_seconds"]), "steps_probe": int(probe.timing["steps"]),
    }  # fmt: skip


def chain(kind: str, code: str, N: int, packing: int, mu_iso: float, mu_s: float, G_p: float) -> list[Run]:
    """Consolidation, probe and shear run of one code; with kind "oracle" both codes have YADE's consolidation."""
    run = dem_runs.run if code == "yade" else lammps_runs.run
    of_first = {"assembly": dem_runs.assembly(N, packing), "mu_iso": mu_iso, "G_p": G_REF, "seed": packing}
    if kind == "oracle":
        first = dem_runs.run("consolidate", **of_first)
        first = first if code == "yade" else lammps_runs.adopt(first)
    else:
        first = run("consolidate", **of_first)
    probe = run("probe", start=first, mu_s=mu_s, G_p=G_p)
    shear = run("shear", start=probe, mu_s=mu_s, G_p=G_p, inertial_number=INERTIAL_NUMBER, strain_end=STRAIN_END)
    return [read_run(path) for path in (first, probe, shear)]


def measured(first: Run, probe: Run, shear: Run) -> dict:
    """Moduli, states, proofs and costs of a chain."""
    record, eta = shear.record, stress_ratio(shear.record["sigma"])
    peak, late = peak_state(shear.strain, eta), shear.strain > CRITICAL_FROM
    out = moduli(probe) | {"scripts": shear.attrs["script_digest"][:10]}
    out |= {"e_initial": float(record["e"][0]), "Z_initial": float(record["Z"][0])}
    out |= {"eta_peak": peak.eta, "eps_peak": peak.eps_a, "eta_critical": float(eta[late].mean())}
    out |= {f"{name}_critical": float(record[name][late].mean()) for name in ("e", "Z", "Z_m", "f_sliding")}
    out |= {name: float(shear.proofs[name]) for name in ("servo_mean_error", "F_unb")}
    for low, high in pairwise(PIECES):
        piece = (shear.strain > low) & (shear.strain <= high)
        out |= {f"{name}_to_{high:g}": float(v[piece].mean()) for name, v in {**record, "eta": eta}.items()
                if name in ("eta", "e", "Z")}  # fmt: skip
    for stage, run in zip(("consolidate", "probe", "shear"), (first, probe, shear), strict=True):
        out |= {f"cpu_{stage}": float(run.timing["cpu_seconds"]), f"steps_{stage}": int(run.timing["steps"])}
    return out


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Difference LAMMPS - YADE of every state beside the scatter of packings, and the ratio of the CPU times.

    A state, or a curve averaged over a piece of strain: mean difference over the packings of a density and a point,
    standard deviation of packings within a code (pooled over both), and the largest difference that this scatter alone
    explains at 95 %, each by itself.
    """
    rows = []
    for (kind, N, mu_iso, mu_s), part in table.groupby(["kind", "N", "mu_iso", "mu_s"]):
        for name in (*STATES, *CURVES, *COSTS[:3]):
            pair = part.pivot(index="packing", columns="code", values=name).dropna()
            if set(pair.columns) != {"yade", "lammps"} or not len(pair):
                continue
            n, mean = len(pair), pair.yade.mean()
            scatter = float(np.sqrt(pair.var(ddof=1).mean())) if n > 1 else np.nan
            limit = stdtrit(2 * n - 2, 0.975) * scatter * np.sqrt(2.0 / n) if n > 1 else np.nan
            difference = float((pair.lammps - pair.yade).mean())
            rows.append({"kind": kind, "N": N, "mu_iso": mu_iso, "mu_s": mu_s, "quantity": name, "packings": n,
                         "YADE": mean, "LAMMPS": pair.lammps.mean(), "difference_percent": 100.0 * difference / mean,
                         "limit_percent": 100.0 * limit / mean, "within": bool(abs(difference) <= limit)})  # fmt: skip
    return pd.DataFrame(rows)


if __name__ == "__main__":
    sys.exit(main(*(sys.argv[1:] or ["oracle"])))
