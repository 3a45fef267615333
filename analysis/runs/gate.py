"""The physical gate: what a product must satisfy before any of its numbers is used.

The limits are those that no sound run reaches: tests/analysis/runs/test_gate.py passes the example runs, and the limits
were compared with the 51 products of the demo and with all 840 curves and moduli of data/laptop/runs.h5.  The largest
values found there stand beside each limit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors_and_files import RunFileError
from ..quantities import DIRECTIONS, DRAINED, PATHS
from .run_file import Run, not_given

#: Quantity -> the open interval in which it lies in any packing of spheres (found: e 0.55 to 0.69, Z 3.3 to 6.0).
RANGES = {"e": (0.0, 5.0), "e_m": (0.0, 20.0), "Z": (-1e-12, 20.0), "Z_m": (-1e-12, 20.0)}
#: Axial over confining stress in shear, in compression (found: 1.0 to 3.0; 10 is a friction angle of 55 degrees), and
#: axial over lateral stress in extension.  Beyond the drained path it is the lateral stress in compression, too.
STRESS_RATIO, EXTENSION_RATIO = (0.5, 10.0), (0.1, 2.0)
#: Strain after which the servo must hold, and its limits for a window's mean and any sample, as in
#: yade_scripts/paths.py (found: 0.0043 and 0.025 drained).
SERVO_FROM, SERVO_LIMIT, SERVO_SAMPLE_LIMIT = 0.01, 0.01, 0.05
#: Path -> these limits: of sigma_3, of p' and of the volume, which undrained tests hold from the start; then the limit
#: of the energy error.
ENERGY_LIMITS = {"drained": 0.10, "constant_p": 0.10, "undrained": 0.15}
HELD_LIMITS = {"drained": (SERVO_LIMIT, SERVO_SAMPLE_LIMIT), "constant_p": (0.002, 0.02), "undrained": (1e-9, 1e-9)}
#: Path -> number of spheres below which its limit of a sample grows with 1 / sqrt(N); 0 for others.
FEWEST = {"constant_p": 2000}
#: Factor by which sigma_z may change from a window to the next one after the strain JUMP_FROM, where the first steep
#: rise has ended, and by which it may fall before (found: 1.24 up, 1.14 down).  In extension rise and fall change
#: places.  Undrained, sigma_z over the lateral stress is judged; p' may rise by the factor PRESSURE_JUMP, and fall by
#: any: a packing that collapses loses it within a tenth of a percent of strain.
JUMP, JUMP_FROM, PRESSURE_JUMP = 1.4, 0.002, 4.0
#: Undrained tests: p' over sigma_3 above which ratios of stresses and the inertial number are judged, and below which
#: it is for good in a test that liquefied; the least p' over the cap in the last window of a test that became stiff.
CARRIES, LIQUEFIED, NEAR_CAP = 0.1, 0.05, 0.5
#: Strain before which no critical state counts as steady, as in yade_scripts/proofs.py.
STEADY_FROM = 0.25
#: Stage -> proof -> its limit; NaN: it must be there and finite.  Shear as in yade_scripts/proofs.py, the others as in
#: yade_scripts/equilibrium.py (found: 2.4e-3, 0.0043, 0.025, 0.067; 4.1e-4 and 1.8e-4).
PROOF_LIMITS = {
    "shear": {
        "max_inertial_number": 2.5e-3,
        "servo_mean_error": SERVO_LIMIT,
        "servo_max_error": SERVO_SAMPLE_LIMIT,
        "energy_error": ENERGY_LIMITS["drained"],
        "F_unb": np.nan,
    },
    "consolidate": {"stress_error": 0.005, "F_unb": 1e-3},
    "probe": {"stress_error": 0.005, "F_unb": 1e-3},
}
#: Proofs without a limit where a test ends before SERVO_FROM.
_SERVO_PROOFS = ("servo_mean_error", "servo_max_error")
#: Where the code of a run does not count the work of friction it proves no energy balance.  What the balance leaves for
#: friction, over the boundary work, is no proof, but if it is less than this then energy came out of nothing.
LEAST_RESIDUAL = -ENERGY_LIMITS["drained"]


def check_product(run: Run) -> None:
    """Raise RunFileError with run, quantity, value and limit for the first thing that cannot be true of a sound run.

    Checked are the proofs and their limits, ranges of the record, the moduli of a probe, and in shear also the strain
    (strictly increasing, its end that of the plan), the ratio of the stresses, what the path holds, jumps of the axial
    stress, and the end against strain and p'.
    """
    for part in (run.timing, {"N": run.parameters.get("N"), "resumed": run.attrs.get("resumed", 0)}):
        for name, value in part.items():
            _within(run, name, value, -1.0 if name != "N" else 0.0, np.inf)
    end, limits = np.inf, PROOF_LIMITS[run.stage]
    if run.stage == "shear":
        end, limits = float(run.strain[-1]), limits | dict(zip(_SERVO_PROOFS, _held_limits(run), strict=True))
        limits |= {"energy_error": ENERGY_LIMITS[run.loading.path]}
    if run.stage == "shear" and run.attrs.get("code") == "lammps":
        del limits["energy_error"]
        _check_no_balance(run)
    for name, limit in limits.items():
        if name not in run.proofs:
            raise RunFileError(f"run {run.run_id}: the proof {name} is missing")
        free = np.isnan(limit) or (name in _SERVO_PROOFS and end <= SERVO_FROM and limit > 1e-6)
        _at_most(run, f"the proof {name}", abs(_number(run.proofs[name])), np.inf if free else limit)
    for name, (low, high) in RANGES.items():
        if name in run.record:
            values = np.asarray(run.record[name])
            # A consolidation begins without contacts; only its last row is used.  A liquefied test ends without them.
            used = slice(run.rows_before_end) if run.stage == "shear" else slice(None)
            _all_within(run, name, values[-1:] if run.stage == "consolidate" else values[used], low, high)
    if run.stage == "shear":
        _check_shear(run)
    elif run.stage == "probe":
        _check_probe(run)
    elif "sigma" in run.record:
        sigma_3 = _sigma_3(run)
        error = np.abs(np.diagonal(run.record["sigma"][-1]) / sigma_3 - 1.0).max()
        _at_most(run, "error of the last stress over sigma_3", error, SERVO_SAMPLE_LIMIT)


def _check_no_balance(run: Run) -> None:
    """A run without an energy balance says so, claims none, and has not made energy out of nothing."""
    claimed = _number(run.proofs.get("energy_error"))
    if "energy_error" not in not_given(run.attrs) or not np.isnan(claimed):
        raise RunFileError(
            f"run {run.run_id}: claims an energy balance ({_shown(claimed)}) that code = 'lammps' cannot prove"
        )
    _within(run, "friction_residual", run.proofs.get("friction_residual"), LEAST_RESIDUAL, np.inf)


def _held_limits(run: Run) -> tuple[float, float]:
    """Limits of the mean and of a sample of what the test holds; raises RunFileError for an unknown test."""
    path, direction = run.loading
    if path not in PATHS or direction not in DIRECTIONS:
        raise RunFileError(f"run {run.run_id}: path {path!r}, direction {direction!r} are no test that is known")
    mean, sample = HELD_LIMITS[path]
    return mean, sample * max(1.0, np.sqrt(FEWEST.get(path, 0) / _number(run.parameters["N"])))


def _check_shear(run: Run) -> None:
    strain, sigma, sigma_3, loading = run.strain, run.record["sigma"], _sigma_3(run), run.loading
    steps = np.diff(strain)
    if not (steps > 0.0).all():
        row = int(np.argmin(steps > 0.0))
        raise RunFileError(
            f"run {run.run_id}: eps_a falls from {strain[row]:.4g} to {strain[row + 1]:.4g} in row {row + 1}, "
            "it must increase strictly"
        )
    axial, lateral = sigma[:, 2, 2], 0.5 * (sigma[:, 0, 0] + sigma[:, 1, 1])
    pressure = (axial + 2.0 * lateral) / 3.0 / sigma_3
    carries = pressure >= CARRIES if loading.is_undrained else np.ones(len(strain), bool)
    if loading == DRAINED:
        _all_within(run, "sigma_z / sigma_3", axial / sigma_3, *STRESS_RATIO, strain)
    else:
        limits = STRESS_RATIO if loading.sign > 0 else EXTENSION_RATIO
        ratio = np.where(carries, axial, 1.0) / np.where(carries, lateral, 1.0)
        _all_within(run, "sigma_z / lateral stress", ratio, *limits, strain)
    _check_held(run, strain, lateral / sigma_3, pressure)
    changing = axial
    if loading.is_undrained:
        _check_jumps(run, "p'", strain, pressure, carries, PRESSURE_JUMP, np.inf)
        changing = np.where(carries, axial / np.where(lateral > 0.0, lateral, 1.0), 1.0)
    _check_jumps(run, "sigma_z", strain, changing**loading.sign, carries, JUMP, JUMP)
    _check_end(run, strain, pressure)


def _check_held(run: Run, strain: np.ndarray, lateral: np.ndarray, pressure: np.ndarray) -> None:
    """What the path holds; lateral stress and p' over sigma_3 (T,)."""
    (limit, of_sample), late = _held_limits(run), strain > SERVO_FROM
    if run.loading.is_undrained:
        volume = (1.0 + run.record["e"]) / (1.0 + run.record["e"][0]) - 1.0
        _all_within(run, "volume over that at the start - 1", volume, -1.01 * limit, 1.01 * limit, strain)
        _within(run, "p' / sigma_3 at the start", pressure[0], 1.0 - SERVO_SAMPLE_LIMIT, 1.0 + SERVO_SAMPLE_LIMIT)
    elif run.loading.path == "constant_p":
        # `servo_mean` is the mean over all steps with a goal, the stress tensor that over some twenty samples.
        _all_within(run, "mean p' / sigma_3 - 1", run.record["servo_mean"][late], -limit, limit, strain[late])
        _all_within(run, "p' / sigma_3 - 1", pressure[late] - 1.0, -of_sample, of_sample, strain[late])
    else:
        _all_within(run, "lateral stress / sigma_3 - 1", lateral[late] - 1.0, -limit, limit, strain[late])


