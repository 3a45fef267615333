"""The sentences of the report below its first screen; their numbers come from the frames."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from ..quantities import EARLY_ENDS, QUANTITIES, parameter
from ..results.reader import Results
from ..tables import published

Frames = Mapping[str, pd.DataFrame]

CLAIMS = (
    "Each statement became a number without the noise of packings and runs, with a 95 % interval. A statement is "
    "supported if the whole interval meets the criterion, contradicted if no part of it does, and inconclusive "
    "otherwise. For an inconclusive statement the table gives the number of points that would make its interval narrow "
    "enough, if its value is the true one. Every interval stands alone: of thirty, one or two are expected to miss the "
    "true value. The criteria are this project's reading of the paper's words."
)

STANDINGS = (
    "A critical state is proven if the mean curves of a density cannot drift by more than the limit over 15 % of "
    "strain, given their error. It is not proven at this size if the error is too large to decide, and not reached if "
    "a larger drift is shown or if the test ends too early. A peak is proven if the mean curve has its maximum inside "
    "the range where a peak may lie."
)

AGAINST_MONTE_CARLO = (
    "Are the representative points enough? Their moments and quantiles are compared with many Monte Carlo samples "
    "through the model of all runs: without noise for the mean and the standard deviation, with the noise of a run for "
    "the quantiles. The second table compares PDEM's PDFs along strain with such samples, noise included."
)

ALL_REACHED = " Only states that all tests of a density reached are here, because their model is that of all inputs."

REPLAY = (
    "All points were run, so the rule that stops a campaign once it has enough runs can be judged afterwards. The rule "
    "is applied to these runs in its own order, batch by batch, and the error that it claims is compared with the one "
    "that the other runs show. Errors are Wasserstein distances over the standard deviation, the largest over peak and "
    "critical stress ratio and critical void ratio at all densities. The claim is about values without noise; the "
    "distance to all runs contains noise."
)
NO_REPLAY = "This cannot be judged: points were not run, or too few were."
REPLAY_WITHOUT_PACKINGS = (
    "The rule that stops a campaign once it has enough runs needs three packings at least, to know their noise. With "
    "the packings of this campaign it claims no error and never stops."
)

STRESS_AXES = (
    "The stress ratio is taken from the axial stress and the mean lateral stress. In a small packing these axes "
    "are not exactly principal axes. The table gives the largest shear stress on them over the major principal "
    "stress in the critical part, and by how much the stress ratio of the principal stresses is higher: window by "
    "window, where this is mostly noise, and for the mean stress tensor."
)

PEAKS = (
    "The maximum of a noisy curve is too large. Therefore the strain of each peak is taken from curves that are pooled "
    "over the points of a density by a regression over the inputs. The peak of a point is the smoothed "
    "value of its own run at this strain. The bias that is left is found by simulation with the measured noise and "
    "subtracted. All other quantities at the peak are taken at the same strain. The table gives the mean bias that "
    "was subtracted, and the number of points whose curve is largest at the first or last strain where a peak may "
    "lie. If fewer than five points have a run, the peak is the maximum of the smoothed curve of each run."
)

ROWE = (
    "Rowe's stress-dilatancy relation compares peak and critical state. The ratio is sigma_1/sigma_3 at the peak over "
    "(1 + D) sigma_1/sigma_3 at the critical state, with D = −d eps_v / d eps_a of the total strains at the peak. "
    "It is 1 if critical friction and dilatancy explain the peak."
)

#: What is said of the benchmarks' tables that lie beside results.h5, by the CSV's name.
BESIDE = {
    "fidelity": "Does the size of this campaign bias its numbers? The same runs were made at five points with more "
    "spheres, at lower rates and with smaller steps. The bias is the difference of this campaign's setting from the "
    "other one, averaged over the points. It is within the target of the accuracy setting if its whole 95 % interval "
    "is; it is open if the interval reaches beyond the target.",
    "beyond": "A well-graded and a gap-graded assembly, and grains that each have their own pair of properties. There "
    "are few runs, so only differences well above the scatter between packings count.",
}


def source(results: Results) -> str:
    """Where the pairs come from."""
    named = results.inputs.get("source") or "an unnamed source"
    text = f"{len(results.pairs)} pairs from {named}."
    if "reconstructed" in named:
        text += (" The paper's own pairs are not public; the reconstructed set reproduces its tables, not its "
                 "measurements.")  # fmt: skip
    return text


def input_warnings(results: Results) -> list[str]:
    """What `plan` warned about the pairs and their fits, one sentence each; nothing in files without warnings."""
    return [f"Warning: {text}." for text in results.inputs.get("warnings", [])]


LIMITS = (
    "The 5 % limit of the Kolmogorov–Smirnov distance is larger if the parameters are known (1.358/√n) than if "
    "they are fitted to the same pairs; the second one applies here."
)


def marginals_against_paper(results: Results) -> str:
    """The fitted medians and widths beside Table 1 of the paper."""
    parts = []
    for symbol, (family, median, width, distance) in published.MARGINALS.items():
        fits = {fit["family"]: fit for fit in results.inputs["marginals"].get(symbol, [])}
        if family not in fits:
            continue
        quantity = QUANTITIES[symbol]
        ours = ", ".join(parameter(symbol, k, v) for k, v in fits[family]["params"].items())
        parts.append(
            f"{symbol}, {family}: {ours} here; the paper has median {median * quantity.shown_factor:g} "
            f"{quantity.shown_unit}".rstrip()
            + f", sigma_ln {width:g} and a distance of {distance:g}. "
        )
    return "".join(parts) + "The paper compares its distances with the limit for known parameters."


def copula_chosen(results: Results) -> str:
    """The chosen copula and why."""
    best = results.inputs["copulas"][0]
    ours = ", ".join(f"{p:.3f}" for p in best["parameters"])
    return (
        f"Chosen: {best['family']} ({ours}), the smallest AIC among the copulas that the parametric bootstrap accepts. "
        "The AIC is computed on ranks."
    )


def copulas_against_paper() -> str:
    """Table 2 of the paper."""
    theirs = "; ".join(
        f"{name} {', '.join(f'{p:g}' for p in parameters)} (AIC {aic:g})"
        for name, (parameters, aic) in published.COPULAS.items()
    )
    return f"The paper: {theirs}. Its p-value compares with independent uniforms and hardly ever rejects."


def initial_states(facts: pd.Series, collapse: pd.DataFrame, names: Mapping[float, str], is_papers_test: bool) -> str:
    """What the table of initial states holds, and its largest difference from the paper's Table 3."""
    loss = collapse["largest_loss_of_e"].max() if len(collapse) else 0.0
    text = (
        "The state after consolidation, with its coefficient of variation in brackets. If one consolidation serves all "
        "points, this is the scatter between packings. The last column is the average over the points before shear: "
        "each is at rest again with its own friction and modulus."
    )
    if loss > 0.005:
        text += (
            " If the friction of a point is below that of its consolidation, the packing loses contacts and densifies; "
            f"its void ratio falls by up to {100 * loss:.1f} %."
        )
    if not is_papers_test or not facts["worst_quantity"]:
        return text
    return text + (
        f" The paper's coefficients are those of its 100 points. The largest difference from its Table 3 is "
        f"{facts['worst_difference_pct']:+.1f} % ({facts['worst_quantity']}, {names[facts['worst_mu_iso']]})."
    )


