"""The campaign's story as one self-contained HTML page, beside what the paper states, with how far to trust it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from analysis import paper, report_friction, report_setting, report_text, report_trust, tables, trust, webpage
from analysis.claims import HELD, NOT_HELD, OPEN
from analysis.collapse import largest_loss
from analysis.figures import FIGURES, write_figures
from analysis.quantities import QUANTITIES
from analysis.results import read_results


def write_report(results, folder) -> Path:
    """Draw all figures into <folder>/figures and write <folder>/report.html from results (a path or open).

    The page embeds its pictures, needs no network, and is written whole or not at all.  Returns its path.
    """
    results = read_results(results)
    folder = Path(folder)
    figures = dict(zip(FIGURES, write_figures(results, folder / "figures"), strict=True))
    name = results.attrs["campaign"] or folder.resolve().name
    text = webpage.page(f"Campaign {name}", sections(results, figures, name))
    target = folder / "report.html"
    part = folder / f".report.{os.getpid()}.part"
    part.write_text(text, encoding="utf-8")
    os.replace(part, target)
    return target


def sections(results, figures, name) -> list[tuple[str, str]]:
    """The page's sections in order, as (heading, HTML); what the campaign has nothing for is left out."""
    claims = tables.claims_table(results)
    found = [
        ("", _head(results, claims, name)),
        ("The paper's claims, each with a number", _claims(claims)),
        ("Inputs: pairs of grain properties", _inputs(results, figures)),
        ("Representative points and grading", _points(results, figures)),
        ("Runs", _runs(results)),
        ("Initial states", _initial(results)),
        ("Stress ratio", _pictures(results, figures, "fig05", "fig06", "fig07") + _peak_critical(results)),
        ("Void ratios, coordination, fabric", _behaviour(results, figures)),
        ("Stiffness and dilatancy", _pictures(results, figures, "fig13")),
        ("Joint densities", _pictures(results, figures, "fig14", "fig15")),
        ("What friction does", _pictures(results, figures, "fig16") + report_friction.friction(results)),
        ("Where the scatter comes from", report_trust.sources(results)),
        ("What the number of pairs leaves open", input_bands(results)),
        ("Friction angles for design", report_trust.design(results)),
        ("How many runs would have been enough", report_trust.replay(results)),
        ("The same at other sizes and rates, and with other grains", report_trust.other_runs(results)),
        ("How far every number can be trusted", report_trust.noise_and_proofs(results)),
        ("Where this comes from", _provenance(results)),
    ]
    return [(heading, content) for heading, content in found if content]


def _head(results, claims, name):
    counts = claims["verdict"].value_counts()
    done = int((results.runs["status"] == "done").sum())
    hours = results.runs["cpu_seconds"].sum() / 3600
    size = report_setting.particles(results)
    items = [
        (str(len(results.points)), f"points of ({_sign('mu_s')}, {_sign('G_p')})"),
        (str(len(results.densities)), "densities"),
        (str(done), "runs, all with a product" if done == len(results.runs) else f"of {len(results.runs)} runs done"),
        (size, "spheres a run"),
        (f"{hours:.3g}", "core-hours"),
        (
            " / ".join(str(counts.get(outcome, 0)) for outcome in (HELD, NOT_HELD, OPEN)),
            "claims held / not held / can't be told",
        ),
    ]
    words = [
        f"How the scatter of two grain properties, interparticle friction and particle shear modulus, shows up in the "
        f"behaviour of a granular soil: {len(results.points)} representative points of their joint distribution, "
        f"sheared by the discrete element method at {len(results.densities)} densities{_frictions(results)}, and the "
        f"probability densities that follow.{_filled_words(results)} Statements of {paper.REFERENCE} stand beside the "
        "numbers of this campaign."
    ]
    words += report_setting.conditions(results) + report_setting.size_warning(results)
    short = "".join(map(webpage.paragraph, report_text.in_short(results, claims)))
    text = "".join(map(webpage.paragraph, words))
    return f"<h1>Campaign {webpage.escape(name)}</h1>{text}{webpage.cards(items)}<h3>In short</h3>{short}"


def _filled_words(results):
    filled = max(int(results.filled(mu_iso).sum()) for mu_iso in results.family_densities())
    return f" Of the points {filled} were not run: their values follow from the others by regression." if filled else ""


