"""The report's sections on how far to trust it: sources of variance, enough runs, other sizes, proofs and noise."""

from __future__ import annotations

import pandas as pd

from analysis import report_text, tables, trust, webpage
from analysis.quantities import QUANTITIES
from analysis.stopping import LEAST


def sources(results):
    frame = tables.variance_sources(results)
    if not len(frame):
        return webpage.paragraph(f"Too few runs for a response surface: at least {LEAST} points a density.")
    parts = ("only mu_s", "only G_p", "shared", "noise")
    shares = frame.drop(columns="leave-one-out error").assign(**{k: [f"{v:.2f}" for v in frame[k]] for k in parts})
    check = tables.monte_carlo_check(results)
    check = check[check["quantity"].isin([QUANTITIES[symbol].heading for symbol in ("eta", "e", "Z", "G_0")])]
    names = ("mean", "sd", "5%", "50%", "95%")
    columns = {name: [f"{webpage.number(a)} ({100 * off:+.1f})" for a, off in
                      zip(check[name], check[f"difference of {name}"], strict=True)] for name in names}  # fmt: skip
    along = tables.monte_carlo_along(results)
    percent = [name for name in along.columns if name not in ("mu_iso", "quantity")]
    along = along.assign(**{name: [f"{100 * v:.1f}" for v in along[name]] for name in percent})
    return (
        webpage.paragraph(report_text.SOURCES)
        + webpage.table(
            shares.sort_values(["quantity", "state", "mu_iso"]),
            "Shares of the variance over the points",
            digits=2,
        )
        + webpage.table(
            check[["quantity", "state", "mu_iso"]].assign(**columns),
            "The points' moments and quantiles, in brackets their difference to Monte Carlo through the response "
            "surface, in % of its standard deviation with noise",
            stack=True,
        )
        + webpage.table(
            along,
            "PDEM against Monte Carlo along strain beyond 1 %: largest differences in % of the "
            "standard deviation; PDF: Wasserstein distance",
        )  # fmt: skip
    )


def replay(results):
    frame = tables.stopping_replay(results)
    if not len(frame):
        return webpage.paragraph("Not to be told here: points were spared, or they are too few for a response surface.")
    for name in ("share of runs", "claimed", "against all runs", "against the surface of all"):
        frame[name] = [f"{v:.1%}" for v in frame[name]]
    return webpage.paragraph(report_text.REPLAY) + webpage.table(frame, "The stopping rule replayed", stack=True)


def design(results):
    frame = tables.design_table(results)
    names = {
        "mean (deg)": "mean",
        "characteristic 5 % from the points (deg)": "5 % of points",
        "characteristic 5 % from the density (deg)": "5 % of density",
    }
    for long, short in names.items():
        frame[short] = [
            f"{v:.1f} ({a:.1f}–{b:.1f})"
            for v, a, b in zip(frame[long], frame[f"{long}, from"], frame[f"{long}, to"], strict=True)
        ]
    text = (
        "Friction angles in degrees in triaxial compression, sin φ = 3η/(6+η), with 95 % bands from resampling the "
        "points, from the packing's noise and from the finite set of pairs. Every run gives all its grains "
        "one pair of properties, so the spread is that of the population's mean properties, not the scatter within one "
        "deposit."
    )
    return webpage.paragraph(text) + webpage.table(
        frame[["mu_iso", "state", *names.values()]], "Mean and characteristic friction angles (degrees)"
    )


def noise_and_proofs(results):
    parts = [webpage.table(trust.proofs(results), "What every shear run proves about itself", stack=True)]
    parts += map(webpage.paragraph, report_text.proof_notes(results))
    parts.append(
        webpage.table(
            trust.noise(results),
            "How much of a spread is noise: standard deviation over the points, standard error of one run's critical "
            "average, scatter between packings, and what all points of a density may share",
            stack=True,
        )
    )
    parts += _bands(results)
    parts.append(
        webpage.table(
            trust.widths(results),
            "Width of the shown densities: kernel against the spread of the points, at the last strain",
        )
    )
    losses = trust.losses(results)
    if losses[["failed", "extended", "lost probability"]].any(axis=None):
        parts.append(
            webpage.table(losses, "Failed and continued shear runs, and the probability they held", stack=True)
        )
    return "".join(parts)


def _bands(results):
    frame = tables.moment_bands(results)
    if not len(frame):
        return []
    for name in ("mean", "sd"):
        frame[name] = [f"{webpage.number(v)} ({webpage.number(a)}–{webpage.number(b)})" for v, a, b in
                       zip(frame[name], frame[f"{name}, from"], frame[f"{name}, to"], strict=True)]  # fmt: skip
    shown = frame[["quantity", "state", "mu_iso", "mean", "sd", "from runs"]]
    return [webpage.paragraph(report_text.BANDS),
            webpage.table(shown, "95 % bands of means and standard deviations; last, the share of the mean's squared "
                          "error that comes from the runs", stack=True, digits=2)]  # fmt: skip


def other_runs(results) -> str:
    """Benchmarks beside results.h5, fidelity.csv and beyond.csv: other sizes and rates, other grains; "" without."""
    parts = []
    for name, show in (("fidelity", _fidelity), ("beyond", _beyond)):
        path = results.path.parent / f"{name}.csv"
        if path.exists():
            parts += [webpage.paragraph(report_text.BESIDE[name]), *show(pd.read_csv(path))]
    return "".join(parts)


def _fidelity(frame):
    """Bias and scatter apart, one row a response and one column a rung."""
    cells = [f"{b:+.1f} ± {h:.1f}, {word}" for b, h, word in
             zip(frame["bias (%)"], frame["± (%)"], frame["bias within"], strict=True)]  # fmt: skip
    bias = _wide(frame.assign(cell=cells), "against", "cell")
    scatter = _wide(frame, "against", "scatter, rung (%)").dropna(axis=1, how="all")
    scatter.insert(1, "laptop", _wide(frame, "against", "scatter, laptop (%)").iloc[:, 1])
    failed = int(frame.drop_duplicates("against")["failed"].sum() + frame["failed, laptop"].iloc[0])
    promised = frame["promised (%)"].iloc[0]
    caption = f"bias of the laptop's setting against each rung in %, ± 95 %, and whether it is within {promised:g} %"
    yield webpage.table(bias, f"The fidelity ladder: {caption} ({failed} chains failed)", stack=True)
    yield webpage.table(scatter, "Scatter between packings at the same point in %", digits=2)


def _beyond(frame):
    """Differences to what each case is compared with, one row a response, beside the scatters."""
    frame = frame.assign(response=frame["response"] + ", " + frame["state"])
    off = _wide(frame.assign(cell=[f"{v:+.1f}" for v in frame["difference (%)"]]), "case", "cell")
    for name in ("scatter between packings (%)", "scatter between draws (%)"):
        off[name.removesuffix(" (%)")] = frame.groupby("response", sort=False)[name].max().to_numpy()
    sides = (("case", "failed"), ("against", "failed of the other"))
    failed = sum(int(frame.drop_duplicates(side)[count].sum()) for side, count in sides)
    yield webpage.table(off, f"Difference in %: of a grading to the standard one, of own pairs to one pair a specimen "
                        f"({failed} chains failed)", stack=True, digits=2)  # fmt: skip


def _wide(frame, column, value):
    """One row a response and one column each value of `column`, in the order of the frame."""
    wide = frame.pivot(index="response", columns=column, values=value)
    return wide.loc[frame["response"].unique(), frame[column].unique()].rename_axis(None, axis=1).reset_index()
