"""One run in LAMMPS: from the parameters of a row to its product, stage by stage."""

from __future__ import annotations

import math
import resource
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from analysis.assembly import read_assembly
from analysis.micromechanics.snapshot import Snapshot
from analysis.runs.gate import PROOF_LIMITS
from analysis.runs.run_file import read_snapshot as read_product_snapshot
from campaign.folder import READ_BY_SCRIPTS, SCRIPTS, clear_scripts
from campaign.lammps import packing, stages
from campaign.lammps.outputs import LammpsError, contact_lists, proofs, read_samples, read_snapshot
from campaign.lammps.product import Product, read_start
from campaign.lammps.proofs import shear_proofs
from campaign.lammps.record import along_contacts, check_contacts, history, record
from campaign.lammps.runner import run_lammps, version
from campaign.lammps.scene import FORCES, MEANS

#: What a run takes from its start, as YADE's stages do: the packing decides.
INHERITED = ("N", "sigma_ln", "seed", "mu_iso", "assembly")
GRAINS, START = READ_BY_SCRIPTS
DENSEST, EDGE_LIMIT = 0.68, 2.1  # as in yade_scripts/consolidate.py


def consolidate(p: SimpleNamespace, folder: Path) -> Product:
    """From the assembly to equilibrium at sigma_3; the product holds the history, the last snapshot and the state."""
    grains = read_assembly(p.assembly)
    p.N, p.sigma_ln, p.d_max = len(grains.radius), _grading_width(grains.radius), 2.0 * float(grains.radius.max())
    ratio = (float(np.sum(4.0 / 3.0 * np.pi * grains.radius**3)) / DENSEST) ** (1 / 3) / (2.0 * grains.radius.max())
    if ratio < EDGE_LIMIT:
        raise LammpsError(
            f"cell too small: its edge will be {ratio:.3g} < {EDGE_LIMIT:g} diameters of the largest grain"
        )
    mass = packing.masses(grains.radius, p.rho, bool(p.density_scaling))
    G = p.G_p * p.stiffness_scale
    dt = p.timestep_factor * stages.DAMPED_STEP * packing.expected_step(grains.radius, mass, G, p.sigma_3, p.d50)
    (folder / GRAINS).write_text(packing.data_file(grains.position, grains.radius, grains.cell, mass))
    product, log = run_scripts(p, folder, {"in": stages.consolidation(p, GRAINS, mass, dt)}, dt,
                               ("end.contacts", stages.END))  # fmt: skip
    snapshot, _ = read_snapshot(folder, "end", p, G, 0.0, log)
    product.record = history(read_samples(folder / "samples.txt", FORCES), grains.radius)
    product.snapshots, product.proofs = [snapshot], proofs(log, "settled")
    product.state, product.exit_reason = (folder / stages.END).read_bytes(), "equilibrium"
    return product


def probe(p: SimpleNamespace, folder: Path) -> Product:
    """Rest with mu_s and G_p, then G_0 with both signs and K_0; the product holds the state at rest."""
    scale, p.stiffness_scale = p.stiffness_scale, 1.0  # a probe is always at full stiffness
    start, restart, step = _begin(p, folder)
    dt = stages.DAMPED_STEP * step * min(1.0, start.G / p.G_p) ** (1.0 / 3.0)
    product, log = run_scripts(p, folder, stages.probe(p, start, restart, dt), dt, ("start.contacts", stages.END))
    snapshot, _ = read_snapshot(folder, "start", p, p.G_p, 0.0, log)
    product.snapshots, product.probe = [snapshot], _moduli(p, log)
    product.proofs = proofs(log, "settled")
    off = float(np.abs(np.diag(_response(log, "none")) / p.sigma_3 - 1.0).max())
    if not off < PROOF_LIMITS["probe"]["stress_error"]:
        raise LammpsError(f"no equilibrium: the stress is off sigma_3 by {off:.3g} once the cell stands still")
    product.proofs["stress_error"] = max(off, product.proofs["stress_error"])
    product.proofs["G_0_asymmetry"] = abs(product.probe["G_0_minus"] / product.probe["G_0"] - 1.0)
    product.state, product.exit_reason = (folder / stages.END).read_bytes(), "probed"
    p.requested_stiffness_scale = scale
    return product


def _moduli(p: SimpleNamespace, log: str) -> dict:
    """G_0 = dq / (3 d eps_q) for both signs and K_0 = dp' / d eps_v, with the increments behind them."""
    stress = {name: _response(log, name) for name in ("none", *stages.DIRECTIONS)}
    change = {name: stress[name] - stress["none"] for name in stages.DIRECTIONS}

    def q(s: np.ndarray) -> float:
        return float(s[2, 2] - 0.5 * (s[0, 0] + s[1, 1]))

    return {
        "strain": p.probe_strain,
        "G_0": q(change["shear"]) / (3.0 * p.probe_strain),
        "G_0_minus": -q(change["back"]) / (3.0 * p.probe_strain),
        "K_0": np.trace(change["bulk"]) / 3.0 / p.probe_strain,
        "d_eps": np.array([p.probe_strain * np.diag(d) for d in stages.DIRECTIONS.values()]),
        "d_sigma": np.array([change[name] for name in stages.DIRECTIONS]),
    }