def _check_jumps(
    run: Run, what: str, strain: np.ndarray, values: np.ndarray, judged: np.ndarray, up: float, down: float
) -> None:
    """Changes of values (T,) from a row to the next one where both are judged; any rise before JUMP_FROM is allowed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = values[1:] / values[:-1]
    highest = np.where(strain[:-1] >= JUMP_FROM, up, np.inf)
    jumps = ((ratio > highest) | (ratio < 1.0 / down)) & judged[1:] & judged[:-1]
    if jumps.any():
        row = int(np.argmax(jumps))
        raise RunFileError(
            f"run {run.run_id}: {what} jumps by the factor {ratio[row]:.3g} at strain {strain[row + 1]:.4g}, "
            f"limit {up:g}"
        )


def _check_end(run: Run, strain: np.ndarray, pressure: np.ndarray) -> None:
    """The strain and p' over sigma_3 (T,) at which a test ends, by the reason that it gives."""
    planned, end, steps = _number(run.parameters.get("strain_end")), float(strain[-1]), np.diff(strain)
    reason, undrained = run.attrs.get("exit_reason"), run.loading.is_undrained
    cap = _number(run.parameters.get("stiff_cap")) / _sigma_3(run) if undrained else np.inf
    if undrained:
        _within(run, "stiff_cap / sigma_3", cap, 1.0, np.inf)
    if undrained and reason == "liquefied":
        start = _number(run.attrs.get("liquefied_from"))
        if not 0.0 < start <= end:
            raise RunFileError(f"run {run.run_id}: liquefied_from = {start:.4g} is not within (0, {end:.4g}]")
        after = pressure[run.rows_before_end + 1 :]
        if len(after):
            _at_most(run, "p' / sigma_3 after it liquefied", float(after.max()), LIQUEFIED)
    elif undrained and reason == "stiff":
        if not pressure[-1] >= NEAR_CAP * cap:
            raise RunFileError(f"run {run.run_id}: ends as stiff at p' / sigma_3 = {pressure[-1]:.4g}, cap {cap:.4g}")
    elif reason == "steady":
        if not end >= min(STEADY_FROM, planned - steps[-1]):
            raise RunFileError(f"run {run.run_id}: ends as steady at strain {end:.4g} < {STEADY_FROM:g}")
    elif not abs(end - planned) <= 1.01 * steps.max():
        raise RunFileError(f"run {run.run_id}: ends at strain {end:.4g}, strain_end = {planned:g} was planned")
    elif undrained:
        _at_most(run, "p' / cap", float(pressure.max() / cap), 1.0)


