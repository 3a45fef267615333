"""The paths of a shear test: what is held while the z axis shortens or lengthens, how well, and what ends the test.

    drained       the servo holds sigma_3 on x and y
    constant_p    the lateral goals follow the axial stress, so that p' keeps its value
    undrained     no servo: the cell deforms at constant volume, the stress is effective stress

In compression the z axis shortens, in extension it lengthens.  The inertial number stays constant on every path: the
rate follows the square root of p', down to p' = RATE_FLOOR sigma_3.
"""

from __future__ import annotations

import math

import numpy as np
from minieigenHP import Matrix3, Vector3

from yade_scripts import rve
from yade_scripts.rve import O

RATE_FLOOR = 0.1  # of sigma_3: the rate does not fall any more below this p'
LIQUEFIED, LIQUEFIED_STRAIN = 0.05, 0.01  # p' over sigma_3 below which, and strain over which, a test has liquefied
TRIM = 0.1  # drained: share of the error of sigma_3 by which a lateral goal is shifted after each sample
GOAL_STEPS, GOAL_FILTER = 5, 0.3  # constant_p: steps between two goals, share of the newest axial stress in the filter
GOAL_GAIN = 0.1  # constant_p: share of the error of p' that is added to the goal of p' at each goal
VOLUME_STEPS = 10  # undrained: steps between two settings of the lateral rate


class Drained:
    """sigma_3 is held on x and y."""

    held, window_limit, sample_limit = "sigma_3 / target", 0.01, 0.05
    fewest = 0  # spheres below which the limit of a sample grows with 1 / sqrt(N)
    #: Energy that the integration itself makes, over the work put in: grows with step and rate.
    energy_limit = 0.10
    #: Which quantities must be steady at a critical state, and the drift of each that is allowed.
    steady = {"eta": 0.05, "e": 0.01}

    def __init__(self, p):
        self.p = p
        self.sign = 1.0 if p.direction == "compression" else -1.0
        self.rate = rve.strain_rate(p)
        self.prompt = p.direction == "extension"

    def start(self) -> None:
        """Begin the test from the packing at rest: strain from zero, axial goal and rate, lateral goals."""
        O.cell.trsf = Matrix3.Identity
        p, servo = self.p, rve.engine("servo")
        servo.stressMask = 3
        servo.goal = Vector3(-p.sigma_3, -p.sigma_3, -2.0 * self.sign * p.strain_end)
        servo.maxStrainRate = Vector3(20.0 * self.rate, 20.0 * self.rate, self.rate)
        servo.strain = Vector3(0, 0, 0)
        servo.strainRate = Vector3(0, 0, 0)
        servo.mass = rve.servo_mass(p)
        servo.dead = False
        self.go_on()

    def go_on(self) -> None:
        """Set up what a scene does not hold; after `start` and after a checkpoint."""

    def mean_error(self, sample: dict) -> float:
        """Relative error of what is held, since the last sample as far as a path knows it."""
        return self.error(sample)

    def error(self, sample: dict) -> float:
        """Relative error of what is held in a sample."""
        return 0.5 * (sample["sigma"][0, 0] + sample["sigma"][1, 1]) / self.p.sigma_3 - 1.0

    def largest_error(self) -> float:
        """Limit of the relative error of a sample."""
        return self.sample_limit * max(1.0, math.sqrt(self.fewest / max(1, len(O.bodies))))

    def follow(self, sample: dict) -> None:
        """After each sample: let the rate follow p', and trim what is held."""
        self._set_rate(sample["sigma"])
        servo = rve.engine("servo")
        servo.maxStrainRate = Vector3(servo.maxStrainRate[0], servo.maxStrainRate[1], self.rate)
        self._trim(sample["sigma"])

    def _set_rate(self, sigma: np.ndarray) -> None:
        """Let the rate follow p': a tenth of the newest value, the rest from the present rate.

        Where p' falls fast, in extension and undrained, the rate follows at once.
        """
        p, newest = self.p, float(np.trace(sigma)) / 3.0
        pressure = (self.rate * p.d50 / rve.inertial_number(p)) ** 2 * p.rho
        pressure += 0.1 * (newest - pressure)
        pressure = min(pressure, newest) if self.prompt else pressure
        self.rate = rve.inertial_number(p) / p.d50 * math.sqrt(max(pressure, RATE_FLOOR * p.sigma_3) / p.rho)

    def _trim(self, sigma: np.ndarray) -> None:
        """Shift the lateral goals against the error just sampled.

        So the *mean* of sigma_3 is held: the servo's own damping is lopsided while the cell deforms (it slows what
        follows the motion and speeds what opposes it) and alone leaves sigma_3 some 0.4 % high.  The shift lives in the
        goal and is limited to 5 %.
        """
        p, servo = self.p, rve.engine("servo")
        goal = [servo.goal[i] + TRIM * (float(sigma[i, i]) - p.sigma_3) for i in (0, 1)]
        lateral = [-min(max(-g, 0.95 * p.sigma_3), 1.05 * p.sigma_3) for g in goal]
        servo.goal = Vector3(lateral[0], lateral[1], servo.goal[2])

    def ended(self, strain: float, sigma: np.ndarray) -> str:
        """Why the test ends here although its strain is not reached; "" while it goes on."""
        return ""

    def to_dict(self) -> dict:
        """What a checkpoint must hold."""
        return {"rate": self.rate}

    def restore(self, saved: dict) -> None:
        vars(self).update(saved)
        self.go_on()


