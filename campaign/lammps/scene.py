"""The scene in LAMMPS commands: spheres in a periodic cell, their law, the servo, and what is sampled.

The law is that of `yade_scripts`: Hertz, tangential force in increments with Mindlin's stiffness (`mindlin/force`:
nothing rescaled when the normal force falls), Coulomb's limit, no damping in shear, no rolling or twisting resistance.
LAMMPS has no servo for a cell whose grains must feel its motion (barostats move the centres and leave the velocities,
so that Mindlin's springs miss part of the sliding).  Hence one of variables: a cell with inertia and damping, whose
strain rates `fix deform` follows while it hands the faces' velocity to what crosses them (`remap v`; with `remap x`
G_0 of a probe is little more than half of what it is).
"""

from __future__ import annotations

import math
from types import SimpleNamespace

from campaign.lammps.packing import AXES

SKIN = 0.06  # of d50: the neighbour list's margin; from 0.02 to 0.1 the speed is the same
SERVO_PERIOD, SERVO_DAMPING = 0.12, 0.7  # cell's own period in inertial times and damping ratio
RATE_STRAIN = 1.25e-3  # strain over which the axial rate follows the mean stress: YADE's own servo needs as much
STIFFNESS = 0.87  # K + 4/3 G of a packing over G_p^(2/3) sigma_3^(1/3): the servo only needs the order
MAX_RATE_I = 4e-3  # fastest deformation of a held axis while coming to rest, as an inertial number
CONTACT_DAMPING = 0.05  # of the critical one, wherever vibration is to be removed
DRAG_TIMES = 0.2  # inertial times in which the drag of `coming_to_rest` takes a grain's velocity

#: Columns of samples.txt, after the step.
SAMPLES = ("eps_a", "length_x", "length_y", "length_z", "sigma_xx", "sigma_yy", "sigma_zz", "sigma_xy", "sigma_xz",
           "sigma_yz", "Z", "single", "active", "solid", "resultant", "kinetic", "turning", "rate_z",
           "C_xx", "C_yy", "C_zz", "C_xy", "C_xz", "C_yz")  # fmt: skip
#: Further columns where they are asked for: the mean normal force, for which every contact is worked out once more, or
#: the stress averaged over the steps since the last sample (at the first sample it is 0).
FORCES = ("mean_f_n",)
MEANS = tuple(f"mean_{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz"))
#: Columns of a list of contacts: the grains, normal force, magnitude of the tangential force.
CONTACTS = ("first", "second", "f_n", "f_t")
#: Columns of the contacts of a snapshot: the grains, the vector from the second to the first, normal force, tangential
#: force of the second on the first.
SNAPSHOT = ("first", "second", "dx", "dy", "dz", "f_n", "f_x", "f_y", "f_z")


def inertial_time(p: SimpleNamespace) -> float:
    """d50 sqrt(rho / sigma_3) in s: strain rates times this are inertial numbers."""
    return p.d50 * math.sqrt(p.rho / p.sigma_3)


def modulus(p: SimpleNamespace, G: float) -> float:
    """K + 4/3 G (Pa) that the servo reckons with, for grains of shear modulus G (Pa)."""
    return STIFFNESS * G ** (2.0 / 3.0) * p.sigma_3 ** (1.0 / 3.0)


def law(p: SimpleNamespace, mu: float, G: float | str, damping: float) -> str:
    """Hertz-Mindlin with Coulomb's limit and viscous `damping` (kg/s) on top, the same in both directions.

    G: shear modulus in Pa, or the name of a variable that holds Young's modulus.  The cutoff is the largest diameter
    `p.d_max`: after a restart LAMMPS would take none, and find no neighbours.
    """
    young = f"${{{G}}}" if isinstance(G, str) else f"{2.0 * G * (1.0 + p.nu):.12g}"
    return (
        f"pair_coeff * * hertz/material {young} {damping:.6g} {p.nu:.12g} "
        f"tangential mindlin/force NULL 1.0 {mu:.12g} damping velocity cutoff {p.d_max:.17g}"
    )


