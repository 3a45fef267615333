"""The sentences of the report: captions, comparisons with the paper, and warnings drawn from the numbers."""

from __future__ import annotations

import numpy as np

from analysis import packings, paper, weighted
from analysis.claims import HELD, NOT_HELD, OPEN
from analysis.collapse import collapsed_runs
from analysis.packing_noise import common_error
from analysis.quantities import QUANTITIES
from analysis.run_states import OFF, PUSHED
from analysis.tables import parameter

SIGNS = {"mu_s": "μ_s", "G_p": "G_p", "e": "e", "e_m": "e_m", "Z": "Z", "Z_m": "Z_m", "eta": "η"}

CAPTIONS = {
    "fig02": "Figure 2. (a) The pairs of interparticle friction and particle shear modulus; (b, c) their histograms "
    "with fitted marginal densities, smallest AIC first.",
    "fig03": "Figure 3. (a, b) Joint density of the two properties, with the pairs; (c) the representative points, "
    "area by probability; (d) twice as many points; (e) distribution functions "
    "carried by the points against the exact ones.",
    "fig04": "Figure 4. Grading of the assembly that all runs share.",
    "fig05": "Figure 5. Stress ratio: probability densities along axial strain; means with two standard deviations "
    "to either side; densities at the peak of every run and at the critical state, shaded as Figure 8. Ticks under an "
    "axis are the points. The paper's dense peaks range from 0.6 to 1.2, its loose ones from 0.5 to 0.9, its critical "
    "states from 0.5 to 0.8.",
    "fig06": "Figure 6. Probability density surfaces of the stress ratio, the densest also in plan. Surfaces start "
    "where the densities of neighbouring strains overlap; what rises above the scale is cut off level.",
    "fig07": "Figure 7. Peak (triangles) and critical state (circles, at the right) of every point, in stress ratio "
    "and void ratio. A peak is that of one run; where a curve has hardly any, in loose samples, it is the largest "
    "fluctuation along a plateau and may lie at any strain.",
    "fig08": "Figure 8. Void ratio. The paper: densities differ at the peak and converge at the critical state. "
    "Shaded, here and wherever a state's density is shown: the 95 % band from resampling the pairs alone; packing "
    "noise is not in it. What rises above a surface's scale is cut off level.",
    "fig09": "Figure 9. Mechanical void ratio, inactive grains counted as void.",
    "fig10": "Figure 10. Coordination number. The paper: between 3.3 and 5.5 at the peak and the critical state, the "
    "same for all densities.",
    "fig11": "Figure 11. Mechanical coordination number.",
    "fig12": "Figure 12. Fabric anisotropy, major minus minor principal value of the fabric tensor.",
    "fig13": "Figure 13. (a, b) Small-strain stiffness and (c, d) dilatancy at the peak: densities, and every point "
    "against the property that drives it. Loose points above the others in (b) have a friction below that of "
    "consolidation: their packing collapsed before the probe and is the denser for it.",
    "fig14": "Figure 14. Joint densities of the critical stress ratio with void ratio and mechanical void ratio. "
    "Product kernels widen what is shown; the correlation given is that of the points.",
    "fig15": "Figure 15. Joint densities of the critical stress ratio with the two coordination numbers.",
    "fig16": "Figure 16. Not in the paper: peak and critical state along interparticle friction, every point and the "
    "response surface for grains whose modulus is that of their like, with the 95 % band of the surface and, as far as "
    "replicate packings tell it, of packings.",
}



def caption(results, name) -> str:
    """The caption of a figure; where pairs are shown, with the file that they come from."""
    of_pairs = f" Pairs: {results.inputs.get('source') or 'unnamed'}." if name in ("fig02", "fig03") else ""
    return CAPTIONS[name] + of_pairs


SOURCES = (
    "Interparticle friction and shear modulus depend on each other, so most of what one tells the other tells too. "
    "The table splits each variance into what only one of them adds once the other is known, what either explains "
    "(shared), and what a smooth response surface over both leaves over (noise of the packing). Beside it, the "
    "moments and quantiles of the points against Monte Carlo samples through that surface, which has no noise in it "
    "(in the quantiles the runs' noise is put back); last, PDEM's densities along strain against such samples with "
    "the runs' noise."
)


REPLAY = (
    "All points were run, so the rule that stops a campaign once it has runs enough can be judged: it is replayed here "
    "on these runs, batch by batch in its own order, and its claim held against what the other runs say. Errors are "
    "Wasserstein distances over the standard deviation, the worst over peak and critical stress ratio and critical "
    "void ratio at all densities. The claim speaks of the response surface; the distance to all runs holds their noise."
)


def open_inputs(results) -> str:
    """How the bands from the pairs were made, and what is not in them."""
    drawn = results.bootstrap_weights(results.family_densities()[0])
    return (
        f"{len(results.pairs)} pairs say only so much about the inputs. They were resampled {len(drawn)} times, the "
        "marginals and the copula refitted (families kept), and the points given the probabilities that each refitted "
        "distribution gives them: no run is repeated. The bands here, and those about the densities at the peak, at "
        "the critical state and of the stiffness in the figures, hold 95 % of what followed. Noise of the packing and "
        "the choice of families are not in them."
    )


