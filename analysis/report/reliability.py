"""The report's sections on trust: standing of the states, accuracy, sources of the variance, checks and benchmarks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from ..quantities import DRAINED, Loading
from ..results.reader import Results
from ..tables.variance_sources import share_columns
from . import input_words, page, wording
from .headings import in_order, quantity_words, readable

Frames = Mapping[str, pd.DataFrame]
Names = Mapping[float, str]
ORDER = ["quantity", "state", "mu_iso"]


def standings(frames: Frames, names: Names) -> str:
    """HTML of the standing of every peak and critical state, with the reason."""
    frame = frames["standings"].sort_values("family", key=lambda family: family != "coupled", kind="stable")
    frame = readable(frame, names)
    caption = "Standing of peak and critical state. ± is the half width of the 95 % interval"
    columns = ["density", "state", "family", "standing", "reason"]
    if frame["family"].nunique() == 1:
        columns.remove("family")
    return page.paragraph(wording.STANDINGS) + page.table(frame[columns], "standings", caption, stack=True)


def accuracy(results: Results, frames: Frames, names: Names) -> str:
    """HTML on what limits the accuracy: the noise of packings and runs, and the number of pairs."""
    texts = [wording.packing(frames["packing_design"])]
    parts = []
    moments = frames["moments"]
    if len(moments):
        facts = frames["report_facts"].iloc[0]
        texts += input_words.accuracy_words(results, facts)
    if len(moments) and facts["measurements"]:
        shares = in_order(moments[moments["kind"] == "denoised"])
        shares = shares.assign(runs_share=[f"{100 * v:.0f}" for v in shares["runs_share"]])
        caption = "Share of the squared width of the mean's 95 % interval that more or larger runs could remove"
        parts.append(page.table(readable(shares[[*ORDER, "runs_share"]], names), "runs_share", caption))
    noise = frames["noise"]
    if len(noise):
        noise = noise.assign(**{name: page.intervals(noise, name) for name in ("packing", "own")})
        shown = readable(in_order(noise)[["quantity", "mu_iso", "packing", "own", "run_error"]], names)
        caption = "Noise at the critical state: standard deviations with 95 % intervals"
        parts.append(page.table(shown, "noise", caption, stack=True))
    return page.paragraphs(texts) + "".join(parts)


def sources(results: Results, frames: Frames, names: Names) -> str:
    """HTML on the sources of the variance; a sentence with too few runs."""
    shares = frames["variance_sources"]
    if not len(shares):
        needed = frames["report_facts"].iloc[0]["runs_needed"]
        return page.paragraph(f"Shares of the variance need at least {needed} points per density.")
    parts = [*share_columns(results.points.names), "noise"]
    shares = in_order(shares)
    shares = shares.assign(
        **{k: [f"{v:.2f}" for v in shares[k]] for k in parts},
        **{k: [f"{v:.2f} ({a:.2f} … {b:.2f})" if v == v else "–" for v, a, b in
               zip(shares[k], shares[f"{k}_low"], shares[f"{k}_high"], strict=True)] for k in ("packing", "own")},
    )[[*ORDER, *parts, "packing", "own"]]  # fmt: skip
    caption = (
        f"Shares of the variance of single specimens: explained by {input_words.inputs_counted(results)}, and noise "
        "(95 % intervals)"
    )
    heads = {"shared": "Several of them"} if len(results.points.names) > 2 else {}
    words = input_words.sources_words(results) + wording.ALL_REACHED * results.loading.is_undrained
    return page.paragraph(words) + page.table(
        readable(shares, names), "variance_sources", caption, digits=2, headings=heads
    )


def against_monte_carlo(frames: Frames, names: Names, loading: Loading = DRAINED) -> str:
    """HTML on the points and PDEM against Monte Carlo through the model; "" with too few runs."""
    check, along = frames["monte_carlo"], frames["monte_carlo_along_strain"]
    if not len(check):
        return ""
    differences = [f"{name}_diff" for name in ("mean", "sd", "q05", "q50", "q95")]
    check = check.assign(**{name: [f"{100 * v:+.1f}" for v in check[name]] for name in differences})
    html = page.paragraph(wording.AGAINST_MONTE_CARLO + wording.ALL_REACHED * loading.is_undrained) + page.table(
        readable(in_order(check)[[*ORDER, *differences]], names), "monte_carlo",
        "Points minus Monte Carlo; sd is the standard deviation with the noise of a run", stack=True,
    )  # fmt: skip
    if not len(along):
        return html
    percent = {"mean": "mean_diff", "sd": "sd_diff", "q05": "q05_diff", "q95": "q95_diff", "W1": "W1",
               "W1_average": "W1_average"}  # fmt: skip
    shown = along.assign(**{name: [f"{100 * v:.1f}" for v in along[name]] for name in percent})
    shown = readable(in_order(shown)[["quantity", "mu_iso", *percent]], names).rename(columns=percent)
    return html + page.table(shown, "monte_carlo_along_strain",
                             "PDEM against Monte Carlo: largest differences along strain beyond 1 %")  # fmt: skip


def checks(frames: Frames, names: Names) -> str:
    """HTML of the checks of the runs: limits, probes, axes of stress, widths of the PDFs, lost probability."""
    parts = [
        page.table(frames["proofs"], "proofs", "Checks of the shear runs, as relative errors unless named", stack=True)
    ]
    parts.append(page.paragraphs(wording.proof_notes(frames)))
    if len(frames["stress_axes"]):
        parts.append(page.paragraph(wording.STRESS_AXES))
        caption = "Axes of the cell and principal axes of stress at the critical state: means over the runs"
        parts.append(page.table(readable(frames["stress_axes"], names), "stress_axes", caption, digits=2))
    widths = frames["pdf_widths"]
    if len(widths):
        shares = {"kernel_share": "kernel_width", "spacing_share": "spacing_of_points"}
        widths = widths.assign(**{name: widths[of] / widths["sd_of_points"] for name, of in shares.items()})
        caption = "What widens the PDFs at the last strain, over the standard deviation of the points"
        shown = readable(in_order(widths)[["quantity", "mu_iso", *shares]], names)
        parts.append(page.table(shown, "pdf_widths", caption, digits=2))
    losses = frames["losses"]
    if losses[["failed", "extended", "lost_probability"]].any(axis=None):
        caption = "Failed and continued shear runs, and their probability"
        parts.append(page.table(readable(losses, names), "losses", caption, stack=True))
    return "".join(parts)


def peaks(frames: Frames, names: Names, loading: Loading = DRAINED) -> str:
    """HTML on how the peaks were estimated, and Rowe's relation."""
    parts = []
    if len(frames["peak_estimates"]):
        further = " In extension the peak is the largest magnitude, and the bias is that of the magnitude." * (
            loading.sign < 0
        )
        further += " A test that ended early has the peak of its own curve, if it passed one." * loading.is_undrained
        parts.append(page.paragraph(wording.PEAKS + further))
        caption = "How the peaks were estimated"
        parts.append(page.table(readable(frames["peak_estimates"], names), "peak_estimates", caption, digits=2))
    if len(frames["rowe"]):
        parts.append(page.paragraph(wording.ROWE))
        shown = readable(frames["rowe"].drop(columns="points"), names)
        parts.append(page.table(shown, "rowe", "Rowe's ratio at the peak: mean and range over the points"))
    return "".join(parts)


