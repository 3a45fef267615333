"""A packing at rest for LAMMPS: its data file, and an input script that shears it as `yade_scripts/shear.py` does.

The law is the same: Hertz, tangential force in increments with Mindlin's stiffness (`mindlin/force`: nothing rescaled
when the normal force falls), Coulomb's limit, no damping, no rolling or twisting resistance.  So is the path: sigma_3
held on x and y, z shortened at a constant inertial number up to a logarithmic strain.  LAMMPS has no servo for a cell
whose grains must feel its motion (barostats move the centres and leave the velocities, so that Mindlin's springs miss
part of the sliding).  Hence one of variables: a cell with inertia and damping, whose strain rates `fix deform` follows
while it hands the faces' velocity to what crosses them (`remap v`).
A data file holds no tangential forces; a stretch under sigma_3 with contact damping brings the packing to rest first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.micromechanics.snapshot import Snapshot

AXES = ("x", "y", "z")
STEP = 0.8  # of the stability limit of the packing at rest
SKIN = 0.06  # of d50: the neighbour list's margin; from 0.02 to 0.1 the speed is the same
REST_TIMES, REST_DAMPING = 10.0, 0.05  # inertial times of rest, and its contact damping, of the critical one
SERVO_PERIOD, SERVO_DAMPING = 0.12, 0.7  # cell's own period in inertial times and damping ratio
RATE_STRAIN = 1.25e-3  # strain over which the axial rate follows the mean stress: YADE's own servo needs as much
SAMPLE_STEPS, ROW_STRAIN = 5, 1e-4  # steps between samples; strain of a row of the record, the mean of its samples

COLUMNS = ("eps_a", "length_x", "length_y", "length_z", "sigma_x", "sigma_y", "sigma_z", "Z")


@dataclass(frozen=True)
class Shear:
    """What is sheared and how: mu_s, G_p (Pa), nu, rho (kg/m3), sigma_3 (Pa), d50 (m), inertial number, last strain."""

    mu_s: float
    G_p: float
    nu: float
    rho: float
    sigma_3: float
    d50: float
    inertial_number: float
    strain_end: float

    @property
    def inertial_time(self) -> float:
        """d50 sqrt(rho / sigma_3) in s: strain rates times this are inertial numbers."""
        return self.d50 * math.sqrt(self.rho / self.sigma_3)

    @property
    def rate(self) -> float:
        """Axial strain rate (1/s) at p' = sigma_3."""
        return self.inertial_number / self.inertial_time


def data_file(s: Snapshot, rho: float) -> str:
    """The grains (centres wrapped into the cell, diameters, density) for LAMMPS; ValueError for a skew cell."""
    edge = np.diag(s.cell)
    skew = float(np.abs(s.cell - np.diag(edge)).max())
    if skew > 1e-12 * edge.min():
        raise ValueError(f"{s.where}: cell skewed by {skew:.3g} m; only a rectangular one can be written")
    rows = [
        f"{k + 1} 1 {2.0 * r:.17g} {rho:.17g} {x:.17g} {y:.17g} {z:.17g}"
        for k, (r, (x, y, z)) in enumerate(zip(s.radius, np.mod(s.position, edge), strict=True))
    ]
    box = [f"0 {length:.17g} {axis}lo {axis}hi" for axis, length in zip(AXES, edge, strict=True)]
    head = ["spheres at rest", "", f"{s.N} atoms", "1 atom types", "", *box, "", "Atoms # sphere", ""]
    return "\n".join([*head, *rows]) + "\n"


def stable_step(s: Snapshot, rho: float) -> float:
    """Largest stable time step (s): sqrt(2 m / k) of the grain whose contacts are stiffest, moving or turning."""
    mass = 4.0 / 3.0 * np.pi * s.radius**3 * rho
    moving, turning = np.zeros((s.N, 3)), np.zeros((s.N, 3))
    along = s.normal**2
    for side in (0, 1):
        np.add.at(moving, s.contact_ids[:, side], s.k_n[:, None] * along + s.k_t[:, None] * (1.0 - along))
        np.add.at(turning, s.contact_ids[:, side], s.k_t[:, None] * (1.0 - along))
    # a turning sphere: (2/5) m r2 against k_t r2
    stiffest = np.maximum(moving, 2.5 * turning).max(axis=1)
    held = stiffest > 0.0
    return math.sqrt(2.0 * float((mass[held] / stiffest[held]).min()))


