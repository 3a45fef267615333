"""The sentences of the report that depend on which inputs are random, and on what is known of their distribution."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from ..quantities import QUANTITIES
from ..results.models import runs_needed
from ..results.reader import Results
from ..tables.friction import has_curves
from .page import listed, plural

#: The random inputs of the paper.
PAIR = ("mu_s", "G_p")
NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}


def inputs_named(results: Results) -> str:
    """The random inputs by name, such as "interparticle friction and particle shear modulus"."""
    return listed([_lower(QUANTITIES[symbol].name) for symbol in results.points.names])


def scatter_of_inputs(results: Results) -> str:
    """What scatters: "the scatter of two grain properties, interparticle friction and particle shear modulus,"."""
    count, names = len(results.points.names), inputs_named(results)
    if count == 1:
        return f"the scatter of one property, {names},"
    words = "grain properties" if kind(results) == "grain properties" else "properties"
    return f"the scatter of {NUMBERS[count]} {words}, {names},"


def are_measured(results: Results) -> bool:
    """Whether the inputs are fitted to a table of measurements, not stated as distributions."""
    return not results.inputs.get("specified")


def inputs_heading(results: Results) -> str:
    """Heading of the section on the distribution of the inputs."""
    return f"Distribution of the {kind(results)}"


def pictures_heading(results: Results) -> str:
    """Heading of the figures of the inputs and points."""
    return "Grain properties and points" if kind(results) == "grain properties" else "Inputs and points"


def inputs_counted(results: Results) -> str:
    """The inputs by their number: "the two properties", or the name of a single one."""
    count = len(results.points.names)
    return f"the {NUMBERS[count]} {'properties' if count == 2 else 'inputs'}" if count > 1 else inputs_named(results)


def points_words(results: Results) -> str:
    """What a point consists of, such as "pairs of mu_s and G_p"."""
    names = results.points.names
    return f"{'pairs' if len(names) == 2 else 'values'} of {listed(names)}"


def question(results: Results) -> str:
    """What the campaign asks, and what its points stand for."""
    count, names = len(results.points), results.points.names
    source = results.inputs.get("source") or "of an unnamed source"
    if is_pair_of_friction_and_modulus(results) and are_measured(results):
        return (
            "How does the scatter of grain properties affect the behaviour of the soil? "
            f"A joint distribution was fitted to {len(results.pairs)} pairs of interparticle friction mu_s and "
            f"particle shear modulus G_p ({source}).{_reconstructed(source)} The distribution is represented by "
            f"{plural(count, 'chosen pair', 'chosen pairs')}, each with its probability."
        )
    joint = "distribution" if len(names) == 1 else "joint distribution"
    given = f"of {len(results.pairs)} rows of measurements ({source})" if are_measured(results) else "that was given"
    return (
        f"How does {scatter_of_inputs(results)} affect the behaviour of the soil? "
        f"{plural(count, 'point represents', 'points represent')} the {joint} {given}, each with its probability."
    )


def _reconstructed(source: str) -> str:
    """A sentence where the pairs are the ones that come with this tool."""
    if Path(source).name != "pairs_reconstructed.csv":
        return ""
    return " These pairs are reconstructed: they reproduce published statistics and are not the original measurements."


def interval_words(results: Results, facts: pd.Series) -> str:
    """What the intervals of the numbers to quote contain."""
    if not facts["measurements"]:
        return "caused by that noise; the uncertainty of the inputs is not in it"
    return f"caused by that noise and by the limited number of {_measurements(results)} ({facts['measurements']})"


def accuracy_words(results: Results, facts: pd.Series) -> list[str]:
    """What reduces the uncertainty of a mean, and how the uncertainty of the inputs enters."""
    rest = f"; the rest comes from the limited number of {_measurements(results)}" if facts["measurements"] else ""
    part = f"only a part of the uncertainty of a mean{rest}" if rest else "the uncertainty of a mean"
    given = "The tables give this part, and" if rest else "The table gives"
    return [
        f"More runs or larger ones reduce {part}. {given} the standard deviations that packings "
        f"and single runs add to the scatter of the {kind(results)}, with 95 % intervals. The standard error of one "
        "run comes from the fluctuation within it.",
        bands_words(results, facts),
    ]


def inputs_source(results: Results, facts: pd.Series) -> str:
    """Where the inputs come from, for inputs that are not the usual pairs.

    facts: the row of `tables.report_facts`, here and below.
    """
    constants = [f"{symbol} = {_value(symbol, value)}" for symbol, value in results.points.constants.items()]
    fixed = f" Constant: {listed(constants)}." if constants else ""
    if are_measured(results):
        named = results.inputs.get("source") or "an unnamed source"
        return f"{len(results.pairs)} rows of {inputs_named(results)} from {named}.{fixed}"
    behind = int(facts["measurements"])
    known = (f"{behind} measurements are behind them." if behind
             else "How many measurements are behind them is not known.")  # fmt: skip
    given = "distribution of {} was" if len(results.points.names) == 1 else "distributions of {} were"
    return f"The {given.format(inputs_named(results))} given, not fitted to measurements. {known}{fixed}"


def bands_words(results: Results, facts: pd.Series) -> str:
    """How the bands from the inputs' own uncertainty were made, and what they do not contain."""
    behind = int(facts["measurements"])
    if not behind:
        return (
            "How many measurements are behind the input distribution is not known. No interval and no band contains "
            "the uncertainty of the inputs: the intervals contain the error of the model only. The key "
            "inputs.pairs_behind states the number of measurements."
        )
    if are_measured(results):
        how = (f"The {_measurements(results)} were drawn again, and every sample chose its families of "
               f"{'marginals' if len(results.points.names) == 1 else 'marginals and copula'} again")  # fmt: skip
    else:
        how = f"Samples of {behind} were drawn from it, and its parameters were fitted again (of the same families)"
    bands = ""
    if facts["refitted"]:
        bands = (f" The bands around the PDFs at a state contain the uncertainty of the {_measurements(results)} only, "
                 f"from {facts['refitted']} refits.")  # fmt: skip
    return (
        f"With {behind} {_measurements(results)} the {'fitted' if are_measured(results) else 'given'} distribution of "
        f"the {kind(results)} is itself uncertain. {how}; no run is repeated.{bands}"
    )


