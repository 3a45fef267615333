"""What metrics cost against reading a snapshot, and how well anisotropies predict the stress ratio of real packings.

    /usr/bin/python3 tests/benchmarks/bench_micromechanics.py cost      (a minute)
    /usr/bin/python3 tests/benchmarks/bench_micromechanics.py yade      (half an hour of YADE; resumes)

`cost` writes data/benchmarks/micromechanics_cost.csv: CPU seconds (median) of reading a 23,312-sphere snapshot and of
each group of metrics, and the ratio to reading it.  `yade` writes data/benchmarks/stress_force_fabric.csv: measured and
predicted q / p' at the peak and at the critical state of real shear runs (means over the snapshots of each state).
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import snapshots  # noqa: E402

from analysis.assembly import make_assembly  # noqa: E402
from analysis.micromechanics import grading  # noqa: E402
from analysis.micromechanics import metrics as mm  # noqa: E402
from analysis.micromechanics.snapshot import Snapshot, check_snapshot  # noqa: E402
from analysis.micromechanics.stress_force_fabric import stress_force_fabric  # noqa: E402
from analysis.runs import peak_critical  # noqa: E402
from analysis.runs.run_file import read_snapshot  # noqa: E402
from tests.benchmarks import dem_runs  # noqa: E402

COST = ROOT / "data" / "benchmarks" / "micromechanics_cost.csv"
FABRIC = COST.with_name("stress_force_fabric.csv")
REPEATS = 15
#: mu_iso and mu_s of the shear runs, G_p = 25.7 GPa, N = 1,000.
RUNS = ((0.001, 0.25), (0.1, 0.25), (0.001, 0.1), (0.001, 0.5))
STRAINS = [*np.arange(0.01, 0.1, 0.0025), *np.arange(0.1, 0.25, 0.01), *np.arange(0.25, 0.4, 0.005)]


def cost() -> None:
    """Time every group of metrics on one snapshot, against a file as the runs write it and an uncompressed one."""
    s = large_snapshot(23_312)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, options in (("gzip", {"compression": "gzip", "shuffle": True}), ("plain", {})):
            path = Path(folder) / f"{name}.h5"
            with h5py.File(path, "w") as file:
                for array in snapshots.SNAPSHOT_ARRAYS:
                    file.create_dataset(array, data=getattr(s, array), **options)
            rows.append((f"reading, {name}", cpu(lambda p=path: read_bare(p))))
    rows += [(name, cpu(task)) for name, task in tasks(s).items()]
    table = pd.DataFrame(rows, columns=["what", "cpu_seconds"])
    table["over_reading_gzip"] = table.cpu_seconds / table.cpu_seconds[0]
    table["over_reading_plain"] = table.cpu_seconds / table.cpu_seconds[1]
    table.insert(1, "contacts", len(s.contact_ids))
    table.to_csv(COST, index=False, float_format="%.4g")
    print(table.to_string(index=False))


def tasks(s: Snapshot) -> dict:
    """The metrics by group, and all of them in one."""
    d, mass = 2.0 * s.radius, s.radius**3
    groups = {
        "check": lambda: check_snapshot(s),
        "snapshot_metrics": lambda: mm.snapshot_metrics(s, 0.5),
        "particle stresses": lambda: mm.particle_stress(s),
        "stress-force-fabric": lambda: stress_force_fabric(s),
        "force distribution": lambda: mm.force_distribution(s.f_n),
        "overlap volume": lambda: mm.overlap_volume(s.radius, s.contact_ids, s.overlap),
        "grading curves": lambda: [grading.grading_curve(d, w) for w in (mass, mm.particle_p_volume(s))],
    }
    return groups | {"all metrics": lambda: [task() for task in groups.values()]}


def cpu(task) -> float:
    """Median CPU seconds of a task."""
    spent = []
    for _ in range(REPEATS):
        start = time.process_time()
        task()
        spent.append(time.process_time() - start)
    return float(np.median(spent))


def read_bare(path: Path) -> list[np.ndarray]:
    with h5py.File(path, "r") as file:
        return [data[()] for data in file.values()]


def large_snapshot(N: int, Z: float = 5.2) -> Snapshot:
    """A random assembly whose radii are inflated until it has about Z contacts a sphere; forces by Hertz's law."""
    a = make_assembly(N, dem_runs.D50, dem_runs.SIGMA_LN, seed=1)
    pairs = cKDTree(a.position, boxsize=a.cell[0]).query_pairs(2.2 * a.radius.max(), output_type="ndarray")
    branch = a.position[pairs[:, 1]] - a.position[pairs[:, 0]]
    branch -= a.cell * np.round(branch / a.cell)
    apart = np.linalg.norm(branch, axis=1) / a.radius[pairs].sum(axis=1)
    factor = np.sort(apart)[int(0.5 * Z * N)]
    ids, branch = pairs[apart < factor], branch[apart < factor]
    f_t = np.random.default_rng(1).normal(size=branch.shape)
    f_t -= np.einsum("ij,ij->i", f_t, branch)[:, None] * branch / np.einsum("ij,ij->i", branch, branch)[:, None]
    return snapshots.hertzian(a.position, factor * a.radius, np.diag(a.cell), ids, branch, f_t=1e-6 * f_t)


def yade() -> None:
    """Shear real packings with many snapshots, decompose each, and average around the peak and beyond 25 % strain."""
    rows = []
    for mu_iso, mu_s in RUNS:
        snapshots = ",".join(f"{x:.4f}" for x in STRAINS)
        _, run = dem_runs.chain(1000, 1, mu_iso, mu_s, 25.7e9, inertial_number=2e-3, snapshots=snapshots)
        eta = peak_critical.stress_ratio(run.record["sigma"])
        peak = peak_critical.peak_state(run.record["eps_a"], eta)
        critical = peak_critical.critical_state(run.record["eps_a"], {"eta": eta, "e": run.record["e"]})
        at = np.array([eps_a for _, eps_a, _ in run.snapshots])
        for state, chosen, smoothed in (
            ("peak", np.abs(at - peak.eps_a) < 0.0076, peak.eta),
            ("critical", at > critical.eps_from, critical.mean["eta"]),
        ):
            split = [stress_force_fabric(read_snapshot(run, int(k))) for k in np.flatnonzero(chosen)]
            rows.append({"mu_iso": mu_iso, "mu_s": mu_s, "state": state, "eta_record": smoothed} | averages(split))
            print({k: v if isinstance(v, str) else f"{v:.4g}" for k, v in rows[-1].items()}, flush=True)
        pd.DataFrame(rows).to_csv(FABRIC, index=False, float_format="%.5g")


def averages(split: list) -> dict[str, float]:
    """Means over snapshots, and the errors of both predictions: of the means, and the largest of a single snapshot."""
    names = ("a_c", "a_n", "a_t", "a_b", "eta", "eta_predicted", "eta_linear")
    mean = {name: float(np.mean([getattr(x, name) for x in split])) for name in names}
    single = max(abs(x.eta_predicted / x.eta - 1.0) for x in split)
    errors = {
        "error": mean["eta_predicted"] / mean["eta"] - 1.0,
        "error_linear": mean["eta_linear"] / mean["eta"] - 1.0,
    }
    return {"snapshots": len(split), **mean, **errors, "worst_single_error": single}


if __name__ == "__main__":
    {"cost": cost, "yade": yade}[sys.argv[1] if len(sys.argv) > 1 else "cost"]()
