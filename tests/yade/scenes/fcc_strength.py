"""A face-centred cubic array of equal spheres compressed along a cube axis; prints what it carries as one line of JSON.

    yade -n -x -j1 tests/yade/scenes/fcc_strength.py          what the tests compare with the closed form
    yade -n -x -j1 tests/yade/scenes/fcc_strength.py rest     which arrays come to rest at which step (some minutes)

Engines, servo, material and inertia are those of a campaign.  The array is built at its overlap under sigma_3, brought
to rest and compressed at constant sigma_3 until all contacts that are left slide.
"""

import json
import math
import os
import sys
from types import SimpleNamespace

sys.path.insert(0, os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0])
sys.path.insert(1, os.path.join(sys.path[0], "tests", "support"))

import numpy as np
import snapshots
from step_bound import balanced_inertia, largest_step, own_inertia
from yade import utils

from analysis.assembly import Assembly
from analysis.micromechanics.snapshot import Snapshot
from yade_scripts import equilibrium, rve
from yade_scripts.paths import PATHS
from yade_scripts.record import snapshot
from yade_scripts.rve import O, ProofError
from yade_scripts.stage import COMMON

CELLS, DIAMETER, STRAIN, SAMPLES = 3, 0.248e-3, 8e-4, 40


def build(p, cells=CELLS) -> None:
    """The array in its cell, with engines whose step follows the contacts."""
    s = snapshots.lattice("fcc", cells, DIAMETER, p.sigma_3, p.G_p, p.nu)
    edge = s.cell[0, 0]
    inside = (s.position + 0.25 * DIAMETER) % edge  # no centre on a face of the cell
    rve.build(Assembly(inside, s.radius, np.full(3, edge)), p)
    rve.use_contact_time_step(p)
    O.run(1, True)


def rest(p, windows=20) -> str:
    """Bring the array to rest; what is off where it does not come to rest."""
    window = equilibrium.window_steps(p)
    try:
        equilibrium.reach(p, window, windows * window, 0.3)
    except ProofError as error:
        return str(error)
    return ""


def compress(p) -> list[dict]:
    """Samples along the axial strain: stress ratio, ratio of the edges of the cell, share of sliding contacts."""
    rows, path = [], PATHS["drained"](p)
    path.start()

    def sample():
        sigma, edge = rve.stress(), O.cell.hSize
        path.follow({"sigma": sigma})
        lateral = 0.5 * (sigma[0, 0] + sigma[1, 1])
        rows.append({"strain": -math.log(O.cell.trsf[2, 2]), "ratio": sigma[2, 2] / lateral,
                     "edges": edge[0, 0] / edge[2, 2], "contacts": utils.avgNumInteractions(),
                     "sliding": rve.contact_law().ratioSlidingContacts()})  # fmt: skip
        if rows[-1]["strain"] >= p.strain_end:
            rve.stop()

    rve.every(max(1, round(p.strain_end / path.rate / O.dt / SAMPLES)), sample)
    rve.run(10**6)
    return rows


def parameters(mu: float, **changes):
    changed = {"mu_iso": mu, "mu_s": mu, "d50": DIAMETER, "strain_end": STRAIN, **changes}
    return SimpleNamespace(**COMMON | changed)


def strength() -> list[dict]:
    """Both frictions at 0.8 of the step; at the whole step with a cell that is four times as heavy."""
    found = []
    for mu, changes in (
        (0.25, {"timestep_factor": 0.8}),
        (0.5, {"timestep_factor": 0.8}),
        (0.25, {"timestep_factor": 1.0, "servo_mass": 0.02}),
    ):
        p = parameters(mu, **changes)
        build(p)
        found.append({"mu": mu, "step": p.timestep_factor, "unrest": rest(p), "rows": compress(p)})
    return found


def which_rest() -> None:
    """Print for each array whether it comes to rest, and the frequencies of its cell and of its grains times the step.

    The servo changes the rate of all three axes by (stress - goal) dt / mass: the cell swings at sqrt(3 K / mass).
    """
    for cells in (3, 4, 5):
        for inertia in (1, 0):
            for factor, mass in ((0.8, 0.005), (0.9, 0.005), (1.0, 0.005), (1.0, 0.02)):
                p = parameters(0.25, timestep_factor=factor, density_scaling=inertia, servo_mass=mass)
                build(p, cells)
                k_n = next(iter(O.interactions)).phys.kn
                K = snapshots.closed_form_fcc(k_n, 0.0, DIAMETER)["K"]
                s = Snapshot(**snapshot("", 0.0))
                grains = largest_step(s, *(balanced_inertia if inertia else own_inertia)(s.radius, p.rho))
                cell = math.sqrt(3.0 * K / rve.servo_mass(p)) * O.dt
                print(f"N {s.N}, {'balanced' if inertia else 'own'} inertia, factor {factor}, servo_mass {mass}: "
                      f"omega dt of the grains {2.0 * O.dt / grains:.3f}, of the cell {cell:.3f}; "
                      f"{rest(p, windows=6) or 'at rest'}", flush=True)  # fmt: skip


if __name__ == "__main__":
    if sys.argv[-1] == "rest":
        which_rest()
    else:
        print("JSON" + json.dumps(strength()), flush=True)
    os._exit(0)
