"""What the report says of the test: material, grading, stress, strain, size, accuracy."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping

import pandas as pd

from ..quantities import FULL_RATE, FULL_RATE_FRICTION
from ..results.reader import Results
from ..tables import published
from . import input_words

Frames = Mapping[str, pd.DataFrame]
#: Words for a setting of the test that is random.
RANDOM = {"d50": "median diameter", "sigma_ln": "standard deviation of ln d", "nu": "Poisson's ratio of the grains",
          "sigma_3": "confining stress"}  # fmt: skip


def introduction(results: Results, frames: Frames) -> str:
    """What the campaign did, in one paragraph."""
    frictions = ", ".join(f"{mu_iso:g}" for mu_iso in results.family_densities())
    filled = int(frames["report_facts"].iloc[0]["filled"])
    return (
        f"How {input_words.scatter_of_inputs(results)} affects the behaviour of a granular soil: "
        f"{len(results.points)} representative points of {'its' if len(results.points.names) == 1 else 'their joint'} "
        "distribution, "
        f"sheared by the discrete element method at {len(results.densities)} "
        f"{'densities' if len(results.densities) > 1 else 'density'}, set by the friction during consolidation "
        f"(mu_iso = {frictions}; the lowest gives the densest), and the PDFs of the responses."
        + (f" {filled} of the points were not run: a regression over the others gives their values." if filled else "")
        + f" Statements of {published.REFERENCE} stand beside the numbers of this campaign."
    )


def test_words(results: Results, facts: pd.Series) -> list[str]:
    """The test in a sentence, and its differences from the paper's; nothing for results without settings."""
    settings = results.attrs["settings"]
    if not settings:
        return []
    grains, material = settings["assembly"], settings["material"]
    stress = settings["consolidation"]["sigma_3_kPa"]
    random = {name: f"a random {words}" for name, words in RANDOM.items() if name in results.points.names}
    size = random.get("d50", f"d50 = {grains['d50_mm']:g} mm")
    width = random.get("sigma_ln", f"a standard deviation of ln d of {grains['sigma_ln']:g}")
    poisson = random.get("nu", f"Poisson's ratio {material['nu']:g}")
    sizes = (
        f"of the sieve curve {grains['sieve']} with d50 = {grains['d50_mm']:.3g} mm"
        if grains.get("sieve")
        else f"{grains['distribution'].replace('_', ' ')} with {size} and {width} by mass"
    )
    test = (
        f"The test: spheres, {sizes}, {poisson}, "
        f"consolidated isotropically to {random.get('sigma_3', f'{stress:g} kPa')} and sheared drained in triaxial "
        f"compression at that confining stress. Strains are logarithmic: the last, {facts['end_strain_pct']:.3g} %, is "
        f"{facts['end_height_pct']:.3g} % of the height."
    )
    lognormal = "sigma_ln" not in random and grains["distribution"] == "lognormal" and not grains.get("sieve")
    graded = lognormal and abs(grains["sigma_ln"] - published.SIGMA_LN) < 5e-3
    scale = settings["dem"]["stiffness_scale"]
    differences = [
        words
        for differs, words in (
            ("sigma_3" in random, "a random confining stress"),
            (
                "sigma_3" not in random and stress != published.SIGMA_3 / 1e3,
                f"{stress:g} kPa instead of {published.SIGMA_3 / 1e3:g}",
            ),
            (not graded, "another grading"),
            (material["heterogeneity"] != "specimen", "a pair of properties for every grain"),
            (scale != 1.0, f"{scale:g} of the grains' stiffness"),
        )
        if differs
    ]
    if not differences:
        return [test]
    return [test, f"This is not the paper's test ({', '.join(differences)}): where its numbers stand beside these, and "
                  "in the verdicts on its claims, two different tests are compared."]  # fmt: skip


def accuracy(results: Results, frames: Frames) -> str:
    """The accuracy setting that was asked for, and what the shear runs used."""
    runs = frames["runs"]
    shear = runs[(runs["stage"] == "shear") & (runs["status"] == "done")]
    preset = tomllib.loads(results.attrs["config"]).get("dem", {}).get("accuracy", "")
    words = {"inertial_number": "inertial number", "strain_end": "axial strain to",
             "timestep_factor": "time step factor", "stiffness_scale": "stiffness factor"}  # fmt: skip
    used = [f"{word} {', '.join(f'{v:g}' for v in sorted(set(shear[name].dropna())))}"
            for name, word in words.items() if name in shear and shear[name].notna().any()]  # fmt: skip
    named = f"the {preset} setting of campaign/accuracy.toml" if preset else "no named setting; every key set by itself"
    return (
        f"Accuracy asked for: {named}. Shear runs: {particles(frames)} spheres, "
        + ", ".join(used)
        + (
            f"; above mu_s = {FULL_RATE_FRICTION:g} the inertial number is at most "
            f"{FULL_RATE * FULL_RATE_FRICTION:.1e} / mu_s."
        )
    )


def particles(frames: Frames) -> str:
    """Number of spheres of the runs, as text."""
    runs = frames["runs"]
    sizes = sorted(set(runs.loc[runs["N"] > 0, "N"]))
    return "–".join(f"{n:,}" for n in (sizes if len(sizes) < 3 else (sizes[0], sizes[-1])))


def size_warning(results: Results, frames: Frames) -> list[str]:
    """What the size of the campaign means for its numbers; nothing for one of about the paper's size."""
    facts = frames["report_facts"].iloc[0]
    if not facts["rough"] or not facts["spheres_least"]:
        return []
    smallest, scatter = facts["spheres_least"], facts["scatter_pct"]
    return [
        f"These numbers are rough. The paper used {published.PARTICLES:,} spheres and {published.POINTS} points; this "
        f"campaign used {particles(frames)} spheres and {len(results.points)} points. One run of {smallest:,} spheres "
        f"scatters by some {scatter:.0f} % in the stress ratio; the sections on claims and on reliability give the "
        "consequences."
    ]