def _frictions(results):
    """The densities by the friction during consolidation that makes them."""
    frictions = ", ".join(f"{mu_iso:g}" for mu_iso in results.family_densities())
    return f", set by the friction during consolidation (mu_iso = {frictions}, the lowest gives the densest)"


def _inputs(results, figures):
    one = "Table 1. Marginal distributions, smallest AIC first"
    two = "Table 2. Copulas: pseudo-AIC on ranks, Cramér–von Mises distance S and its p-values"
    of_marginals = ("property", "family", "parameters", "aic", "bic", "ks", "ks_critical", "ks_critical_fitted",
                    "ad", "ad_critical_fitted")  # fmt: skip
    of_copulas = ("family", "parameters", "aic", "bic", "tau", "S", "p_paper", "p_bootstrap", "accepted")
    parts = [webpage.paragraph(report_text.source(results)), _pictures(results, figures, "fig02")]
    parts += _fits(tables.marginals(results), of_marginals, one, report_text.marginals_against_paper, results)
    parts += _fits(tables.copulas(results), of_copulas, two, report_text.copulas_against_paper, results)
    return "".join(parts)


def _fits(frame, columns, caption, compare, results):
    """A table of fits and the sentence that compares it with the paper's; nothing if nothing was fitted."""
    if not len(frame):
        return []
    shown = frame[[name for name in columns if name in frame]]
    return [webpage.table(shown, caption, stack=True), webpage.paragraph(compare(results))]


def _points(results, figures):
    attrs = results.inputs["points"]
    facts = "; ".join(f"{k} = {_plain(v)}" for k, v in attrs.items() if k != "columns")
    ranges = " and ".join(
        f"{_sign(s)} from {_shown(s, results.points[s].min())} to {_shown(s, results.points[s].max())}"
        for s in ("mu_s", "G_p")
    )
    text = f"{len(results.points)} points with {ranges}" + (f" ({facts})." if facts else ".")
    text += " The paper's 100 points span 0.15–0.65 and 16–61 GPa; its own lognormals reach lower."
    return webpage.paragraph(text) + _pictures(results, figures, "fig03", "fig04")


def _runs(results):
    counts = trust.run_counts(results)
    never = [name for name in ("failed", "spared", "steady early") if not counts[name].any()]
    counts = webpage.table(counts.drop(columns=never), "Runs by stage", stack=True)
    notes = [report_setting.accuracy(results), *report_text.run_notes(results)]
    return counts + "".join(map(webpage.paragraph, notes))


def _initial(results):
    frame = tables.initial_state(results)
    worst = frame.loc[frame["difference (%)"].abs().idxmax()] if frame["difference (%)"].notna().any() else None
    text = (
        "The state after consolidation, as the paper's Table 3 has it; where one consolidation serves all points, its "
        "COV is the scatter between packings, the paper's that of its 100 points. Beside it the average over the "
        "points before shear, each at rest again with its own friction and modulus: where friction is below that of "
        f"consolidation, a packing collapses, its void ratio by up to {largest_loss(results):.1%}." + (
        f" The largest difference to the paper's Table 3 is {worst['difference (%)']:+.1f} % "
        f"({_sign(worst['quantity'])} at mu_iso = {worst['mu_iso']:g})."
        if worst is not None
        else ""
    ))
    shown = frame[["quantity", "mu_iso"]].assign(
        **{
            "here (COV)": _with_cov(frame["mean"], frame["COV"]),
            "paper (COV)": _with_cov(frame["paper mean"], frame["paper COV"]),
            "difference (%)": frame["difference (%)"],
            "before shear (COV)": _with_cov(frame["mean before shear"], frame["COV before shear"]),
        }
    )
    shown = shown.sort_values(["quantity", "mu_iso"])
    return webpage.paragraph(text) + webpage.table(
        shown, "Table 3. Initial soil state: means, COV in brackets", digits=2
    )


def _peak_critical(results):
    frame = tables.peak_critical(results)
    frame = frame[(frame["family"] == "coupled") & frame["quantity"].isin(["eta", "e", "Z"])]
    frame = frame[frame["state"].isin(["peak", "critical"])]
    frame = frame.assign(
        paper=[
            f"{a:g}–{b:g}" if np.isfinite(a) else "–"
            for a, b in zip(frame["paper from"], frame["paper to"], strict=True)
        ]
    )
    frame = frame.assign(here=[f"{a:.2f}–{b:.2f}" for a, b in zip(frame["least"], frame["largest"], strict=True)])
    columns = ["quantity", "state", "mu_iso", "mean", "COV", "here", "paper"]
    return webpage.table(
        frame.sort_values(["quantity", "state", "mu_iso"])[columns],
        "Peak and critical state: moments and "
        "range over the points, beside the range that the paper reads off its figures",
    )