def _check_probe(run: Run) -> None:
    """G_0 and K_0 are positive, and less than the grains' own shear modulus (found: 0.002 to 0.02 of it)."""
    stiffest = _number(run.parameters.get("G_p"))
    probe = run.probe or {}
    for name in ("G_0", "K_0", *(["G_0_minus"] if "G_0_minus" in probe else [])):
        _within(run, name, probe.get(name), 0.0, stiffest)


def _sigma_3(run: Run) -> float:
    value = _number(run.parameters.get("sigma_3"))
    _within(run, "sigma_3", value, 0.0, np.inf)
    return value


def _number(value: Any) -> float:
    """A value of the file as a number; NaN for everything that is none."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return np.nan


def _within(run: Run, what: str, value: Any, low: float, high: float) -> None:
    if not low < _number(value) < high:
        raise RunFileError(f"run {run.run_id}: {what} = {_shown(value)} is not within ({low:g}, {high:g})")


def _at_most(run: Run, what: str, value: float, limit: float) -> None:
    if not (np.isfinite(value) and value <= limit):
        bound = f"exceeds {limit:g}" if np.isfinite(value) else "is not finite"
        raise RunFileError(f"run {run.run_id}: {what} = {value:.4g} {bound}")


def _all_within(
    run: Run, what: str, values: np.ndarray, low: float, high: float, strain: np.ndarray | None = None
) -> None:
    good = (values > low) & (values < high)
    if not good.all():
        row = int(np.argmin(good))
        where = f"in row {row}" if strain is None else f"at strain {strain[row]:.4g}"
        raise RunFileError(f"run {run.run_id}: {what} = {values[row]:.4g} {where} is not within ({low:g}, {high:g})")


def _shown(value: Any) -> str:
    return "missing" if value is None else f"{value:.4g}" if isinstance(value, float) else repr(value)[:60]
