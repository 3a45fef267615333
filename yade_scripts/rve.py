"""The representative volume element: spheres in a periodic cell, its engines, servo and material.

Imported by the stages inside YADE.  Compression is negative in YADE and positive in everything that leaves this module.
"""

from __future__ import annotations

import math

import numpy as np
from minieigenHP import Matrix3, Vector3
from yade import utils
from yade.wrapper import (
    Bo1_Sphere_Aabb,
    ForceResetter,
    FrictMat,
    GlobalStiffnessTimeStepper,
    Ig2_Sphere_Sphere_ScGeom,
    InsertionSortCollider,
    InteractionLoop,
    Ip2_FrictMat_FrictMat_MindlinPhys,
    Law2_ScGeom_MindlinPhys_Mindlin,
    NewtonIntegrator,
    Omega,
    PeriTriaxController,
    PyRunner,
)

from analysis.assembly import BOX_MARGIN
from yade_scripts.inertia import rayleigh_step, set_inertia

O = Omega()  # noqa: E741  YADE's own name for its scene
SMALL_N = 200
#: Friction up to which shear may be as fast as FULL_RATE (inertial number); above, less in proportion.
FULL_RATE_FRICTION, FULL_RATE = 0.3, 2.4e-3


class ProofError(RuntimeError):
    """A stage could not prove what it claims; the text carries quantity, value and limit."""


def build(assembly, p) -> None:
    """Fill the scene with the assembly's spheres (position, radius in m) in its periodic cell."""
    O.reset()
    O.periodic = True
    O.cell.setBox(Vector3(*map(float, assembly.cell)))
    material = O.materials.append(
        FrictMat(
            young=young(p.G_p * p.stiffness_scale, p.nu), poisson=p.nu, frictionAngle=math.atan(p.mu_iso), density=p.rho
        )
    )
    O.bodies.append(
        [
            utils.sphere(Vector3(*map(float, x)), float(r), material=material)
            for x, r in zip(assembly.position, assembly.radius, strict=True)
        ]
    )
    set_inertia(p)
    set_engines(p)


def young(G: float, nu: float) -> float:
    """Young's modulus (Pa) from shear modulus (Pa) and Poisson's ratio."""
    return 2.0 * G * (1.0 + nu)


def inertial_number(p) -> float:
    """Inertial number at which a packing is sheared: the one asked for, above FULL_RATE_FRICTION under a limit.

    What slides less shakes more: at mu_s = 0.62 (1,000 spheres) FULL_RATE lowers Z and Z_m by 3.5 and 3.2 % and raises
    e_m by 1.5 % against a quarter of it with half the step, and the same work put into smaller steps changes nothing
    of that; at the limit 1.0, 1.0 and 0.3 % are left.
    """
    if p.mu_s <= FULL_RATE_FRICTION:
        return p.inertial_number
    return min(p.inertial_number, FULL_RATE * FULL_RATE_FRICTION / p.mu_s)


def strain_rate(p) -> float:
    """Axial strain rate (1/s) at sigma_3 of that inertial number, I = rate * d50 * sqrt(rho / sigma_3)."""
    return inertial_number(p) / (p.d50 * math.sqrt(p.rho / p.sigma_3))


def set_engines(p, calc_energy: bool = False) -> None:
    """The whole loop: no gravity, no clumps, no viscous contact damping, no torques, nothing a sphere scene can skip.

    The time step is a third of the Rayleigh step until `use_contact_time_step` is called: with few contacts the
    stiffness-based step is meaningless.
    """
    O.engines = [
        ForceResetter(),
        InsertionSortCollider([Bo1_Sphere_Aabb()], verletDist=-BOX_MARGIN, label="collider"),
        InteractionLoop(
            [Ig2_Sphere_Sphere_ScGeom()],
            [Ip2_FrictMat_FrictMat_MindlinPhys()],
            [Law2_ScGeom_MindlinPhys_Mindlin(calcEnergy=calc_energy, label="law")],
            label="contacts",
        ),
        GlobalStiffnessTimeStepper(
            active=False,
            timestepSafetyCoefficient=p.timestep_factor,
            timeStepUpdateInterval=25,
            label="stepper",
        ),
        PeriTriaxController(
            dynCell=True,
            globUpdate=1,
            growDamping=p.servo_damping,
            dead=True,
            mass=servo_mass(p),
            absStressTol=1e12,
            relStressTol=1e-12,
            maxUnbalanced=1e-12,
            label="servo",
        ),
        # Here places and forces belong together: what a path holds, and what a stage watches.
        PyRunner(iterPeriod=1, dead=True, label="hold"),
        PyRunner(iterPeriod=1, dead=True, label="watch"),
        NewtonIntegrator(damping=p.damping, label="newton"),
    ]
    O.dt = rayleigh_step(p) / 3.0


