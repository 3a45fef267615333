"""Two spheres of the campaign's own scene collide obliquely; prints impulses and velocities as one line of JSON.

The second grain flies against the first, which is at rest; the angle is that between its velocity and the normal.
Each collision is made with the grains' own inertia and with the balanced one.
"""

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
from yade_scripts.rve import O
from yade_scripts.stage import COMMON

MU, SPEED, GAP = 0.2, 1e-3, 1e-12  # m/s; m
RADIUS = (1.2e-4, 0.9e-4)  # m


def collide(radius, degrees: float, mu: float, balanced: bool) -> dict:
    """One collision: what it did to momentum, and the velocities of the two surfaces at the contact."""
    p = SimpleNamespace(**COMMON | {"mu_iso": mu, "density_scaling": int(balanced)})
    edge, (r1, r2) = 10.0 * sum(radius), radius
    x = np.array([[0.3 * edge, 0.5 * edge, 0.5 * edge], [0.3 * edge + r1 + r2 + GAP, 0.5 * edge, 0.5 * edge]])
    rve.build(Assembly(x, np.array(radius), np.full(3, edge)), p)
    first, second = O.bodies
    angle = math.radians(degrees)
    second.state.vel = SPEED * Vector3(-math.cos(angle), math.sin(angle), 0.0)
    mass = np.array([first.state.mass, second.state.mass])
    before, slip_before, turning = velocities(), surface_slip(radius), angular_momentum(mass)
    O.dt *= 0.02
    touched = False
    while not (touched and force() == 0.0):
        O.step()
        touched = touched or force() > 0.0
    after = velocities()
    impulse = mass[1] * (after[1] - before[1])
    momentum = np.abs(mass @ (after - before)).max() / np.linalg.norm(mass @ before)
    angular = abs(angular_momentum(mass) / turning - 1.0)
    return {
        "angle": degrees, "mu": mu, "balanced": balanced, "masses": mass.tolist(),
        "moments": [b.state.inertia[0] for b in O.bodies],
        "sliding": float(abs(impulse[1]) / (mu * impulse[0])), "momentum": float(momentum), "angular_momentum": angular,
        "normal_restitution": float((after[1] - after[0])[0] / -(before[1] - before[0])[0]),
        "tangential_restitution": float((after[1] - after[0])[1] / (before[1] - before[0])[1]),
        "slip_restitution": float(-surface_slip(radius) / slip_before),
    }  # fmt: skip


def velocities() -> np.ndarray:
    return np.array([tuple(b.state.vel) for b in O.bodies])


def angular_momentum(mass) -> float:
    """About the z axis through the origin, kg m2/s."""
    x, v = np.array([tuple(b.state.pos) for b in O.bodies]), velocities()
    spin = sum(b.state.inertia[2] * b.state.angVel[2] for b in O.bodies)
    return float(mass @ (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) + spin)


def surface_slip(radius) -> float:
    """Velocity along y (m/s) of the second grain's surface at the contact relative to the first's."""
    v, spin = velocities(), [b.state.angVel[2] for b in O.bodies]
    return float(v[1, 1] - v[0, 1] - spin[0] * radius[0] - spin[1] * radius[1])


def force() -> float:
    contact = next(iter(O.interactions), None)
    return contact.phys.normalForce.norm() if contact is not None and contact.isReal else 0.0


found = [
    collide(RADIUS, degrees, mu, balanced)
    for degrees, mu in ((30.0, 0.25), (60.0, MU), (75.0, MU))
    for balanced in (False, True)
]
print("JSON" + json.dumps({"radius": RADIUS, "rho": COMMON["rho"], "collisions": found}), flush=True)
os._exit(0)
