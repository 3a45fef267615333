"""Quality of the runs: their outcome and proofs, packing noise, widths of the PDFs, lost probability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ..pdem import weighted
from ..quantities import QUANTITIES, Loading
from ..results.models import state_model
from ..results.reader import JUDGED_STATES, Results
from ..runs.archive import SAME_STATES
from ..runs.states import OFF, PUSHED
from ..surrogates.surrogate import FEWEST_PACKINGS
from .columns import named, with_interval

#: Proof of a shear run -> words, and the limit beyond which a run fails (those of yade_scripts/proofs.py; NaN: none).
PROOFS = {
    "max_inertial_number": ("largest inertial number", 2.5e-3),
    "servo_mean_error": ("mean error of the confining stress", 0.01),
    "servo_max_error": ("largest error of the confining stress", 0.05),
    "energy_error": ("error of the energy balance", 0.10),
    "F_unb": ("unbalanced force over the mean contact force", float("nan")),
}
#: What another path holds in place of the confining stress, the limits of its mean and of a sample, and that of energy.
HELD = {"constant_p": ("the mean effective stress", 0.002, 0.02, 0.10), "undrained": ("the volume", 1e-9, 1e-9, 0.15)}
#: Quantities whose packing noise and PDF width are tabled; not e where the volume is held.
SHOWN = ("eta", "e", "Z", "Phi_dev")


def runs(results: Results) -> pd.DataFrame:
    """One row per run of the plan: its outcome, its cost and its proofs, and whether its packing collapsed."""
    return results.runs.assign(collapsed=collapsed_runs(results))


def collapsed_runs(results: Results) -> np.ndarray:
    """Which of `results.runs` (R,) are probes and shear runs that start from a collapsed packing.

    A packing collapses where its grains take on less friction than it was consolidated with: it loses contacts and
    becomes denser.  No limit of equilibrium is broken on the way, but the density that results depends on the grains'
    inertia too (data/benchmarks/stability.csv, cells whose mu_s is below mu_iso).
    """
    table, mu_s = results.runs, np.full(len(results.runs), np.inf)
    for family in results.families:
        points = results.family_points(family)
        of_family = (table["family"] == family).to_numpy() & (table["stage"] != "consolidate").to_numpy()
        mu_s[of_family] = table["point"][of_family].map(pd.Series(points.mu_s, index=points.id))
    return mu_s < table["mu_iso"].to_numpy(float)


def packing_collapse(results: Results) -> pd.DataFrame:
    """Per density: the largest share of its void ratio that a point's packing loses between consolidation and shear."""
    rows = []
    for mu_iso in results.family_densities():
        values, probability = results.consolidated("e", mu_iso)
        if len(values):
            least = np.nanmin(results.shown_state("initial", "e", mu_iso))
            rows.append((mu_iso, 1 - least / (values @ probability)))
    return pd.DataFrame(rows, columns=["mu_iso", "largest_loss_of_e"])


def run_counts(results: Results) -> pd.DataFrame:
    """One row per stage and family, and a total: runs planned, done, failed, spared, ended as steady; core-hours."""
    table = results.runs
    parts = [(stage, family, part) for (stage, family), part in table.groupby(["stage", "family"], sort=False)]
    rows = []
    for stage, family, part in [*parts, ("all", "", table)]:
        counts = {word: int((part["status"] == word).sum()) for word in ("done", "failed", "spared")}
        rows.append(
            {"stage": stage, "family": family, "planned": len(part), **counts,
             "steady_early": int((part["reason"] == "steady").sum()),
             "core_hours": part["cpu_seconds"].sum() / 3600, "mean_steps": part["steps"].mean()}
        )  # fmt: skip
    return pd.DataFrame(rows)


def proofs_of(loading: Loading) -> dict[str, tuple[str, float]]:
    """Proof of a shear run -> words and limit, in a test."""
    if loading.path not in HELD:
        return PROOFS
    what, mean, sample, energy = HELD[loading.path]
    held = {
        "servo_mean_error": (f"mean error of {what}", mean),
        "servo_max_error": (f"largest error of {what}", sample),
        "energy_error": (PROOFS["energy_error"][0], energy),
    }
    return PROOFS | held


def proofs(results: Results) -> pd.DataFrame:
    """Median and largest value of every proof over the shear runs that have it, and the limit of that proof."""
    shear = _done(results, "shear")
    rows = []
    for name, (words, limit) in proofs_of(results.loading).items():
        values = shear[name].abs().dropna()
        if len(values):
            rows.append((words, values.median(), values.max(), limit, shear.loc[values.idxmax(), "run_id"]))
    return pd.DataFrame(rows, columns=["proof", "median", "largest", "limit", "run_of_the_largest"])