def replay(frames: Frames, names: Names, loading: Loading = DRAINED) -> str:
    """HTML on the stopping rule, applied to runs that are all there; "" for undrained tests."""
    if loading.is_undrained:
        return ""
    frame = frames["stopping_replay"]
    if not len(frame):
        return page.paragraph(wording.NO_REPLAY)
    if not np.isfinite(frame["claimed"]).any():
        return page.paragraph(wording.REPLAY_WITHOUT_PACKINGS)
    shares = ("share_of_runs", "claimed", "error_all_runs", "error_surface")
    shown = frame.assign(**{k: [f"{100 * v:.1f} %" if np.isfinite(v) else "none" for v in frame[k]] for k in shares},
                         **{k: [_named(text, names) for text in frame[k]] for k in ("claimed_for", "worst_in")},
                         target=frame["target"].str.replace("%", " %"))  # fmt: skip
    caption = "Where the rule would have stopped, the error that it claims, and the errors that the other runs show"
    return page.paragraph(wording.REPLAY) + page.table(shown, "stopping_replay", caption, stack=True)


def _named(response: str, names: Names) -> str:
    """Name of a judged response with the name of its density in place of mu_iso."""
    words, _, mu_iso = response.partition(", mu_iso = ")
    return f"{words}, {names[float(mu_iso)]}" if mu_iso else response


