"""The physical gate: what a product must satisfy before any of its numbers is used.

The limits are those that no sound run reaches: tests/analysis/runs/test_gate.py passes the example runs, and the limits
were compared with the 51 products of the demo and with all 840 curves and moduli of data/laptop/runs.h5.  The largest
values found there stand beside each limit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors_and_files import RunFileError
from .run_file import Run

#: Quantity -> the open interval in which it lies in any packing of spheres (found: e 0.55 to 0.69, Z 3.3 to 6.0).
RANGES = {"e": (0.0, 5.0), "e_m": (0.0, 20.0), "Z": (-1e-12, 20.0), "Z_m": (-1e-12, 20.0)}
#: Axial over confining stress in shear (found: 1.0 to 3.0; 10 is a friction angle of 55 degrees).
STRESS_RATIO = (0.5, 10.0)
#: Strain after which the servo must hold, and its limits for a window's mean and any sample, as in
#: yade_scripts/proofs.py (found: 0.0043 and 0.025).
SERVO_FROM, SERVO_LIMIT, SERVO_SAMPLE_LIMIT = 0.01, 0.01, 0.05
#: Factor by which sigma_z may change from a window to the next one after the strain JUMP_FROM, where the first steep
#: rise has ended, and by which it may fall before (found: 1.24 up, 1.14 down).
JUMP, JUMP_FROM = 1.4, 0.002
#: Strain before which no critical state counts as steady, as in yade_scripts/proofs.py.
STEADY_FROM = 0.25
#: Stage -> proof -> its limit; NaN: it must be there and finite.  Shear as in yade_scripts/proofs.py, the others as in
#: yade_scripts/equilibrium.py (found: 2.4e-3, 0.0043, 0.025, 0.067; 4.1e-4 and 1.8e-4).
PROOF_LIMITS = {
    "shear": {
        "max_inertial_number": 2.5e-3,
        "servo_mean_error": SERVO_LIMIT,
        "servo_max_error": SERVO_SAMPLE_LIMIT,
        "energy_error": 0.10,
        "F_unb": np.nan,
    },
    "consolidate": {"stress_error": 0.005, "F_unb": 1e-3},
    "probe": {"stress_error": 0.005, "F_unb": 1e-3},
}
#: Proofs without a limit where a test ends before SERVO_FROM.
_SERVO_PROOFS = ("servo_mean_error", "servo_max_error")


def check_product(run: Run) -> None:
    """Raise RunFileError with run, quantity, value and limit for the first thing that cannot be true of a sound run.

    Checked are the proofs and their limits, ranges of the record, the moduli of a probe, and in shear also the strain
    (strictly increasing, its end that of the plan), the confining stress and jumps of the axial one.
    """
    for part in (run.timing, {"N": run.parameters.get("N"), "resumed": run.attrs.get("resumed", 0)}):
        for name, value in part.items():
            _within(run, name, value, -1.0 if name != "N" else 0.0, np.inf)
    end = float(run.record["eps_a"][-1]) if run.stage == "shear" else np.inf
    for name, limit in PROOF_LIMITS[run.stage].items():
        if name not in run.proofs:
            raise RunFileError(f"run {run.run_id}: the proof {name} is missing")
        free = np.isnan(limit) or (name in _SERVO_PROOFS and end <= SERVO_FROM)
        _at_most(run, f"the proof {name}", abs(_number(run.proofs[name])), np.inf if free else limit)
    for name, (low, high) in RANGES.items():
        if name in run.record:
            values = np.asarray(run.record[name])
            # A consolidation begins without contacts; only its last row is used.
            _all_within(run, name, values[-1:] if run.stage == "consolidate" else values, low, high)
    if run.stage == "shear":
        _check_shear(run)
    elif run.stage == "probe":
        _check_probe(run)
    elif "sigma" in run.record:
        sigma_3 = _sigma_3(run)
        error = np.abs(np.diagonal(run.record["sigma"][-1]) / sigma_3 - 1.0).max()
        _at_most(run, "error of the last stress over sigma_3", error, SERVO_SAMPLE_LIMIT)


def _check_shear(run: Run) -> None:
    strain, sigma, sigma_3 = run.record["eps_a"], run.record["sigma"], _sigma_3(run)
    steps = np.diff(strain)
    if not (steps > 0.0).all():
        row = int(np.argmin(steps > 0.0))
        raise RunFileError(
            f"run {run.run_id}: eps_a falls from {strain[row]:.4g} to {strain[row + 1]:.4g} in row {row + 1}, "
            "it must increase strictly"
        )
    _all_within(run, "sigma_z / sigma_3", sigma[:, 2, 2] / sigma_3, *STRESS_RATIO, strain)
    late = strain > SERVO_FROM
    lateral = 0.5 * (sigma[late, 0, 0] + sigma[late, 1, 1]) / sigma_3 - 1.0
    _all_within(run, "lateral stress / sigma_3 - 1", lateral, -SERVO_LIMIT, SERVO_LIMIT, strain[late])
    ratio = sigma[1:, 2, 2] / sigma[:-1, 2, 2]
    highest = np.where(strain[:-1] >= JUMP_FROM, JUMP, np.inf)
    jumps = (ratio > highest) | (ratio < 1.0 / JUMP)
    if jumps.any():
        row = int(np.argmax(jumps))
        raise RunFileError(
            f"run {run.run_id}: sigma_z jumps by the factor {ratio[row]:.3g} at strain {strain[row + 1]:.4g}, "
            f"limit {JUMP:g}"
        )
    planned, end = _number(run.parameters.get("strain_end")), float(strain[-1])
    if run.attrs.get("exit_reason") == "steady":
        if not end >= min(STEADY_FROM, planned - steps[-1]):
            raise RunFileError(f"run {run.run_id}: ends as steady at strain {end:.4g} < {STEADY_FROM:g}")
    elif not abs(end - planned) <= 1.01 * steps.max():
        raise RunFileError(f"run {run.run_id}: ends at strain {end:.4g}, strain_end = {planned:g} was planned")


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
