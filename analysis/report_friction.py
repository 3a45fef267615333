"""The report's section on friction: critical stress ratio along it, densities apart, and what others published."""

from __future__ import annotations

import numpy as np

from analysis import tables, webpage
from analysis.published_shear import SOURCE, SURFACES, beside_published
from analysis.quantities import QUANTITIES
from analysis.stopping import LEAST


def friction(results) -> str:
    """HTML of the critical stress ratio along friction: table, densities apart, published values beside it."""
    frame = tables.friction_table(results)
    frame = frame[(frame["state"] == "critical") & (frame["quantity"] == QUANTITIES["eta"].heading)]
    if not len(frame):
        few = f"No table of single frictions: that takes {LEAST} points a density, with runs that reach one of them."
        return webpage.paragraph(few)
    shown = frame.assign(text=[_with_half(v, h) for v, h in zip(frame["value"], frame["± (95 %)"], strict=True)])
    shown = shown.pivot(index=["mu_s", "G_p (GPa)"], columns="mu_iso", values="text")
    shown.columns = [f"mu_iso = {mu_iso:g}" for mu_iso in shown.columns]
    caption = "Critical stress ratio along interparticle friction, from all points (± 95 %)"
    parts = [webpage.table(shown.reset_index(), caption), webpage.paragraph(density_at_a_friction(frame))]
    published = beside_published(frame)
    if len(published):
        parts.append(webpage.paragraph(published_words(published)))
    return "".join(parts)


def density_at_a_friction(frame) -> str:
    """Whether the critical stress ratio at a friction depends on the initial density, from `friction_table`'s rows."""
    if frame["mu_iso"].nunique() < 2:
        return "There is one density, so what the initial density does cannot be told."
    told = frame[frame["differs"].isin(["yes", "not shown"])]
    if not len(told):
        return "What the initial density does cannot be told: no replicate packings tell what a packing adds."
    level = told["value"] - told["from the mean of densities"]
    off = 100 * (told["from the mean of densities"] / level).abs().max()
    wide = 100 * (told["± (95 %) of that"] / level).max()
    beyond = int((told["differs"] == "yes").sum())
    return (
        "At the same friction the densities' critical stress ratios lie within "
        f"{off:.1f} % of their mean, known to ± {wide:.1f} % at worst: {beyond or 'none'} of {len(told)} differences "
        f"{'lies' if beyond == 1 else 'lie'} beyond their single 95 % intervals (neighbouring frictions share a "
        "surface and go together)."
    )


def published_words(frame) -> str:
    """Published critical states of spheres beside this campaign's, from `beside_published`'s rows."""
    parts = []
    for row in frame.to_dict("records"):
        by = " and ".join(f"{row[name]:.3f} ({row[f'off {name} (%)']:+.1f} %)" for name in SURFACES)
        parts.append(f"{row['here']:.3f} here against {by} at μ_s = {row['mu_s']:g}")
    return (
        f"Published for spheres in slow simple shear ({SOURCE}), brought to triaxial compression on the critical "
        f"surface of {' and of '.join(SURFACES)} (in brackets what this campaign is off by): {'; '.join(parts)}. Those "
        "are spheres of another grading and contact law."
    )


def _with_half(value, half):
    """A value with its half width, where there is one."""
    return f"{value:.3f}" + (f" ± {half:.3f}" if np.isfinite(half) else "")