def other_runs(frames: Frames) -> str:
    """HTML of the benchmarks beside results.h5, other sizes and rates, other grains; "" without them."""
    parts: list[str] = []
    for name, show in (("fidelity", _fidelity), ("beyond", _beyond)):
        if len(frames[name]):
            parts += [page.paragraph(wording.BESIDE[name]), *show(frames[name])]
    return "".join(parts)


def _fidelity(frame: pd.DataFrame) -> Iterator[str]:
    """Bias and scatter apart, one row per response and one column per other setting."""
    frame = frame.assign(response=[_response(text) for text in frame["response"]])
    within = {"yes": "within", "no": "outside"}
    cells = [f"{b:+.1f} ± {h:.1f}, {within.get(word, word)}" for b, h, word in
             zip(frame["bias (%)"], frame["± (%)"], frame["bias within"], strict=True)]  # fmt: skip
    bias = _wide(frame.assign(cell=cells), "against", "cell")
    scatter = _wide(frame, "against", "scatter, rung (%)").dropna(axis=1, how="all")
    scatter.insert(1, "this setting", _wide(frame, "against", "scatter, laptop (%)").iloc[:, 1])
    failed = int(frame.drop_duplicates("against")["failed"].sum() + frame["failed, laptop"].iloc[0])
    promised = frame["promised (%)"].iloc[0]
    heads = {name: f"{name[0].upper()}{name[1:]}" for name in (*bias.columns, *scatter.columns)}
    heads |= {name: f"{words} (%)" for name, words in heads.items() if name != "response"}
    yield page.table(
        bias, "fidelity",
        f"Bias of this campaign's setting against others in %, ± half width of the 95 % interval, and whether it is "
        f"within {promised:g} % ({page.plural(failed, 'chain of runs', 'chains of runs')} failed)",
        stack=True, headings=heads,
    )  # fmt: skip
    yield page.table(scatter, "scatter", "Scatter between packings at the same point in %", digits=2, headings=heads)


def _beyond(frame: pd.DataFrame) -> Iterator[str]:
    """Differences from what each case is compared with, one row per response, beside the scatters."""
    frame = frame.assign(
        response=[_response(f"{r}_{s}") for r, s in zip(frame["response"], frame["state"], strict=True)]
    )
    frame["case"] = frame["case"].replace("own pair a grain", "own pair per grain")
    differences = _wide(frame.assign(cell=[f"{v:+.1f}" for v in frame["difference (%)"]]), "case", "cell")
    for name in ("scatter between packings (%)", "scatter between draws (%)"):
        differences[name] = frame.groupby("response", sort=False)[name].max().to_numpy()
    sides = (("case", "failed"), ("against", "failed of the other"))
    failed = sum(int(frame.drop_duplicates(side)[count].sum()) for side, count in sides)
    heads = {name: f"{name[0].upper()}{name[1:]}" for name in differences.columns}
    heads |= {name: f"{words} (%)" for name, words in heads.items() if name in set(frame["case"])}
    yield page.table(
        differences, "beyond",
        "Difference in %: of a grading from the standard one, of grains with their own pairs from grains with one pair "
        f"({page.plural(failed, 'chain of runs', 'chains of runs')} failed)",
        stack=True, digits=2, headings=heads,
    )  # fmt: skip


def _response(text: str) -> str:
    """Words of a response of a benchmark, such as "eta_peak" or "G_0 (MPa)_probe"."""
    symbol, _, state = text.rpartition("_")
    words = {"peak": "peak", "critical": "critical", "probe": "small strain"}
    return f"{quantity_words(symbol.split(' (')[0]).split(' (')[0]}, {words.get(state, state)}"


def _wide(frame: pd.DataFrame, column: str, value: str) -> pd.DataFrame:
    """One row per response and one column per value of `column`, in the order of the frame."""
    wide = frame.pivot(index="response", columns=column, values=value)
    return wide.loc[frame["response"].unique(), frame[column].unique()].rename_axis(None, axis=1).reset_index()
