"""The probe of a state that another code brought to rest: its grains, and the tangential forces of its contacts.

Parameters are those of the probe; `start` is a probe's product.  The state is taken as it is: nothing is run before the
increments but the rest that each of them has.  The product's proofs name the contacts that were lost or found, and the
largest difference of the stress from that of the state, over sigma_3.
"""

import os
import sys
from types import SimpleNamespace

sys.path.insert(0, os.path.abspath(os.path.join(os.path.dirname(sys.argv[0]), "..", "..", "..")))

import numpy as np
from minieigenHP import Vector3

from analysis.micromechanics.metrics import love_stress
from analysis.runs.run_file import read_snapshot
from yade_scripts import rve, stage
from yade_scripts.equilibrium import inertial_time
from yade_scripts.product import ProductError, saved_scene
from yade_scripts.record import snapshot
from yade_scripts.rve import O

run_stage, stage.main = stage.main, lambda *_: None  # importing the probe must not run it
from yade_scripts import probe  # noqa: E402

NO_STEP = 1e-30  # time step (s) in which contacts are made, and nothing moves


def protocol(p, product) -> None:
    """Build the state, probe it with both signs, write."""
    s = read_snapshot(p.start, "start")
    p.mu_iso, p.N = p.mu_s, s.N
    rve.build(SimpleNamespace(position=s.position, radius=s.radius, cell=np.diag(s.cell)), p)
    take_over(s)
    rve.use_contact_time_step(p)
    rve.engine("newton").damping = probe.DAMPING
    before = probe.at_rest(probe.REST_TIMES * inertial_time(p))
    scene, product.snapshots = saved_scene(), [snapshot("start", 0.0)]
    directions = [probe.SHEAR, -probe.SHEAR, probe.BULK]
    responses = [probe.increment(p, scene, p.probe_strain * d) - before for d in directions]
    product.probe = probe.results(p, [p.probe_strain * d for d in directions], responses)
    there = love_stress(s.branch, s.f_n + s.f_t, float(np.linalg.det(s.cell)))
    mine, its = (set(map(tuple, ids.tolist())) for ids in (product.snapshots[0]["contact_ids"], s.contact_ids))
    product.proofs = {
        "stress_error": float(np.abs(before - there).max() / p.sigma_3),
        "contacts_lost": len(its - mine),
        "contacts_found": len(mine - its),
    }
    product.state, product.exit_reason = scene, "probed"
    product.write()


def take_over(s) -> None:
    """Make the contacts of a snapshot, and give them their tangential forces."""
    normal_step, O.dt = O.dt, NO_STEP
    O.run(1, True)
    O.dt = normal_step
    forces = {tuple(pair): force for pair, force in zip(s.contact_ids.tolist(), s.f_t.tolist(), strict=True)}
    for contact in O.interactions:
        first, second = contact.id1, contact.id2
        sign = 1.0 if (first, second) in forces else -1.0
        force = forces.pop((first, second) if sign > 0.0 else (second, first), None)
        if force is not None:
            contact.phys.shearElastic = contact.phys.shearForce = Vector3(*(sign * f for f in force))
    if forces:
        raise ProductError(f"{len(forces)} of {len(s.contact_ids)} contacts of {s.where} were not made")


run_stage("probe", protocol)
