"""Real LAMMPS runs for the benchmarks, each run once, its product kept in build/ and found again; see `dem_runs`.

`adopt` gives LAMMPS the packing of a product of YADE.  A file of grains holds no tangential forces, so the packing
comes to rest under its own stress first, with contact damping and drag.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from analysis.runs.run_file import read_run, read_snapshot  # noqa: E402
from campaign.files import code_digest  # noqa: E402
from campaign.lammps import packing, protocol, scene, stages  # noqa: E402
from campaign.lammps.__main__ import COMMON  # noqa: E402
from campaign.lammps.outputs import proofs  # noqa: E402
from campaign.lammps.outputs import read_snapshot as read_output  # noqa: E402
from campaign.run_one import run_environment  # noqa: E402
from tests.benchmarks.dem_runs import BUILD, RunCrashed, RunFailed  # noqa: E402


def scripts() -> str:
    """Which code makes the runs: the first figures of a sha256 over campaign/lammps."""
    return code_digest(ROOT / "campaign" / "lammps")[:10]


def run(stage: str, **values) -> Path:
    """The product of a stage with these parameters (SI), run when missing; raises RunFailed with the stated reason."""
    name = _name(stage, values)
    product, failure = BUILD / f"{name}.h5", BUILD / f"{name}.failed.json"
    if not product.exists() and not failure.exists():
        BUILD.mkdir(parents=True, exist_ok=True)
        row = {"description": name, "product": f"'{product}'", "code": "'lammps'"}
        row |= {k: f"'{v}'" if isinstance(v, (str, Path)) else repr(v) for k, v in values.items()}
        table = BUILD / f"{name}.table"
        table.write_text("  ".join(row) + "\n" + "  ".join(row.values()) + "\n")
        env = run_environment() | {"YADE_BATCH": f"{table}:2", "CAMPAIGN_RANKS": os.environ.get("BENCH_RANKS", "1")}
        with open(BUILD / f"{name}.log", "w") as log:
            subprocess.run([sys.executable, "-m", "campaign.lammps", stage], cwd=ROOT, env=env, check=False,
                           stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT)  # fmt: skip
    if product.exists():
        return product
    if not failure.exists():
        raise RunCrashed(f"{name}: no product, see {BUILD / name}.log")
    raise RunFailed(json.loads(failure.read_text())["reason"])


def adopt(source: Path, **values) -> Path:
    """A product of LAMMPS with the grains of YADE's product `source`, a consolidation or a probe, at rest.

    values: parameters that differ from those of the source, such as density_scaling.
    """
    origin = read_run(source)
    name = _name(f"adopted_{origin.stage}", {"start": str(source)} | values)
    product = BUILD / f"{name}.h5"
    if product.exists():
        return product
    p = SimpleNamespace(**COMMON | origin.parameters | values | {"code": "lammps", "stiffness_scale": 1.0})
    p.stage, p.started, p.run_id, p.product, p.ranks = origin.stage, time.time(), name, str(product), 1
    label = "start" if p.stage == "probe" else "end"
    s = read_snapshot(origin, label)
    mass = packing.masses(s.radius, p.rho, bool(p.density_scaling))
    p.N, p.d_max = s.N, 2.0 * float(s.radius.max())
    dt = p.timestep_factor * stages.DAMPED_STEP * packing.stable_step(s, mass)
    folder = protocol.make_folder(p)
    (folder / protocol.GRAINS).write_text(packing.data_file(s.position, s.radius, packing.edges(s), mass))
    made, log = protocol.run_scripts(p, folder, {"in": _adoption(p, mass, dt, label)}, dt,
                                    (f"{label}.contacts", stages.END))  # fmt: skip
    made.snapshots, made.proofs = [read_output(folder, label, p, p.G_p, 0.0, log)[0]], proofs(log, "settled")
    made.state, made.exit_reason = (folder / stages.END).read_bytes(), "adopted"
    protocol.finish(made, folder)
    return product


def _adoption(p, mass: np.ndarray, dt: float, label: str) -> str:
    """The input script of `adopt`."""
    m, mu = float(np.median(mass)), p.mu_s if p.stage == "probe" else p.mu_iso
    quiet = stages.PROBE_QUIET if p.stage == "probe" else stages.CONSOLIDATION_QUIET
    return "\n".join([
        scene.settings(p, f"read_data {protocol.GRAINS}"), scene.law(p, mu, p.G_p, scene.damping(p, m, p.G_p)),
        scene.engines(dt), scene.servo(p, p.G_p, dt), scene.drag(p, m),
        scene.coming_to_rest(p, dt, stages.CONSOLIDATION_WINDOW, 30, quiet, scene.z_limit(len(mass)), "settled"),
        scene.RELEASE, scene.snapshot(label), f"write_restart {stages.END}", "",
    ])  # fmt: skip


def _name(stage: str, values: dict) -> str:
    texts = {k: str(v) for k, v in values.items()}
    identity = json.dumps([stage, scripts(), texts], sort_keys=True)
    return f"lammps_{stage}_{hashlib.sha256(identity.encode()).hexdigest()[:12]}"
