"""The same packings sheared in YADE and in LAMMPS: eta, e and Z along the strain, and what either costs.

    /usr/bin/python3 tests/benchmarks/bench_lammps.py        (a quarter of an hour; resumes where it stopped)

Optional: without LAMMPS (Debian's package lammps) it says so and ends. Each packing is consolidated, brought to rest
with mu_s and sheared by this project's own stages; the grains at rest go to LAMMPS (`lammps_runs.adopt`), which shears
them at the same inertial number under the same confining stress (`campaign/lammps`), with their own inertia.
data/benchmarks/lammps.csv has a row per packing and code and LAMMPS's bare loop at two sizes; lammps_agreement.csv the
difference of the codes beside the scatter of packings; lammps.png shows the curves. CPU seconds, user and system, are
those of whole processes on one core.
"""

from __future__ import annotations

import itertools
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import numpy as np
import pandas as pd
from scipy.special import stdtrit

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.micromechanics.metrics import love_stress  # noqa: E402
from analysis.micromechanics.snapshot import Snapshot  # noqa: E402
from analysis.runs.peak_critical import peak_state, stress_ratio  # noqa: E402
from analysis.runs.run_file import Run, read_run, read_snapshot  # noqa: E402
from campaign.lammps import packing as lammps_packing  # noqa: E402
from campaign.lammps import runner, scene, stages  # noqa: E402
from campaign.lammps.outputs import LammpsError  # noqa: E402
from tests.benchmarks import lammps_runs  # noqa: E402
from tests.benchmarks.dem_runs import BUILD, RunFailed, chain, digest  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "lammps.csv"
N, PACKINGS, MU_ISO, MU_S, G_P, STRAIN_END = 1000, (1, 2, 3), 0.04, 0.25, 25.7e9, 0.40
CRITICAL_FROM, SERVO_FROM = 0.25, 0.01  # strains: of the critical state, and from which the servo is judged
EARLY = 0.02  # strain up to which two runs of one packing keep together, before chaos parts them
STEP = 0.8  # of the stability limit: time step of the bare loop
COPIES = {1: 20_000, 3: 1_000}  # bare loop: copies of the packing an axis, and steps
SYMBOLS = ("eta", "e", "Z")
STATES = ("eta_peak", "eta_critical", "e_critical", "Z_critical", "e_initial", "Z_initial")


@dataclass(frozen=True)
class Curve:
    """A shear run: window means symbol -> (T,) over `eps_a` (T,), relative error of sigma_3 (T,), and the cost."""

    eps_a: np.ndarray
    values: dict[str, np.ndarray]
    servo: np.ndarray
    steps: int
    cpu_seconds: float
    dt: float
    version: str


