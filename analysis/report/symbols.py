"""Symbols as the page shows them: the names of the code in a text become Greek letters and subscripts."""

from __future__ import annotations

import html
import re

#: Name in the code -> letter and subscript on the page.
SYMBOLS = {
    "eta": ("η", ""), "phi": ("φ", ""), "mu_s": ("μ", "s"), "mu_iso": ("μ", "iso"), "G_p": ("G", "p"),
    "G_0": ("G", "0"), "K_0": ("K", "0"), "e_m": ("e", "m"), "Z_m": ("Z", "m"), "D_p": ("D", "p"),
    "Phi_dev": ("Φ", "dev"),
    "Phi_1": ("Φ", "1"), "Phi_3": ("Φ", "3"), "sigma_1": ("σ", "1"), "sigma_3": ("σ", "3"), "sigma_ln": ("σ", "ln"),
    "eps_a": ("ε", "a"), "eps_v": ("ε", "v"), "eps_q": ("ε", "q"), "I_G": ("I", "G"), "d50": ("d", "50"),
    "I_G_active": ("I", "G, active"), "I_G_stress": ("I", "G, stress"), "N_c": ("N", "c"), "N_0": ("N", "0"),
    "N_1": ("N", "1"), "E_p": ("E", "p"), "V_s": ("V", "s"), "rho": ("ρ", ""), "tau": ("τ", ""), "theta": ("θ", ""),
    "nu": ("ν", ""),
    "r_u": ("r", "u"), "s_u": ("s", "u"), "eps_pt": ("ε", "a, pt"), "sigma_a": ("σ", "a"), "sigma_r": ("σ", "r"),
}  # fmt: skip
_NAMES = re.compile(r"(?<![\w.])(" + "|".join(sorted(SYMBOLS, key=len, reverse=True)) + r")(?!\w|\.\w)")
#: Comparisons in the text of a criterion.
_SIGNS = {"<=": "≤", ">=": "≥"}


def marked(text: object) -> str:
    """Text as HTML: escaped, with letters and subscripts for the names of quantities."""
    return _NAMES.sub(lambda m: _with_subscript(*SYMBOLS[m[1]]), _escaped(text))


def plain(text: object) -> str:
    """Text for an attribute or a title: escaped, with letters and an underscore before a subscript."""
    return _NAMES.sub(lambda m: "_".join(filter(None, SYMBOLS[m[1]])), _escaped(text))


def _escaped(text: object) -> str:
    words = str(text)
    for sign, shown in _SIGNS.items():
        words = words.replace(sign, shown)
    return html.escape(words, quote=True)


def _with_subscript(letter: str, below: str) -> str:
    return f"{letter}<sub>{below}</sub>" if below else letter
