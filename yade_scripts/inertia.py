"""Inertia of the grains: their own, or balanced so that nearly all of them allow the same time step.

A quasi-static answer does not depend on how a packing's mass is spread over its grains, the time step does: it is set
by the grain with the least inertia for its contact stiffness.  Two things waste it.  A grain's stiffness grows with its
size as r^1.35 only (fitted to sheared packings; number of contacts times k_n), its mass as r^3: so the small ones rule.
And a sphere's moment of inertia, 2/5 m r^2, lets it spin at a higher frequency than it shakes.  With `density_scaling`
every grain gets a mass ~ r^1.35 and 2.5 times the moment of inertia; the mass of all of them together stays, and so
does the inertial number.  `tests/benchmarks/bench_dem.py` measures step and bias.

Balanced inertia is for quasi-static tests only.  It changes collisions: at 30 degrees and mu = 0.25 two grains rebound
along the contact with 0.59 of their slip, in place of 0.14 (`tests/yade/test_collisions.py`).  The bias was measured at
an inertial number of 2.4e-3; `stage.py` refuses one above 2.5e-3.
"""

from __future__ import annotations

import math

import numpy as np
from minieigenHP import Vector3
from yade.wrapper import Omega

O = Omega()  # noqa: E741  YADE's own name for its scene
EXPONENT, SPIN = 1.35, 2.5


def radii() -> np.ndarray:
    """Radii (N,) in m, in the order of the grains' numbers."""
    return np.array([b.shape.radius for b in O.bodies])


def set_inertia(p) -> None:
    """Give every grain its mass and moment of inertia; the sum of the masses is that of the grains at density rho."""
    r = radii()
    mass = p.rho * 4.0 / 3.0 * np.pi * r**3
    spin = 1.0
    if p.density_scaling:
        mass, spin = mass.sum() * r**EXPONENT / np.sum(r**EXPONENT), SPIN
    for body, m in zip(O.bodies, map(float, mass), strict=True):
        moment = 0.4 * spin * m * body.shape.radius**2
        body.state.mass, body.state.inertia = m, Vector3(moment, moment, moment)


def rayleigh_step(p) -> float:
    """Smallest Rayleigh time step (s) of the grains with the inertia they have."""
    r, mass = radii(), np.array([body.state.mass for body in O.bodies])
    density = mass / (4.0 / 3.0 * np.pi * r**3)
    step = math.pi * r * np.sqrt(density / (p.G_p * p.stiffness_scale)) / (0.1631 * p.nu + 0.8766)
    return float(step.min())
