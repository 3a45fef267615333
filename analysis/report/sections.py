"""The report as one self-contained HTML page: the campaign's results beside the paper's, and their reliability."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..errors_and_files import atomic_write
from ..figures import write_figures
from ..quantities import QUANTITIES
from ..results.reader import Results, ResultsError, read_results
from ..tables import DERIVED_TABLES, REPORT_TABLES, TABLES, published
from ..tables.claim_intervals import CONTRADICTED, INCONCLUSIVE, SUPPORTED
from . import conditions, friction, input_words, page, reliability, wording

#: Every table; the report shows most of them.
NEEDED = {*TABLES, *REPORT_TABLES, *DERIVED_TABLES}


class Content(NamedTuple):
    """What the page is made of: open results, frames as `evaluate` returns them, figure name -> PNG."""

    results: Results
    frames: Mapping[str, pd.DataFrame]
    figures: Mapping[str, Path]


def write_report(results: str | Path | Results, frames: Mapping[str, pd.DataFrame], folder: str | Path) -> Path:
    """Draw all figures into <folder>/figures and write <folder>/report.html.

    Parameters
    ----------
    results : str, Path or Results
        results.h5, or results that are already open.
    frames : mapping of str to pandas.DataFrame
        As `evaluate` returns them for these results.
    folder : str or Path
        Where the page and the figures go.

    Returns
    -------
    Path
        The page. It embeds its pictures, needs no network, and is written whole or not at all.

    Examples
    --------
    >>> import tempfile
    >>> page = write_report("runs/demo/results.h5", evaluate("runs/demo/results.h5"), tempfile.mkdtemp())
    >>> page.name
    'report.html'
    """
    results = read_results(results)
    if missing := sorted(NEEDED - set(frames)):
        raise ResultsError(f"the report needs all tables; missing: {', '.join(missing)} (frames = evaluate(results))")
    folder = Path(folder)
    figures = {path.stem: path for path in write_figures(results, frames, folder / "figures")}
    name = results.attrs["campaign"] or folder.resolve().name
    target = folder / "report.html"
    with atomic_write(target) as part:
        part.write_text(page.page(f"Campaign {name}", sections(Content(results, frames, figures), name)), "utf-8")
    return target


def sections(content: Content, name: str) -> list[tuple[str, str]]:
    """The page's sections in order, as (heading, HTML); sections without content are left out."""
    results, frames, _ = content
    listed = [
        ("", _head(content, name)),
        ("The paper's claims, each with a number", _claims(frames["claims"])),
        (input_words.inputs_heading(results), _inputs(content)),
        ("Representative points and grading", _points(content)),
        ("Runs", _runs(results, frames)),
        ("Initial states", _initial(frames)),
        ("Stress ratio", _pictures(content, "fig05", "fig06", "fig07") + _peak_critical(frames)),
        ("Void ratios, coordination, fabric", _behaviour(content)),
        ("Stiffness and dilatancy", _pictures(content, "fig13")),
        ("Joint PDFs", _pictures(content, "fig14", "fig15")),
        ("The effect of friction", _effect_of_friction(content)),
        ("Sources of the scatter", reliability.sources(results, frames)),
        ("Moments and quantiles with their uncertainty", moments_html(results, frames)),
        ("Friction angles for design", reliability.friction_angles(frames)),
        ("How many runs would have been enough", reliability.replay(frames)),
        ("Other sizes and rates, and other grains", reliability.other_runs(frames)),
        ("Reliability of the numbers", reliability.noise_and_proofs(frames)),
        ("Provenance", _provenance(results)),
    ]
    return [(heading, html) for heading, html in listed if html]


def _head(content: Content, name: str) -> str:
    results, frames, _ = content
    outcomes = frames["claims"]["verdict"].value_counts()
    counts = frames["run_counts"].iloc[-1]
    done, planned = int(counts["done"]), int(counts["planned"])
    items = [
        (str(len(results.points)), f"points of ({', '.join(map(wording.sign, results.points.names))})"),
        (str(len(results.densities)), "densities" if len(results.densities) > 1 else "density"),
        (str(done), "runs, all with a product" if done == planned else f"of {planned} runs done"),
        (conditions.particles(frames), "spheres per run"),
        (f"{counts['core_hours']:.3g}", "core-hours"),
        (
            " / ".join(str(outcomes.get(outcome, 0)) for outcome in (SUPPORTED, CONTRADICTED, INCONCLUSIVE)),
            "claims supported / contradicted / inconclusive",
        ),
    ]
    paragraphs = [
        conditions.introduction(results, frames),
        *conditions.test_words(results, frames["report_facts"].iloc[0]),
    ]
    paragraphs += conditions.size_warning(results, frames)
    short = "".join(map(page.paragraph, wording.in_short(frames)))
    text = "".join(map(page.paragraph, paragraphs))
    return f"<h1>Campaign {page.escape(name)}</h1>{text}{page.cards(items)}<h3>In short</h3>{short}"