BANDS = (
    "How sure means and standard deviations are: 95 % bands from the runs' noise, with the error that the points of a "
    "density share by their packing where that is known, and from the number of pairs, to which the inputs are "
    "refitted. Both are those of the response surface, without the scatter of single runs, which widens the spreads of "
    "the other tables."
)


#: What is said of the benchmarks' tables that lie beside results.h5, by the CSV's name.
BESIDE = {
    "fidelity": "Does the size of this campaign bend its numbers? The same chains at five points with more spheres and "
    "at lower rates. Bias is that of this campaign's setting against the rung, averaged over the points; it is within "
    "the promise of the accuracy setting if its whole 95 % interval is.",
    "beyond": "What the paper leaves out: a well-graded and a gap-graded assembly, and grains that each have a pair of "
    "properties of their own. Few runs, so differences count only well beyond the scatter between packings.",
}


def packing(results) -> str:
    """How noise that all points of a density share is allowed for."""
    text = (
        "All points of a density start from the same packing, so part of the noise of a run is common to them: it does "
        "not average out over the points, and only replicate packings or more spheres show or lower it. "
    )
    _, freedom = common_error(results, "critical", "eta")
    if not np.isfinite(freedom) or freedom == 0:
        return text + (
            "The intervals of the claims allow for it by one run's standard error where a run tells that; what it "
            "would move otherwise cannot be told."
        )
    sizes = [packings.compared(sets).shape for sets in (results.state_replicates("critical", "eta", m)
                                                        for m in results.family_densities()) if sets is not None]
    count, several = np.min(sizes, axis=0)
    taken_off = (
        "What the first packing is off by over these is taken off all points, along the strain and in every state, by "
        "the share of it that is the packing's and not the scatter of single runs. "
        if several >= packings.FEWEST else ""
    )  # fmt: skip
    return text + (
        f"Here {count} packings serve {several} of the points. {taken_off}The intervals of claims, friction angles "
        "and means allow for what is left: how much the mean over these points differs between packings, pooled over "
        "the densities."
    )


def in_short(results, claims) -> list[str]:
    """The main numbers and what the claims come to, in a few sentences."""
    densities = results.family_densities()
    parts = []
    for state, stated in (("peak", "0.6–1.2 in dense and 0.5–0.9 in loose samples"), ("critical", "0.5–0.8 for all")):
        numbers = []
        for mu_iso in densities:
            values, weight = results.state(state, "eta", mu_iso), results.weights(mu_iso)
            numbers.append(f"{weighted.mean(values, weight):.3f} ± {weighted.std(values, weight):.3f}")
        parts.append(
            f"Stress ratio at the {state} state, mean ± standard deviation from the densest to the loosest: "
            f"{', '.join(numbers)} (the paper: {stated})."
        )
    held = int((claims["verdict"] == HELD).sum())
    parts.append(f"{held} of {len(claims)} claims are held.")
    for outcome, words in ((NOT_HELD, "not held"), (OPEN, "that can't be told")):
        named = claims.loc[claims["verdict"] == outcome, "claim"]
        if len(named):
            parts.append(
                f"Claims {words}: " + ("; ".join(named) if len(named) <= 6 else f"{len(named)}, see the table") + "."
            )
    return parts


def source(results) -> str:
    """Where the pairs come from."""
    named = results.inputs.get("source") or "an unnamed source"
    return (
        f"{len(results.pairs)} pairs from {named}. The paper's own 94 pairs are not public; a reconstructed set "
        "repeats its tables, not its measurements."
    )


def marginals_against_paper(results) -> str:
    """The fitted medians and widths beside Table 1."""
    parts = []
    for symbol, (family, median, width, distance) in paper.MARGINALS.items():
        fits = {fit["family"]: fit for fit in results.inputs["marginals"].get(symbol, [])}
        if not fits:
            continue
        best = next(iter(fits))
        quantity = QUANTITIES[symbol]
        ours = "not fitted"
        if family in fits:
            ours = ", ".join(parameter(symbol, k, v) for k, v in fits[family]["params"].items())
        parts.append(
            f"{SIGNS[symbol]}: smallest AIC for {best}; {family} here {ours}; the paper's median "
            f"{median * quantity.shown_factor:g} {quantity.shown_unit}".rstrip()
            + f", sigma_ln {width:g}, D = {distance:g}"
        )
    return (
        ". ".join(parts)
        + (". " if parts else "")
        + (
            "The paper's critical distance 1.358/√n is for known parameters; the one for fitted parameters is "
            "smaller and given beside it, as for the Anderson–Darling statistic (ad)."
        )
    )


