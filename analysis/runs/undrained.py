"""What only undrained tests have: excess pore pressure, phase transformation, and strength at 10 % axial strain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..quantities import STRENGTH_STRAIN
from . import peak_critical

#: p' must rise again by this factor after its minimum: without a rise there is no phase transformation, but a steady
#: state or liquefaction.
RISE = 1.1
#: Half-width in strain over which curves are smoothed for the strength.
WIDTH = 0.03


def pore_pressure(sigma: np.ndarray, sigma_3: float) -> dict[str, np.ndarray]:
    """u (T,) Pa and r_u (T,) of effective stress tensors (T, 3, 3) Pa: the total lateral stress stays sigma_3 Pa."""
    u = sigma_3 - 0.5 * (sigma[:, 0, 0] + sigma[:, 1, 1])
    return {"u": u, "r_u": u / sigma_3}


def transformation(strain: np.ndarray, p: np.ndarray, eta: np.ndarray) -> dict[str, float]:
    """Phase transformation, the minimum of the smoothed p' (T,) over strain (T,): eps_pt, and p and eta there.

    NaN where the smoothed p' is smallest in the first or last row or never rises again by the factor RISE.  The curves
    are smoothed as in `peak_critical.smooth`.  Raises TriaxialError as `peak_critical.peak_state` does.
    """
    peak_critical.check_record(strain, p, eta)
    smoothed = peak_critical.smooth(strain, np.column_stack([p, eta]))
    row = int(np.argmin(smoothed[:, 0]))
    inside = 0 < row < len(strain) - 1 and smoothed[row:, 0].max() >= RISE * smoothed[row, 0]
    if not inside:
        return dict.fromkeys(("eps_pt", "p", "eta"), np.nan)
    return {"eps_pt": float(strain[row]), "p": float(smoothed[row, 0]), "eta": float(smoothed[row, 1])}


def strength(strain: np.ndarray, curves: Mapping[str, np.ndarray], sign: float) -> dict[str, float]:
    """q, p, eta and u (Pa) of `curves` (T,) at the strain STRENGTH_STRAIN, and s_u = |q| / 2.

    sign: 1 in compression, -1 in extension.  NaN if the record, whose rows are means of windows, ends before.
    """
    names = ("q", "p", "eta", "u")
    if strain[-1] + 0.5 * (strain[-1] - strain[-2]) < STRENGTH_STRAIN * (1.0 - 1e-6):
        return dict.fromkeys((*names, "s_u"), np.nan)
    smoothed = peak_critical.smooth(strain, np.column_stack([curves[name] for name in names]), width=WIDTH)
    at = {name: float(np.interp(STRENGTH_STRAIN, strain, y)) for name, y in zip(names, smoothed.T, strict=True)}
    return at | {"s_u": 0.5 * sign * at["q"]}