class ConstantP(Drained):
    """p' is held: both lateral goals are (3 p' - sigma_z) / 2, with the axial stress filtered over some 17 steps.

    Grains that slip let p' fluctuate: the largest sample of 500 rough grains was off by 2.7 % (drained: sigma_3 by
    1.8 %).  The mean of a window is therefore taken over all goals, and the limit of a sample is larger for few spheres.
    """

    held, window_limit, sample_limit = "p' / target", 0.002, 0.02
    fewest = 2000

    def __init__(self, p):
        super().__init__(p)
        self.pressure, self.axial = p.sigma_3, p.sigma_3  # goal of p', filtered axial stress
        self.sum, self.count = 0.0, 0  # of p' since the last sample

    def go_on(self) -> None:
        rve.every(GOAL_STEPS, self._aim, label="hold")

    def _aim(self) -> None:
        servo, target = rve.engine("servo"), self.p.sigma_3
        pressure = -sum(servo.stress) / 3.0
        self.sum, self.count = self.sum + pressure, self.count + 1
        self.pressure = min(max(self.pressure + GOAL_GAIN * (target - pressure), 0.95 * target), 1.05 * target)
        self.axial += GOAL_FILTER * (-servo.stress[2] - self.axial)
        lateral = -max(0.5 * (3.0 * self.pressure - self.axial), 0.02 * target)
        servo.goal = Vector3(lateral, lateral, servo.goal[2])

    def mean_error(self, sample: dict) -> float:
        if not self.count:
            return self.error(sample)
        mean, self.sum, self.count = self.sum / self.count, 0.0, 0
        return mean / self.p.sigma_3 - 1.0

    def error(self, sample: dict) -> float:
        return float(np.trace(sample["sigma"])) / 3.0 / self.p.sigma_3 - 1.0

    def _trim(self, sigma: np.ndarray) -> None:
        """Nothing: `_aim` does it more often."""

    def to_dict(self) -> dict:
        return super().to_dict() | {"pressure": self.pressure, "axial": self.axial}


class Undrained(Drained):
    """The volume is held: the lateral edges follow the axial one exactly, step by step."""

    held, window_limit, sample_limit = "volume / start", 1e-9, 1e-9
    #: A packing that collapses loses contacts under load, and the contact law the tangential energy of these: 4.5 % of
    #: what was put in with small steps, 7 % with the usual ones.
    energy_limit = 0.15
    steady = {"eta": 0.05, "p": 0.05}

    def __init__(self, p):
        super().__init__(p)
        self.prompt = True
        self.volume = math.nan
        self.low_since = math.nan  # strain since which p' is below LIQUEFIED

    def start(self) -> None:
        O.cell.trsf = Matrix3.Identity
        rve.release_servo()
        self.volume = O.cell.volume
        self.go_on()

    def go_on(self) -> None:
        rve.every(VOLUME_STEPS, self._deform, label="hold")
        self._deform()

    def _deform(self) -> None:
        """The rate of the present p', and the lateral rates that keep the volume and remove what has gone astray.

        YADE multiplies each edge by 1 + rate dt in a step.  The lateral rate follows from a product of one; what the
        change of dt within VOLUME_STEPS leaves is removed over the next ones.
        """
        p = self.p
        self._set_rate(rve.stress())
        axial = -self.sign * self.rate * O.dt
        lateral = (1.0 + axial) ** -0.5 - 1.0
        lateral -= 0.5 * math.log(O.cell.volume / self.volume) / VOLUME_STEPS
        rates = [lateral / O.dt, lateral / O.dt, axial / O.dt]
        O.cell.velGrad = Matrix3(rates[0], 0, 0, 0, rates[1], 0, 0, 0, rates[2])

    def error(self, sample: dict) -> float:
        return O.cell.volume / self.volume - 1.0

    def follow(self, sample: dict) -> None:
        """Nothing: `_deform` does it more often."""

    def ended(self, strain: float, sigma: np.ndarray) -> str:
        pressure = float(np.trace(sigma)) / 3.0
        if pressure >= LIQUEFIED * self.p.sigma_3:
            self.low_since = math.nan
        elif math.isnan(self.low_since):
            self.low_since = strain
        if pressure > self.p.stiff_cap:
            return "stiff"
        return "liquefied" if strain - self.low_since >= LIQUEFIED_STRAIN else ""

    def to_dict(self) -> dict:
        return super().to_dict() | {"volume": self.volume, "low_since": self.low_since}


PATHS = {"drained": Drained, "constant_p": ConstantP, "undrained": Undrained}
