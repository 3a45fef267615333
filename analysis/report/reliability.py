"""The report's sections on reliability: sources of the scatter, enough runs, other sizes, proofs and noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pandas as pd

from ..results.reader import Results
from ..tables.variance_sources import share_columns
from . import input_words, page, wording

Frames = Mapping[str, pd.DataFrame]


def sources(results: Results, frames: Frames) -> str:
    """HTML on the sources of the variance, and on the points and PDEM against Monte Carlo."""
    shares = frames["variance_sources"]
    if not len(shares):
        return page.paragraph(
            "Too few runs for shares of the variance: they need at least "
            f"{frames['report_facts'].iloc[0]['runs_needed']} points per density."
        )
    parts = [*share_columns(results.points.names), "noise"]
    shares = shares[["quantity", "state", "mu_iso", *parts, "packing", "own"]].assign(
        **{k: [f"{v:.2f}" for v in shares[k]] for k in parts},
        **{k: [f"{v:.2f} ({a:.2f}–{b:.2f})" if v == v else "–" for v, a, b in
               zip(shares[k], shares[f"{k}_low"], shares[f"{k}_high"], strict=True)] for k in ("packing", "own")},
    )  # fmt: skip
    check = frames["monte_carlo"]
    check = check[check["quantity"].isin(("eta", "e", "Z", "G_0"))]
    compared = {name: [f"{page.number(a)} ({100 * difference:+.1f})"
                       for a, difference in zip(check[name], check[f"{name}_diff"], strict=True)]
                for name in ("mean", "sd", "q05", "q50", "q95")}  # fmt: skip
    along = frames["monte_carlo_along_strain"]
    percent = [name for name in along.columns if name not in ("mu_iso", "quantity", "unit")]
    along = along.assign(quantity=page.headings(along), **{k: [f"{100 * v:.1f}" for v in along[k]] for k in percent})
    return "".join((
        page.paragraph(input_words.sources_words(results)),
        page.table(
            shares.sort_values(["quantity", "state", "mu_iso"]), "Shares of the variance (95 % intervals)", digits=2
        ),
        page.table(
            check[["state", "mu_iso"]].assign(**compared, quantity=page.headings(check))
            [["quantity", "state", "mu_iso", *compared]],
            "Moments and quantiles of the points; in brackets their difference from Monte Carlo through the model with "
            "noise, in % of its standard deviation",
            stack=True,
        ),
        page.table(
            along.drop(columns="unit"),
            "PDEM against Monte Carlo along strain beyond 1 %: largest differences in % of the standard deviation; "
            "W1: Wasserstein distance of the PDFs",
        ),
    ))  # fmt: skip


def replay(frames: Frames) -> str:
    """HTML on the stopping rule applied in hindsight."""
    frame = frames["stopping_replay"]
    if not len(frame):
        return page.paragraph("This cannot be judged: points were spared, or too few were run.")
    shares = ("share_of_runs", "claimed", "error_all_runs", "error_surface")
    shown = frame.assign(**{name: [f"{v:.1%}" for v in frame[name]] for name in shares})
    return page.paragraph(wording.REPLAY) + page.table(shown, "The stopping rule in hindsight", stack=True)


def friction_angles(frames: Frames) -> str:
    """HTML of the friction angles with their intervals."""
    frame = frames["design"]
    names = ("mean_deg", "sd_deg", "q05_deg", "q95_deg")
    shown = frame.assign(**{name: [f"{v:.1f} ({a:.1f}–{b:.1f})" if v == v else "withheld" for v, a, b in zip(
        frame[name], frame[f"{name}_low"], frame[f"{name}_high"], strict=True)] for name in names})  # fmt: skip
    caption = "Friction angles (degrees): mean, standard deviation, 5 % (characteristic) and 95 % quantile"
    columns = ["mu_iso", "state", "standing", "kind", *names]
    return page.paragraph(wording.FRICTION_ANGLES) + page.table(shown[columns], caption, stack=True)


def noise_and_proofs(frames: Frames) -> str:
    """HTML of the proofs, the drift, the noise of packings, the bands, the PDF widths and the lost probability."""
    parts = [page.table(frames["proofs"], "Checks of the shear runs", stack=True)]
    parts += map(page.paragraph, wording.proof_notes(frames))
    noise = frames["noise"]
    intervals = {name: page.intervals(noise, name, "–") for name in ("packing", "own")}
    noise = noise.assign(**intervals, quantity=page.headings(noise))
    parts.append(page.table(
        noise[["quantity", "mu_iso", "sd_of_points", "packing", "own", "run_error"]],
        "Noise at the critical state: standard deviation over the points, of packings and of single runs (95 % "
        "intervals), and the standard error of one run's average from its own fluctuation",
        stack=True,
    ))  # fmt: skip
    if len(frames["stress_axes"]):
        parts.append(page.paragraph(wording.STRESS_AXES))
        parts.append(page.table(frames["stress_axes"], "Axes of the cell and principal axes of stress, in %", digits=2))
    if len(frames["peak_estimates"]):
        parts.append(page.paragraph(wording.PEAKS))
        parts.append(page.table(frames["peak_estimates"], "How the peaks were estimated", digits=2))
    if len(frames["rowe"]):
        parts.append(page.paragraph(wording.ROWE))
        parts.append(page.table(frames["rowe"], "Rowe's ratio at the peak: mean and range over the points", digits=3))
    parts.append(page.table(
        frames["pdf_widths"].assign(quantity=page.headings(frames["pdf_widths"])).drop(columns="unit"),
        "Width of the PDFs: kernel beside the spread of the points, at the last strain",
    ))  # fmt: skip
    losses = frames["losses"]
    if losses[["failed", "extended", "lost_probability"]].any(axis=None):
        parts.append(page.table(losses, "Failed and continued shear runs, and their probability", stack=True))
    return "".join(parts)


def other_runs(frames: Frames) -> str:
    """HTML of the benchmarks beside results.h5, other sizes and rates, other grains; "" without them."""
    parts: list[str] = []
    for name, show in (("fidelity", _fidelity), ("beyond", _beyond)):
        if len(frames[name]):
            parts += [page.paragraph(wording.BESIDE[name]), *show(frames[name])]
    return "".join(parts)


def _fidelity(frame: pd.DataFrame) -> Iterator[str]:
    """Bias and scatter apart, one row per response and one column per rung."""
    cells = [f"{b:+.1f} ± {h:.1f}, {word}" for b, h, word in
             zip(frame["bias (%)"], frame["± (%)"], frame["bias within"], strict=True)]  # fmt: skip
    bias = _wide(frame.assign(cell=cells), "against", "cell")
    scatter = _wide(frame, "against", "scatter, rung (%)").dropna(axis=1, how="all")
    scatter.insert(1, "lowest rung", _wide(frame, "against", "scatter, laptop (%)").iloc[:, 1])
    failed = int(frame.drop_duplicates("against")["failed"].sum() + frame["failed, laptop"].iloc[0])
    promised = frame["promised (%)"].iloc[0]
    caption = f"bias of this campaign's setting against each rung in %, ± 95 %, and whether it is within {promised:g} %"
    yield page.table(bias, f"The fidelity ladder: {caption} ({failed} chains failed)", stack=True)
    yield page.table(scatter, "Scatter between packings at the same point in %", digits=2)


def _beyond(frame: pd.DataFrame) -> Iterator[str]:
    """Differences from what each case is compared with, one row per response, beside the scatters."""
    frame = frame.assign(response=frame["response"] + ", " + frame["state"])
    differences = _wide(frame.assign(cell=[f"{v:+.1f}" for v in frame["difference (%)"]]), "case", "cell")
    for name in ("scatter between packings (%)", "scatter between draws (%)"):
        differences[name.removesuffix(" (%)")] = frame.groupby("response", sort=False)[name].max().to_numpy()
    sides = (("case", "failed"), ("against", "failed of the other"))
    failed = sum(int(frame.drop_duplicates(side)[count].sum()) for side, count in sides)
    caption = (f"Difference in %: of a grading from the standard one, of one pair per grain from one pair per "
               f"specimen ({failed} chains failed)")  # fmt: skip
    yield page.table(differences, caption, stack=True, digits=2)


def _wide(frame: pd.DataFrame, column: str, value: str) -> pd.DataFrame:
    """One row per response and one column per value of `column`, in the order of the frame."""
    wide = frame.pivot(index="response", columns=column, values=value)
    return wide.loc[frame["response"].unique(), frame[column].unique()].rename_axis(None, axis=1).reset_index()
