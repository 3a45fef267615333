"""Stage 1, isotropic consolidation: from the assembly (no contacts) to equilibrium at sigma_3 with friction mu_iso.

    YADE_BATCH=runs.table:2 yade -n -x -j1 yade_scripts/consolidate.py        one row
    yade-batch runs.table yade_scripts/consolidate.py                         all rows

The product holds the history, the last snapshot and the scene itself, from which `probe.py` and `shear.py` start.
"""

import math
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from minieigenHP import Matrix3, Vector3

from analysis.assembly import read_assembly
from yade_scripts import equilibrium, rve
from yade_scripts.inertia import radii, rayleigh_step
from yade_scripts.material import grading_width, solid_volume, swap, target
from yade_scripts.product import saved_scene
from yade_scripts.record import History, snapshot
from yade_scripts.rve import O, ProofError
from yade_scripts.stage import main

DENSEST, EDGE_LIMIT = 0.68, 2.1  # solid fraction hardly ever passed; YADE's collider needs edges above two diameters
TOUCH = 0.1  # share of sigma_3 at which the rate-driven compression hands over to the servo
COMPRESSION_I, RAMP_TIMES = 2e-3, 50.0  # inertial number of the compression; length of the ramp in inertial times
DAMPING, MAX_WINDOWS = 0.1, 150  # local damping while consolidating: it only removes vibration


def protocol(p, product) -> None:
    """Compress at a constant rate, ramp the stress up to sigma_3, hold until equilibrium is proven."""
    rve.build(read_assembly(p.assembly), p)
    swap(*target(p, p.mu_iso), p.nu, p.rho)
    p.N, p.sigma_ln = len(O.bodies), grading_width()
    check_cell()
    rve.engine("newton").damping = DAMPING
    history = History(p)
    compress(p, history)
    ramp(p, history)
    window = equilibrium.window_steps(p)
    product.proofs = equilibrium.reach(p, window, MAX_WINDOWS * window, 3 * DAMPING)
    history()
    product.record = history.arrays()
    product.snapshots = [snapshot("end", 0.0)]
    product.state, product.exit_reason = saved_scene(), "equilibrium"
    product.write()


def check_cell() -> None:
    """Refuse a cell that will end up too small for its largest grain, which must not touch its own image."""
    ratio = (solid_volume() / DENSEST) ** (1.0 / 3.0) / (2.0 * radii().max())
    if ratio < EDGE_LIMIT:
        raise ProofError(
            f"cell too small: its edge will be {ratio:.3g} < {EDGE_LIMIT:g} diameters of the largest grain"
        )


def compress(p, history) -> None:
    """Shrink the cell at a constant rate until the grains carry a tenth of sigma_3."""
    rate = COMPRESSION_I / equilibrium.inertial_time(p)
    O.cell.velGrad = Matrix3(-rate, 0, 0, 0, -rate, 0, 0, 0, -rate)
    O.dt = 0.5 * rayleigh_step(p)

    def touched():
        if rve.stress().trace() / 3.0 > TOUCH * p.sigma_3:
            rve.stop()

    rve.every(100, touched)
    rve.run(math.ceil(1.0 / rate / O.dt))


def ramp(p, history) -> None:
    """Hand over to the servo and raise its target to sigma_3, slowly enough not to overshoot."""
    rve.use_contact_time_step(p)
    start, begin = rve.stress().trace() / 3.0, O.time
    length = RAMP_TIMES * equilibrium.inertial_time(p)
    rve.servo_isotropic(p, start, equilibrium.MAX_RATE_I / equilibrium.inertial_time(p))

    def raise_goal():
        history()
        done = min(1.0, (O.time - begin) / length)
        goal = start + (p.sigma_3 - start) * done
        rve.engine("servo").goal = Vector3(-goal, -goal, -goal)
        if done == 1.0:
            rve.stop()

    rve.every(50, raise_goal)
    rve.run(10**7)


main("consolidate", protocol)