def _inputs(content: Content) -> str:
    results, frames, _ = content
    of_marginals = ("property", "family", "parameters", "aic", "bic", "ks", "ks_critical", "ks_critical_fitted",
                    "ad", "ad_critical_fitted")  # fmt: skip
    of_copulas = ("family", "parameters", "aic", "bic", "tau", "S", "p_paper", "p_bootstrap", "accepted")
    usual = input_words.is_pair_of_friction_and_modulus(results) and input_words.are_measured(results)
    facts = frames["report_facts"].iloc[0]
    source = wording.source(results) if usual else input_words.inputs_source(results, facts)
    parts = [page.paragraph(source), *map(page.paragraph, wording.input_warnings(results))]
    parts.append(_pictures(content, "fig02"))
    if len(frames["marginals"]):
        order = ", smallest AIC first" if input_words.are_measured(results) else ""
        caption = f"Table 1. Marginal distributions{order}"
        shown = _columns(frames["marginals"], of_marginals)
        shown = shown if input_words.are_measured(results) else shown.dropna(axis=1, how="all")
        parts.append(page.table(shown, caption, stack=True))
        if usual:
            parts.append(page.paragraph(wording.marginals_against_paper(results)))
    if len(frames["copulas"]):
        tests = ", Cramér–von Mises distance S and its p-values" if "S" in frames["copulas"] else ""
        caption = f"Table 2. Copulas: pseudo-AIC on ranks{tests}"
        if not input_words.are_measured(results):
            caption = "Table 2. The copula that was given"
        parts.append(page.table(_columns(frames["copulas"], of_copulas), caption, stack=True))
        if usual:
            parts.append(page.paragraph(wording.copulas_against_paper(results)))
    return "".join(parts)


def _columns(frame: pd.DataFrame, names: Iterable[str]) -> pd.DataFrame:
    return frame[[name for name in names if name in frame]]


def _points(content: Content) -> str:
    results = content.results
    attrs = results.inputs["points"]
    facts = "; ".join(f"{k} = {_plain(v)}" for k, v in attrs.items() if k != "columns")
    ranges = input_words.listed([
        f"{wording.sign(s)} from {_shown(s, results.points[s].min())} to {_shown(s, results.points[s].max())}"
        for s in results.points.names
    ])  # fmt: skip
    text = f"{len(results.points)} points with {ranges}" + (f" ({facts})." if facts else ".")
    if input_words.is_pair_of_friction_and_modulus(results):
        text += " The paper's 100 points span 0.15–0.65 and 16–61 GPa; its own lognormals reach lower."
    return page.paragraph(text) + _pictures(content, "fig03", "fig04")


def _effect_of_friction(content: Content) -> str:
    """Figure and tables along friction, or nothing where friction is not random."""
    if "mu_s" not in content.results.points.names:
        return ""
    return _pictures(content, "fig16") + friction.friction(content.frames)


def _runs(results: Results, frames: Mapping[str, pd.DataFrame]) -> str:
    counts = frames["run_counts"]
    zero = [name for name in ("failed", "spared", "steady_early") if not counts[name].any()]
    table = page.table(counts.drop(columns=zero), "Runs by stage", stack=True)
    notes = [conditions.accuracy(results, frames), *wording.run_notes(results, frames)]
    return table + "".join(map(page.paragraph, notes))


def _initial(frames: Mapping[str, pd.DataFrame]) -> str:
    frame = frames["initial_state"]
    shown = frame[["quantity", "mu_iso"]].assign(
        here_cov=_with_cov(frame["mean"], frame["COV"]),
        paper_cov=_with_cov(frame["paper_mean"], frame["paper_COV"]),
        difference_pct=frame["difference_pct"],
        before_shear_cov=_with_cov(frame["mean_before_shear"], frame["COV_before_shear"]),
    )
    shown = shown.sort_values(["quantity", "mu_iso"])
    text = page.paragraph(wording.initial_states(frames["report_facts"].iloc[0], frames["packing_collapse"]))
    return text + page.table(shown, "Table 3. Initial soil state: means, COV in brackets", digits=2)


