"""The words of the report that depend on the test: drained, constant p' or undrained, compression or extension."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from ..quantities import DRAINED, EARLY_ENDS, Loading
from ..results.reader import Results
from . import page

Frames = Mapping[str, pd.DataFrame]
#: Cap of p' (MPa) at which an undrained test ends as stiff, where the settings do not state it.
CAP_MPA = 10.0
#: Meanings of quantities in extension, undrained and at constant p', for the glossary.
EXTENSION = {
    "eps_a": "logarithmic strain along z since the start of shear, shown positive in extension",
    "p": "(sigma_a + 2 sigma_r) / 3",
    "q": "sigma_a - sigma_r, axial minus lateral stress; negative in extension",
    "eta": "q / p', negative in extension",
    "phi": "arcsin(3 |eta| / (6 - |eta|)), in triaxial extension",
    "D_p": "-d eps_v^p / d |eps_q^p|, positive where the soil dilates",
}
OF_SIGMA_3 = {
    "constant_p": "isotropic stress after consolidation; p' keeps this value",
    "undrained": "isotropic stress after consolidation, and the constant total lateral stress",
}
#: Symbols of the glossary that undrained tests do not have, and those that only they have.
NOT_UNDRAINED, UNDRAINED = ("eps_v", "D_p"), ("u", "r_u", "s_u", "eps_pt")
TERMS_UNDRAINED = {
    "phase transformation": "smallest p' of a test, if p' rises again by a tenth at least",
    "liquefied": "p' fell below 5 % of its start for good; the test ends there",
    "stiff": "p' rose above a cap, beyond which grains would crush; the test ends there",
    "conditional": "a number that holds for the tests that have not ended; their probabilities are scaled to the sum 1",
}


def made(loading: Loading, stress: str) -> str:
    """What is done after consolidation, as a part of a sentence; stress: " of 100 kPa", or other words, or ""."""
    if loading.path == "constant_p":
        return f"triaxial {loading.direction} at a constant mean effective stress{stress}"
    if loading.is_undrained:
        return f"undrained triaxial {loading.direction}, that is at constant volume, from an isotropic stress{stress}"
    return f"{loading.words} at a constant confining stress{stress}"


def further(results: Results) -> list[str]:
    """Sentences on signs, and on ends of undrained tests, for tests other than drained compression."""
    loading = results.loading
    if loading == DRAINED:
        return []
    words = ["The Lode angle is 30° (triaxial compression)."]
    if loading.sign < 0:
        words = ["The axial stress is the smallest one: the Lode angle is −30° (triaxial extension), deviatoric stress "
                 "and stress ratio are negative, and the axial extension is shown as a positive strain."]  # fmt: skip
    if loading.is_undrained:
        cap = results.attrs["settings"].get("shear", {}).get("stiff_cap_MPa", CAP_MPA)
        words.append(
            "Stresses are effective stresses; the excess pore pressure u is what the effective lateral stress has "
            "lost, since the total lateral stress is constant. A test ends before its strain if it liquefies (p' below "
            f"5 % of its start for good) or becomes stiff (p' above {cap:g} MPa, beyond which grains would crush). "
            "Both are results: the point keeps its probability, and the numbers of the other points hold for the tests "
            "that go on."
        )
    return [" ".join(words)]


def picture(loading: Loading, stress: str, strain: str) -> tuple[str, str, str]:
    """Two lines below the picture of the test (without and with the symbol's value), and its description."""
    below = {"constant_p": "p' constant, lateral stress follows", "undrained": "volume constant, no drainage"}
    before = {"constant_p": "stress at the start", "undrained": "stress at the start"}
    words = f"{loading.words[0].upper()}{loading.words[1:]} of spheres: axial strain to {strain}, "
    if loading.path == "drained":
        return "lateral stress", "constant", f"{words}lateral stress{stress} constant"
    held = {"constant_p": "mean effective stress constant", "undrained": "volume constant"}[loading.path]
    return before[loading.path], below[loading.path], f"{words}stress at the start{stress}, {held}"


def meaning(loading: Loading, symbol: str, usual: str) -> str:
    """Meaning of a quantity in the glossary."""
    if symbol == "sigma_3" and loading.path in OF_SIGMA_3:
        return OF_SIGMA_3[loading.path]
    if symbol == "eps_v" and loading.path != "drained":
        return usual
    return EXTENSION.get(symbol, usual) if loading.sign < 0 else usual


def holds_for(rows: pd.DataFrame, ends: pd.DataFrame) -> str:
    """For which probability the numbers of a state hold, and what became of the rest; "" if all tests reached it.

    rows: of one density and state of `quote`; ends: the table of ends.
    """
    if "holds_for" not in rows or not len(rows) or rows["holds_for"].min() >= 1.0:
        return ""
    share, state = float(rows["holds_for"].max()), rows.iloc[0]["state"]
    of_density = ends[(ends["mu_iso"] == rows.iloc[0]["mu_iso"]) & (ends["family"] == "coupled")]
    parts = [f"{percent(row['probability'])} {EARLY_ENDS[row['end']]}" for _, row in of_density.iterrows()
             if row["end"] in EARLY_ENDS and row["points"]]  # fmt: skip
    if state == "transformation":
        return "no test shows one" if share == 0 else f"shown by {percent(share)} of the probability"
    before = f": {page.listed(parts)} before" if state in ("critical", "strength") and parts else ""
    return f"no test reached it{before}" if share == 0 else f"holds for {percent(share)} of the probability{before}"


def percent(share: float) -> str:
    """A probability in words, such as "28 %"; not 0 or 100 % unless it is exactly that."""
    rounded = f"{100 * share:.0f}"
    if rounded in ("0", "100") and 0.0 < share < 1.0:
        return "less than 1 %" if rounded == "0" else "more than 99 %"
    return f"{rounded} %"