def sources_words(results: Results) -> str:
    """What the table of variance shares splits."""
    names = results.points.names
    if len(names) == 1:
        head = (f"The table splits each variance into the part of {_lower(QUANTITIES[names[0]].name)} and the noise of "
                "packings and single runs, which a model of all runs separates.")  # fmt: skip
    else:
        first = _upper(inputs_named(results))
        two = len(names) == 2
        explain, known = ("the other explains", "the other is") if two else ("the others explain", "the others are")
        either = "either explains" if two else "several of them explain"
        head = (
            f"{first} may depend on each other; then each explains a part of what {explain}. The table splits each "
            f"variance into the part that only one of them adds once {known} known, the part that {either}, "
            "and the noise of packings and single runs, which a model of all runs separates."
        )
        if len(names) > 2:
            head += " The Shapley effects divide what is shared among the inputs; they add up to what all explain."
    return head


def caption_of_inputs(results: Results, name: str) -> str:
    """Caption of a figure that depends on the inputs, where these are not measured pairs of mu_s and G_p; else ""."""
    names, count = results.points.names, len(results.points.names)
    usual = count == 2 and len(results.pairs) > 0
    if name == "fig04" and {"sigma_ln", "d50"} & {*names}:
        return "Grading of one specimen; every point has grains of its own."
    if name == "fig13" and "G_p" not in names:
        return ("(a, b) Small-strain stiffness and (c, d) dilatancy at the peak: PDFs, and every point "
                f"against {inputs_named(results) if count == 1 else 'an input'}.")  # fmt: skip
    if name == "fig16" and not has_curves(results):
        return ("Peak and critical state of every point against interparticle friction. The strain of a peak is that "
                f"of curves pooled over the points. A model of all runs needs {runs_needed(results)} points per "
                "density, so there are no lines.")  # fmt: skip
    if name == "fig16" and names != PAIR:
        others = "" if count == 1 else ", with the other inputs at their regressions on friction"
        return ("Peak and critical state against interparticle friction. Symbols are the points; the strain of a peak "
                "is that of curves pooled over the points. Lines are the model of all runs with its 95 % band"
                f"{others}.")  # fmt: skip
    if usual or name not in ("fig02", "fig03"):
        return ""
    shown = "measurements" if len(results.pairs) else "representative points"
    if name == "fig02":
        if count == 1:
            return f"Distribution of {inputs_named(results)}, with the {shown} as ticks."
        return (
            f"On the diagonal the marginal PDFs of {inputs_named(results)}; below it the joint PDF of each "
            f"two of them as contours, with the {shown}."
        )
    parts = "The representative points" if count == 1 else "The representative points in each two of the inputs"
    return f"{parts}, area by probability, and the distribution functions that they carry against the exact ones."


def is_pair_of_friction_and_modulus(results: Results) -> bool:
    """Whether mu_s and G_p are the two random inputs, as in the paper."""
    return results.points.names == PAIR


def band_note(results: Results) -> str:
    """What the shaded band of a PDF is, for captions; "" without a band."""
    if results.bootstrap_probability(results.family_densities()[0]) is None:
        return ""
    what = f"resampling the {_measurements(results)} alone" if are_measured(results) else "refits of the inputs alone"
    return (f" Shaded, here and wherever the PDF of a state is shown: the 95 % band from {what}, without packing "
            "noise.")  # fmt: skip


def kind(results: Results) -> str:
    """What the inputs are: grain properties, or inputs where others are among them."""
    return "grain properties" if {*results.points.names} <= {"mu_s", "G_p", "nu"} else "inputs"


def _measurements(results: Results) -> str:
    """The measurements behind the inputs: pairs, or measurements."""
    return "pairs" if are_measured(results) and len(results.points.names) == 2 else "measurements"


def _value(symbol: str, value: float) -> str:
    quantity = QUANTITIES[symbol]
    return f"{value * quantity.shown_factor:.4g} {quantity.shown_unit}".rstrip()


def _lower(name: str) -> str:
    return name[0].lower() + name[1:]


def _upper(name: str) -> str:
    return name[0].upper() + name[1:]
