"""Strength in triaxial extension predicted from compression, by two surfaces, and campaigns of both directions.

With p = 1 and x = eta / 3, triaxial principal stresses are 1 + 2 x and, twice, 1 - x.  The Lode angle is 30 degrees in
compression and -30 degrees in extension, the two ends of its range.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ..pdem import weighted
from ..results.reader import JUDGED_STATES, Results


def matsuoka_nakai_extension(eta: ArrayLike) -> np.ndarray:
    """Stress ratio in extension, negative, of the surface I1 I2 / I3 through eta in compression: -3 eta / (3 + eta).

    On it the friction angle is the same in compression and in extension, as on the surface of Mohr and Coulomb.
    """
    ratio = np.asarray(eta, float)
    return -3.0 * ratio / (3.0 + ratio)


def lade_duncan_extension(eta: ArrayLike) -> np.ndarray:
    """Stress ratio in extension, negative, of the surface I1^3 / I3 = constant through eta (0 to 3) in compression.

    2 x^3 - 3 x^2 has the same value at both, of which x = eta / 3 is one root; the negative root of what is left is
    x = (b - sqrt(b^2 + 8 x_c b)) / 4 with b = 3 - 2 x_c.
    """
    return _other_root(np.asarray(eta, float))


def matsuoka_nakai_compression(eta: ArrayLike) -> np.ndarray:
    """The inverse of `matsuoka_nakai_extension`: stress ratio in compression for eta (-1.5 to 0) in extension."""
    ratio = np.abs(np.asarray(eta, float))
    return 3.0 * ratio / (3.0 - ratio)


def lade_duncan_compression(eta: ArrayLike) -> np.ndarray:
    """The inverse of `lade_duncan_extension`: the positive root below 1 for x = eta / 3 (-1.5 to 0) in extension."""
    return _other_root(np.asarray(eta, float))


def _other_root(eta: np.ndarray) -> np.ndarray:
    b = 3.0 - 2.0 * eta / 3.0
    return 3.0 * (b - np.sqrt(b**2 + 8.0 * eta / 3.0 * b)) / 4.0


#: Surface -> stress ratio in extension for that in compression, and the other way round.
EXTENSION: dict[str, Callable[[ArrayLike], np.ndarray]] = {
    "Matsuoka-Nakai": matsuoka_nakai_extension, "Lade-Duncan": lade_duncan_extension,
}  # fmt: skip
COMPRESSION: dict[str, Callable[[ArrayLike], np.ndarray]] = {
    "Matsuoka-Nakai": matsuoka_nakai_compression, "Lade-Duncan": lade_duncan_compression,
}  # fmt: skip


def extension_strength(results: Results) -> pd.DataFrame:
    """Per density and state of an extension campaign: mean eta, and the one in compression by either surface.

    Without columns for a compression campaign.
    """
    if results.loading.sign > 0:
        return pd.DataFrame()
    rows = []
    for mu_iso in results.family_densities():
        for state in JUDGED_STATES:
            eta, probability = results.shown_state(state, "eta", mu_iso), results.probability(mu_iso)
            row = {"mu_iso": mu_iso, "state": state, "eta_extension": float(weighted.mean(eta, probability))}
            known = np.where(eta < 0, eta, np.nan)
            for name, surface in COMPRESSION.items():
                row[f"{name}_compression"] = float(weighted.mean(surface(known), probability))
            rows.append(row)
    return pd.DataFrame(rows)


def directions(campaigns: Sequence[tuple[str, Results]]) -> pd.DataFrame:
    """Extension beside what compression predicts: one row per pair of campaigns, density and state.

    campaigns: name and results; the columns `compression` and `extension` name them.  `eta_compression` and
    `eta_extension` are means over the points; each surface has a column of the mean prediction over the points of the
    compression campaign, and one of the difference of the extension campaign from it in %, of the magnitude.  No rows
    unless both directions are there with the same density.
    """
    rows = []
    of_compression = [(name, results) for name, results in campaigns if results.loading.sign > 0]
    of_extension = [(name, results) for name, results in campaigns if results.loading.sign < 0]
    for one, first in of_compression:
        for other, second in of_extension:
            for mu_iso in first.family_densities():
                same = next((m for m in second.family_densities() if abs(m - mu_iso) <= 1e-9 * mu_iso), None)
                if same is not None:
                    rows += [_pair(one, first, other, second, mu_iso, same, state) for state in JUDGED_STATES]
    columns = ["compression", "extension", "mu_iso", "state", "eta_compression", "eta_extension"]
    columns += [column for name in EXTENSION for column in (name, f"{name}_difference_pct")]
    return pd.DataFrame(rows, columns=columns)


def _pair(
    one: str, first: Results, other: str, second: Results, mu_iso: float, same: float, state: str
) -> dict[str, object]:
    eta, probability = first.shown_state(state, "eta", mu_iso), first.probability(mu_iso)
    found = float(weighted.mean(second.shown_state(state, "eta", same), second.probability(same)))
    row: dict[str, object] = {"compression": one, "extension": other, "mu_iso": mu_iso, "state": state}
    row |= {"eta_compression": float(weighted.mean(eta, probability)), "eta_extension": found}
    for name, surface in EXTENSION.items():
        predicted = float(weighted.mean(surface(np.where(eta > 0, eta, np.nan)), probability))
        row |= {name: predicted, f"{name}_difference_pct": 100 * (found / predicted - 1)}
    return row
