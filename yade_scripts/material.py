"""Swap of friction and shear modulus in a loaded packing: on the material for new contacts, on each contact it has."""

from __future__ import annotations

import math

import h5py
import numpy as np
from yade import utils
from yade.wrapper import FrictMat

from yade_scripts.inertia import radii
from yade_scripts.rve import O, ProofError, young


def target(p, mu: float) -> tuple:
    """Friction and shear modulus (Pa, scaled for the run) asked for: numbers, or arrays (N,) of per-grain values.

    `heterogeneity="grain"` reads the datasets mu_s and G_p of the HDF5 file `grains`; its friction applies when `mu` is
    the specimen's mu_s, so that consolidation keeps its own.
    """
    if p.heterogeneity == "specimen":
        return mu, p.G_p * p.stiffness_scale
    with h5py.File(p.grains, "r") as file:
        mu_s, G_p = file["mu_s"][()], file["G_p"][()]
    if len(mu_s) != len(O.bodies) or len(G_p) != len(O.bodies):
        raise ProofError(f"grains {p.grains}: {len(mu_s)} values for {len(O.bodies)} spheres")
    return (mu_s if mu == p.mu_s else mu), G_p * p.stiffness_scale


def swap(mu, G, nu: float, rho: float) -> float:
    """Give every grain friction `mu` and shear modulus `G` (numbers or arrays (N,)); return the largest G_new / G_old.

    The Hertz and Mindlin constants of each contact are set anew by YADE's own rule for two materials; forces of the
    normal springs follow their overlaps at the next step, tangential forces stay until they slip.
    """
    n = len(O.bodies)
    mu, G = np.broadcast_to(np.asarray(mu, float), n), np.broadcast_to(np.asarray(G, float), n)
    before = O.bodies[0].material.young
    if np.ptp(mu) == 0.0 and np.ptp(G) == 0.0:
        for material in O.materials:
            _set(material, mu[0], G[0], nu, rho)
    else:
        for body in O.bodies:
            body.material = FrictMat()
            _set(body.material, mu[body.id], G[body.id], nu, rho)
    for contact in O.interactions:
        i, j, geom, phys = contact.id1, contact.id2, contact.geom, contact.phys
        root = math.sqrt(geom.refR1 * geom.refR2 / (geom.refR1 + geom.refR2))
        e_i, e_j = young(G[i], nu), young(G[j], nu)
        phys.kno = 4.0 / 3.0 * e_i * e_j / ((1.0 - nu**2) * (e_i + e_j)) * root
        phys.kso = 2.0 * (G[i] + G[j]) / (2.0 - nu) * root
        phys.tangensOfFrictionAngle = min(mu[i], mu[j])
    return float(young(G.max(), nu) / before)


def scale_modulus(factor: float) -> None:
    """Multiply the constants of every contact, and the modulus of a material that all grains share, by a factor."""
    for material in O.materials:
        material.young *= factor
    for contact in O.interactions:
        phys = contact.phys
        phys.kno *= factor
        phys.kso *= factor


def _set(material, mu: float, G: float, nu: float, rho: float) -> None:
    material.young, material.poisson, material.frictionAngle, material.density = young(G, nu), nu, math.atan(mu), rho


def current_modulus() -> float:
    """Shear modulus (Pa) of the grains, the geometric mean where each has its own."""
    mean = math.exp(np.mean(np.log([body.material.young for body in O.bodies])))
    return mean / (2.0 * (1.0 + O.bodies[0].material.poisson))


def solid_volume() -> float:
    """Volume of all grains (m3)."""
    return float(np.sum(4.0 / 3.0 * np.pi * radii() ** 3))


def grading_width() -> float:
    """Standard deviation of ln d by mass, of the grains as they are."""
    mass, x = radii() ** 3, np.log(radii())
    mean = np.average(x, weights=mass)
    return float(np.sqrt(np.average((x - mean) ** 2, weights=mass)))


def contact_counts() -> np.ndarray:
    """Contacts of each grain (N,)."""
    return np.array(utils.numIntrsOfEachBody())
