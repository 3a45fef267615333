"""What was tested: inputs, material, stress, strain and size, and how the test differs from the paper's."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from ..quantities import DRAINED, FULL_RATE, FULL_RATE_FRICTION
from ..results.reader import Results
from ..tables import published
from . import input_words, loading_words, page

Frames = Mapping[str, pd.DataFrame]
#: Largest relative difference of the marginals' medians and widths from the paper's Table 1, and of Kendall's tau from
#: that of its copula, for inputs of the paper's kind.
NEAR, NEAR_TAU = 0.1, 0.1


def tested(results: Results, frames: Frames) -> list[str]:
    """What was tested, in two or three sentences."""
    settings, facts = results.attrs["settings"], frames["report_facts"].iloc[0]
    names = results.density_names()
    inputs = input_words.question(results)
    size = f"{particles(frames)} spheres" if particles(frames) else "spheres"
    size += _grading(results)
    stress = f" of {settings['consolidation']['sigma_3_kPa']:g} kPa" if settings else ""
    if "sigma_3" in results.points.names:
        stress = ", random from specimen to specimen,"
    same = "pair" if input_words.is_pair_of_friction_and_modulus(results) else "properties"
    strain, loading = end_strain(results), results.loading
    test = (
        f"Each specimen has {size}, all with the same {same}. It is simulated by the discrete element method (DEM): "
        f"isotropic consolidation, then {loading_words.made(loading, stress)} to "
        f"{100 * strain:.3g} % logarithmic axial strain (the height {'decreases' if loading.sign > 0 else 'increases'} "
        f"by {loading.sign * -100 * math.expm1(-loading.sign * strain):.2g} %). The cell is periodic: it has no walls."
    )
    if len(names) == 1:
        densities = f"There is one density, set by the friction during consolidation: mu_iso = {next(iter(names)):g}."
    else:
        densities = (
            f"There are {len(names)} densities, set by the friction during consolidation: mu_iso = "
            f"{page.listed([f'{mu_iso:g} ({name})' for mu_iso, name in names.items()])}."
        )
    densities += " During shear the friction is mu_s."
    return [inputs, f"{test} {densities}", *loading_words.further(results), *_filled(results, int(facts["filled"]))]


def _grading(results: Results) -> str:
    """The grading in brackets: its median diameter, its sieve curve, and what of it is random."""
    settings, random = results.attrs["settings"], results.points.names
    words = []
    if settings and settings["assembly"].get("sieve"):
        words.append(f"sieve curve {settings['assembly']['sieve']}")
    if "d50" in random:
        words.append("random median diameter")
    elif settings:
        words.append(f"median diameter {settings['assembly']['d50_mm']:.3g} mm")
    if "sigma_ln" in random:
        words.append("random standard deviation of ln d")
    return f" ({', '.join(words)})" if words else ""


def end_strain(results: Results) -> float:
    """Axial strain to which the tests were made: as asked, or the last average where the settings are not known."""
    settings = results.attrs["settings"]
    return float(settings["shear"]["strain_end"] if settings else results.strain[-1])


def _filled(results: Results, filled: int) -> list[str]:
    if not filled:
        return []
    return [f"{filled} of {len(results.points)} points were not run; a regression over the inputs gives their values."]


def paper_differences(results: Results) -> list[str]:
    """How the test differs from the paper's in all but its size, in words; empty if it is the paper's test.

    The paper's test: its grading and stress, one pair of properties per specimen, the full stiffness, densities that
    the paper has, too, and inputs of its kind: friction and modulus are random, with lognormal marginals and a
    dependence near those of its Tables 1 and 2.
    """
    settings = results.attrs["settings"]
    known = {mu_iso for _, mu_iso in published.INITIAL_STATE}
    others = [f"{mu_iso:g}" for mu_iso in results.family_densities() if mu_iso not in known]
    differences = [] if results.loading == DRAINED else [f"another test ({results.loading.words})"]
    differences += [f"other densities (mu_iso = {page.listed(others)})"] if others else []
    if settings:
        differences += _other_settings(settings, results.points.names)
    if not input_words.is_pair_of_friction_and_modulus(results):
        return [*differences, f"other random inputs ({input_words.inputs_named(results)})"]
    return differences + _other_inputs(results.inputs)


def _other_settings(settings: Mapping[str, Any], random: Sequence[str]) -> list[str]:
    """Differences of the settings that are not `random`, which are named as inputs."""
    grains, stress = settings["assembly"], settings["consolidation"]["sigma_3_kPa"]
    usual = published.SIGMA_3 / 1e3
    lognormal = grains["distribution"] == "lognormal" and not grains.get("sieve")
    graded = lognormal and ("sigma_ln" in random or abs(grains["sigma_ln"] - published.SIGMA_LN) < 5e-3)
    scale = settings["dem"]["stiffness_scale"]
    differences = (
        ("sigma_3" not in random and stress != usual, f"{stress:g} kPa instead of {usual:g} kPa"),
        (not graded, "another grading"),
        (settings["material"]["heterogeneity"] != "specimen", "a pair of properties for every grain"),
        (scale != 1.0, f"{scale:g} of the grains' stiffness"),
    )
    return [words for differs, words in differences if differs]


def _other_inputs(inputs: Mapping[str, Any]) -> list[str]:
    near = set(inputs["marginals"]) == set(published.MARGINALS)
    for symbol, (family, median, width, _) in published.MARGINALS.items():
        fits = inputs["marginals"].get(symbol) or [{"family": "", "params": {}}]
        params = fits[0]["params"]
        near &= fits[0]["family"] == family and all(
            abs(params.get(name, 0.0) / value - 1) <= NEAR for name, value in (("median", median), ("sigma_ln", width))
        )
    tau = inputs["copulas"][0].get("tau", published.TAU) if inputs["copulas"] else published.TAU
    return [] if near and abs(tau - published.TAU) <= NEAR_TAU else ["another distribution of the grain properties"]


def accuracy(results: Results, frames: Frames) -> str:
    """The accuracy setting that was asked for, and what the shear runs used."""
    runs = frames["runs"]
    shear = runs[(runs["stage"] == "shear") & (runs["status"] == "done")]
    preset = tomllib.loads(results.attrs["config"]).get("dem", {}).get("accuracy", "")
    words = {"inertial_number": "inertial number", "timestep_factor": "factor on the time step",
             "stiffness_scale": "factor on the grains' stiffness"}  # fmt: skip
    used = [f"{word} {' and '.join(f'{v:g}' for v in sorted(set(shear[name].dropna())))}"
            for name, word in words.items() if name in shear and shear[name].notna().any()]  # fmt: skip
    asked = f"the setting {preset} of campaign/accuracy.toml" if preset else "no named setting, every key by itself"
    return (
        f"Accuracy asked for: {asked}. Shear runs: {particles(frames)} spheres, {', '.join(used)}. Above "
        f"mu_s = {FULL_RATE_FRICTION:g} the inertial number is at most {FULL_RATE * FULL_RATE_FRICTION:.1e} / mu_s."
    )


def particles(frames: Frames) -> str:
    """Number of spheres of the runs, as text."""
    runs = frames["runs"]
    sizes = sorted(set(runs.loc[runs["N"] > 0, "N"]))
    return "–".join(f"{n:,}" for n in (sizes if len(sizes) < 3 else (sizes[0], sizes[-1])))


def size_warning(frames: Frames) -> list[str]:
    """What the number of spheres means for a single run; nothing for a campaign of about the paper's size."""
    facts = frames["report_facts"].iloc[0]
    if not facts["rough"] or not facts["spheres_least"]:
        return []
    return [
        f"A single run is rough: with another packing of {facts['spheres_least']:,} spheres its stress ratio changes "
        f"by about {facts['scatter_pct']:.0f} % (standard deviation)."
    ]