def standings(results: Results) -> pd.DataFrame:
    """One row per family, density and judged state: its standing and the reason, one sentence with numbers."""
    rows = []
    for family in results.families:
        for mu_iso in results.family_densities(family):
            for state in JUDGED_STATES:
                standing = results.standing(state, mu_iso, family)
                rows.append((family, mu_iso, state, standing.status, standing.reason))
    return pd.DataFrame(rows, columns=["family", "mu_iso", "state", "standing", "reason"])


def archived_runs(results: Results) -> pd.DataFrame:
    """One row: how many runs come from an archive (runs.h5) whose states another version of the analysis measured."""
    present = results.attrs["versions"].get("analysis code", "")
    other = ~results.runs["measured_by"].isin(["", present, *SAME_STATES])
    return pd.DataFrame([{"other_version": int(other.sum())}])


def stress_axes(results: Results) -> pd.DataFrame:
    """Per density: how far the axes of the cell are from the principal axes of stress at the critical state, in %.

    Means over the shear runs that have recorded it: the largest off-diagonal stress over sigma_1, and how much higher
    the stress ratio of the principal stresses is, window by window and for the mean tensor.  eta itself is that of the
    axes.  No rows for runs that were archived by an earlier version.
    """
    columns = {"axes_off_diagonal": "off_diagonal_pct", "axes_eta_windows": "eta_windows_pct", "axes_eta_mean":
               "eta_mean_pct"}  # fmt: skip
    shear = _done(results, "shear").reindex(columns=["mu_iso", "family", "N", *columns])
    shear = shear[shear["axes_eta_mean"].notna()]
    rows = [
        {"mu_iso": mu_iso, "runs": len(part), "spheres": int(part["N"].min())}
        | {name: 100 * part[column].mean() for column, name in columns.items()}
        for mu_iso, part in shear.groupby("mu_iso")
    ]
    return pd.DataFrame(rows, columns=["mu_iso", "runs", "spheres", *columns.values()])


def rowe(results: Results) -> pd.DataFrame:
    """Rowe's ratio (sigma_1/sigma_3)_peak / ((1 + D) (sigma_1/sigma_3)_critical) per density: mean and range of points.

    D = -d eps_v / d eps_a (Rowe 1962; compression positive), from D_p = -d eps_v / d eps_q of the same slopes by
    D = D_p / (1 - D_p / 3).  sigma_1 / sigma_3 = (3 + 2 eta) / (3 - eta).  The ratio is 1 where critical friction and
    dilatancy explain the peak, and below 1 where the peak is lower than they give.  `dilatancy` is the mean D.  No rows
    in extension and undrained.
    """
    rows = []
    for mu_iso in results.family_densities() if results.loading.sign > 0 else ():
        if not {"eta", "D_p"} <= set(results.state_symbols("peak", mu_iso)):
            continue
        peak, critical = (results.shown_state(state, "eta", mu_iso) for state in ("peak", "critical"))
        D_p = results.shown_state("peak", "D_p", mu_iso)
        D = D_p / (1.0 - D_p / 3.0)
        ratio = (3 + 2 * peak) / (3 - peak) / ((1 + D) * (3 + 2 * critical) / (3 - critical))
        known = np.isfinite(ratio)
        if known.any():
            probability = results.probability(mu_iso)
            mean, dilatancy = (float(weighted.mean(v, probability)) for v in (ratio, D))
            rows.append((mu_iso, int(known.sum()), dilatancy, mean, ratio[known].min(), ratio[known].max()))
    return pd.DataFrame(rows, columns=["mu_iso", "points", "dilatancy", "ratio", "lowest", "highest"])


def peak_estimates(results: Results) -> pd.DataFrame:
    """How the peaks were estimated, per family and density.

    `estimate`: pooled over the points, or single runs.  `mean_bias`: mean over the points of what was subtracted from
    the stress ratio.  `no_interior_peak`: points whose curve is largest at the first or last strain where a peak may
    lie.  Both are NaN where each run has the peak of its own curve.
    """
    rows = []
    for family in results.families:
        for mu_iso in results.family_densities(family):
            peaks = results.peak_estimate(mu_iso, family)
            if peaks is None:
                rows.append((family, mu_iso, "single runs", np.nan, np.nan))
                continue
            known = np.isfinite(peaks.bias)
            bias = weighted.mean(peaks.bias[known], weighted.normalised(results.probability(mu_iso, family)[known]))
            rows.append((family, mu_iso, "pooled over the points", float(bias), int((~peaks.interior[known]).sum())))
    return pd.DataFrame(rows, columns=["family", "mu_iso", "estimate", "mean_bias", "no_interior_peak"])


