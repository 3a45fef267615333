"""What a shear run in LAMMPS must prove, with the limits of `analysis.runs.gate`: quasi-static, sigma_3 held.

An energy balance it cannot prove: friction's work is not counted.  What the balance leaves for friction must not be
negative, or else energy came out of nothing.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.runs.gate import LEAST_RESIDUAL, PROOF_LIMITS, SERVO_FROM, SERVO_LIMIT, SERVO_SAMPLE_LIMIT, STEADY_FROM
from analysis.runs.peak_critical import stress_ratio
from campaign.lammps.outputs import LammpsError

STEADY_WINDOW = 0.10  # strain over which the critical state must be steady


def shear_proofs(record: dict[str, np.ndarray], energy_strain: float) -> dict[str, float]:
    """Figures of every proof; raises LammpsError for the first that fails."""
    strain = record["eps_a"]
    late = strain > SERVO_FROM if strain[-1] > SERVO_FROM else strain > 0.0
    end = float(strain[-1])
    judged = int(np.searchsorted(strain, min(energy_strain, end) - 1e-9))
    figures = {
        "max_inertial_number": float(record["I"][1:].max()),
        "servo_mean_error": float(np.abs(record["servo_mean"][late]).max()),
        "servo_max_error": float(record["servo_max"][late].max()),
        "energy_error": math.nan,
        "friction_residual": float(record["E_residual"][judged] / abs(record["W_boundary"][judged])),
        "F_unb": float(record["F_unb"][late].mean()),
        **steadiness(record),
    }
    _limit("not quasi-static: I", figures["max_inertial_number"], PROOF_LIMITS["shear"]["max_inertial_number"], end)
    if end > SERVO_FROM:
        _limit("servo: |mean sigma_3 / target - 1| of a window", figures["servo_mean_error"], SERVO_LIMIT, end)
        _limit("servo: |sigma_3 / target - 1| of a sample", figures["servo_max_error"], SERVO_SAMPLE_LIMIT, end)
    _limit("energy balance: energy out of nothing over the work put in", -figures["friction_residual"],
           -LEAST_RESIDUAL, float(strain[judged]))  # fmt: skip
    return figures


def steadiness(record: dict[str, np.ndarray]) -> dict[str, float]:
    """Drift of eta and e over the last 10 % of strain, as relative change; NaN before there is such a part."""
    strain, names = record["eps_a"], {"eta": stress_ratio(record["sigma"]), "e": record["e"]}
    late = strain > strain[-1] - STEADY_WINDOW
    out = {f"drift_{name}{kind}": math.nan for kind in ("", "_se") for name in names}
    if strain[-1] < STEADY_FROM or late.sum() < 4:
        return out
    for name, values in names.items():
        slope, error = _slope(strain[late], values[late])
        out[f"drift_{name}"] = slope * STEADY_WINDOW / values[late].mean()
        out[f"drift_{name}_se"] = error * STEADY_WINDOW / values[late].mean()
    return out


def _slope(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Least-squares slope and its standard error with residuals correlated over a strain of 0.03."""
    dx = x - x.mean()
    slope = float(dx @ (y - y.mean()) / (dx @ dx))
    residual = y - y.mean() - slope * dx
    correlated = max(1.0, 0.03 / np.diff(x).mean())
    return slope, float(np.sqrt(residual @ residual / max(len(x) - 2, 1) / (dx @ dx) * correlated))


def _limit(what: str, value: float, limit: float, strain: float) -> None:
    if not value <= limit:
        raise LammpsError(f"{what} = {value:.3g} > {limit:g} at strain {strain:.3g}")
