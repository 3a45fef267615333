"""Two spheres of the campaign's own scene driven by hand; prints what YADE answers as one line of JSON."""

import json
import math
import os
import sys
from types import SimpleNamespace

sys.path.insert(0, os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0])

import numpy as np
from minieigenHP import Vector3

from analysis.assembly import Assembly
from yade_scripts import rve
from yade_scripts.material import swap
from yade_scripts.rve import O

R1, R2, GAP_STEP = 1.2e-4, 0.9e-4, 1e-9


def parameters():
    return SimpleNamespace(
        G_p=25.7e9,
        nu=0.2,
        mu_iso=0.25,
        rho=2670.0,
        d50=0.248e-3,
        sigma_3=100e3,
        damping=0.0,
        timestep_factor=0.8,
        stiffness_scale=1.0,
        density_scaling=0,
        inertial_number=1e-3,
        servo_mass=0.05,
        servo_damping=0.8,
    )


def pair(p, gap: float, driven: bool):
    """The two spheres along x with that gap (negative: overlap); driven ones follow their velocity only."""
    edge = 10.0 * (R1 + R2)
    x = np.array([[0.3 * edge, 0.5 * edge, 0.5 * edge], [0.3 * edge + R1 + R2 + gap, 0.5 * edge, 0.5 * edge]])
    rve.build(Assembly(x, np.array([R1, R2]), np.full(3, edge)), p)
    rve.contact_law().calcEnergy = True
    for body in O.bodies:
        body.state.blockedDOFs = "xyzXYZ" if driven else ""
    return O.bodies[0], O.bodies[1]


def contact():
    return next(iter(O.interactions), None)


def move(body, velocity, steps: int) -> float:
    """Drive a body for some steps; return the work that the contact force did on it (trapezoidal rule)."""
    body.state.vel = Vector3(*velocity)
    forces = []
    for _ in range(steps):
        O.step()  # forces at the old place, then the move
        forces.append(force_on_second())
    body.state.vel = Vector3(0, 0, 0)
    O.step()
    forces.append(force_on_second())
    mean = 0.5 * (np.array(forces[1:]) + np.array(forces[:-1]))
    return float(np.sum(mean @ np.array(velocity)) * O.dt)


def force_on_second() -> np.ndarray:
    c = contact()
    if c is None or not c.isReal:
        return np.zeros(3)
    return np.array(c.phys.normalForce + c.phys.shearForce) * (1.0 if c.id2 == 1 else -1.0)


def static(p) -> dict:
    """Normal force and both stiffnesses at three overlaps, before and after a swap of G_p in the loaded contact."""
    out = []
    for overlap in (1e-9, 3e-8, 5e-7):
        pair(p, -overlap, driven=True)
        O.step()
        c = contact()
        row = {"overlap": overlap, "F": c.phys.normalForce.norm(), "k_n": c.phys.kn, "k_t": c.phys.ks}
        swap(0.5, 2.0 * p.G_p, p.nu, p.rho)
        O.step()
        out.append(
            row
            | {"F_swapped": c.phys.normalForce.norm(), "k_t_swapped": c.phys.ks, "mu": c.phys.tangensOfFrictionAngle}
        )
    return {"static": out}


def tangential(p) -> dict:
    """Tangential stiffness from a small displacement, then the Coulomb limit from a large one."""
    _, b = pair(p, -3e-8, driven=True)
    O.step()
    speed = 1e-12 / O.dt
    move(b, (0, speed, 0), 100)
    small = contact().phys.shearForce.norm() / (100 * 1e-12)
    move(b, (0, 1e3 * speed, 0), 300)
    c = contact()
    return {"k_t_measured": small, "k_t": c.phys.ks, "ratio": c.phys.shearForce.norm() / c.phys.normalForce.norm()}


def cycle(p) -> dict:
    """Load, shear there and back below sliding, unload: the work of the closed cycle over the largest stored energy."""
    _, b = pair(p, 1e-10, driven=True)
    speed = 1e-11 / O.dt
    stored = move(b, (-speed, 0, 0), 3000)
    work = stored
    for direction in (1, -1, -1, 1):
        work += move(b, (0, direction * 0.01 * speed, 0), 500)
    work += move(b, (speed, 0, 0), 3000)
    return {"cycle_work": work, "cycle_stored": stored}


def collision(p) -> dict:
    """Duration and restitution of a central collision, without any damping."""
    a, b = pair(p, 1e-10, driven=False)
    v = 0.01
    b.state.vel = Vector3(-v, 0, 0)
    O.dt *= 0.02
    touched, begin, end = False, 0.0, 0.0
    while not (touched and force_on_second()[0] == 0.0):
        O.step()
        if not touched and force_on_second()[0] > 0.0:
            touched, begin = True, O.time
        end = O.time
    restitution = (b.state.vel[0] - a.state.vel[0]) / v
    return {"duration": end - begin, "restitution": restitution, "v": v, "spin": max(abs(x) for x in a.state.angVel)}


p = parameters()
print(
    "JSON"
    + json.dumps(
        {"R1": R1, "R2": R2, "G_p": p.G_p, "nu": p.nu, "rho": p.rho, "mu": p.mu_iso, "pi": math.pi}
        | static(p)
        | tangential(p)
        | cycle(p)
        | collision(p)
    )
)