def damping(p: SimpleNamespace, mass: float, G: float) -> float:
    """Viscous damping (kg/s) of a contact between grains of that mass (kg): CONTACT_DAMPING of the critical one."""
    force, stiff = 1.3 * p.sigma_3 * p.d50**2, G / (1.0 - p.nu)
    overlap = (0.75 * force / stiff / math.sqrt(0.25 * p.d50)) ** (2.0 / 3.0)
    return CONTACT_DAMPING * 2.0 * math.sqrt(0.5 * mass * 2.0 * stiff * math.sqrt(0.25 * p.d50 * overlap))


def settings(p: SimpleNamespace, read: str) -> str:
    """Commands before and after the packing is read; `read` reads it."""
    style = "\npair_style granular" if read.startswith("read_data") else ""  # a restart has it, with its springs
    return f"""units si
atom_style sphere
boundary p p p
comm_modify vel yes
{read}
neighbor {SKIN * p.d50:.6g} bin
neigh_modify every 1 delay 0 check yes{style}"""


def engines(dt: float) -> str:
    """Commands that set the time step (s), the integrator and what is measured of stress and contacts."""
    return f"""timestep {dt:.9g}
fix motion all nve/sphere
compute sigma all pressure NULL pair
compute touching all contact/atom
compute pairs all pair/local p10 p11 p12 force p1 p2 p3 cutoff radius
compute springs all pair/local force p4 cutoff radius
compute ids all property/local patom1 patom2 cutoff radius
compute coordination all reduce ave c_touching
compute mean_f_n all reduce ave c_pairs[4]
variable force atom sqrt(fx*fx+fy*fy+fz*fz)
compute resultant all reduce ave v_force
variable pressure equal (c_sigma[1]+c_sigma[2]+c_sigma[3])/3
variable F_unb equal c_resultant/(c_mean_f_n+1e-30)
thermo_style custom step v_pressure c_coordination lx ly lz
thermo_modify norm no format float %.9g
thermo 5000"""


def samples(period: int, further: tuple[str, ...]) -> str:
    """Commands that write a line of SAMPLES and of FORCES or MEANS to samples.txt every `period` steps.

    Kinetic energy is that about the cell's flow.

    The variables rate_x, rate_y and rate_z must hold the strain rates of the cell, length_0 its height at strain 0.
    """
    flow = " ".join(f"+(v{a}-v_rate_{a}*({a}-v_middle_{a}))^2" for a in AXES).replace(" ", "").lstrip("+")
    middles = "\n".join(f"variable middle_{a} equal 0.5*({a}lo+{a}hi)" for a in AXES)
    lengths = "\n".join(f"variable length_{a} equal l{a}" for a in AXES)
    stress = " ".join(f"c_sigma[{k}]" for k in range(1, 7))
    columns_of = {FORCES: ["c_mean_f_n"], MEANS: [f"f_means[{k}]" for k in range(1, 7)]}
    averaged = f"fix means all ave/time 1 {period} {period} {stress}\n" if further == MEANS else ""
    columns = " ".join([
        "v_eps_a", *(f"v_length_{a}" for a in AXES), stress, "c_coordination",
        *(f"c_sums[{k}]" for k in (1, 2, 3)), "c_resultant", "c_sums[4]", "c_turning", "v_rate_z",
        *(f"c_fabric[{k}]" for k in range(1, 7)), *columns_of[further],
    ])  # fmt: skip
    return f"""variable eps_a equal ln(v_length_0/lz)
{lengths}
{middles}
compute sizes all property/atom radius
variable single atom c_touching==1
variable active atom c_touching>1
variable solid atom (c_touching>1)*4/3*PI*c_sizes^3
variable kinetic atom 0.5*mass*({flow})
compute sums all reduce sum v_single v_active v_solid v_kinetic
compute turning all erotate/sphere
compute fabric all fabric radius contact
{averaged}fix samples all ave/time {period} 1 {period} {columns} format " %.12g" file samples.txt"""