def _peak_critical(frames: Mapping[str, pd.DataFrame]) -> str:
    frame = frames["peak_critical"]
    frame = frame[(frame["family"] == "coupled") & frame["quantity"].isin(["eta", "e", "Z"])]
    frame = frame[frame["state"].isin(["peak", "critical"])]
    paper = [f"{a:g}–{b:g}" if np.isfinite(a) else "–"
             for a, b in zip(frame["paper_low"], frame["paper_high"], strict=True)]  # fmt: skip
    here = [
        f"{a:.2f}–{b:.2f}" if np.isfinite(a) else "withheld" for a, b in zip(frame["min"], frame["max"], strict=True)
    ]
    frame = frame.assign(here=here, paper=paper).sort_values(["quantity", "state", "mu_iso"])
    return page.table(
        frame[["quantity", "state", "mu_iso", "standing", "mean", "COV", "here", "paper"]],
        "Peak and critical state: moments and range over the points, beside the range that the paper reads off its "
        "figures",
    )


def _behaviour(content: Content) -> str:
    frame = content.frames["peak_critical"]
    frame = frame[(frame["family"] == "coupled") & frame["quantity"].isin(["I_G_active", "I_G_stress"])]
    frame = frame[frame["state"].isin(["peak", "critical"]) & frame["mean"].notna()]
    caption = (
        f"Grading indices of the grains that carry stress; the paper: both about {published.GRADING_INDEX}, COV about "
        f"{published.GRADING_INDEX_COV:g}; all grains here: {content.results.grading.get('I_G', np.nan):.4f}"
    )
    columns = ["quantity", "state", "mu_iso", "mean", "COV"]
    table = page.table(frame.sort_values(["quantity", "state", "mu_iso"])[columns], caption, digits=4)
    return _pictures(content, "fig08", "fig09", "fig10", "fig11", "fig12") + table


def moments_html(results: Results, frames: Mapping[str, pd.DataFrame]) -> str:
    """HTML of the states' moments and quantiles, denoised and as simulated, or a sentence that there are none."""
    frame = frames["moments"]
    if not len(frame):
        return page.paragraph("There are too few runs for moments with intervals.")
    shown = frame.assign(quantity=page.headings(frame))
    for name in ("mean", "sd", "q05", "q95"):
        shown[name] = page.intervals(frame, name, " … ")
    columns = ["quantity", "state", "mu_iso", "kind", "mean", "sd", "q05", "q95", "runs_share"]
    shown = shown.sort_values(["quantity", "state", "mu_iso", "kind"], ascending=[True, True, True, False])
    notes = (wording.MOMENTS, input_words.bands_words(results, frames["report_facts"].iloc[0]))
    text = "".join(map(page.paragraph, notes))
    caption = "Mean, standard deviation, 5 % and 95 % quantile of the states, with 95 % intervals"
    return text + page.table(shown[columns], caption, stack=True, digits=2)


def _claims(claims: pd.DataFrame) -> str:
    columns = (claims["value"], claims["low"], claims["high"], claims["criterion"])
    values = [f"{page.number(v)} ({page.number(a)} … {page.number(b)}), criterion {limit}"
              for v, a, b, limit in zip(*columns, strict=True)]  # fmt: skip
    needed = [f"; would be decided by {words}" if words else "" for words in claims["to_decide"]]
    values = [value + more for value, more in zip(values, needed, strict=True)]
    shown = claims.assign(value_interval=values)[["claim", "verdict", "value_interval", "number"]]
    return page.paragraph(wording.CLAIMS) + page.table(shown, stack=True)


def _provenance(results: Results) -> str:
    attrs = results.attrs
    facts = [f"results.h5 of {attrs['created']}"] + [f"{k} {v}" for k, v in attrs["versions"].items()]
    facts += [f"YADE {v}" for v in sorted(set(results.runs["yade_version"]) - {""})]
    digests = sorted(set(results.runs["script_digest"]) - {""})
    facts.append("run scripts " + ", ".join(d[:12] for d in digests))
    return page.paragraph("; ".join(facts) + ".") + f"<h3>Settings</h3><pre>{page.escape(attrs['config'])}</pre>"


def _pictures(content: Content, *starts: str) -> str:
    return "".join(
        page.figure(path, wording.caption(content.results, name[:5]))
        for start in starts
        for name, path in content.figures.items()
        if name.startswith(start)
    )


def _with_cov(mean: Iterable[float], cov: Iterable[float]) -> list[str]:
    """Means with their COV in brackets, where there is one."""
    return [page.number(m) + (f" ({page.number(round(c, 4), 2)})" if np.isfinite(c) else "")
            for m, c in zip(mean, cov, strict=True)]  # fmt: skip


def _shown(symbol: str, value: float) -> str:
    quantity = QUANTITIES[symbol]
    unit = quantity.shown_unit or quantity.unit
    return f"{value * quantity.shown_factor:.3g}" + ("" if unit in ("", "1") else f" {unit}")


def _plain(value: Any) -> str:
    return ", ".join(f"{v:.3g}" for v in np.atleast_1d(value)) if np.asarray(value).dtype.kind == "f" else str(value)
