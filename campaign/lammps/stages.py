"""The input scripts of the three stages, as LAMMPS reads them: consolidation, probe, shear.

Each follows the script of the same name in `yade_scripts`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from analysis.quantities import effective_inertial_number
from campaign.lammps import scene
from campaign.lammps.packing import AXES

#: Directions of a probe's increments (3,), compression positive: shear at constant volume with both signs, and bulk.
DIRECTIONS = {"shear": (-0.5, -0.5, 1.0), "back": (0.5, 0.5, -1.0), "bulk": (1.0 / 3.0,) * 3}
#: Time steps over `packing.stable_step` of the packing at rest.  The largest stable step was 1.15 to 1.2 times that, at
#: rest, 1.07 to 1.15 times in shear (32 states of four packings of 400), and 0.97 times with contacts damped.
STEP, DAMPED_STEP = 0.95, 0.9
TOUCH, COMPRESSION_I, RAMP_TIMES = 0.1, 2e-3, 50.0  # as in yade_scripts/consolidate.py
#: Time step until the grains touch, over that at sigma_3: contacts that carry TOUCH of it are softer by 0.1^(1/3).
TOUCHING_STEP = 1.4
MOST_WINDOWS, CONSOLIDATION_WINDOW, PROBE_WINDOW = 150, 10.0, 5.0  # windows, and their inertial times
MOST_REST_WINDOWS = 60
#: Unbalanced force of the state at rest.  A packing that collapsed, because its mu_s is below mu_iso, still lost stress
#: at 1.2e-5; the other probes of the default campaign ended at 1.3e-6 or less.
CONSOLIDATION_QUIET, PROBE_QUIET = 1e-3, 1e-6
#: Samples in a typical window, half as many as in YADE: a window's means change by at most a third of their difference
#: from those of the next window (1,000 spheres).  The stress is averaged over all steps.
SAMPLES_PER_WINDOW = 10
CONTACT_SAMPLES, MOST_LISTED = 5, 4e6  # samples between two lists of contacts; grains that all lists may hold
BLOW_UP = 100.0  # p' over sigma_3 at which a run ends
STIFFENING_TIMES, STIFFENING_INCREMENTS = 5.0, 50  # as in yade_scripts/start.py
END = "end.restart"  # the state that a stage leaves for the next one
RAMP, REST = 1.0, 3.0  # inertial times of a probe's increment and of the rest after it
STANDSTILL = 1.0  # inertial times from equilibrium to the state that is probed: the cell stands still


@dataclass(frozen=True)
class Start:
    """The state that a run starts from: number of grains, their median mass (kg), mu, shear modulus (Pa), height (m).

    G: that with which grains of this run's nu are as stiff.  at_rest: it is a probe's with mu_s, G_p, nu and sigma_3 of
    this run, so that its own proof of equilibrium holds.
    """

    N: int
    mass: float
    mu: float
    G: float
    height: float
    at_rest: bool


def consolidation(p: SimpleNamespace, grains: str, mass: np.ndarray, dt: float) -> str:
    """From the assembly (no contacts) to equilibrium at sigma_3 with friction mu_iso; mass (N,) kg, dt in s."""
    m, time = float(np.median(mass)), scene.inertial_time(p)
    G, rate = p.G_p * p.stiffness_scale, COMPRESSION_I / time
    rates = dict.fromkeys(AXES, f"-{rate:.9g}")
    change = scene.z_limit(len(mass))
    moves = " ".join(f"{axis} trate -{rate:.9g}" for axis in AXES)
    return f"""# {p.run_id}: {len(mass)} spheres, isotropic consolidation to {p.sigma_3 / 1e3:g} kPa
{scene.settings(p, f"read_data {grains}")}
{scene.law(p, p.mu_iso, G, scene.damping(p, m, G))}
{scene.engines(TOUCHING_STEP * dt)}

# shrink the cell at a constant rate until the grains carry a tenth of sigma_3
{scene.stream(rates)}
fix cell all deform 1 {moves} remap v units box
fix touched all halt 100 v_pressure > {TOUCH * p.sigma_3:.9g} error continue
run {math.ceil(1.0 / rate / dt)}
unfix touched
unfix cell
timestep {dt:.9g}
{scene.stream(rates, -1)}

# hand over to the servo and raise its goal to sigma_3
variable goal equal ramp($(v_pressure:%.12g),{p.sigma_3:.12g})
variable length_0 equal $(lz:%.17g)
{scene.servo(p, G, dt, goal="v_goal")}
{scene.samples(2000, scene.FORCES)}
{scene.run(math.ceil(RAMP_TIMES * time / dt), dt)}

