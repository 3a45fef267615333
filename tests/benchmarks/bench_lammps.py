"""The same packings sheared in YADE and in LAMMPS: eta, e and Z along the strain, and what either costs.

    /usr/bin/python3 tests/benchmarks/bench_lammps.py        (a quarter of an hour; resumes where it stopped)

Optional: without LAMMPS (Debian's package lammps) it says so and ends.  Each packing is consolidated, brought to rest
with mu_s and sheared by this project's own stages; the state at rest goes to LAMMPS (`lammps_input.py`), which shears
it at the same inertial number under the same confining stress.  data/benchmarks/lammps.csv has a row per packing and
code and LAMMPS's bare loop at two sizes; lammps_agreement.csv the difference of the codes beside the scatter of
packings; lammps.png shows the curves.  CPU seconds, user and system, are those of whole processes on one core.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import resource
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
from scipy.special import stdtrit

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.micromechanics.metrics import love_stress, sphere_volume  # noqa: E402
from analysis.micromechanics.snapshot import Snapshot  # noqa: E402
from analysis.runs.peak_critical import peak_state, stress_ratio  # noqa: E402
from analysis.runs.run_file import Run, read_snapshot  # noqa: E402
from tests.benchmarks import lammps_input  # noqa: E402
from tests.benchmarks.dem_runs import BUILD, RunFailed, chain, digest  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "lammps.csv"
N, PACKINGS, MU_ISO, MU_S, G_P, STRAIN_END = 1000, (1, 2, 3), 0.04, 0.25, 25.7e9, 0.40
CRITICAL_FROM, SERVO_FROM = 0.25, 0.01  # strains: of the critical state, and from which the servo is judged
EARLY = 0.02  # strain up to which two runs of one packing keep together, before chaos parts them
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
        rows += [speed(probe, shear, copies) for copies in COPIES]
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
    """The probe's packing at rest sheared in LAMMPS, averaged over YADE's windows; cost without the rest before."""
    s = read_snapshot(probe, "start")
    p = parameters(shear)
    modulus = probe.probe["K_0"] + 4.0 / 3.0 * probe.probe["G_0"]
    dt = lammps_input.STEP * lammps_input.stable_step(s, p.rho)
    folder, cpu = lammps("shear", s, p, lammps_input.shear_script(s, p, modulus, dt))
    check_hertz(s, folder)
    data = dict(zip(("step", *lammps_input.COLUMNS), np.loadtxt(folder / "record.txt").T, strict=True))
    data = pd.DataFrame(average(data, shear.record["eps_a"]))
    sigma = np.stack([np.diag(row) for row in data[["sigma_x", "sigma_y", "sigma_z"]].to_numpy()])
    volume = data.length_x * data.length_y * data.length_z
    values = {"eta": stress_ratio(sigma), "e": volume.to_numpy() / sphere_volume(s.radius).sum() - 1.0}
    servo = (data.sigma_x + data.sigma_y).to_numpy() / (2.0 * p.sigma_3) - 1.0
    steps = int(data.last_step.iloc[-1] - data.last_step.iloc[0])
    share, version = steps / data.last_step.iloc[-1], (folder / "log.txt").read_text().split(")")[0].split("(")[1]
    return Curve(data.eps_a.to_numpy(), values | {"Z": data.Z.to_numpy()}, servo, steps, share * cpu, dt, version)


def parameters(shear: Run) -> lammps_input.Shear:
    """What the YADE run was asked for."""
    names = lammps_input.Shear.__dataclass_fields__
    return lammps_input.Shear(**{name: shear.parameters[name] for name in names})


def lammps(name: str, s: Snapshot, p: lammps_input.Shear, script: str) -> tuple[Path, float]:
    """Folder and CPU seconds of a LAMMPS run of that script on that packing, run when missing; RunFailed on errors."""
    data = lammps_input.data_file(s, p.rho)
    folder = BUILD / f"lammps_{name}_{hashlib.sha256((data + script).encode()).hexdigest()[:12]}"
    done = folder / "done.json"
    if not done.exists():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "packing.data").write_text(data)
        (folder / "in.txt").write_text(script)
        before = cpu_of_children()
        ended = subprocess.run(
            ["lmp", "-in", "in.txt", "-log", "log.txt", "-screen", "none"], cwd=folder, stdin=subprocess.DEVNULL,
            env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True, check=False,
        )  # fmt: skip
        text = (folder / "log.txt").read_text() if (folder / "log.txt").exists() else ended.stderr
        if ended.returncode or "ERROR" in text:
            reason = next((line for line in text.splitlines() if "ERROR" in line), f"exit status {ended.returncode}")
            raise RunFailed(f"{folder.name}: LAMMPS: {reason}")
        done.write_text(json.dumps({"cpu_seconds": cpu_of_children() - before}))
    return folder, json.loads(done.read_text())["cpu_seconds"]


def cpu_of_children() -> float:
    """CPU seconds, user and system, of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def check_hertz(s: Snapshot, folder: Path, limit: float = 1e-4) -> None:
    """RunFailed unless LAMMPS begins with the stress of YADE's normal forces, up to what little still moves."""
    lines = (folder / "log.txt").read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("Step "))
    found = np.array(lines[at + 1].split()[1:4], float)
    expected = np.abs(np.diag(love_stress(s.branch, s.f_n, s.volume)))
    error = float(np.abs(found / expected - 1.0).max())
    if not error < limit:
        raise RunFailed(f"{folder.name}: stress of the normal forces is off by {error:.3g} > {limit:g}")


def average(data: dict[str, np.ndarray], eps_a: np.ndarray) -> dict[str, np.ndarray]:
    """The row at rest, then means of the fine rows about the strains `eps_a` (T,), and each window's `last_step`."""
    edges = np.concatenate([[-np.inf, 1e-6], 0.5 * (eps_a[1:-1] + eps_a[2:]), [np.inf]])
    window = np.searchsorted(edges, data["eps_a"], side="right") - 1
    count = np.bincount(window, minlength=len(eps_a))
    if (count == 0).any():
        raise RunFailed(f"LAMMPS: no row of its record about strain {eps_a[count == 0][0]:.3g}")
    means = {key: np.bincount(window, y) / count for key, y in data.items()}
    return means | {"last_step": np.array([data["step"][window == k].max() for k in range(len(eps_a))])}


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


def speed(probe: Run, shear: Run, copies: int) -> dict:
    """Row of LAMMPS's bare loop over the packing repeated: neither servo nor record."""
    s, p, steps = read_snapshot(probe, "start"), parameters(shear), COPIES[copies]
    dt = lammps_input.STEP * lammps_input.stable_step(s, p.rho)
    _, cpu = lammps("bare", s, p, lammps_input.speed_script(p, dt, copies, steps))
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
