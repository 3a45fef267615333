"""Isotropic equilibrium under the servo, and its proof: stress on each axis, unbalanced force, steady contacts."""

from __future__ import annotations

import math

import numpy as np
from yade import utils

from yade_scripts import rve
from yade_scripts.material import contact_counts
from yade_scripts.rve import O, ProofError

MAX_RATE_I = 4e-3  # fastest deformation the servo may use, as an inertial number: faster ones overshoot
STRESS_LIMIT, FORCE_LIMIT, Z_LIMIT = 0.005, 1e-3, 1e-3  # of sigma_3; of the mean contact force; contacts


def reach(p, window: int, max_steps: int, damping: float, quiet: float = FORCE_LIMIT) -> dict[str, float]:
    """Hold sigma_3 on all axes until a whole window proves equilibrium; return the figures of the proof.

    Within `window` steps every axis stays within 0.5 % of sigma_3, the unbalanced force ends below `quiet`, the mean
    Z of the two halves differs by less than 0.001 (or by one contact, where N is so small that one contact is more).
    Raises ProofError with the figure that is off when `max_steps` do not suffice.
    """
    watch = _Watch(p, window, quiet)
    rve.engine("newton").damping = damping
    rve.servo_isotropic(p, p.sigma_3, MAX_RATE_I / inertial_time(p))
    rve.every(max(1, window // 40), watch)
    rve.run(max_steps)
    rve.engine("newton").damping = p.damping
    proof = watch.proof()
    failed = watch.failed(proof)
    if failed:
        raise ProofError(f"no equilibrium after {max_steps} steps: " + failed)
    return proof


class _Watch:
    """Samples stress, unbalanced force and Z; pauses the run when a window of samples proves equilibrium."""

    def __init__(self, p, window: int, quiet: float):
        self.p, self.size, self.quiet = p, 40, quiet
        self.rows: list[tuple[float, float, float]] = []
        self.overshoot = 0.0
        self.z_limit = max(Z_LIMIT, 2.0 / len(O.bodies))

    def __call__(self) -> None:
        ratio = np.diag(rve.stress()) / self.p.sigma_3 - 1.0
        if not np.all(np.isfinite(ratio)) or ratio.max() > 100.0:
            raise ProofError(f"blow-up: stress {ratio.max() + 1.0:.3g} times sigma_3 at step {O.iter}")
        self.overshoot = max(self.overshoot, float(ratio.mean()))
        self.rows.append((float(np.abs(ratio).max()), utils.unbalancedForce(), float(contact_counts().mean())))
        if len(self.rows) >= self.size and not self.failed(self.proof()):
            rve.stop()

    def proof(self) -> dict[str, float]:
        error, force, z = np.array(self.rows[-self.size :]).T
        half = len(z) // 2
        return {
            "stress_error": float(error.max()),
            "F_unb": float(force[half:].mean()),
            "Z_change": float(abs(z[half:].mean() - z[:half].mean())),
            "overshoot": self.overshoot,
        }

    def failed(self, proof: dict[str, float]) -> str:
        for name, limit in (("stress_error", STRESS_LIMIT), ("F_unb", self.quiet), ("Z_change", self.z_limit)):
            if not proof[name] < limit:
                return f"{name} = {proof[name]:.3g} > {limit:.3g}"
        return ""


def window_steps(p) -> int:
    """Ten inertial times d50 sqrt(rho / sigma_3) in steps: long against any rearrangement that inertia governs."""
    return max(400, math.ceil(10.0 * inertial_time(p) / O.dt))


def inertial_time(p) -> float:
    """d50 sqrt(rho / sigma_3) in s: strain rates times this are inertial numbers."""
    return p.d50 * math.sqrt(p.rho / p.sigma_3)