# hold it until equilibrium is proven
variable goal equal {p.sigma_3:.12g}
{scene.drag(p, m)}
{scene.coming_to_rest(p, dt, CONSOLIDATION_WINDOW, MOST_WINDOWS, CONSOLIDATION_QUIET, change, "settled")}

# the state without the forces of damping: some of them would be tensile
{scene.law(p, p.mu_iso, G, 0.0)}
{scene.snapshot("end")}
write_restart {END}
"""


def probe(p: SimpleNamespace, start: Start, restart: str, dt: float) -> dict[str, str]:
    """The scripts of a probe: the packing at rest with its own mu_s and G_p, then each increment from that state.

    Each is a run of its own, because LAMMPS' `clear` ends in a crash after a restart was written.
    """
    time, m = scene.inertial_time(p), start.mass
    ramp, rest, standstill = (math.ceil(times * time / dt) for times in (RAMP, REST, STANDSTILL))
    begin = f"""{scene.law(p, p.mu_s, p.G_p, scene.damping(p, m, p.G_p))}
{scene.engines(dt)}
{scene.drag(p, m)}"""
    rest_script = f"""# {p.run_id}: {start.N} spheres, the state at rest from which the probe's increments start
{scene.settings(p, f"read_restart {restart}")}
reset_timestep 0
{_to_rest(p, start, p.G_p, dt, PROBE_QUIET)}

