"""Responses along interparticle friction: values and errors at given mu_s, and the differences between densities.

The grain properties depend on each other, so all others are set to their regressions on mu_s over the representative
points, in logarithms; constant ones keep their value.  Values come from the model of all runs of a density: the noise
of packings and runs averages out.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..quantities import QUANTITIES
from ..results.models import model_of, runs_needed, state_model
from ..results.reader import Results, Runs
from ..surrogates.surrogate import Surrogate
from .columns import unit

#: Frictions that are tabled, as far as the runs reach.
FRICTIONS = (0.065, 0.10, 0.15, 0.25, 0.40, 0.50, 0.65)
RESPONSES = (("peak", "eta"), ("critical", "eta"), ("critical", "e"), ("critical", "Z"))
#: Those of undrained tests.
UNDRAINED = (("transformation", "eta"), ("peak", "eta"), ("critical", "eta"), ("critical", "Z"))
LEVEL = 0.95
COLUMNS = ["state", "quantity", "unit", "mu_s", "G_p_GPa", "mu_iso", "value", "ci95", "diff_from_mean", "diff_ci95",
           "differs"]  # fmt: skip


def responses(results: Results) -> tuple[tuple[str, str], ...]:
    """States and quantities of a campaign that are followed along friction."""
    return UNDRAINED if results.loading.is_undrained else RESPONSES


def variable_along(results: Results, symbol: str, mu_s: np.ndarray) -> np.ndarray:
    """Median (n,) in SI units of an input at the frictions mu_s (n,), such as G_p: mu_s itself, or the regression.

    The regression is that of the logarithms over the weighted points.
    """
    points = results.family_points()
    if symbol == "mu_s" or symbol in points.constants:
        return np.asarray(mu_s, float) if symbol == "mu_s" else np.full(len(mu_s), points.constants[symbol])
    line = np.polyfit(np.log(points.mu_s), np.log(points[symbol]), 1, w=np.sqrt(points.probability))
    return np.exp(np.polyval(line, np.log(mu_s)))


def along_friction(
    results: Results, state: str, symbol: str, mu_s: np.ndarray
) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """mu_iso -> values and 95 % half widths (n,) of a state's quantity at the frictions mu_s (n,), in SI units.

    From the model, whose error contains the noise of packings if there are three or more.  Densities with too few runs
    (`runs_needed`, 12 for two inputs) are left out; none is given if one lacks the quantity or mu_s is not random.
    """
    runs = _runs(results, state, symbol)
    return {m: _at(results, state_model(results, state, symbol, m), mu_s) for m in runs}


def has_curves(results: Results) -> bool:
    """Whether any state can be given along friction."""
    return any(_runs(results, *response) for response in RESPONSES)


def differences_along(
    results: Results, state: str, symbol: str, mu_s: np.ndarray
) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """mu_iso -> difference from the mean of all densities and its 95 % half width (n,) at the frictions mu_s (n,).

    A point has the same packing number at every density, so the model is that of the runs' differences: what the
    densities share does not count.  NaN with one density, or if too few points have a value at all of them.
    """
    runs = _runs(results, state, symbol)
    if len(runs) < 2:
        return {m: (np.full(len(mu_s), np.nan), np.full(len(mu_s), np.nan)) for m in runs}
    mean = np.mean([r.values for r in runs.values()], axis=0)
    models = {m: model_of(results, r._replace(values=r.values - mean)) for m, r in runs.items()}
    unknown = (np.full(len(mu_s), np.nan), np.full(len(mu_s), np.nan))
    return {m: unknown if model is None else _at(results, model, mu_s) for m, model in models.items()}


def _runs(results: Results, state: str, symbol: str) -> dict[float, Runs]:
    """The runs of every density with enough of them; none if a density lacks the quantity or mu_s is not random."""
    densities = results.family_densities()
    if "mu_s" not in results.points.names or any(symbol not in results.state_symbols(state, m) for m in densities):
        return {}
    runs = {m: results.runs_at(state, symbol, m) for m in densities}
    return {m: r for m, r in runs.items() if np.isfinite(r.values).sum() >= runs_needed(results)}


def _at(results: Results, model: Surrogate | None, mu_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and 95 % half widths (n,) of a model at the frictions mu_s (n,)."""
    assert model is not None  # _runs gives densities of enough runs
    asked = np.column_stack([variable_along(results, name, mu_s) for name in results.points.names])
    value = model.predict(asked)[0]
    off = model.draws(400, np.random.default_rng(1)).predict(asked)[:, 0] - value
    return value, np.quantile(np.abs(off), LEVEL, axis=0)


