"""What a report says of the test that its runs are: material, grading, stress, strain, size, accuracy."""

from __future__ import annotations

import tomllib

import numpy as np

from analysis import paper


def conditions(results) -> list[str]:
    """The test in a sentence, and where it is not the paper's, another; nothing for results without settings."""
    asked = results.attrs["settings"]
    if not asked:
        return []
    grains, material, stress = asked["assembly"], asked["material"], asked["consolidation"]["sigma_3_kPa"]
    end = float(results.strain[-1])
    told = (
        f"The test: spheres, {grains['distribution'].replace('_', ' ')} with d50 = {grains['d50_mm']:g} mm and a "
        f"standard deviation of ln d of {grains['sigma_ln']:g} by mass, Poisson's ratio {material['nu']:g}, "
        f"consolidated isotropically to {stress:g} kPa and sheared drained in triaxial compression at that confining "
        f"stress. Strains are logarithmic: the last, {100 * end:.3g} %, is {100 * (1 - np.exp(-end)):.3g} % of the "
        "height."
    )
    graded = grains["distribution"] == "lognormal" and abs(grains["sigma_ln"] - paper.SIGMA_LN) < 5e-3
    other = [
        words
        for differs, words in (
            (stress != paper.SIGMA_3 / 1e3, f"{stress:g} kPa instead of {paper.SIGMA_3 / 1e3:g}"),
            (not graded, "another grading"),
            (material["heterogeneity"] != "specimen", "a pair of properties a grain"),
            (asked["dem"]["stiffness_scale"] != 1.0, f"{asked['dem']['stiffness_scale']:g} of the grains' stiffness"),
        )
        if differs
    ]
    if not other:
        return [told]
    return [told, f"That is not the paper's test ({', '.join(other)}): its numbers beside these, and the verdicts on "
                  "its claims, compare two different tests."]  # fmt: skip


def accuracy(results) -> str:
    """The accuracy setting asked for, and what the shear runs really used."""
    shear = results.runs[(results.runs["stage"] == "shear") & (results.runs["status"] == "done")]
    asked = tomllib.loads(results.attrs["config"]).get("dem", {}).get("accuracy", "")
    words = {"inertial_number": "inertial number", "strain_end": "axial strain to",
             "timestep_factor": "time step factor", "stiffness_scale": "stiffness factor"}  # fmt: skip
    used = [f"{word} {', '.join(f'{v:g}' for v in sorted(set(shear[name].dropna())))}"
            for name, word in words.items() if name in shear and shear[name].notna().any()]  # fmt: skip
    named = f"the {asked} setting of campaign/accuracy.toml" if asked else "none by name, every key set by itself"
    return f"Accuracy asked for: {named}. Shear runs: {particles(results)} spheres, " + ", ".join(used) + (
        "; above mu_s = 0.3 the inertial number is at most 7.2e-4 / mu_s."
    )


def particles(results) -> str:
    """Number of spheres of the runs, as text."""
    sizes = sorted(set(results.runs.loc[results.runs["N"] > 0, "N"]))
    return "–".join(f"{n:,}" for n in (sizes if len(sizes) < 3 else (sizes[0], sizes[-1])))


def size_warning(results) -> list[str]:
    """What the size of the campaign means for its numbers."""
    sizes = results.runs.loc[results.runs["N"] > 0, "N"]
    if not len(sizes) or sizes.max() >= 0.5 * paper.PARTICLES and len(results.points) >= paper.POINTS:
        return []
    smallest = int(sizes.min())
    scatter = 100 * 0.03 * np.sqrt(1000 / smallest)
    return [
        f"These numbers are rough. The paper used {paper.PARTICLES:,} spheres and {paper.POINTS} points; here it is "
        f"{particles(results)} spheres and {len(results.points)} points. One run of {smallest:,} spheres scatters by "
        f"some {scatter:.0f} % in the stress ratio; the sections on claims and on trust say what that leaves."
    ]
