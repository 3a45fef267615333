"""What a shear run must prove: quasi-static, sigma_3, p' or the volume held, energy balanced, critical state steady.

A failed proof is an error that carries the number, its limit and the strain.
"""

from __future__ import annotations

import numpy as np

from yade_scripts.paths import RATE_FLOOR
from yade_scripts.rve import ProofError

I_LIMIT = 2.5e-3  # quasi-static below, always
SERVO_FROM = 0.01  # strain after which the start of shear is forgotten and the servo must hold
BLOW_UP = 100.0  # largest stress over sigma_3; on an undrained path over a tenth of the cap of p', too
#: Friction below which the grains of an undamped test keep vibrating so that the servo misses its target; a damping that
#: is enough.
SLIPPERY, CALMING = 0.03, 0.2
ENERGY = "energy balance: error over the work put in"
STEADY_FROM, STEADY_WINDOW = 0.25, 0.10  # strain from which, and over which, the critical state must be steady


def check_shear(p, sample: dict, windows) -> None:
    """Refuse at once what can't come right again: NaN or exploding stress, a lost servo, energy out of nothing."""
    strain, sigma = windows.strain(sample), sample["sigma"]
    if not np.all(np.isfinite(sigma)):
        raise ProofError(f"blow-up: the stress is not finite at strain {strain:.4g}")
    if sigma.max() > BLOW_UP * max(p.sigma_3, 0.1 * p.stiff_cap if p.path == "undrained" else 0.0):
        raise ProofError(f"blow-up: stress {sigma.max() / p.sigma_3:.3g} times sigma_3 at strain {strain:.4g}")
    if len(windows.rows) < 2 or strain < SERVO_FROM:
        return
    path, row = windows.path, windows.rows[-1]
    _limit(f"servo lost: |mean {path.held} - 1|", abs(row["servo_mean"]), 5.0 * path.window_limit, strain,
           advice(p))  # fmt: skip
    if windows.balance is not None:
        _limit(ENERGY, windows.balance[0], path.energy_limit, windows.balance[1])


def shear_proofs(p, windows) -> dict[str, float]:
    """Figures of every proof; raises ProofError for the first that fails.

    The inertial number is judged in windows at whose end, too, p' is above the floor of the rate, RATE_FLOOR sigma_3.
    """
    record, path = windows.arrays(), windows.path
    strain = np.array([windows.strain(row) for row in windows.rows])
    late = strain > SERVO_FROM if strain[-1] > SERVO_FROM else strain > 0.0
    end, (energy_error, energy_strain) = float(strain[-1]), windows.energy_balance()
    carries = np.trace(record["sigma"], axis1=1, axis2=2) / 3.0 >= RATE_FLOOR * p.sigma_3
    carries[:-1] &= carries[1:]
    figures = dict(
        max_inertial_number=float(record["I"][1:][carries[1:]].max(initial=0.0)),
        servo_mean_error=float(np.abs(record["servo_mean"][late]).max()),
        servo_max_error=float(record["servo_max"][late].max()),
        energy_error=energy_error,
        F_unb=float(record["F_unb"][late & carries].mean()) if (late & carries).any() else 0.0,
        **steadiness(windows),
    )
    _limit("not quasi-static: I", figures["max_inertial_number"], I_LIMIT, end)
    if end > SERVO_FROM:
        mean, largest, hint = figures["servo_mean_error"], figures["servo_max_error"], advice(p)
        _limit(f"servo: |mean {path.held} - 1| of a window", mean, path.window_limit, end, hint)
        _limit(f"servo: |{path.held} - 1| of a sample", largest, path.largest_error(), end, hint)
    _limit(ENERGY, energy_error, path.energy_limit, energy_strain)
    return figures


def steadiness(windows) -> dict[str, float]:
    """Drift of what must be steady over the last 10 % of strain, as relative change; NaN before there is such a part."""
    rows, names = windows.rows, windows.path.steady
    strain = np.array([windows.strain(row) for row in rows])
    late = strain > strain[-1] - STEADY_WINDOW
    out = {f"drift_{name}{kind}": np.nan for kind in ("", "_se") for name in names}
    if strain[-1] < STEADY_FROM or late.sum() < 4:
        return out
    for name in names:
        values = _values(rows, name)[late]
        slope, error = _slope(strain[late], values)
        out[f"drift_{name}"] = slope * STEADY_WINDOW / values.mean()
        out[f"drift_{name}_se"] = error * STEADY_WINDOW / values.mean()
    return out


def is_steady(windows) -> bool:
    """True when, past 25 % strain, what must be steady is: e drifts by less than 1 % per 10 % of strain, and so on.

    The drifts of eta and p' must be known to 5 % and be less than 1 % or their noise: a drift that cannot be
    distinguished from scatter proves nothing, and a small run goes on.
    """
    if windows.strain(windows.rows[-1]) < STEADY_FROM + 0.5 * STEADY_WINDOW:
        return False
    drift, steady = steadiness(windows), True
    for name, limit in windows.path.steady.items():
        change, error = abs(drift[f"drift_{name}"]), abs(drift[f"drift_{name}_se"])
        steady &= change < limit if name == "e" else error < limit and change < max(0.01, 2 * error)
    return bool(steady)


def _values(rows: list[dict], name: str) -> np.ndarray:
    """eta, p' or a recorded scalar of every row."""
    if name not in ("eta", "p"):
        return np.array([row[name] for row in rows])
    sigma = np.array([row["sigma"] for row in rows])
    sigma_3 = 0.5 * (sigma[:, 0, 0] + sigma[:, 1, 1])
    p = (sigma[:, 2, 2] + 2.0 * sigma_3) / 3.0
    return p if name == "p" else 3.0 * (sigma[:, 2, 2] - sigma_3) / (sigma[:, 2, 2] + 2.0 * sigma_3)


def _slope(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Least-squares slope and its standard error with residuals correlated over a strain of 0.03."""
    dx = x - x.mean()
    slope = float(dx @ (y - y.mean()) / (dx @ dx))
    residual = y - y.mean() - slope * dx
    correlated = max(1.0, 0.03 / np.diff(x).mean())
    return slope, float(np.sqrt(residual @ residual / max(len(x) - 2, 1) / (dx @ dx) * correlated))


def advice(p) -> str:
    """What helps where the servo fails because friction takes up hardly anything; it ends a sentence, or is empty."""
    if p.mu_s >= SLIPPERY or p.damping > 0.0:
        return ""
    return f"; mu_s = {p.mu_s:g} dissipates too little: use damping = {CALMING:g} (dem.damping of a campaign)"


def _limit(what: str, value: float, limit: float, strain: float, hint: str = "") -> None:
    if not value <= limit:
        raise ProofError(f"{what} = {value:.3g} > {limit:g} at strain {strain:.3g}{hint}")
