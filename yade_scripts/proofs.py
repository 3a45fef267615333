"""What a shear run must prove: quasi-static, sigma_3 held, energy balanced, critical state steady.

A failed proof is an error that carries the number, its limit and the strain.
"""

from __future__ import annotations

import numpy as np

from yade_scripts.rve import ProofError

I_LIMIT = 2.5e-3  # quasi-static below, always
SERVO_FROM = 0.01  # strain after which the start of shear is forgotten and the servo must hold
SERVO_WINDOW_LIMIT, SERVO_LIMIT = 0.01, 0.05  # mean of a window; any sample
ENERGY_LIMIT = 0.10  # energy that the integration itself makes, over the work put in: grows with step and rate
ENERGY = "energy balance: error over the work put in"
STEADY_FROM, STEADY_WINDOW = 0.25, 0.10  # strain from which, and over which, the critical state must be steady
STEADY_E, STEADY_ETA = 0.01, 0.05  # drift of e over that part, and what the drift of eta must be known to


def check_shear(p, sample: dict, windows) -> None:
    """Refuse at once what can't come right again: NaN or exploding stress, a lost servo, energy out of nothing."""
    strain, sigma = sample["eps_a"], sample["sigma"]
    if not np.all(np.isfinite(sigma)):
        raise ProofError(f"blow-up: the stress is not finite at strain {strain:.4g}")
    if sigma.max() > 100.0 * p.sigma_3:
        raise ProofError(f"blow-up: stress {sigma.max() / p.sigma_3:.3g} times sigma_3 at strain {strain:.4g}")
    if len(windows.rows) < 2 or strain < SERVO_FROM:
        return
    row = windows.rows[-1]
    _limit("servo lost: |mean sigma_3 / target - 1|", abs(row["servo_mean"]), 5.0 * SERVO_WINDOW_LIMIT, strain)
    if windows.balance is not None:
        _limit(ENERGY, windows.balance[0], ENERGY_LIMIT, windows.balance[1])


def shear_proofs(p, windows) -> dict[str, float]:
    """Figures of every proof; raises ProofError for the first that fails."""
    record = windows.arrays()
    strain = record["eps_a"]
    late = strain > SERVO_FROM if strain[-1] > SERVO_FROM else strain > 0.0
    end, (energy_error, energy_strain) = float(strain[-1]), windows.energy_balance()
    figures = dict(
        max_inertial_number=float(record["I"][1:].max()),
        servo_mean_error=float(np.abs(record["servo_mean"][late]).max()),
        servo_max_error=float(record["servo_max"][late].max()),
        energy_error=energy_error,
        F_unb=float(record["F_unb"][late].mean()),
        **steadiness(windows.rows),
    )
    _limit("not quasi-static: I", figures["max_inertial_number"], I_LIMIT, end)
    if end > SERVO_FROM:
        _limit("servo: |mean sigma_3 / target - 1| of a window", figures["servo_mean_error"], SERVO_WINDOW_LIMIT, end)
        _limit("servo: |sigma_3 / target - 1| of a sample", figures["servo_max_error"], SERVO_LIMIT, end)
    _limit(ENERGY, energy_error, ENERGY_LIMIT, energy_strain)
    return figures


def steadiness(rows: list[dict]) -> dict[str, float]:
    """Drift of eta and e over the last 10 % of strain, as relative change over it; NaN before there is such a part."""
    strain = np.array([row["eps_a"] for row in rows])
    late = strain > strain[-1] - STEADY_WINDOW
    if strain[-1] < STEADY_FROM or late.sum() < 4:
        return {"drift_eta": np.nan, "drift_e": np.nan, "drift_eta_se": np.nan, "drift_e_se": np.nan}
    out = {}
    for name, values in (("eta", _eta(rows)), ("e", np.array([row["e"] for row in rows]))):
        slope, error = _slope(strain[late], values[late])
        out[f"drift_{name}"] = slope * STEADY_WINDOW / values[late].mean()
        out[f"drift_{name}_se"] = error * STEADY_WINDOW / values[late].mean()
    return out


def is_steady(rows: list[dict]) -> bool:
    """True when, past 25 % strain, e drifts by less than 1 % per 10 % of strain, eta by less than that or its noise.

    The drift of eta must be known to 5 %: one that cannot be told from scatter proves nothing, and a small run goes on.
    """
    if rows[-1]["eps_a"] < STEADY_FROM + 0.5 * STEADY_WINDOW:
        return False
    drift = steadiness(rows)
    known = drift["drift_eta_se"] < STEADY_ETA
    return abs(drift["drift_e"]) < STEADY_E and known and abs(drift["drift_eta"]) < max(0.01, 2 * drift["drift_eta_se"])


def _eta(rows: list[dict]) -> np.ndarray:
    sigma = np.array([row["sigma"] for row in rows])
    sigma_3 = 0.5 * (sigma[:, 0, 0] + sigma[:, 1, 1])
    return 3.0 * (sigma[:, 2, 2] - sigma_3) / (sigma[:, 2, 2] + 2.0 * sigma_3)


def _slope(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Least-squares slope and its standard error with residuals correlated over a strain of 0.03."""
    dx = x - x.mean()
    slope = float(dx @ (y - y.mean()) / (dx @ dx))
    residual = y - y.mean() - slope * dx
    correlated = max(1.0, 0.03 / np.diff(x).mean())
    return slope, float(np.sqrt(residual @ residual / max(len(x) - 2, 1) / (dx @ dx) * correlated))


def _limit(what: str, value: float, limit: float, strain: float) -> None:
    if not value <= limit:
        raise ProofError(f"{what} = {value:.3g} > {limit:g} at strain {strain:.3g}")