def contacts(period: int) -> str:
    """Commands that write all contacts to contacts.txt every `period` steps, in the columns CONTACTS."""
    return f"""dump contacts all local {period} contacts.txt c_ids[1] c_ids[2] c_springs[1] c_springs[2]
dump_modify contacts format float %.9g"""


def snapshot(name: str) -> str:
    """Commands that write all grains and contacts at the present step, for which forces are computed anew."""
    return f"""dump grains_{name} all custom 1 {name}.grains id radius mass x y z
dump_modify grains_{name} sort id format float %.17g
dump contacts_{name} all local 1 {name}.contacts {_SNAPSHOT_COLUMNS}
dump_modify contacts_{name} format float %.17g
{NEW_LISTS}
run 0
undump grains_{name}
undump contacts_{name}
print "STRESS {name} {STRESS} height $(lz:%.17g)\""""


_SNAPSHOT_COLUMNS = " ".join([*(f"c_ids[{k}]" for k in (1, 2)), *(f"c_pairs[{k}]" for k in range(1, 8))])


#: The stress tensor for `print`, Pa.
STRESS = " ".join(f"$(c_sigma[{k}]:%.17g)" for k in range(1, 7))


def stream(rates: dict[str, str], sign: int = 1) -> str:
    """Commands that add the flow of the cell (sign 1), or take it away (-1): axis -> formula of its strain rate."""
    lines = []
    for axis, rate in rates.items():
        lines += [
            f"variable half_{axis} equal {sign}*0.5*l{axis}*({rate})",
            f"velocity all ramp v{axis} $(-v_half_{axis}) $(v_half_{axis}) {axis} $({axis}lo) $({axis}hi) "
            "sum yes units box",
        ]
    return "\n".join(lines)


def servo(p: SimpleNamespace, G: float, dt: float, axial_rate: float = 0.0, goal: str = "") -> str:
    """Commands that hold sigma_3, or the stress `goal` (a formula), on all axes; with an axial rate (1/s) z shortens.

    A held axis is a damped oscillator, rate' = w2 (sigma - goal) / modulus + 2 z w sigma' / modulus, integrated once
    and limited while the packing comes to rest. The axial rate keeps the inertial number: it follows sqrt(p' /
    sigma_3). The integrals, for each axis that of the rate (for z the followed sqrt(p' / sigma_3) - 1), live in a `fix
    ave/time` that averages over one step, and so remembers; then come the rates themselves.  The formulas hold numbers
    rather than variables, since LAMMPS reads each of them anew in every step.
    """
    omega = 2.0 * math.pi / (SERVO_PERIOD * inertial_time(p))
    limit, stiff = MAX_RATE_I / inertial_time(p), modulus(p, G)
    lines = []
    for k, axis in enumerate(AXES, start=1):
        if axis == "z" and axial_rate:
            mean = f"abs(c_sigma[1]+c_sigma[2]+c_sigma[3])/{3.0 * p.sigma_3:.12g}"
            follow = f"{dt * axial_rate / RATE_STRAIN:.9g}*(sqrt({mean})-1-f_servo[{k}])"
            lines += [
                f"variable memory_{axis} equal f_servo[{k}]+{follow}",
                f"variable asked_{axis} equal -{axial_rate:.12g}*(1+f_servo[{k}])",
            ]
        else:
            error = f"(c_sigma[{k}]-{goal or f'{p.sigma_3:.12g}'})"
            memory = f"f_servo[{k}]+{dt * omega**2 / stiff:.9g}*{error}"
            asked = f"f_servo[{k}]+{2.0 * SERVO_DAMPING * omega / stiff:.9g}*{error}"
            if not axial_rate:
                memory, asked = _limited(memory, limit), _limited(asked, limit)
            lines += [f"variable memory_{axis} equal {memory}", f"variable asked_{axis} equal {asked}"]
        lines += [
            f"variable rate_{axis} equal f_servo[{k + 3}]",
            f"variable velocity_{axis} equal f_servo[{k + 3}]*l{axis}",
        ]
    remembered = " ".join(f"v_{name}_{axis}" for name in ("memory", "asked") for axis in AXES)
    moves = " ".join(f"{axis} variable v_growth_{axis} v_velocity_{axis}" for axis in AXES)
    lines += [f"fix servo all ave/time 1 1 1 {remembered}", f"fix cell all deform 1 {moves} remap v units box"]
    return "\n".join(lines)


