"""The report's section on friction: critical stress ratio along it, differences between densities, published values."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from ..quantities import DRAINED, Loading, with_error
from ..tables.published import SOURCE, SURFACES
from . import page


def friction(frames: Mapping[str, pd.DataFrame], names: Mapping[float, str], loading: Loading = DRAINED) -> str:
    """HTML of the critical stress ratio along friction: table, differences between densities, published values.

    Published values stand beside drained compression only.
    """
    frame = frames["friction"]
    frame = frame[(frame["state"] == "critical") & (frame["quantity"] == "eta")]
    if not len(frame):
        return page.paragraph(
            "There is no table of single frictions: it needs "
            f"{frames['report_facts'].iloc[0]['runs_needed']} points per density, and runs that reach one of the "
            "frictions."
        )
    shown = frame.assign(text=[with_error(v, h) for v, h in zip(frame["value"], frame["ci95"], strict=True)])
    shown = shown.pivot(index=["mu_s", "G_p_GPa"], columns="mu_iso", values="text")
    shown.columns = [names[mu_iso] for mu_iso in shown.columns]
    heads = {name: f"Stress ratio eta, {name}" for name in shown.columns}
    caption = (
        "Critical stress ratio eta at single frictions, from the model of all runs (± half width of the 95 % interval)"
    )
    shown = shown.reset_index().assign(mu_s=[f"{mu_s:g}" for mu_s, _ in shown.index])
    parts = [page.table(shown, "friction", caption, headings=heads),
             page.paragraph(density_words(frames["density_differences"]))]  # fmt: skip
    if loading == DRAINED and len(frames["published_shear"]):
        parts.append(page.paragraph(published_words(frames["published_shear"])))
    return "".join(parts)


def density_words(differences: pd.DataFrame) -> str:
    """Whether the critical stress ratio at a friction depends on the density, from `friction.density_differences`."""
    row = differences.iloc[0]
    if row["densities"] < 2:
        return "With one density there is nothing to compare at a given friction."
    if not row["differences"]:
        return ("The effect of the initial density cannot be decided: with fewer than three packings their noise is "
                "not known.")  # fmt: skip
    outside, count = int(row["outside"]), int(row["differences"])
    beyond = f"{outside or 'None'} of {page.plural(count, 'difference', 'differences')}"
    return (
        f"At the same friction the critical stress ratios of the densities lie within {row['largest_pct']:.1f} % of "
        f"their mean; the least certain difference is known to ± {row['widest_ci95_pct']:.1f} %. {beyond} "
        f"{'lie' if outside > 1 else 'lies'} outside the 95 % interval of that difference alone. Neighbouring "
        "frictions share a model and are not independent."
    )


def published_words(frame: pd.DataFrame) -> str:
    """Published critical states of spheres beside this campaign's, from `beside_published`'s rows."""
    parts = []
    for row in frame.to_dict("records"):
        by = " and ".join(f"{row[name]:.3f} ({row[f'{name}_difference_pct']:+.1f} %)" for name in SURFACES)
        parts.append(f"{row['here']:.3f} here against {by} at mu_s = {row['mu_s']:g}")
    return (
        f"Published for spheres in slow simple shear ({SOURCE}), converted to triaxial compression on the critical "
        f"surface of {' and of '.join(SURFACES)} (in brackets the difference of this campaign): {'; '.join(parts)}. "
        "Those are spheres of another grading and contact law."
    )