def main() -> int:
    """Run what is missing, write tables and figure, print the verdict; 0, or 1 when a run failed."""
    if shutil.which("lmp") is None:
        print("skipped: no lmp on the path (Debian's package lammps)")
        return 0
    curves, rows, status = {}, [], 0
    for packing in PACKINGS:
        try:
            probe, shear = chain(N, packing, MU_ISO, MU_S, G_P, strain_end=STRAIN_END)
            both = {"YADE": yade_curve(shear), "LAMMPS": lammps_curve(probe, shear)}
        except RunFailed as error:
            print(f"packing {packing}: {error}", file=sys.stderr)
            status = 1
            continue
        curves[packing] = both
        rows += [row(packing, code, curve) for code, curve in both.items()]
        print(pd.DataFrame(rows[-2:]).to_string(index=False), flush=True)
    if not curves:
        return 1
    try:
        rows += [speed(shear, copies) for copies in COPIES]
    except RunFailed as error:
        print(f"bare loop: {error}", file=sys.stderr)
        status = 1
    table = pd.DataFrame(rows)
    table.to_csv(TABLE, index=False, float_format="%.6g")
    agreed = agreement(table, curves)
    agreed.to_csv(TABLE.with_name("lammps_agreement.csv"), index=False, float_format="%.4g")
    draw(curves, TABLE.with_suffix(".png"))
    print(agreed.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
    print(verdict(table, agreed))
    return status


def yade_curve(shear: Run) -> Curve:
    """The product's own record; its first row is the state before shear."""
    record, cost = shear.record, shear.timing
    values = {"eta": stress_ratio(record["sigma"]), "e": record["e"], "Z": record["Z"]}
    return Curve(
        record["eps_a"], values, record["servo_mean"], int(cost["steps"]), float(cost["cpu_seconds"]), cost["dt_mean"],
        shear.attrs["yade_version"],
    )  # fmt: skip


def lammps_curve(probe: Run, shear: Run) -> Curve:
    """The probe's packing at rest sheared in LAMMPS with the grains' own inertia; cost without the rest before."""
    p = shear.parameters
    start = lammps_runs.adopt(probe.path, density_scaling=0)
    names = ("mu_s", "G_p", "inertial_number", "strain_end")
    product = lammps_runs.run("shear", start=start, density_scaling=0, **{name: p[name] for name in names})
    check_hertz(read_snapshot(probe, "start"), read_snapshot(start, "start"))
    return yade_curve(read_run(product))


def check_hertz(yade: Snapshot, adopted: Snapshot, limit: float = 1e-3) -> None:
    """RunFailed unless the adopted packing carries the stress of YADE's in the same cell, up to what still moved."""
    for name, a, b in (("cell", yade.cell, adopted.cell), ("stress", _stress(yade), _stress(adopted))):
        error = float(np.abs(np.diag(b) / np.diag(a) - 1.0).max())
        if not error < limit:
            raise RunFailed(f"{adopted.where}: {name} of the adopted packing is off by {error:.3g} > {limit:g}")


def _stress(s: Snapshot) -> np.ndarray:
    return love_stress(s.branch, s.force, s.volume)


def row(packing: int, code: str, curve: Curve) -> dict:
    """States, servo and cost of one run."""
    late, judged = curve.eps_a > CRITICAL_FROM, curve.eps_a > SERVO_FROM
    peak = peak_state(curve.eps_a, curve.values["eta"])
    out = {"run": "shear", "code": code, "version": curve.version, "packing": packing, "N": N, "scripts": digest()}
    out["dt"] = curve.dt
    out |= cost(N, curve.steps, curve.cpu_seconds)
    out |= {
        "servo_mean": curve.servo[judged].mean(),
        "servo_worst_window": np.abs(curve.servo[judged]).max(),
        "eta_peak": peak.eta,
        "eps_peak": peak.eps_a,
    }
    out |= {f"{symbol}_critical": curve.values[symbol][late].mean() for symbol in SYMBOLS}
    return out | {f"{symbol}_initial": curve.values[symbol][0] for symbol in ("e", "Z")}


def cost(n: int, steps: int, cpu: float) -> dict:
    """Steps, particle-steps, CPU seconds and their ratio."""
    return {
        "steps": steps,
        "particle_steps": n * steps,
        "cpu_seconds": cpu,
        "particle_steps_per_cpu_second": n * steps / cpu,
    }


def speed(shear: Run, copies: int) -> dict:
    """Row of LAMMPS's bare loop over the packing repeated: neither servo nor record."""
    p, steps = SimpleNamespace(**shear.parameters, run_id="bare"), COPIES[copies]
    s = read_snapshot(shear, "start")
    p.d_max = 2.0 * float(s.radius.max())
    mass = lammps_packing.masses(s.radius, p.rho, False)
    dt = STEP * lammps_packing.stable_step(s, mass)
    folder = BUILD / f"lammps_bare_{copies}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "grains.data").write_text(lammps_packing.data_file(s.position, s.radius, lammps_packing.edges(s), mass))
    half = 0.5 * stages.strain_rate(p)
    text = [
        scene.settings(p, "read_data grains.data"), scene.law(p, p.mu_s, p.G_p, 0.0), scene.engines(dt),
        f"replicate {copies} {copies} {copies}",
        f"fix cell all deform 1 x erate {half:.9g} y erate {half:.9g} z erate {-2.0 * half:.9g} remap v units box",
        f"run {steps}",
    ]  # fmt: skip
    (folder / "in.lammps").write_text("\n".join(text) + "\n")
    try:
        _, cpu = runner.run_lammps(folder, "in", 1)
    except LammpsError as error:
        raise RunFailed(str(error)) from None
    n = s.N * copies**3
    return {"run": "bare loop", "code": "LAMMPS", "N": n, "scripts": digest(), "dt": dt} | cost(n, steps, cpu)


def agreement(table: pd.DataFrame, curves: dict) -> pd.DataFrame:
    """Difference of the codes beside the scatter of packings: states and whole curves.

    A state: mean difference LAMMPS - YADE over the packings, standard deviation of packings within a code (pooled over
    both), and the largest difference that this scatter alone explains at 95 %, each state by itself.  A curve: mean
    |difference| over strain of the codes on the same packing, and of two packings in the same code, which is the limit.
    """
    shears = table[table.run == "shear"]
    out = []
    for name in STATES:
        pair = shears.pivot(index="packing", columns="code", values=name)
        n, scatter = len(pair), float(np.sqrt(pair.var(ddof=1).mean()))
        limit = stdtrit(2 * n - 2, 0.975) * scatter * np.sqrt(2.0 / n) if n > 1 else np.nan
        out.append(verdict_row(name, pair.YADE.mean(), float((pair.LAMMPS - pair.YADE).mean()), scatter, limit))
    pairs = list(itertools.combinations(curves, 2))
    for end, symbol in itertools.product((EARLY, STRAIN_END), SYMBOLS):
        codes = np.mean([apart(both["YADE"], both["LAMMPS"], symbol, end) for both in curves.values()])
        scatter = np.mean([apart(curves[i][c], curves[j][c], symbol, end) for i, j in pairs for c in curves[i]])
        mean = np.mean([over_strain(both["YADE"], both["YADE"].values[symbol], end) for both in curves.values()])
        out.append(verdict_row(f"{symbol} to {100 * end:g} %", mean, codes, scatter, scatter))
    return pd.DataFrame(out)


def verdict_row(name: str, mean: float, difference: float, scatter: float, limit: float) -> dict:
    out = {"quantity": name, "YADE": mean, "difference": difference, "difference_percent": 100.0 * difference / mean}
    out |= {"scatter": scatter, "scatter_percent": 100.0 * scatter / mean, "limit": limit}
    return out | {"within": bool(abs(difference) <= limit)}


def apart(a: Curve, b: Curve, symbol: str, end: float) -> float:
    """Mean |difference| of two runs with the same windows, up to the strain `end`."""
    return over_strain(a, np.abs(a.values[symbol] - b.values[symbol]), end)


def over_strain(curve: Curve, y: np.ndarray, end: float) -> float:
    """Mean of y (T,) over the strain up to `end`; a window weighs what it is wide."""
    upto = curve.eps_a <= end
    return float(np.average(y[upto], weights=np.gradient(curve.eps_a)[upto]))


def draw(curves: dict, path: Path) -> None:
    """eta, e and Z along the strain: one colour a packing, YADE full, LAMMPS dashed."""
    labels = {"eta": r"$\eta = q/p'$", "e": "$e$", "Z": "$Z$"}
    fig, axes = plt.subplots(1, 3, figsize=(10.5, 3.4), constrained_layout=True)
    colours = plt.get_cmap("viridis")(np.linspace(0.05, 0.8, len(curves)))
    for (packing, both), colour in zip(curves.items(), colours, strict=True):
        for (code, curve), line in zip(both.items(), ("-", "--"), strict=True):
            for axis, symbol in zip(axes, SYMBOLS, strict=True):
                label = f"{code}, packing {packing}"
                axis.plot(100 * curve.eps_a, curve.values[symbol], line, color=colour, lw=1.1, label=label)
    for axis, symbol in zip(axes, SYMBOLS, strict=True):
        axis.set(xlabel=r"axial strain $\epsilon_a$ (%)", ylabel=labels[symbol], xlim=(0, 100 * STRAIN_END))
    axes[0].set_ylim(bottom=0.5)
    axes[1].legend(frameon=False, fontsize=8)
    fig.savefig(path, dpi=130)
    plt.close(fig)


def verdict(table: pd.DataFrame, agreed: pd.DataFrame) -> str:
    """One line: how much agrees, and both speeds."""
    shears = table[table.run == "shear"].groupby("code")[["steps", "particle_steps", "cpu_seconds"]].mean()
    rate = shears.particle_steps / shears.cpu_seconds
    bare = table[table.run == "bare loop"].set_index("N").particle_steps_per_cpu_second
    off = ", ".join(agreed.quantity[~agreed.within])
    return (
        f"{agreed.within.sum()} of {len(agreed)} within packing scatter{f' (not: {off})' if off else ''}; "
        f"a shear run costs {shears.cpu_seconds.YADE:.0f} CPU s in YADE ({shears.steps.YADE:.0f} steps, "
        f"{rate.YADE:.3g} particle-steps per CPU s), {shears.cpu_seconds.LAMMPS:.0f} in LAMMPS "
        f"({shears.steps.LAMMPS:.0f} steps, {rate.LAMMPS:.3g}, {rate.LAMMPS / rate.YADE:.2f} times YADE's); "
        "LAMMPS's bare loop " + ", ".join(f"{value:.3g} at N = {n}" for n, value in bare.items())
    )


if __name__ == "__main__":
    sys.exit(main())