def run_notes(results: Results, frames: Frames) -> list[str]:
    """Failures with their reasons, and early stops, in words."""
    runs, counts = frames["runs"], frames["run_counts"].iloc[-1]
    failed = runs[runs["status"] == "failed"]
    notes = [f"{len(failed)} of {len(runs)} runs failed."] if len(failed) else []
    notes += [f"{row.run_id}: {row.reason}" for row in failed.head(10).itertuples()]
    if len(failed) > 10:
        notes.append(f"... and {len(failed) - 10} more, all in tables/runs.csv.")
    collapsed = int((runs["collapsed"] & (runs["status"] == "done")).sum())
    if collapsed:
        notes.append(
            f"{collapsed} probes and shear runs start from a collapsed packing, because their friction is below that "
            "of its consolidation (column collapsed in tables/runs.csv). The density that results depends on the "
            "grains' inertia, too: in the stability map, of 64 to 200 spheres, by less than 1 % in void ratio."
        )
    if counts["spared"]:
        filled = int(frames["report_facts"].iloc[0]["filled"])
        notes.append(
            f"{int(counts['spared'])} runs were not needed, because the target error was reached without them: "
            f"{filled} of {len(results.points)} points were not run; a regression over the inputs gives their values."
        )
    older = int(frames["archived_runs"].iloc[0]["other_version"])
    if older:
        notes.append(
            f"{older} runs come from an archive that another version of the analysis wrote: their states are those "
            "that this version measured (column measured_by in tables/runs.csv)."
        )
    if counts["steady_early"]:
        notes.append(
            f"{int(counts['steady_early'])} shear runs stopped early because their critical state was steady. Beyond "
            "that strain their curves are continued by their critical averages, and counted as continued."
        )
    return notes