def probe_checks(results: Results) -> pd.DataFrame:
    """One row: probes, those checked against the static solve of their network, and those that it replaces.

    `pushed_limit`: share of contacts near the Coulomb limit above which a probe is checked; `difference_limit`:
    relative difference of G_0 above which the network's value is used; `largest_difference` of those checked.
    """
    probes = _done(results, "probe")
    differences = probes["probe_off"].dropna().abs()
    return pd.DataFrame([{
        "probes": len(probes),
        "checked": len(differences),
        "pushed_limit": PUSHED,
        "replaced": int((differences > OFF).sum()),
        "difference_limit": OFF,
        "largest_difference": differences.max(),
    }])  # fmt: skip


def packing_design(results: Results) -> pd.DataFrame:
    """One row: the least numbers of `packings` and `points` of a density, and `known`: whether packings are judged.

    The packings are those of the runs at the critical state, or at the peak where the critical state is withheld.  For
    undrained tests they are those of the points: a density of which few tests reach the critical state has no model.
    """
    densities = results.family_densities()
    if results.loading.is_undrained:
        used = [results.packing(m)[results.probability(m) > 0] for m in densities]
        packings = min(len(np.unique(those)) for those in used)
    else:
        packings = min(_packings(results, mu_iso) for mu_iso in densities)
    points = min(int((results.probability(mu_iso) > 0).sum()) for mu_iso in results.family_densities())
    return pd.DataFrame([{"packings": packings, "points": points, "known": packings >= FEWEST_PACKINGS}])


def _packings(results: Results, mu_iso: float) -> int:
    models = (state_model(results, state, "eta", mu_iso) for state in ("critical", "peak"))
    return next((model.packings for model in models if model is not None), 1)


def noise(results: Results, symbols: Sequence[str] = SHOWN) -> pd.DataFrame:
    """Per density and quantity at the critical state: the spread of the points beside the noise of packings and runs.

    `sd_of_points` as simulated; `run_error`: standard error of one run's average, from block averages within the run.
    `packing` and `own`: standard deviations that packings add to all their runs and each run by itself, with 95 %
    intervals, from the model; NaN where they cannot be separated.  In displayed units.
    """
    rows = []
    for mu_iso in results.family_densities():
        probability = results.probability(mu_iso)
        for symbol in _varying(results, symbols, results.state_symbols("critical", mu_iso)):
            factor = QUANTITIES[symbol].shown_factor
            spread = float(weighted.std(results.shown_state("critical", symbol, mu_iso), probability))
            error = results.state_error("critical", symbol, mu_iso)
            run_error = np.nan if error is None else float(weighted.mean(error**2, probability)) ** 0.5
            row = {"mu_iso": mu_iso, **named(symbol), "sd_of_points": factor * spread, "run_error": factor * run_error}
            model = state_model(results, "critical", symbol, mu_iso)
            for name in ("packing", "own"):
                numbers = np.full(3, np.nan)
                if model is not None:
                    interval = getattr(model, f"{name}_interval")[0]
                    numbers = factor * np.array([getattr(model, f"noise_{name}")[0], *interval])
                row |= dict(zip(with_interval(name), numbers, strict=True))
            rows.append(row)
    return pd.DataFrame(rows)


def pdf_widths(results: Results, symbols: Sequence[str] = SHOWN) -> pd.DataFrame:
    """Kernel width of the PDFs beside the points' standard deviation and spacing, at the last strain with a test."""
    rows = []
    for mu_iso in results.family_densities():
        for symbol in _varying(results, symbols, results.symbols(mu_iso)):
            response = results.response(symbol, mu_iso)
            pdf, factor = response.pdf, QUANTITIES[symbol].shown_factor
            last = int(np.flatnonzero(response.going)[-1])
            rows.append({
                "mu_iso": mu_iso,
                **named(symbol),
                "sd_of_points": factor * float(response.std[last]),
                "kernel_width": factor * float(pdf.shown_width[last]),
                "spacing_of_points": factor * float(pdf.spacing[last]),
                "method": pdf.method,
            })  # fmt: skip
    return pd.DataFrame(rows)


def _varying(results: Results, symbols: Sequence[str], there: Sequence[str]) -> list[str]:
    """Those of the symbols that are there and that the test does not hold."""
    return [symbol for symbol in symbols if symbol in there and not (symbol == "e" and results.loading.is_undrained)]


def losses(results: Results) -> pd.DataFrame:
    """Per family and density: shear runs planned, done, failed, continued as steady, and the lost probability."""
    rows = []
    for family in results.families:
        for mu_iso in results.family_densities(family):
            counts = results.counts(mu_iso, family)
            numbers = {name: counts[name] for name in ("planned", "done", "failed", "extended", "lost_probability")}
            rows.append({"family": family, "mu_iso": mu_iso, **numbers})
    return pd.DataFrame(rows)


def _done(results: Results, stage: str) -> pd.DataFrame:
    table = results.runs
    return table[(table["stage"] == stage) & (table["status"] == "done")]
