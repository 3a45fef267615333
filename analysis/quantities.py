"""Registry of all quantities: symbol, name, unit, shape, meaning and source, each stated once.

The writer and the reader of runs, the tables, the axis labels and the documentation take names and units from here.
This module imports the standard library only, so that `yade_scripts` can use it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple


@dataclass(frozen=True)
class Quantity:
    """One quantity: values are in the SI `unit`, tables and figures show `shown_unit`.

    `shape` is the shape of one sample: "" for a scalar, "3" for a vector, "3,3" for a tensor.
    `shown_factor` converts the SI value to the shown one (value * shown_factor, in shown_unit).  `equation` is the
    number in the paper or another source, `tex` the symbol on axis labels.
    """

    symbol: str
    name: str
    unit: str
    meaning: str
    equation: str = ""
    shape: str = ""
    tex: str = ""
    shown_unit: str = ""
    shown_factor: float = 1.0

    @property
    def label(self) -> str:
        """Axis label with the displayed unit, e.g. 'Particle shear modulus $G_p$ (GPa)'."""
        sign = f" ${self.tex}$" if self.tex else ""
        return f"{self.name}{sign}{self._unit}"

    @property
    def heading(self) -> str:
        """Symbol with the displayed unit, for tables, e.g. 'G_p (GPa)'."""
        return self.symbol + self._unit

    @property
    def _unit(self) -> str:
        unit = self.shown_unit or self.unit
        return f" ({unit})" if unit not in ("", "1") else ""


def _table(*rows: Quantity) -> dict[str, Quantity]:
    return {row.symbol: row for row in rows}


_kPa: dict[str, Any] = {"shown_unit": "kPa", "shown_factor": 1e-3}
_MPa: dict[str, Any] = {"shown_unit": "MPa", "shown_factor": 1e-6}
_GPa: dict[str, Any] = {"shown_unit": "GPa", "shown_factor": 1e-9}
_mm: dict[str, Any] = {"shown_unit": "mm", "shown_factor": 1e3}
_pct: dict[str, Any] = {"shown_unit": "%", "shown_factor": 100.0}

#: Inputs of a run.
INPUTS = _table(
    Quantity("mu_s", "Interparticle friction", "1", "Coulomb coefficient of every contact in shear", tex=r"\mu_s"),
    Quantity("G_p", "Particle shear modulus", "Pa", "shear modulus of the grains' material", tex="G_p", **_GPa),
    Quantity("mu_iso", "Consolidation friction", "1", "interparticle friction while consolidating", tex=r"\mu_{iso}"),
    Quantity("nu", "Particle Poisson's ratio", "1", "Poisson's ratio of the grains' material", tex=r"\nu"),
    Quantity("rho", "Grain density", "kg/m3", "density of the grains", tex=r"\rho"),
    Quantity("sigma_3", "Confining stress", "Pa", "lateral stress held by the servo", tex=r"\sigma_3", **_kPa),
    Quantity("d50", "Median grain size", "m", "diameter that splits the mass in halves", tex="d_{50}", **_mm),
    Quantity("sigma_ln", "Grading width", "1", "standard deviation of ln d by mass", tex=r"\sigma_{\ln d}"),
    Quantity("N", "Number of spheres", "1", "spheres in the periodic cell", tex="N"),
)

#: Record of a run: averages over each output window, never single steps.
RECORD = _table(
    Quantity(
        "eps_a",
        "Axial strain",
        "1",
        "logarithmic strain along z since the start of shear, compression positive",
        tex=r"\varepsilon_a",
        **_pct,
    ),
    Quantity(
        "eps_v",
        "Volumetric strain",
        "1",
        "logarithmic volume strain, compression positive",
        tex=r"\varepsilon_v",
        **_pct,
    ),
    Quantity(
        "sigma",
        "Stress tensor",
        "Pa",
        "Love's sum over contacts, compression positive",
        "Eq. 21",
        "3,3",
        r"\sigma_{ij}",
        **_kPa,
    ),
    Quantity("cell", "Cell edges", "m", "edge lengths of the periodic cell", shape="3", tex="L_i", **_mm),
    Quantity("e", "Void ratio", "1", "(V - V_s) / V_s", tex="e"),
    Quantity(
        "e_m",
        "Mechanical void ratio",
        "1",
        "void ratio in which particles of fewer than two contacts are void",
        tex="e_m",
    ),
    Quantity("Z", "Coordination number", "1", "2 N_c / N", tex="Z"),
    Quantity(
        "Z_m", "Mechanical coordination number", "1", "(2 N_c - N_1) / (N - N_0 - N_1)", "Thornton 2000", tex="Z_m"
    ),
    Quantity("Phi", "Fabric tensor", "1", "mean of n_i n_j over contacts", "Eq. 17", "3,3", r"\Phi_{ij}"),
    Quantity("f_sliding", "Sliding fraction", "1", "share of contacts at the Coulomb limit", tex="f_s"),
    Quantity("I", "Inertial number", "1", "strain rate * d50 * sqrt(rho / p')", tex="I"),
    Quantity("F_unb", "Unbalanced force", "1", "mean resultant force over mean contact force", tex="F_{unb}"),
    Quantity("E_elastic", "Elastic energy", "J", "stored in normal and tangential contact springs"),
    Quantity("E_kinetic", "Kinetic energy", "J", "of the grains, about the mean flow of the cell"),
    Quantity("E_friction", "Frictional dissipation", "J", "since the start of shear"),
    Quantity("E_damping", "Damping dissipation", "J", "numerical damping, since the start of shear"),
    Quantity("W_boundary", "Boundary work", "J", "V sigma_ij d eps_ij summed since the start of shear"),
    Quantity("servo_mean", "Mean servo error", "1", "window mean of what the test holds over its target, minus one"),
    Quantity("servo_max", "Largest servo error", "1", "largest |held / target - 1| of the window's samples"),
)

#: Responses: derived at every strain and propagated by PDEM.
RESPONSES = _table(
    Quantity("eta", "Stress ratio", "1", "q / p'", tex=r"\eta = q/p'"),
    RECORD["e"],
    RECORD["e_m"],
    RECORD["Z"],
    RECORD["Z_m"],
    Quantity("Phi_dev", "Fabric anisotropy", "1", "Phi_1 - Phi_3", "Eq. 18", tex=r"\Phi_{dev}"),
    RECORD["eps_v"],
)

#: Scalars: one value per run and state, besides the responses at the peak and at the critical state.
SCALARS = _table(
    Quantity("p", "Mean effective stress", "Pa", "(sigma_1 + 2 sigma_3) / 3", tex="p'", **_kPa),
    Quantity("q", "Deviatoric stress", "Pa", "sigma_1 - sigma_3", tex="q", **_kPa),
    Quantity("phi", "Friction angle", "deg", "arcsin(3 eta / (6 + eta)), in triaxial compression", tex=r"\varphi"),
    Quantity(
        "eps_peak",
        "Axial strain at the peak",
        "1",
        "where the smoothed stress ratio is largest",
        tex=r"\varepsilon_{a,peak}",
        **_pct,
    ),
    Quantity("G_0", "Small-strain stiffness", "Pa", "dq / (3 d eps_q) of the constant-volume probe", tex="G_0", **_MPa),
    Quantity("K_0", "Small-strain bulk modulus", "Pa", "dp' / d eps_v at small strain", tex="K", **_MPa),
    Quantity("D_p", "Dilatancy at the peak", "1", "-d eps_v^p / d eps_q^p", tex="D^p"),
    Quantity("I_G", "Grading index", "1", "exp of the standard deviation of ln d by mass", "Eqs. 19-20", tex="I_G"),
    Quantity(
        "I_G_active",
        "Active grading index",
        "1",
        "I_G of the particles that carry stress",
        "Eqs. 19-20",
        tex="I_G^{active}",
    ),
    Quantity(
        "I_G_stress", "Stress grading index", "1", "I_G weighted by p^(m) V^(m)", "Eqs. 19, 23", tex="I_G^{stress}"
    ),
)

#: What only undrained tests have.  Their total lateral stress is constant: it is sigma_3 at the start.
UNDRAINED = _table(
    Quantity("u", "Excess pore pressure", "Pa", "sigma_3 minus the effective lateral stress", tex="u", **_kPa),
    Quantity("r_u", "Pore pressure ratio", "1", "u / sigma_3", tex="r_u"),
    Quantity("s_u", "Undrained strength", "Pa", "|q| / 2 at 10 % axial strain", tex="s_u", **_kPa),
    Quantity("eps_pt", "Axial strain at phase transformation", "1", "where the smoothed p' is smallest",
             tex=r"\varepsilon_{a,pt}", **_pct),
)  # fmt: skip

QUANTITIES: dict[str, Quantity] = {**INPUTS, **RECORD, **RESPONSES, **SCALARS, **UNDRAINED}

#: What a shear test holds: sigma_3 on the sides, p', or the volume.
PATHS = ("drained", "constant_p", "undrained")
DIRECTIONS = ("compression", "extension")
#: Ends of an undrained test before its strain: p' fell for good below 5 % of its start, or rose above a cap.
#: End -> what the test did, in words.
EARLY_ENDS = {"liquefied": "liquefied", "stiff": "became stiff"}


class Loading(NamedTuple):
    """The test that was made: what is held, and whether the axis shortens or lengthens."""

    path: str = "drained"
    direction: str = "compression"

    @property
    def sign(self) -> float:
        """1 in compression and -1 in extension: the sign of axial strain, q and eta."""
        return 1.0 if self.direction == "compression" else -1.0

    @property
    def is_undrained(self) -> bool:
        """Whether the volume is held."""
        return self.path == "undrained"

    @property
    def steady(self) -> dict[str, float]:
        """What must be steady at a critical state: symbol -> largest relative drift."""
        return {"eta": 0.05, "p": 0.05} if self.is_undrained else {"eta": 0.05, "e": 0.01}

    @property
    def words(self) -> str:
        """Name of the test, such as "undrained triaxial extension"."""
        path = {"constant_p": "constant-p' triaxial", "undrained": "undrained triaxial"}.get(
            self.path, "drained triaxial"
        )
        return f"{path} {self.direction}"

    @property
    def strain_label(self) -> str:
        """Axis label of the axial strain, which is shown positive in both directions."""
        label = QUANTITIES["eps_a"].label
        return label if self.sign > 0 else label.replace("Axial strain", "Axial extension")


#: The usual test, which files without a word of it have.
DRAINED = Loading()


def responses_of(path: str) -> dict[str, Quantity]:
    """The responses along strain of a path: symbol -> quantity."""
    if path != "undrained":
        return RESPONSES
    stresses = {symbol: {**SCALARS, **UNDRAINED}[symbol] for symbol in ("p", "q", "u", "r_u")}
    return {"eta": RESPONSES["eta"], **stresses, **{s: r for s, r in RESPONSES.items() if s not in ("eta", "eps_v")}}


#: The stages of a run that have states, and the states of each; the last two of shear are those of undrained tests.
STAGE_STATES = {"shear": ("initial", "peak", "critical", "transformation", "strength"), "probe": ("probe",)}
#: Axial strain at which the undrained strength is taken.
STRENGTH_STRAIN = 0.10

#: Quantities of the packing at the end of consolidation.
CONSOLIDATED = ("e", "e_m", "Z", "Z_m")


def parameter(symbol: str, name: str, value: float, error: float = math.nan) -> str:
    """Text of a fitted parameter `name` of the quantity `symbol` with its standard error, e.g. 'median = 25.7 ± 1 GPa'.

    A parameter has the unit of its quantity, but a shape and a standard deviation of the logarithm have none.
    """
    quantity = QUANTITIES[symbol]
    has_unit = not name.endswith(("shape", "sigma_ln")) and quantity.shown_factor != 1.0
    factor, unit = (quantity.shown_factor, f" {quantity.shown_unit}") if has_unit else (1.0, "")
    text = with_error(value * factor, error * factor) if math.isfinite(error) else f"{value * factor:.5g}"
    return f"{name} = {text}{unit}"


def decimals(error: float) -> int:
    """Decimals to which a value of this uncertainty is given; negative for tens, hundreds, ...

    The uncertainty has two digits if its first three are at most 354, and one digit otherwise (Particle Data Group).
    """
    exponent = math.floor(math.log10(error))
    first = round(error / 10.0 ** (exponent - 2))
    return 1 - exponent if first < 355 else -exponent


def rounded(value: float, error: float) -> tuple[str, str]:
    """Texts of a value and of its uncertainty, rounded together; rounding them once more changes nothing.

    Three digits and no second text if the uncertainty is not known or zero; a dash for a value that is not finite.
    """
    if not math.isfinite(value):
        return "–", ""
    if not (math.isfinite(error) and error > 0):
        return _three_digits(value), ""
    places = decimals(error)
    return _fixed(value, places), _fixed(error, places)


def with_error(value: float, error: float) -> str:
    """A value with its uncertainty as one text, e.g. '0.638 ± 0.017'; see `rounded`."""
    shown, half = rounded(value, error)
    return f"{shown} ± {half}" if half else shown


def _fixed(value: float, places: int) -> str:
    """A number with so many decimals, never '-0'."""
    number = round(value, places)
    return f"{number + 0.0 if number else 0.0:.{max(places, 0)}f}"


def _three_digits(value: float) -> str:
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    return _fixed(value, 2 - exponent) if -4 <= exponent < 6 else f"{value:.2e}"


#: Critical states are judged from this axial strain on, over at least one block (the correlation strain of the stress
#: ratio); a test that ends earlier has no critical state.
CRITICAL_FROM, CRITICAL_BLOCK = 0.25, 0.03

#: The rate law of shear: above the interparticle friction FULL_RATE_FRICTION the inertial number is at most
#: FULL_RATE * FULL_RATE_FRICTION / mu_s, because a higher rate changes Z there.  yade_scripts/rve.py has the same
#: numbers; a test compares them.
FULL_RATE_FRICTION, FULL_RATE = 0.3, 2.4e-3


def effective_inertial_number(asked: float, mu_s: float) -> float:
    """Inertial number at which a shear run is made: the one asked for, or the limit of the rate law if that is less."""
    return asked if mu_s <= FULL_RATE_FRICTION else min(asked, FULL_RATE * FULL_RATE_FRICTION / mu_s)