def _behaviour(results, figures):
    frame = tables.peak_critical(results)
    frame = frame[(frame["family"] == "coupled") & frame["quantity"].isin(["I_G_active", "I_G_stress"])]
    frame = frame[frame["state"].isin(["peak", "critical"]) & frame["mean"].notna()]
    caption = (
        f"Grading indices of the grains that carry stress; the paper: both about {paper.GRADING_INDEX}, COV about "
        f"{paper.GRADING_INDEX_COV:g}; all grains here: {results.grading.get('I_G', np.nan):.4f}"
    )
    columns = ["quantity", "state", "mu_iso", "mean", "COV"]
    shown = webpage.table(frame.sort_values(["quantity", "state", "mu_iso"])[columns], caption, digits=4)
    return _pictures(results, figures, "fig08", "fig09", "fig10", "fig11", "fig12") + shown


def input_bands(results) -> str:
    """HTML on what the number of pairs leaves open: moments with bands, or a sentence that there are none."""
    frame = tables.input_bands(results)
    if not len(frame):
        return webpage.paragraph("The inputs were not refitted to resampled pairs, so there are no bands from them.")
    for name in ("mean", "sd"):
        columns = (frame[name], frame[f"{name}, from"], frame[f"{name}, to"])
        frame[f"{name} (95 %)"] = [
            f"{webpage.number(v)} ({webpage.number(a)} … {webpage.number(b)})" for v, a, b in zip(*columns, strict=True)
        ]
    shown = frame[["quantity", "state", "mu_iso", "mean (95 %)", "sd (95 %)"]].sort_values(["quantity", "state"])
    return webpage.paragraph(report_text.open_inputs(results)) + webpage.table(
        shown, "Moments over the points with bands from resampling the pairs", stack=True
    )


def _claims(claims):
    intro = (
        "Each claim became a number with a 95 % interval from resampling the points, with the packing's noise as "
        "a shift common to all points of a density. It is held if the whole interval meets the criterion, not held if "
        "none of it does, and else can't be told; the criteria are this project's reading of the paper's words."
    )
    told = [f"{webpage.number(v)} ({webpage.number(a)} … {webpage.number(b)}), wanted {limit}" for v, a, b, limit in
            zip(claims["value"], claims["from"], claims["to"], claims["criterion"], strict=True)]  # fmt: skip
    frame = claims.assign(**{"value (interval)": told})
    return webpage.paragraph(intro) + webpage.table(
        frame[["claim", "verdict", "value (interval)", "number"]], stack=True
    )


def _provenance(results):
    attrs = results.attrs
    facts = [f"results.h5 of {attrs['created']}"] + [f"{k} {v}" for k, v in attrs["versions"].items()]
    facts += [f"YADE {v}" for v in sorted(set(results.runs["yade_version"]) - {""})]
    digests = sorted(set(results.runs["script_digest"]) - {""})
    facts.append("run scripts " + ", ".join(d[:12] for d in digests))
    return webpage.paragraph("; ".join(facts) + ".") + f"<h3>Settings</h3><pre>{webpage.escape(attrs['config'])}</pre>"


def _pictures(results, figures, *starts):
    return "".join(
        webpage.figure(path, report_text.caption(results, name[:5]))
        for start in starts
        for name, path in figures.items()
        if name.startswith(start)
    )



def _with_cov(mean, cov):
    """Means with their COV in brackets, where there is one."""
    return [webpage.number(m) + (f" ({webpage.number(round(c, 4), 2)})" if np.isfinite(c) else "")
            for m, c in zip(mean, cov, strict=True)]  # fmt: skip


def _sign(symbol):
    return report_text.SIGNS.get(symbol, symbol)


def _shown(symbol, value):
    quantity = QUANTITIES[symbol]
    unit = quantity.shown_unit or quantity.unit
    return f"{value * quantity.shown_factor:.3g}" + ("" if unit in ("", "1") else f" {unit}")


def _plain(value):
    return ", ".join(f"{v:.3g}" for v in np.atleast_1d(value)) if np.asarray(value).dtype.kind == "f" else str(value)
