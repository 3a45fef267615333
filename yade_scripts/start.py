"""Begin with the packing of an earlier stage: load it, give it this run's material, bring it to rest."""

from __future__ import annotations

import numpy as np

from yade_scripts import equilibrium, rve
from yade_scripts.inertia import set_inertia
from yade_scripts.material import current_modulus, scale_modulus, swap, target
from yade_scripts.product import load_start
from yade_scripts.rve import O

DAMPING, MAX_STEPS = 0.3, 400_000  # local damping while coming to rest; it is off (p.damping) when shear begins
STIFFENING_TIMES, STIFFENING_INCREMENTS = 5.0, 100  # inertial times over which G_p changes, and in how many increments
#: A run takes these from its start product, unless its own table names them: the packing decides.
INHERITED = ("N", "sigma_ln", "seed", "mu_iso", "assembly")


def begin(p, quiet: float = equilibrium.FORCE_LIMIT, calc_energy: bool = False) -> dict[str, float]:
    """Load p.start and return the proof of equilibrium with this run's mu_s, G_p and sigma_3.

    A packing that already has them (a probe's product) is taken as it is: its own proof holds and nothing is run.
    """
    origin = load_start(p.start)
    for name in INHERITED:
        if name in origin:
            setattr(p, name, origin[name])
    p.N = len(O.bodies)
    O.resetTime()
    set_inertia(p)
    rve.set_engines(p, calc_energy)
    rve.use_contact_time_step(p)
    O.run(1, True)  # only after a step is the time step the contacts', and does the contact law know its scene
    same = origin["stage"] == "probe" and all(
        origin[name] == getattr(p, name) for name in ("mu_s", "G_p", "stiffness_scale", "sigma_3", "heterogeneity")
    )
    if same:
        return {}
    stiffen(p)
    swap(*target(p, p.mu_s), p.nu, p.rho)
    return equilibrium.reach(p, equilibrium.window_steps(p) // 2, MAX_STEPS, DAMPING, quiet)


def stiffen(p) -> None:
    """Lead the shear modulus to this run's at constant stress and with the friction of consolidation.

    A sudden change would multiply the stress; unloading from there opens contacts that do not close again (at twice the
    modulus a dense packing lost a tenth of them).  The last value, per grain where asked for, is set by `swap`.
    """
    before = current_modulus()
    after = float(np.exp(np.mean(np.log(target(p, p.mu_s)[1]))))
    if abs(after / before - 1.0) < 1e-3:
        return
    length, begin_at, reached = STIFFENING_TIMES * equilibrium.inertial_time(p), O.time, before

    def increment():
        nonlocal reached
        done = min(1.0, (O.time - begin_at) / length)
        goal = before * (after / before) ** done
        scale_modulus(goal / reached)
        reached = goal
        if done == 1.0:
            rve.stop()

    rve.engine("newton").damping = DAMPING
    rve.servo_isotropic(p, p.sigma_3, equilibrium.MAX_RATE_I / equilibrium.inertial_time(p))
    rve.every(length / O.dt / STIFFENING_INCREMENTS, increment)
    rve.run(MAX_STEPS)