run {standstill}
{scene.snapshot("start")}
print "RESPONSE none {scene.STRESS}"
write_restart {END}
"""
    increments = {
        name: f"""# {p.run_id}: a small strain from the state at rest: {name}
{scene.settings(p, f"read_restart {END}")}
{begin}
{_increment(p.probe_strain * np.array(direction), ramp, dt)}
run {rest}
run 0
print "RESPONSE {name} {scene.STRESS}"
"""
        for name, direction in DIRECTIONS.items()
    }
    return {"in": rest_script} | increments


def _increment(strain: np.ndarray, ramp: int, dt: float) -> str:
    """Commands that deform the cell by a strain (3,), compression positive, within so many steps.

    LAMMPS gives images the velocity of the cell from the second step of a run on.  That velocity is therefore larger by
    ramp / (ramp - 1); without the factor the tangential springs between images miss a step (G_0 was 0.13 % too low).
    """
    lines, rates = [], {a: f"{-e / (ramp * dt):.12g}" for a, e in zip(AXES, strain, strict=True)}
    for axis, e in zip(AXES, strain, strict=True):
        lines += [
            f"variable growth_{axis} equal ramp(0,$(l{axis}*{math.expm1(-e):.17g}:%.17g))",
            f"variable velocity_{axis} equal {-e / ((ramp - 1) * dt):.12g}*l{axis}",
        ]
    moves = " ".join(f"{axis} variable v_growth_{axis} v_velocity_{axis}" for axis in AXES)
    return "\n".join([
        *lines, scene.stream(rates), f"fix cell all deform 1 {moves} remap v units box",
        f"run {ramp}", "unfix cell", scene.stream(rates, -1),
    ])  # fmt: skip


def _to_rest(p: SimpleNamespace, start: Start, G: float, dt: float, quiet: float, softer_dt: float = 0.0) -> str:
    """Commands that give a packing mu_s and the shear modulus G (Pa) and bring it to rest under sigma_3.

    The modulus is led to its value at constant stress and with the friction of consolidation; a sudden change would
    multiply the stress.  softer_dt: time step (s) from there on, with the damping that belongs to G.
    """
    m, time = start.mass, scene.inertial_time(p)
    before, after = (2.0 * g * (1.0 + p.nu) for g in (start.G, G))
    resist = scene.damping(p, m, max(start.G, G))
    lines = [
        scene.law(p, start.mu, start.G, resist), scene.engines(dt),
        scene.servo(p, max(start.G, G), dt), scene.drag(p, m),
    ]  # fmt: skip
    if abs(after / before - 1.0) >= 1e-3:
        growth = math.log(after / before) / STIFFENING_INCREMENTS
        steps = math.ceil(STIFFENING_TIMES * time / dt / STIFFENING_INCREMENTS)
        lines += [
            "", "# lead Young's modulus to this run's", f"variable k loop {STIFFENING_INCREMENTS}", "label stiffer",
            f"variable young equal $({before:.12g}*exp({growth:.12g}*v_k):%.12g)",
            scene.law(p, start.mu, "young", resist), scene.run(steps, dt), "next k", "jump SELF stiffer",
        ]  # fmt: skip
    if softer_dt > dt:
        resist = scene.damping(p, m, G)
        dt = softer_dt
        lines += [
            "", "# softer grains: a larger time step", scene.RELEASE,
            scene.law(p, start.mu, G, resist), f"timestep {dt:.9g}", scene.servo(p, G, dt),
        ]  # fmt: skip
    return "\n".join([
        *lines, "", "# take on mu_s, and hold sigma_3 until equilibrium is proven", scene.law(p, p.mu_s, G, resist),
        scene.coming_to_rest(p, dt, PROBE_WINDOW, MOST_REST_WINDOWS, quiet, scene.z_limit(start.N), "settled"),
        scene.RELEASE,
    ])  # fmt: skip


def shear(p: SimpleNamespace, start: Start, restart: str, step: float, strains: list[float]) -> tuple[str, float]:
    """Drained triaxial compression along z from the packing at rest, with a snapshot at each of the strains.

    step: the stable time step (s) of the start.  Returns the script and the time step of shear, s.
    """
    G, rate = p.G_p * p.stiffness_scale, strain_rate(p)
    with_G = step * (start.G / G) ** (1.0 / 3.0)  # stiffness of contacts at constant stress ~ G^(2/3)
    dt = STEP * with_G
    period = sampling_period(p, dt)
    listing = period * contact_samples(start.N, p.strain_end / rate / dt / period)
    most = 3 * math.ceil(p.strain_end / rate / dt)  # never reached: the rate grows with p'
    head = [f"# {p.run_id}: {start.N} spheres, drained triaxial compression along z",
            scene.settings(p, f"read_restart {restart}"), "reset_timestep 0"]  # fmt: skip
    if start.at_rest:
        head += [scene.law(p, p.mu_s, G, 0.0), scene.engines(dt)]
    else:
        rest = _to_rest(
            p, start, G, DAMPED_STEP * min(step, with_G), CONSOLIDATION_QUIET, softer_dt=DAMPED_STEP * with_G
        )
        head += [rest, "unfix drag", scene.law(p, p.mu_s, G, 0.0), f"timestep {dt:.9g}"]
    segments = []
    for k, strain in enumerate([*strains, p.strain_end]):
        name = "end" if k == len(strains) else f"strain_{k}"
        segments += [
            f"fix reached all halt {period} v_eps_a >= {strain:.12g} error continue", scene.run(most, dt),
            "unfix reached", scene.snapshot(name),
        ]  # fmt: skip
    script = "\n".join([
        *head, "", scene.snapshot("start"), "",
        "# the grains start with the cell's own motion; sigma_3 is held on x and y", "reset_timestep 0",
        "variable length_0 equal $(lz:%.17g)",
        scene.stream({"z": f"-{rate:.12g}"}), scene.servo(p, G, dt, rate),
        scene.samples(period, scene.MEANS), scene.contacts(listing),
        f"fix blow_up all halt 100 v_pressure > {BLOW_UP * p.sigma_3:.9g} error hard", "", *segments, "",
    ])  # fmt: skip
    return script, dt


def strain_rate(p: SimpleNamespace) -> float:
    """Axial strain rate (1/s) at p' = sigma_3."""
    return effective_inertial_number(p.inertial_number, p.mu_s) / scene.inertial_time(p)


def sampling_period(p: SimpleNamespace, dt: float) -> int:
    """Steps between two samples: SAMPLES_PER_WINDOW in the typical (median) window, and ten or more."""
    widths = np.diff(window_edges(p.strain_end, p.windows), prepend=0.0)
    return max(10, round(float(np.sort(widths)[len(widths) // 2]) / strain_rate(p) / dt / SAMPLES_PER_WINDOW))


def contact_samples(N: int, samples: float) -> int:
    """Samples from one list of contacts to the next of so many, so that their file stays below a gigabyte.

    A list takes about 100 bytes per grain.
    """
    return max(CONTACT_SAMPLES, math.ceil(samples * N / MOST_LISTED))


def window_edges(strain_end: float, windows: int | str = "default") -> np.ndarray:
    """Strains at which output windows end, as in yade_scripts/record.py."""
    if windows != "default":
        return np.linspace(0.0, strain_end, int(windows) + 1)[1:]
    edges = np.concatenate([np.arange(1, 10) * 1e-3, 0.01 + np.arange(16) * 2.5e-3, np.arange(0.05, 2.5, 5e-3)])
    return np.append(edges[edges < strain_end - 1e-9], strain_end)
