"""Words with symbols and units for every column of a table on the page, and for the values of the usual columns."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from ..quantities import INPUTS, QUANTITIES

#: Column of a frame -> heading on the page.  Units stand in the heading, or in the cell where rows have several.
HEADINGS = {
    "density": "Density", "quantity": "Quantity", "state": "State", "standing": "Standing", "reason": "Reason",
    "family": "Runs", "stage": "Stage", "method": "Method", "points": "Points", "spheres": "Spheres", "runs": "Runs",
    "mean": "Mean", "sd": "Standard deviation", "q05": "5 % quantile", "q50": "Median", "q95": "95 % quantile",
    "COV": "Coefficient of variation", "here": "This campaign", "paper": "The paper",
    "difference_pct": "Difference (%)", "before_shear": "Before shear",
    "property": "Property", "distribution": "Distribution", "parameters": "Parameters with standard errors",
    "given_parameters": "Parameters",
    "copula": "Copula", "aic": "AIC", "bic": "BIC", "ks": "Kolmogorov–Smirnov distance",
    "ks_critical": "5 % limit, parameters known", "ks_critical_fitted": "5 % limit, parameters fitted",
    "ad": "Anderson–Darling statistic", "ad_critical_fitted": "5 % limit of it, parameters fitted",
    "kendall": "Kendall's tau", "S": "Cramér–von Mises distance S", "p_bootstrap": "Bootstrap p-value",
    "p_paper": "The paper's p-value", "accepted": "Accepted",
    "planned": "Planned", "done": "Done", "failed": "Failed", "spared": "Not needed",
    "steady_early": "Ended early, steady", "core_hours": "Core-hours", "mean_steps": "Steps, mean",
    "extended": "Continued as steady", "lost_probability": "Lost probability",
    "mu_s": "Interparticle friction mu_s", "G_p_GPa": "Shear modulus G_p (GPa)",
    **{f"only_{symbol}": f"Only {symbol}" for symbol in INPUTS},
    **{f"shapley_{symbol}": f"Shapley effect of {symbol}" for symbol in INPUTS}, "shared": "Either of the two",
    "noise": "Noise, both kinds", "packing": "Noise of packings", "own": "Noise of single runs",
    "run_error": "Standard error of one run", "runs_share": "Share of runs in the interval of the mean (%)",
    "mean_diff": "Mean (% of sd)", "sd_diff": "Standard deviation (%)", "q05_diff": "5 % quantile (% of sd)",
    "q50_diff": "Median (% of sd)", "q95_diff": "95 % quantile (% of sd)",
    "W1": "Wasserstein distance, largest (% of sd)", "W1_average": "Wasserstein distance, average (% of sd)",
    "kernel_share": "Kernel width over standard deviation", "spacing_share": "Spacing of the points over it",
    "proof": "Check", "median": "Median of the runs", "largest": "Largest", "limit": "Limit",
    "run_of_the_largest": "Run of the largest",
    "off_diagonal_pct": "Largest shear stress over sigma_1 (%)",
    "eta_windows_pct": "Principal eta higher by, per window (%)", "eta_mean_pct": "Principal eta higher by, mean "
    "tensor (%)",
    "estimate": "Peaks taken from", "mean_bias": "Mean bias of eta, subtracted",
    "no_interior_peak": "Points without an interior peak",
    "dilatancy": "Mean D", "ratio": "Mean ratio", "lowest": "Lowest", "highest": "Highest",
    "target": "Error asked for", "shear_runs": "Shear runs", "share_of_runs": "Share of all runs",
    "claimed": "Error claimed", "claimed_for": "Response with that error",
    "error_all_runs": "Error against all runs", "worst_in": "Response with that error against all runs",
    "error_surface": "Error against the model of all runs", "verdict": "Verdict",
    "claim": "Statement of the paper", "value": "Value (95 % interval)", "number": "What the number is",
    "criterion": "Criterion", "response": "Response", "symbol": "Symbol", "meaning": "Meaning", "name": "Name",
    "key": "Item", "text": "Value",
    "end": "End", "probability": "Probability (95 % interval)", "strains": "Strain: first, median, last (%)",
    "which": "Points", "fitted_to": "Line through", "e_100": "Void ratio at 100 kPa", "slope": "Slope per ln p'",
    "scatter": "Scatter of e", "slope_given_inputs": "Slope at given grain properties",
    "scatter_given_inputs": "Scatter at given grain properties", "range": "Range of p' (kPa)",
    "eta_extension": "Mean eta in extension", "holds_for": "Holds for (%)",
}  # fmt: skip
STATES = {"initial": "before shear", "transformation": "phase transformation", "peak": "peak",
          "strength": "10 % axial strain", "critical": "critical", "probe": "small strain"}  # fmt: skip
FAMILIES = {"coupled": "all inputs vary", "G_p": "only G_p varies", "shared": "for all points", "": ""}
STAGES = {"consolidate": "consolidation", "probe": "small-strain probe", "shear": "shear", "all": "all"}


#: Order of quantities and states in the rows of a table.
QUANTITY_ORDER = (
    "eta",
    "p",
    "q",
    "u",
    "r_u",
    "s_u",
    "eps_pt",
    "e",
    "e_m",
    "Z",
    "Z_m",
    "Phi_dev",
    "D_p",
    "G_0",
    "I_G_active",
    "I_G_stress",
)


def in_order(frame: pd.DataFrame) -> pd.DataFrame:
    """A frame with its rows by quantity, state and density, each in the usual order."""
    ranks = {"quantity": QUANTITY_ORDER.index, "state": [*STATES].index}
    keys = [name for name in ("quantity", "state", "mu_iso") if name in frame]
    return frame.sort_values(keys, key=lambda c: c.map(ranks[c.name]) if c.name in ranks else c, kind="stable")


def readable(frame: pd.DataFrame, names: Mapping[float, str]) -> pd.DataFrame:
    """A frame with words in place of mu_iso (`names`), quantity and unit, state, stage and family."""
    words = {"state": STATES, "stage": STAGES, "family": FAMILIES}
    shown = frame.assign(**{name: frame[name].map(text) for name, text in words.items() if name in frame})
    if "quantity" in frame:
        shown["quantity"] = [quantity_words(symbol) for symbol in frame["quantity"]]
    if "mu_iso" in frame:
        shown = shown.rename(columns={"mu_iso": "density"}).assign(density=[names[m] for m in frame["mu_iso"]])
    return shown.drop(columns="unit", errors="ignore")


def quantity_words(symbol: str) -> str:
    """Name, symbol and displayed unit of a quantity, such as "small-strain stiffness G_0 (MPa)"."""
    quantity = QUANTITIES[symbol]
    unit = {"1": "", "deg": " (°)"}.get(quantity.shown_unit or quantity.unit, f" ({quantity.shown_unit})")
    shown = "p'" if symbol == "p" else symbol
    return f"{quantity.name[0].lower()}{quantity.name[1:]} {shown}{unit}"