def engine(label: str):
    """The engine of that label (labels are globals of YADE's prompt only)."""
    return next(e for e in O.engines if e.label == label)


def contact_law():
    return engine("contacts").lawDispatcher.functors[0]


def use_contact_time_step(p) -> None:
    """From here on the step follows the contact stiffness, capped at twice the Rayleigh step."""
    stepper = engine("stepper")
    stepper.maxDt = 2.0 * rayleigh_step(p)
    stepper.timestepSafetyCoefficient = p.timestep_factor
    stepper.active = True


def servo_mass(p) -> float:
    """Inertia of the servo's cell, kg/m: a share of the grains' mass over the edge, so that N needs no retuning.

    The cell's period grows with its edge, the grains' time step does not: below SMALL_N grains the cell must be heavier
    to follow in the same step (64 grains at 1.0 of the contact time step never came to rest without).
    """
    share = p.servo_mass * max(1.0, (SMALL_N / len(O.bodies)) ** (2.0 / 3.0))
    return share * p.rho * 0.62 * O.cell.volume ** (2.0 / 3.0)


def servo_isotropic(p, pressure: float, max_rate: float) -> None:
    """Hold the mean stress `pressure` (Pa) on all three axes."""
    servo = engine("servo")
    servo.stressMask = 7
    servo.goal = Vector3(-pressure, -pressure, -pressure)
    servo.maxStrainRate = Vector3(max_rate, max_rate, max_rate)
    servo.mass = servo_mass(p)
    servo.dead = False


def release_servo() -> None:
    """No servo, no deformation."""
    engine("servo").dead = True
    O.cell.velGrad = Matrix3.Zero


def every(period: int, call, label: str = "watch") -> None:
    """Call `call()` every `period` steps; its exception stops the run and is raised again by `run`.

    label: "watch", or "hold" for a second call, which comes first in a step.
    """
    import __main__

    def guarded() -> None:
        try:
            call()
        except BaseException as error:
            __main__.rve_watch_error = error
            stop()

    setattr(__main__, f"rve_{label}", guarded)
    __main__.rve_watch_error = None
    runner = engine(label)
    runner.iterPeriod, runner.command, runner.dead = max(1, int(period)), f"rve_{label}()", False


def quiet() -> None:
    """Call nothing any more that `every` set up."""
    for runner in O.engines:
        if runner.label in ("hold", "watch"):
            runner.dead = True


def stop() -> None:
    """End `run` with the step that is under way; to be called from within it, by what `every` calls.

    O.pause() lets `run` return when it next looks, in some runs of a hundred while the step is still integrated: what
    the stage then changes would reach half of that step, and the same run twice would not be the same.
    """
    O.stopAtIter = O.iter + 1


def run(steps: int) -> None:
    """Run up to that many steps; what `every` raised is raised here."""
    import __main__

    O.run(int(steps), True)
    quiet()
    error, __main__.rve_watch_error = getattr(__main__, "rve_watch_error", None), None
    if error is not None:
        raise error


def stress() -> np.ndarray:
    """Love's stress (3, 3), Pa, compression positive, symmetrised."""
    tensor = utils.getStress()
    s = -np.array([[tensor[i, j] for j in range(3)] for i in range(3)])
    return 0.5 * (s + s.T)