#: Runs of a code that does not count the work of friction.
NO_BALANCE = (
    "No energy balance is proven: LAMMPS does not count the work of friction. The products hold what the balance "
    "leaves for friction (E_residual); it is no proof, but a run is refused in which it is less than -10 % of the "
    "boundary work."
)


def proof_notes(frames: Frames) -> list[str]:
    """Missing energy balances, corrected probes, and how many runs prove a steady critical state."""
    runs = frames["runs"]
    shear = runs[(runs["status"] == "done") & (runs["stage"] == "shear")]
    notes, checks = [], frames["probe_checks"].iloc[0]
    if len(shear) and shear["energy_error"].isna().all():
        notes.append(NO_BALANCE)
    if checks["checked"]:
        notes.append(
            f"In {int(checks['checked'])} of {int(checks['probes'])} small-strain probes more than "
            f"{100 * checks['pushed_limit']:.1f} % of the contacts are so near the Coulomb limit that the probe may "
            "make them slide. These probes are compared with the static solution of their contact network. In "
            f"{int(checks['replaced'])} of them the difference exceeds {100 * checks['difference_limit']:.0f} % "
            f"(largest: {100 * checks['largest_difference']:.0f} %); there the value of the network is used."
        )
    early = shear["reason"].isin(EARLY_ENDS)
    if early.any():
        notes.append(f"{int(early.sum())} of {len(shear)} shear runs ended before their strain; @table:ends@ has them.")
        shear = shear[~early]
        if not len(shear):
            return notes
    unsteady = shear[shear["unsteady"] != ""]
    if not len(unsteady):
        return [*notes, f"All {len(shear)} shear runs prove that their critical state is steady."]
    first = unsteady.iloc[0]
    return [
        *notes,
        f"{len(unsteady)} of {len(shear)} shear runs do not prove by themselves that their critical state is steady, "
        "mostly because the scatter of one run hides such a drift. Their averages are used nevertheless, unless the "
        "critical state is withheld. The first of "
        f"them, {first['run_id']}: {first['unsteady']}.",
    ]


def packing(design: pd.DataFrame) -> str:
    """What is known of the noise of packings, from `run_quality.packing_design`."""
    row = design.iloc[0]
    if row["packings"] == 1:
        return (
            "All points of a density start from the same packing, so part of the noise of a run is common to them. It "
            "does not average out over the points, and it is not known: the intervals of means and quantiles do not "
            "contain it, and those of the paper's statements contain the standard error of one run in its place. "
            "Several packings (assembly.packings) would show it."
        )
    text = f"The {row['points']} points of a density use {row['packings']} packings. "
    if not row["known"]:
        return text + "That is too few to know the noise of packings; the intervals are too narrow."
    return text + (
        "A model of all runs separates the effect of the grain properties from the noise of packings and single runs, "
        "and all intervals contain the error that this noise leaves."
    )
