"""Published numbers that a campaign is compared with: Liu, Lyu & Zhao (2025), and critical states of spheres."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.optimize import brentq

REFERENCE = (
    "Liu, Lyu & Zhao (2025), Quantifying the impact of the inherent coupling of particle-scale variability on granular "
    "soil behavior, J. Geotech. Geoenviron. Eng."
)

#: Table 3: (quantity, mu_iso) -> (mean, COV).
INITIAL_STATE = {
    ("e", 0.001): (0.538, 0.001), ("e", 0.04): (0.582, 0.007), ("e", 0.1): (0.620, 0.005),
    ("e_m", 0.001): (0.581, 0.004), ("e_m", 0.04): (0.642, 0.011), ("e_m", 0.1): (0.705, 0.008),
    ("Z", 0.001): (5.77, 0.006), ("Z", 0.04): (5.33, 0.010), ("Z", 0.1): (4.92, 0.008),
    ("Z_m", 0.001): (6.14, 0.004), ("Z_m", 0.04): (5.76, 0.007), ("Z_m", 0.1): (5.43, 0.005),
}  # fmt: skip

#: Ranges of the stress ratio that the text reads off its Figure 5: (state, quantity, mu_iso) -> (from, to).
STATE_RANGE = {
    ("peak", "eta", 0.001): (0.6, 1.2), ("peak", "eta", 0.1): (0.5, 0.9),
    ("critical", "eta", 0.001): (0.5, 0.8), ("critical", "eta", 0.04): (0.5, 0.8), ("critical", "eta", 0.1): (0.5, 0.8),
    **{(state, "Z", mu_iso): (3.3, 5.5) for state in ("peak", "critical") for mu_iso in (0.001, 0.04, 0.1)},
}  # fmt: skip

#: Table 1: property -> (family, median in SI, sigma_ln, Kolmogorov-Smirnov distance).
MARGINALS = {"mu_s": ("lognormal", 0.214, 0.469, 0.123), "G_p": ("lognormal", 25.7e9, 0.354, 0.102)}

#: Table 2: copula family -> (parameters, AIC).
COPULAS = {
    "gaussian": ((-0.738,), -59.25), "student": ((-0.722, 6.05), -57.94),
    "frank": ((-5.40,), -43.68), "plackett": ((0.198,), -41.78),
}  # fmt: skip

#: Kendall's tau of its copula, 2 / pi arcsin(-0.738).
TAU = -0.528

SIGMA_3, SIGMA_LN = 100e3, 0.174  # Pa; standard deviation of ln d by mass
GRADING_INDEX = 1.19
GRADING_INDEX_COV = 0.001
STEADY_STRAIN = 0.25
PARTICLES = 23312
POINTS = 100

#: Friction of spheres -> shear stress over mean stress in slow simple shear at large strain.
SIMPLE_SHEAR = {0.1: 0.268, 0.5: 0.382}
SOURCE = (
    "Chialvo, Sun & Sundaresan (2012), Phys. Rev. E 85, 021305; the numbers are those of the case jetBedPU of the "
    "public solver twoPhaseEulerPimpleFoamPU, which uses their model, because the article itself was not available"
)
#: Critical surfaces, as invariants of the principal stresses (p = 1) that are constant on them.
SURFACES = {
    "Lade-Duncan": lambda a, b, c: (a + b + c) ** 3 / (a * b * c),
    "Matsuoka-Nakai": lambda a, b, c: (a + b + c) * (a * b + b * c + c * a) / (a * b * c),
}


def in_triaxial_compression(ratio: float, surface: str) -> float:
    """Stress ratio eta = q/p of triaxial compression on the critical surface through simple shear at tau/p = `ratio`.

    The three normal stresses of simple shear are taken as equal: principal stresses 1 + ratio, 1 and 1 - ratio over p.
    """
    invariant = SURFACES[surface]
    level = invariant(1 + ratio, 1.0, 1 - ratio)
    return brentq(lambda eta: invariant(1 + 2 * eta / 3, 1 - eta / 3, 1 - eta / 3) - level, 1e-6, 2.9)


def beside_published(friction_table: pd.DataFrame) -> pd.DataFrame:
    """Published critical stress ratios in triaxial compression beside those of a `friction.friction_table`.

    One row per friction that both have: `here`, the mean over the densities, the published value by either surface, and
    the difference of `here` from it in %.
    """
    critical = friction_table[(friction_table["state"] == "critical") & (friction_table["quantity"] == "eta")]
    rows = []
    for mu_s, ratio in SIMPLE_SHEAR.items():
        here = critical.loc[np.isclose(critical["mu_s"].astype(float), mu_s), "value"].mean()
        if np.isnan(here):
            continue
        row = {"mu_s": mu_s, "published_tau_over_p": ratio, "here": here}
        for surface in SURFACES:
            row[surface] = in_triaxial_compression(ratio, surface)
            row[f"{surface}_difference_pct"] = 100 * (here / row[surface] - 1)
        rows.append(row)
    return pd.DataFrame(rows)