def run(steps: int, dt: float) -> str:
    """Commands that run so many steps of dt (s) under the servo; `fix deform` wants the growth since a run's begin."""
    growth = [
        f"variable growth_{axis} equal l{axis}*(1+{dt:.9g}*f_servo[{k}])-$(l{axis}:%.17g)"
        for k, axis in enumerate(AXES, start=4)
    ]
    return "\n".join([*growth, NEW_LISTS, f"run {steps}"])


#: Command before a run that follows another one at the same step.  A list of contacts that was made at that step would
#: not be made again, although grains are sorted and images renumbered: it lacks contacts or has wrong ones.  One more
#: compute, or one less, lets LAMMPS make all lists anew.
NEW_LISTS = 'if "$(is_defined(compute,again))" then "uncompute again" else "compute again all pair/local dist"'


def _limited(value: str, limit: float) -> str:
    """A formula limited to +- limit: LAMMPS has no minimum of two numbers."""
    return f"0.5*(abs({value}+{limit:.9g})-abs({value}-{limit:.9g}))"


RELEASE = """unfix cell
unfix servo"""


def drag(p: SimpleNamespace, mass: float) -> str:
    """Command that takes the velocity of a grain of that mass (kg) in DRAG_TIMES inertial times; for a resting cell.

    Contact damping alone takes ever longer for the slow vibrations of larger specimens.
    """
    return f"fix drag all viscous {mass / (DRAG_TIMES * inertial_time(p)):.6g}"


def coming_to_rest(
    p: SimpleNamespace, dt: float, window_times: float, most: int, quiet: float, z_limit: float, settled: str
) -> str:
    """Commands that hold sigma_3 until a window proves equilibrium, at most so many windows; then go to the label.

    Each window of `window_times` inertial times prints its proof, as in yade_scripts/equilibrium.py: the largest error
    of the stress on any axis, the mean unbalanced force of its second half, the change of the mean Z between halves.
    """
    period = max(1, math.ceil(max(400, window_times * inertial_time(p) / dt) / 40))
    larger = "0.5*(v_off_x+v_off_y+abs(v_off_x-v_off_y))"
    offs = "\n".join(
        f"variable off_{a} equal abs(c_sigma[{k}]/{p.sigma_3:.12g}-1)" for k, a in enumerate(AXES, start=1)
    )
    return f"""{offs}
variable off equal 0.5*({larger}+v_off_z+abs({larger}-v_off_z))
variable trial loop {most}
label window_{settled}
fix first all vector {period} v_off c_coordination
{run(20 * period, dt)}
variable worst equal $(max(f_first[1]):%.12g)
variable before equal $(ave(f_first[2]):%.12g)
unfix first
fix second all vector {period} v_off c_coordination v_F_unb
{run(20 * period, dt)}
variable worst equal $(0.5*(v_worst+max(f_second[1])+abs(v_worst-max(f_second[1]))):%.12g)
variable change equal $(abs(ave(f_second[2])-v_before):%.12g)
variable quiet equal $(ave(f_second[3]):%.12g)
unfix second
print "PROOF {settled} stress_error ${{worst}} F_unb ${{quiet}} Z_change ${{change}}"
if "${{worst}} < 0.005 && ${{quiet}} < {quiet:g} && ${{change}} < {z_limit:g}" then "jump SELF {settled}"
next trial
jump SELF window_{settled}
print "NOT AT REST"
quit 3
label {settled}"""


def z_limit(N: int) -> float:
    """Change of the mean Z that counts as none: 0.001, or one contact where one is more."""
    return max(1e-3, 2.0 / N)
