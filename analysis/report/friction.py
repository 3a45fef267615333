"""The report's section on friction: critical stress ratio along it, differences between densities, published values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from ..tables.published import SOURCE, SURFACES
from . import page


def friction(frames: Mapping[str, pd.DataFrame]) -> str:
    """HTML of the critical stress ratio along friction: table, differences between densities, published values."""
    frame = frames["friction"]
    frame = frame[(frame["state"] == "critical") & (frame["quantity"] == "eta")]
    if not len(frame):
        return page.paragraph(
            f"No table of single frictions: it needs {frames['report_facts'].iloc[0]['runs_needed']} points per "
            "density, and runs that reach one of the frictions."
        )
    shown = frame.assign(text=[_with_half(v, h) for v, h in zip(frame["value"], frame["ci95"], strict=True)])
    shown = shown.pivot(index=["mu_s", "G_p_GPa"], columns="mu_iso", values="text")
    shown.columns = [f"mu_iso = {mu_iso:g}" for mu_iso in shown.columns]
    caption = "Critical stress ratio along interparticle friction, from all points (± 95 %)"
    parts = [page.table(shown.reset_index(), caption), page.paragraph(density_words(frames["density_differences"]))]
    if len(frames["published_shear"]):
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
    outside = int(row["outside"])
    return (
        f"At the same friction the critical stress ratios of the densities lie within {row['largest_pct']:.1f} % of "
        f"their mean; the differences are known to ± {row['widest_ci95_pct']:.1f} % at worst. {outside or 'None'} of "
        f"{int(row['differences'])} differences {'lie' if outside > 1 else 'lies'} outside their single 95 % "
        "intervals. Neighbouring frictions share a model and are not independent."
    )


def published_words(frame: pd.DataFrame) -> str:
    """Published critical states of spheres beside this campaign's, from `beside_published`'s rows."""
    parts = []
    for row in frame.to_dict("records"):
        by = " and ".join(f"{row[name]:.3f} ({row[f'{name}_difference_pct']:+.1f} %)" for name in SURFACES)
        parts.append(f"{row['here']:.3f} here against {by} at μ_s = {row['mu_s']:g}")
    return (
        f"Published for spheres in slow simple shear ({SOURCE}), converted to triaxial compression on the critical "
        f"surface of {' and of '.join(SURFACES)} (in brackets the difference of this campaign): {'; '.join(parts)}. "
        "Those are spheres of another grading and contact law."
    )


def _with_half(value: float, half: float) -> str:
    """A value with its half width, where there is one."""
    return f"{value:.3f}" + (f" ± {half:.3f}" if np.isfinite(half) else "")