def copulas_against_paper(results) -> str:
    """The chosen copula beside Table 2."""
    fits = results.inputs["copulas"]
    theirs = "; ".join(
        f"{name} {', '.join(f'{p:g}' for p in parameters)} (AIC {aic:g})"
        for name, (parameters, aic) in paper.COPULAS.items()
    )
    best = fits[0]
    ours = ", ".join(f"{p:.3f}" for p in best["parameters"])
    return (
        f"Chosen here: {best['family']} ({ours}). The paper: {theirs}. The smallest AIC among the copulas that the "
        "parametric bootstrap accepts is taken; the paper's own p-value compares with independent uniforms and hardly "
        "ever rejects."
    )


def run_notes(results) -> list[str]:
    """Failures with their reasons, and early stops, in words."""
    runs = results.runs
    failed = runs[runs["status"] == "failed"]
    early = int(((runs["stage"] == "shear") & (runs["reason"] == "steady")).sum())
    notes = [f"{len(failed)} of {len(runs)} runs failed."] if len(failed) else []
    notes += [f"{row.run_id}: {row.reason}" for row in failed.head(10).itertuples()]
    if len(failed) > 10:
        notes.append(f"... and {len(failed) - 10} more, all in tables/runs.csv.")
    fallen = int((collapsed_runs(results) & (runs["status"] == "done")).sum())
    if fallen:
        notes.append(
            f"{fallen} probes and shear runs start from a collapsed packing, their friction being below that of its "
            "consolidation (collapsed in tables/runs.csv). How dense it becomes depends on the grains' inertia too: in "
            "the stability map, of 64 to 200 spheres, by less than 1 % in void ratio."
        )
    spared = int((runs["status"] == "spared").sum())
    if spared:
        filled = max(int(results.filled(m, f).sum()) for f in results.families for m in results.family_densities(f))
        notes.append(
            f"{spared} runs were spared, the error asked for being reached without them: {filled} of "
            f"{len(results.points)} points are not run but filled by regression over the two properties."
        )
    present = results.attrs["versions"].get("analysis code", "")
    older = int((~runs["measured_by"].isin(["", present])).sum())
    if older:
        notes.append(
            f"{older} runs come from an archive that another version of the analysis wrote: their states are as that "
            "version measured them (measured_by in tables/runs.csv)."
        )
    if early:
        notes.append(
            f"{early} shear runs stopped early because their critical state was steady; beyond that strain their "
            "curves are continued by their critical averages, and counted as continued."
        )
    return notes


def proof_notes(results) -> list[str]:
    """Whether the critical averages rest on a proven steady state."""
    shear = results.runs[(results.runs["stage"] == "shear") & (results.runs["status"] == "done")]
    unsteady = shear[shear["unsteady"] != ""]
    notes = [packing(results)]
    probes = results.runs[(results.runs["stage"] == "probe") & (results.runs["status"] == "done")]
    off = probes["probe_off"].dropna()
    if len(off):
        notes.append(
            f"In {len(off)} of {len(probes)} small-strain probes over {PUSHED:.1%} of the contacts are so near the "
            f"Coulomb limit that the probe may make them slide. These are checked against the static solve of their "
            f"contact network: {int((off.abs() > OFF).sum())} are off by more than {OFF:.0%}, by {off.abs().max():.0%} "
            "at most, and give way to it."
        )
    notes += pooled_drift(shear)
    if not len(unsteady):
        return [*notes, f"All {len(shear)} shear runs prove their critical state steady."]
    first = unsteady.iloc[0]
    return [
        *notes,
        f"{len(unsteady)} of {len(shear)} shear runs do not prove by themselves that their critical state is steady, "
        "mostly because one run's scatter hides such drifts; their averages are used nevertheless. The first of them, "
        f"{first['run_id']}: {first['unsteady']}.",
    ]


def pooled_drift(shear) -> list[str]:
    """The mean drift over the critical part of a density's runs, which many runs tell better than any one.

    With replicate packings that of the points that all of them serve, its error from the packings.
    """
    told, alone = [], False
    for mu_iso, runs in shear[shear["family"] == "coupled"].groupby("mu_iso"):
        known = runs[["packing", "point", "drift_eta", "drift_e"]].dropna()
        packing, drift = known["packing"], known[["drift_eta", "drift_e"]]
        served = known.groupby("point")["packing"].transform("nunique") == packing.nunique()
        if packing.nunique() > 1 and served.any():
            drift = drift[served].groupby(packing[served]).mean()
        else:
            alone = True
        if len(drift) > 1:
            mean, error = 100 * drift.mean(), 100 * drift.std() / np.sqrt(len(drift))
            told.append(
                f"mu_iso = {mu_iso:g}: η {mean.iloc[0]:+.1f} ± {error.iloc[0]:.1f} %, "
                f"e {mean.iloc[1]:+.2f} ± {error.iloc[1]:.2f} %"
            )
    if not told:
        return []
    whose = ("a density's runs and its standard error, as if runs of one packing were independent" if alone
             else "the points that all packings serve and its standard error between packings")  # fmt: skip
    return [f"Drift from the beginning to the end of the critical part, mean of {whose}: " + "; ".join(told) + "."]
