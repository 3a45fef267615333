"""The sentences of the report: captions, comparisons with the paper, and warnings; their numbers come from frames."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from ..quantities import QUANTITIES, parameter
from ..results.reader import Results
from ..results.standing import NOT_PROVEN, NOT_REACHED, PROVEN
from ..tables import published
from ..tables.claim_intervals import CONTRADICTED, INCONCLUSIVE, SUPPORTED
from . import input_words

Frames = Mapping[str, pd.DataFrame]

SIGNS = {
    "mu_s": "μ_s",
    "G_p": "G_p",
    "nu": "ν",
    "sigma_ln": "σ_ln d",
    "sigma_3": "σ_3",
    "d50": "d50",
    "e": "e",
    "e_m": "e_m",
    "Z": "Z",
    "Z_m": "Z_m",
    "eta": "η",
}

CAPTIONS = {
    "fig02": "Figure 2. (a) The pairs of interparticle friction and particle shear modulus; (b, c) their histograms "
    "with fitted marginal PDFs, smallest AIC first.",
    "fig03": "Figure 3. (a, b) Joint PDF of the two properties, with the pairs; (c) the representative points, "
    "area by probability; (d) twice as many points; (e) distribution functions "
    "carried by the points against the exact ones.",
    "fig04": "Figure 4. Grading of the assembly that all runs share.",
    "fig05": "Figure 5. Stress ratio: PDFs along axial strain; means with two standard deviations to either side; PDFs "
    "at the peak of every point and at the critical state, shaded as in Figure 8. Ticks under an axis are the points. "
    "The paper's dense peaks range from 0.6 to 1.2, its loose ones from 0.5 to 0.9, its critical states from 0.5 to "
    "0.8.",
    "fig06": "Figure 6. PDF surfaces of the stress ratio, the densest also in plan. A surface starts where the PDFs of "
    "neighbouring strains overlap; values above the scale are cut off.",
    "fig07": "Figure 7. Peak (triangles) and critical state (circles, at the right) of every point, in stress ratio "
    "and void ratio. The strain of a peak comes from curves that are pooled over all points of a density; its value is "
    "that of the point's own run. The strain jumps where the pooled curve has two maxima. Loose samples have hardly "
    "any peak.",
    "fig08": "Figure 8. Void ratio. The paper: densities differ at the peak and converge at the critical state. "
    "Values above the scale of a surface are cut off.",
    "fig09": "Figure 9. Mechanical void ratio, inactive grains counted as void.",
    "fig10": "Figure 10. Coordination number. The paper: between 3.3 and 5.5 at the peak and the critical state, the "
    "same for all densities.",
    "fig11": "Figure 11. Mechanical coordination number.",
    "fig12": "Figure 12. Fabric anisotropy, major minus minor principal value of the fabric tensor.",
    "fig13": "Figure 13. (a, b) Small-strain stiffness and (c, d) dilatancy at the peak: PDFs, and every point against "
    "the property that controls it. Loose points above the others in (b) have a friction below that of consolidation: "
    "their packing collapsed before the probe and became denser.",
    "fig14": "Figure 14. Joint PDFs of the critical stress ratio with void ratio and mechanical void ratio. Product "
    "kernels widen the PDFs; the correlation given is that of the points.",
    "fig15": "Figure 15. Joint PDFs of the critical stress ratio with the two coordination numbers.",
    "fig16": "Figure 16. Not in the paper: peak and critical state along interparticle friction. Every point, with its "
    "peak at the strain that is pooled over the points, and the denoised values at the modulus that the regression on "
    "friction gives, with their 95 % band.",
}


def sign(symbol: str) -> str:
    """A symbol as the page shows it."""
    return SIGNS.get(symbol, symbol)


def caption(results: Results, name: str) -> str:
    """The caption of a figure; where pairs are shown, with the file that they come from."""
    source = results.inputs.get("source") or "unnamed"
    of_pairs = f" Pairs: {source}." if name in ("fig02", "fig03") and len(results.pairs) else ""
    band = input_words.band_note(results) if name == "fig08" else ""
    return (input_words.caption_of_inputs(results, name) or CAPTIONS[name]) + band + of_pairs


CLAIMS = (
    "Each claim became a number of the denoised values with a 95 % interval. A claim is supported if the whole "
    "interval meets the criterion, contradicted if no part of it does, and inconclusive otherwise. For an inconclusive "
    "claim the number of points is given with which its interval would be narrow enough, if its value is the true one. "
    "Every interval stands alone: of some thirty claims, one or two intervals are expected to miss the true value. The "
    "criteria are this project's reading of the paper's words."
)

MOMENTS = (
    "Denoised: what the grain properties do, from a model of all runs of a density (a smooth function of the inputs, "
    "the noise of packings, and that of single runs). As simulated: what one specimen of the simulated number of "
    "spheres does, with both kinds of noise. Quote the denoised numbers for the effect of the grain properties."
)

REPLAY = (
    "All points were run, so the rule that stops a campaign once it has enough runs can be judged in hindsight. The "
    "rule is applied to these runs, batch by batch in its own order, and its claim is compared with what the other "
    "runs show. Errors are Wasserstein distances over the standard deviation, the worst over peak and critical stress "
    "ratio and critical void ratio at all densities. The claim is about the denoised values; the distance to all runs "
    "contains their noise. With fewer than three packings the rule cannot judge and claims nothing."
)

STRESS_AXES = (
    "The stress ratio is taken from the axial stress and the mean lateral stress. In a small packing these axes are "
    "not exactly principal axes. The table gives the largest off-diagonal stress divided by the major principal stress "
    "in the critical part, and by how much the stress ratio of the principal stresses is higher: window by window, "
    "where it is mostly noise, and for the mean stress tensor."
)

PEAKS = (
    "Peaks: the maximum of a noisy curve is too large. The strain of each peak is therefore taken from curves that are "
    "pooled over the points of a density by a regression over the inputs. The peak of a point is the smoothed "
    "value of its own run at this strain. The bias that is left is estimated by simulation with the noise as measured, "
    "and it is subtracted. All other quantities at the peak are taken at the same strain. The table gives the mean "
    "bias that was subtracted, and the number of points whose curve is largest at the first or last strain where a "
    "peak may lie. If fewer than five points have a run, the peak is the maximum of each run's own smoothed curve."
)

ROWE = (
    "Rowe's stress-dilatancy relation compares peak and critical state: (σ1/σ3) at the peak over (1 + D) (σ1/σ3) at "
    "the critical state, with D = −dε_v/dε_a at the peak. It is 1 if the critical friction and the dilatancy explain "
    "the peak."
)

FRICTION_ANGLES = (
    "Friction angles in degrees in triaxial compression, sin φ = 3η/(6+η), with 95 % intervals. Denoised: a large "
    "volume of soil; as simulated: a specimen of the simulated size. Every run gives all its grains one pair of "
    "properties, so the spread is that of a population's mean properties, not the scatter within one deposit."
)

#: What is said of the benchmarks' tables that lie beside results.h5, by the CSV's name.
BESIDE = {
    "fidelity": "Does the size of this campaign bias its numbers? The same chains of runs at five points with more "
    "spheres and at lower rates. Bias is the difference of this campaign's setting from the rung, averaged over the "
    "points. A bias counts as within the target of the accuracy setting if its whole 95 % interval is.",
    "beyond": "Not in the paper: a well-graded and a gap-graded assembly, and grains that each have a pair of "
    "properties of their own. There are few runs, so only differences well above the scatter between packings count.",
}


def in_short(frames: Frames) -> list[str]:
    """The main numbers and the outcome of the claims, in a few sentences."""
    states, claims = frames["peak_critical"], frames["claims"]
    states = states[(states["family"] == "coupled") & (states["quantity"] == "eta")]
    sentences = []
    for state, stated in (("peak", "0.6–1.2 in dense and 0.5–0.9 in loose samples"), ("critical", "0.5–0.8 for all")):
        of_state = states[states["state"] == state]
        columns = (of_state["mean"], of_state["sd"], of_state["standing"])
        numbers = ", ".join("not reached" if standing == NOT_REACHED else f"{m:.3f} ± {s:.3f}"
                            for m, s, standing in zip(*columns, strict=True))  # fmt: skip
        sentences.append(
            f"Stress ratio at the {state} state, mean ± standard deviation from the densest to the loosest: {numbers} "
            f"(the paper: {stated})."
        )
    sentences += standing_words(frames["standings"])
    supported = int((claims["verdict"] == SUPPORTED).sum())
    sentences.append(f"{supported} of {len(claims)} claims are supported.")
    for outcome in (CONTRADICTED, INCONCLUSIVE):
        named = claims.loc[claims["verdict"] == outcome, "claim"]
        if len(named):
            listed = "; ".join(named) if len(named) <= 6 else f"{len(named)}, see the table"
            sentences.append(f"Claims that are {outcome}: {listed}.")
    return sentences


def standing_words(frame: pd.DataFrame) -> list[str]:
    """One sentence per judged state of the coupled family that is not proven, with the reason."""
    frame = frame[(frame["family"] == "coupled") & (frame["standing"] != PROVEN)]
    consequence = {NOT_REACHED: "its values are withheld", NOT_PROVEN: "its values are shown and may still drift"}
    return [
        f"The {row.state} state at mu_iso = {row.mu_iso:g} is {row.standing}, and {consequence[row.standing]}: "
        f"{row.reason}."
        for row in frame.itertuples()
    ]


def source(results: Results) -> str:
    """Where the pairs come from."""
    named = results.inputs.get("source") or "an unnamed source"
    return (
        f"{len(results.pairs)} pairs from {named}. The paper's own 94 pairs are not public; a reconstructed set "
        "reproduces its tables, not its measurements."
    )


def input_warnings(results: Results) -> list[str]:
    """What `plan` warned about the pairs and their fits, one sentence each; nothing in files without warnings."""
    return [f"Warning: {text}." for text in results.inputs.get("warnings", [])]


def marginals_against_paper(results: Results) -> str:
    """The fitted medians and widths beside Table 1."""
    parts = []
    for symbol, (family, median, width, distance) in published.MARGINALS.items():
        fits = {fit["family"]: fit for fit in results.inputs["marginals"].get(symbol, [])}
        if not fits:
            continue
        best = next(iter(fits))
        quantity = QUANTITIES[symbol]
        ours = "not fitted"
        if family in fits:
            ours = ", ".join(parameter(symbol, k, v) for k, v in fits[family]["params"].items())
        parts.append(
            f"{sign(symbol)}: smallest AIC for {best}; {family} here {ours}; the paper's median "
            f"{median * quantity.shown_factor:g} {quantity.shown_unit}".rstrip()
            + f", sigma_ln {width:g}, D = {distance:g}. "
        )
    return "".join(parts) + (
        "The paper's critical distance 1.358/√n holds for known parameters. The one for fitted parameters is smaller "
        "and given beside it, as for the Anderson–Darling statistic (ad)."
    )


def copulas_against_paper(results: Results) -> str:
    """The chosen copula beside Table 2."""
    best = results.inputs["copulas"][0]
    theirs = "; ".join(
        f"{name} {', '.join(f'{p:g}' for p in parameters)} (AIC {aic:g})"
        for name, (parameters, aic) in published.COPULAS.items()
    )
    ours = ", ".join(f"{p:.3f}" for p in best["parameters"])
    return (
        f"Chosen here: {best['family']} ({ours}). The paper: {theirs}. The smallest AIC among the copulas that the "
        "parametric bootstrap accepts is taken; the paper's own p-value compares with independent uniforms and hardly "
        "ever rejects."
    )


def initial_states(facts: pd.Series, collapse: pd.DataFrame) -> str:
    """What the table of initial states holds, and its largest difference from the paper's Table 3."""
    loss = collapse["largest_loss_of_e"].max() if len(collapse) else 0.0
    text = (
        "The state after consolidation, as in the paper's Table 3. Where one consolidation serves all points, its COV "
        "is the scatter between packings, while the paper's is that of its 100 points. Beside it stands the average "
        "over the points before shear, each at rest again with its own friction and modulus. Where the friction is "
        f"below that of consolidation, a packing collapses; its void ratio falls by up to {loss:.1%}."
    )
    if not facts["worst_quantity"]:
        return text
    return text + (
        f" The largest difference from the paper's Table 3 is {facts['worst_difference_pct']:+.1f} % "
        f"({sign(facts['worst_quantity'])} at mu_iso = {facts['worst_mu_iso']:g})."
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
            "grains' inertia too: in the stability map, of 64 to 200 spheres, by less than 1 % in void ratio."
        )
    if counts["spared"]:
        filled = int(frames["report_facts"].iloc[0]["filled"])
        notes.append(
            f"{int(counts['spared'])} runs were spared, because the target error was reached without them: {filled} of "
            f"{len(results.points)} points were not run; a regression over the inputs gives their values."
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


def proof_notes(frames: Frames) -> list[str]:
    """Packing noise, corrected probes, drift, and how many runs prove a steady critical state."""
    runs = frames["runs"]
    runs = runs[runs["status"] == "done"]
    shear = runs[runs["stage"] == "shear"]
    notes = [packing(frames["packing_design"])]
    checks = frames["probe_checks"].iloc[0]
    if checks["checked"]:
        notes.append(
            f"In {int(checks['checked'])} of {int(checks['probes'])} small-strain probes more than "
            f"{checks['pushed_limit']:.1%} of the contacts are so near the Coulomb limit that the probe may make them "
            "slide. These probes are checked against the static solve of their contact network. In "
            f"{int(checks['replaced'])} of them the difference exceeds {checks['difference_limit']:.0%} (largest: "
            f"{checks['largest_difference']:.0%}); there the network's value is used."
        )
    notes += drift_words(frames["critical_drift"])
    unsteady = shear[shear["unsteady"] != ""]
    if not len(unsteady):
        return [*notes, f"All {len(shear)} shear runs prove that their critical state is steady."]
    first = unsteady.iloc[0]
    return [
        *notes,
        f"{len(unsteady)} of {len(shear)} shear runs do not prove by themselves that their critical state is steady, "
        "mostly because the scatter of one run hides such drifts; their averages are used nevertheless. The first of "
        f"them, {first['run_id']}: {first['unsteady']}.",
    ]


def packing(design: pd.DataFrame) -> str:
    """What is known of the noise of packings, from `run_quality.packing_design`."""
    row = design.iloc[0]
    if row["packings"] == 1:
        return (
            "All points of a density start from the same packing, so part of the noise of a run is common to them. It "
            "does not average out over the points, and it is not known: the intervals of means and quantiles do not "
            "contain it, and those of the claims contain the standard error of one run in its place. Several packings "
            "(assembly.packings) would show it."
        )
    text = f"The {row['points']} points of a density use {row['packings']} packings. "
    if not row["known"]:
        return text + "That is too few to know the noise of packings; the intervals are too narrow."
    return text + (
        "A model of all runs separates what the grain properties do from what packings and single runs add, and all "
        "intervals contain the error that this noise leaves."
    )


def drift_words(frame: pd.DataFrame) -> list[str]:
    """The mean drift over the critical part, from `run_quality.critical_drift`; nothing if it is not known."""
    if not len(frame):
        return []
    drifts = "; ".join(
        f"mu_iso = {row.mu_iso:g}: η {row.drift_eta_pct:+.1f} ± {row.error_eta_pct:.1f} %, "
        f"e {row.drift_e_pct:+.2f} ± {row.error_e_pct:.2f} %"
        for row in frame.itertuples()
    )
    basis = (
        "the runs of a density, with the error between its packings" if frame["between_packings"].all()
        else "the runs of a density, with the standard error as if runs of one packing were independent"
    )  # fmt: skip
    return [f"Drift from the beginning to the end of the critical part, mean over {basis}: {drifts}."]
