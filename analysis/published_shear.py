"""Published critical states of spheres in simple shear, brought to triaxial compression, beside a campaign's own."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.optimize import brentq

#: Friction of spheres -> shear stress over mean stress in slow simple shear at large strain.
SIMPLE_SHEAR = {0.1: 0.268, 0.5: 0.382}
SOURCE = (
    "Chialvo, Sun & Sundaresan (2012), Phys. Rev. E 85, 021305, read in the case jetBedPU of the public solver "
    "twoPhaseEulerPimpleFoamPU that is built on it, the article itself not being at hand"
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


def beside_published(friction_table) -> pd.DataFrame:
    """Published critical stress ratios in triaxial compression beside those of a `friction_effect.friction_table`.

    One row a friction that both have: `here`, the mean over the densities, the published value by either surface, and
    what `here` is off by in %.
    """
    critical = friction_table[(friction_table["state"] == "critical") & (friction_table["quantity"] == "eta")]
    rows = []
    for mu_s, ratio in SIMPLE_SHEAR.items():
        here = critical.loc[np.isclose(critical["mu_s"], mu_s), "value"].mean()
        if np.isnan(here):
            continue
        row = {"mu_s": mu_s, "published tau/p": ratio, "here": here}
        for surface in SURFACES:
            row[surface] = in_triaxial_compression(ratio, surface)
            row[f"off {surface} (%)"] = 100 * (here / row[surface] - 1)
        rows.append(row)
    return pd.DataFrame(rows)