def friction_table(results: Results) -> pd.DataFrame:
    """Peak and critical states at seven frictions and every density, in displayed units, beside the densities' mean.

    `ci95` is the 95 % half width of `value`.  `differs`: "yes" where a value differs from the mean over the densities
    at its friction by more than the 95 % half width of the difference; "not shown" otherwise; empty with
    fewer than three packings, whose noise is not known, or with one density.  Frictions beyond the runs of some density
    are left out.
    """
    rows = []
    points, densities = results.family_points().mu_s, results.family_densities()
    for state, symbol in responses(results):
        if "mu_s" not in results.points.names or any(symbol not in results.state_symbols(state, m) for m in densities):
            continue
        run = np.all([np.isfinite(results.measured(state, symbol, m)) for m in densities], axis=0)
        mu_s = np.array([mu for mu in FRICTIONS if run.any() and points[run].min() <= mu <= points[run].max()])
        by_density, factor = along_friction(results, state, symbol, mu_s), QUANTITIES[symbol].shown_factor
        modulus = variable_along(results, "G_p", mu_s) * QUANTITIES["G_p"].shown_factor
        differences = differences_along(results, state, symbol, mu_s)
        for mu_iso, (value, half) in by_density.items():
            off, wide = differences[mu_iso]
            model = state_model(results, state, symbol, mu_iso)
            noise_is_known = len(by_density) > 1 and model is not None and model.knows_packings
            for k, mu in enumerate(mu_s):
                differs = "" if not noise_is_known else "yes" if abs(off[k]) > wide[k] else "not shown"
                rows.append((state, symbol, unit(symbol), mu, modulus[k], mu_iso, factor * value[k],
                             factor * half[k], factor * off[k], factor * wide[k], differs))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)


def friction_curves(results: Results, count: int = 60) -> pd.DataFrame:
    """States along friction for a picture: `count` values of mu_s over the range of the points, in displayed units.

    Columns state, quantity, unit, mu_iso, mu_s, value and its 95 % half width ci95 (`along_friction`).  Where tests
    ended early, the range is that of the points that reached the state.
    """
    points = results.family_points()
    mu_s = np.geomspace(points.mu_s.min(), points.mu_s.max(), count if "mu_s" in points.names else 1)
    parts = []
    for state, symbol in responses(results):
        factor = QUANTITIES[symbol].shown_factor
        for mu_iso, (value, half) in along_friction(results, state, symbol, mu_s).items():
            columns = {"state": state, "quantity": symbol, "unit": unit(symbol), "mu_iso": mu_iso, "mu_s": mu_s}
            frame = pd.DataFrame(columns | {"value": value * factor, "ci95": half * factor})
            if results.has_early_ends(mu_iso):
                reached = points.mu_s[np.isfinite(results.measured(state, symbol, mu_iso))]
                frame = frame[(frame["mu_s"] >= reached.min()) & (frame["mu_s"] <= reached.max())]
            parts.append(frame)
    empty = pd.DataFrame(columns=["state", "quantity", "unit", "mu_iso", "mu_s", "value", "ci95"])
    return pd.concat(parts, ignore_index=True) if parts else empty


def density_differences(table: pd.DataFrame) -> pd.DataFrame:
    """One row: how much the critical stress ratio at a given friction differs between densities, from `friction_table`.

    `densities`; `differences` that can be decided; `largest_pct` of them and the widest 95 % half width
    `widest_ci95_pct`, in % of the densities' mean; how many lie `outside` their interval.
    """
    critical = table[(table["state"] == "critical") & (table["quantity"] == "eta")]
    decided = critical[critical["differs"].isin(["yes", "not shown"])]
    mean = decided["value"] - decided["diff_from_mean"]
    return pd.DataFrame([{
        "densities": critical["mu_iso"].nunique(),
        "differences": len(decided),
        "outside": int((decided["differs"] == "yes").sum()),
        "largest_pct": 100 * (decided["diff_from_mean"] / mean).abs().max(),
        "widest_ci95_pct": 100 * (decided["diff_ci95"] / mean.abs()).max(),
    }])  # fmt: skip
