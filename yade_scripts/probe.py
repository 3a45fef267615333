"""Stage 2, small-strain probe: the packing at rest with its own mu_s and G_p, then tiny strain increments from there.

    YADE_BATCH=runs.table:2 yade -n -x -j1 yade_scripts/probe.py        one row
    yade-batch runs.table yade_scripts/probe.py                         all rows

The swap mu_iso -> mu_s (and G_p) happens here, so the state at rest that this product holds is where `shear.py` starts.
Each increment is ramped and brought to rest, always from that same state: axisymmetric constant-volume shear with
both signs (G_0), and isotropic compression (K_0).  Only the two states at rest count.
"""

import math
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

import numpy as np
from minieigenHP import Matrix3

from yade_scripts import rve
from yade_scripts.equilibrium import inertial_time
from yade_scripts.product import load_scene, saved_scene
from yade_scripts.record import snapshot
from yade_scripts.rve import O
from yade_scripts.stage import main
from yade_scripts.start import begin

QUIET = 1e-4  # unbalanced force of the state at rest: ten times quieter than consolidation asks for
DAMPING, RAMP_TIMES, REST_TIMES = 0.5, 1.0, 2.0  # inertial times of ramp and rest: G_0 is then within 1e-4 of its limit

SHEAR = np.diag([-0.5, -0.5, 1.0])  # compression along z at constant volume: eps_q = 1
BULK = np.eye(3) / 3.0  # eps_v = 1


def protocol(p, product) -> None:
    """Rest, snapshot, probe with both signs, write."""
    scale, p.stiffness_scale = p.stiffness_scale, 1.0  # a probe is always at full stiffness
    product.proofs = begin(p, quiet=QUIET)
    rve.release_servo()
    rve.engine("newton").damping = DAMPING
    before = at_rest(REST_TIMES * inertial_time(p))
    scene = saved_scene()
    product.snapshots = [snapshot("start", 0.0)]
    product.state = scene
    directions = [SHEAR, -SHEAR, BULK]
    responses = [increment(p, scene, p.probe_strain * d) - before for d in directions]
    product.probe = results(p, [p.probe_strain * d for d in directions], responses)
    product.proofs["G_0_asymmetry"] = abs(product.probe["G_0_minus"] / product.probe["G_0"] - 1.0)
    product.exit_reason = "probed"
    p.requested_stiffness_scale = scale
    product.write()


def increment(p, scene: bytes, strain: np.ndarray) -> np.ndarray:
    """Stress (3, 3), Pa, when all is at rest again after a strain increment (3, 3, compression positive)."""
    load_scene(scene)
    time = inertial_time(p)
    rate = -strain / (RAMP_TIMES * time)
    steps = math.ceil(RAMP_TIMES * time / O.dt)
    O.cell.velGrad = Matrix3(*(rate * (RAMP_TIMES * time / (steps * O.dt))).ravel())
    rve.engine("stepper").active = False
    O.run(steps, True)
    O.cell.velGrad = Matrix3.Zero
    return at_rest(REST_TIMES * time)


def at_rest(duration: float) -> np.ndarray:
    """Stress (3, 3), Pa, after that time without deformation."""
    O.run(math.ceil(duration / O.dt), True)
    return rve.stress()


def results(p, d_eps: list, d_sigma: list) -> dict:
    """G_0 = dq / (3 d eps_q) for both signs and K_0 = dp' / d eps_v."""

    def q(s):
        return s[2, 2] - 0.5 * (s[0, 0] + s[1, 1])

    return {
        "strain": p.probe_strain,
        "G_0": q(d_sigma[0]) / (3.0 * p.probe_strain),
        "G_0_minus": -q(d_sigma[1]) / (3.0 * p.probe_strain),
        "K_0": np.trace(d_sigma[2]) / 3.0 / p.probe_strain,
        "d_eps": np.array(d_eps),
        "d_sigma": np.array(d_sigma),
    }


main("probe", protocol)
