"""The largest time step at which a contact network is stable, and the step that YADE's stepper takes for it.

The packing is linearised: contacts are springs (k_n along the normal, k_t across; sliding ones too, which only makes
the network stiffer), grains have a mass and a moment of inertia.  Central differences are stable up to 2 / omega_max,
where omega_max is the largest angular frequency of all motions of all grains together, rotations included.
GlobalStiffnessTimeStepper looks at one grain at a time: it takes the stiffness K that the grain meets while all its
neighbours are held, and 1.41044 sqrt(m / K).  The factor is just below sqrt(2), since no motion of a network of springs
between equal grains has omega^2 > 2 K / m.
"""

from __future__ import annotations

import numpy as np
from paths import DATA
from scipy import sparse
from scipy.sparse.linalg import eigsh

from analysis.micromechanics.snapshot import Snapshot
from analysis.micromechanics.stiffness import _compatibility, _contact_springs

#: Products of the laptop campaign that are kept: a packing at rest and its shear, with snapshots.
PROBE, SHEAR = (next((DATA / "laptop" / "example_runs").glob(f"{stage}_*.h5")) for stage in ("probe", "shear"))
STEPPER_FACTOR = 1.41044  # of YADE's GlobalStiffnessTimeStepper


def balanced_inertia(radius: np.ndarray, rho: float, exponent: float = 1.35, spin: float = 2.5):
    """Masses (N,) in kg and moments of inertia (N,) in kg m2 that `yade_scripts/inertia.py` gives to grains (N,) in m.

    tests/yade/test_step_bound.py compares them with those of a scene.
    """
    mass = rho * np.sum(4.0 / 3.0 * np.pi * radius**3) * radius**exponent / np.sum(radius**exponent)
    return mass, 0.4 * spin * mass * radius**2


def own_inertia(radius: np.ndarray, rho: float):
    """Masses (N,) in kg and moments of inertia (N,) in kg m2 of solid spheres (N,) in m."""
    mass = rho * 4.0 / 3.0 * np.pi * radius**3
    return mass, 0.4 * mass * radius**2


def largest_step(s: Snapshot, mass: np.ndarray, moment: np.ndarray) -> float:
    """2 / omega_max (s) of the contact network with these masses (N,) in kg and moments of inertia (N,) in kg m2."""
    B, springs = _compatibility(s), _contact_springs(s)
    index = np.arange(len(springs) + 1)
    K = (B.T @ sparse.bsr_matrix((springs, index[:-1], index)) @ B).tocsr()
    inertia = np.column_stack([mass] * 3 + [moment / s.radius**2] * 3).ravel()  # its rotations are lengths, r theta
    half = sparse.diags(inertia**-0.5)
    square = eigsh(half @ K @ half, k=1, which="LA", v0=np.ones(len(inertia)), return_eigenvectors=False)[0]
    return 2.0 / float(np.sqrt(square))


def stepper_step(s: Snapshot, mass: np.ndarray, moment: np.ndarray) -> float:
    """The step (s) of GlobalStiffnessTimeStepper at a factor of 1.0: the least of all grains and of their axes."""
    push, turn = np.zeros((s.N, 3)), np.zeros((s.N, 3))
    for k in (0, 1):
        grain = s.contact_ids[:, k]
        np.add.at(push, grain, s.k_t[:, None] + (s.k_n - s.k_t)[:, None] * s.normal**2)
        np.add.at(turn, grain, (s.k_t * s.radius[grain] ** 2)[:, None] * (1.0 - s.normal**2))
    held = push.max(axis=1) > 0.0
    square = np.minimum(mass[held] / push[held].max(axis=1), moment[held] / turn[held].max(axis=1))
    return STEPPER_FACTOR * float(np.sqrt(square.min()))