def _response(log: str, name: str) -> np.ndarray:
    """The stress (3, 3), Pa, that the script printed after an increment."""
    line = next((line for line in log.splitlines() if line.startswith(f"RESPONSE {name} ")), None)
    if line is None:
        raise LammpsError(f"no response {name} in the log")
    xx, yy, zz, xy, xz, yz = map(float, line.split()[2:])
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def shear(p: SimpleNamespace, folder: Path) -> Product:
    """Drained triaxial compression; the product holds the record, the snapshots and the proofs."""
    start, restart, step = _begin(p, folder)
    if (height := start.height * math.exp(-p.strain_end)) < 2.0 * p.d_max:
        raise LammpsError(
            f"thin cell: its height at strain_end = {p.strain_end:g} is {height:.4g} m < {2.0 * p.d_max:.4g} m, two "
            "diameters of the largest grain, so that two grains would touch twice"
        )
    G = p.G_p * p.stiffness_scale
    strains = sorted(float(part) for part in str(p.snapshots).split(",") if part.strip())
    script, dt = stages.shear(p, start, restart, step, strains)
    wanted = ("samples.txt", "contacts.txt", "end.contacts")
    product, log = run_scripts(p, folder, {"in": script}, dt, wanted)
    first, _ = read_snapshot(folder, "start", p, G, 0.0, log)
    samples = read_samples(folder / "samples.txt", MEANS)
    if (reached := float(samples["eps_a"][-1])) < p.strain_end:
        raise LammpsError(f"the strain stands still at {reached:.4g} of {p.strain_end:g}")
    lists = along_contacts(contact_lists(folder / "contacts.txt"), first["radius"], p, G)
    if wrong := check_contacts(samples, lists, p.N):
        raise LammpsError(wrong)
    product.record = record(p, samples, lists, first["radius"], stages.window_edges(p.strain_end, p.windows))
    product.proofs = shear_proofs(product.record, p.energy_strain)
    product.snapshots = [first]
    for k in range(len(strains) + 1):
        name = "end" if k == len(strains) else f"strain_{k}"
        snapshot, _ = read_snapshot(folder, name, p, G, 0.0, log)
        snapshot["eps_a"] = float(np.log(first["cell"][2, 2] / snapshot["cell"][2, 2]))
        snapshot["label"] = name.split("_")[0]
        product.snapshots.append(snapshot)
    product.exit_reason = "strain_end"
    return product


STAGES = {"consolidate": consolidate, "probe": probe, "shear": shear}


def _begin(p: SimpleNamespace, folder: Path) -> tuple[stages.Start, str, float]:
    """What a run starts from: facts, the state's file in the run's folder, and the time step (s) that it allows."""
    origin, state = read_start(Path(p.start))
    for name in INHERITED:
        if name in origin:
            setattr(p, name, origin[name])
    restart = START
    (folder / restart).write_bytes(state)
    s: Snapshot = read_product_snapshot(p.start, "end" if origin["stage"] == "consolidate" else "start")
    p.N, p.d_max = s.N, 2.0 * float(s.radius.max())
    if bool(origin["density_scaling"]) != bool(p.density_scaling) or origin["rho"] != p.rho:
        raise LammpsError(
            f"start {p.start}: rho = {origin['rho']:g}, density_scaling = {origin['density_scaling']}, this run has "
            f"rho = {p.rho:g}, density_scaling = {p.density_scaling}; a state of LAMMPS keeps its masses"
        )
    mass = packing.masses(s.radius, p.rho, bool(p.density_scaling))
    probed = origin["stage"] == "probe"
    at_rest = probed and all(origin[k] == getattr(p, k) for k in ("mu_s", "G_p", "stiffness_scale", "nu", "sigma_3"))
    start = stages.Start(
        N=s.N, mass=float(np.median(mass)), mu=origin["mu_s" if probed else "mu_iso"],
        G=origin["G_p"] * origin["stiffness_scale"] * (1.0 - p.nu) / (1.0 - origin["nu"]),
        height=float(s.cell[2, 2]), at_rest=at_rest,
    )  # fmt: skip
    stiffer = max(1.0, p.sigma_3 / origin["sigma_3"]) ** (1.0 / 3.0)  # contacts at this run's stress
    return start, restart, p.timestep_factor * packing.stable_step(s, mass) / math.sqrt(stiffer)


def run_scripts(
    p: SimpleNamespace, folder: Path, scripts: dict[str, str], dt: float, outputs: tuple[str, ...]
) -> tuple[Product, str]:
    """Run scripts in the run's folder, one after the other; the product with what is known of the run, and the logs.

    Raises LammpsError if a file of `outputs` is not there at the end.
    """
    product, logs = Product(p, script="\n".join(scripts.values()), dt=dt), []
    for name, script in scripts.items():
        (folder / f"{name}.lammps").write_text(script)
    for name in scripts:
        log, cpu = run_lammps(folder, name, p.ranks)
        logs.append(log)
        product.cpu_seconds += cpu
        product.steps += sum(int(line.split()[-5]) for line in log.splitlines() if line.startswith("Loop time of"))
    for name in outputs:
        if not (folder / name).exists():
            raise LammpsError(f"LAMMPS stopped without {name}")
    product.version = version(logs[0])
    return product, "\n".join(logs)


def finish(product: Product, folder: Path) -> None:
    """Write the product with the CPU time of this process added, and keep of the folder what a run by hand needs."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    product.cpu_seconds += own.ru_utime + own.ru_stime
    product.write()
    clear_scripts(folder)


def make_folder(p: SimpleNamespace) -> Path:
    """A new folder of the run beside its product, for the script and its output."""
    folder = Path(p.product).with_suffix(SCRIPTS)
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    return folder


def _grading_width(radius: np.ndarray) -> float:
    """Standard deviation of ln d by mass."""
    mass, x = radius**3, np.log(radius)
    return float(np.sqrt(np.average((x - np.average(x, weights=mass)) ** 2, weights=mass)))