def shear_script(s: Snapshot, shear: Shear, modulus: float, dt: float) -> str:
    """The input script; modulus as in `write_shear`, dt in s."""
    row_steps = SAMPLE_STEPS * max(1, round(ROW_STRAIN / shear.rate / dt / SAMPLE_STEPS))
    rest = row_steps * math.ceil(REST_TIMES * shear.inertial_time / dt / row_steps)
    most = 2 * math.ceil(shear.strain_end / shear.rate / dt)  # never reached: the rate grows with p'
    mass = 4.0 / 3.0 * math.pi * float(np.median(s.radius)) ** 3 * shear.rho
    damping = REST_DAMPING * 2.0 * math.sqrt(0.5 * mass * float(np.median(s.k_n)))
    return f"""# {s.N} spheres, drained triaxial compression along z
{scene(shear, dt, damping)}
compute sigma all pressure NULL pair
compute touching all contact/atom
compute coordination all reduce ave c_touching
thermo_style custom step c_sigma[1] c_sigma[2] c_sigma[3] c_coordination vol ke
thermo_modify norm no format float %.12g
thermo 2000

# to rest under sigma_3 on every axis, with contact damping; the last row's worth is recorded
{servo(shear, modulus, AXES)}
run {rest - row_steps}
variable eps_a equal ln($(lz:%.17g)/lz)
variable length_x equal lx
variable length_y equal ly
variable length_z equal lz
fix record all ave/time {SAMPLE_STEPS} {row_steps // SAMPLE_STEPS} {row_steps} v_eps_a &
    v_length_x v_length_y v_length_z c_sigma[1] c_sigma[2] c_sigma[3] c_coordination format " %.12g" file record.txt
run {row_steps}
unfix cell
unfix servo

# shear, without damping; the grains start with the cell's own motion
{contact_law(shear, 0.0)}
variable half equal 0.5*lz*{shear.rate:.12g}
velocity all ramp vz ${{half}} $(-v_half) z $(zlo) $(zhi) sum yes units box
{servo(shear, modulus, AXES[:2])}
fix end all halt {row_steps} v_eps_a >= {shear.strain_end:g} error continue
run {most}
"""


def speed_script(shear: Shear, dt: float, copies: int, steps: int) -> str:
    """The bare loop: the packing `copies` times an axis, shortened at constant rate and volume, no servo, no record."""
    half = 0.5 * shear.rate
    return f"""{scene(shear, dt, 0.0)}
replicate {copies} {copies} {copies}
fix cell all deform 1 x erate {half:.9g} y erate {half:.9g} z erate {-shear.rate:.9g} remap v units box
run {steps}
"""


def scene(shear: Shear, dt: float, damping: float) -> str:
    """Commands that read the packing and set law, step (s) and integrator; `damping` as in `contact_law`."""
    return f"""units si
atom_style sphere
boundary p p p
comm_modify vel yes
read_data packing.data
neighbor {SKIN * shear.d50:.6g} bin
neigh_modify every 1 delay 0 check yes
pair_style granular
{contact_law(shear, damping)}
timestep {dt:.9g}
fix motion all nve/sphere"""


def contact_law(shear: Shear, damping: float) -> str:
    """Hertz-Mindlin with Coulomb's limit and viscous `damping` (kg/s) on top, the same in both directions."""
    young = 2.0 * shear.G_p * (1.0 + shear.nu)
    return (
        f"pair_coeff * * hertz/material {young:.12g} {damping:.6g} {shear.nu:.12g} "
        f"tangential mindlin/force NULL 1.0 {shear.mu_s:.12g} damping velocity"
    )


def servo(shear: Shear, modulus: float, held: tuple[str, ...]) -> str:
    """Commands that hold sigma_3 on the axes `held` and shorten z, unless it is held, at constant inertial number.

    A held axis is a damped oscillator, rate' = w2 (sigma - sigma_3) / modulus + 2 z w sigma' / modulus, integrated
    once.  The integrals live in a `fix ave/time` that averages over one step, and so remembers: for each axis that of
    the rate (for z the followed sqrt(p'/sigma_3) - 1), then for each axis the growth of the cell in m.
    """
    omega = 2.0 * math.pi / (SERVO_PERIOD * shear.inertial_time)
    lines = []
    for k, axis in enumerate(AXES, start=1):
        if axis in held:
            lines += [
                f"variable error_{axis} equal (c_sigma[{k}]-{shear.sigma_3:.12g})/{modulus:.9g}",
                f"variable memory_{axis} equal f_servo[{k}]+dt*{omega**2:.9g}*v_error_{axis}",
                f"variable rate_{axis} equal f_servo[{k}]+{2.0 * SERVO_DAMPING * omega:.9g}*v_error_{axis}",
            ]
        else:
            faster = f"sqrt((c_sigma[1]+c_sigma[2]+c_sigma[3])/{3.0 * shear.sigma_3:.12g})-1"
            follow = f"dt*{shear.rate / RATE_STRAIN:.9g}*({faster}-f_servo[{k}])"
            lines += [
                f"variable memory_{axis} equal f_servo[{k}]+{follow}",
                f"variable rate_{axis} equal -{shear.rate:.12g}*(1+f_servo[{k}])",
            ]
        lines += [
            f"variable velocity_{axis} equal v_rate_{axis}*l{axis}",
            f"variable next_{axis} equal f_servo[{k + 3}]+dt*v_velocity_{axis}",
            f"variable growth_{axis} equal f_servo[{k + 3}]",
        ]
    remembered = " ".join(f"v_{name}_{axis}" for name in ("memory", "next") for axis in AXES)
    moves = " ".join(f"{axis} variable v_growth_{axis} v_velocity_{axis}" for axis in AXES)
    lines += [f"fix servo all ave/time 1 1 1 {remembered}", f"fix cell all deform 1 {moves} remap v units box"]
    return "\n".join(lines)
