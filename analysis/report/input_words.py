"""The sentences of the report that depend on which inputs are random, and on what is known of their distribution."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from ..quantities import QUANTITIES
from ..results.reader import Results

#: The random inputs of the paper.
PAIR = ("mu_s", "G_p")
NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}


def listed(words: Sequence[str]) -> str:
    """Words as a list in a sentence: "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def inputs_named(results: Results) -> str:
    """The random inputs by name, such as "interparticle friction and particle shear modulus"."""
    return listed([_lower(QUANTITIES[symbol].name) for symbol in results.points.names])


def scatter_of_inputs(results: Results) -> str:
    """What scatters: "the scatter of two grain properties, interparticle friction and particle shear modulus,"."""
    count, names = len(results.points.names), inputs_named(results)
    if count == 1:
        return f"the scatter of one property, {names},"
    kind = "grain properties" if {*results.points.names} <= {"mu_s", "G_p", "nu"} else "properties"
    return f"the scatter of {NUMBERS[count]} {kind}, {names},"


def are_measured(results: Results) -> bool:
    """Whether the inputs are fitted to a table of measurements, not stated as distributions."""
    return not results.inputs.get("specified")


def inputs_heading(results: Results) -> str:
    """Heading of the section on the inputs."""
    if not are_measured(results):
        return "Inputs: distributions that were given"
    return (
        "Inputs: pairs of grain properties" if len(results.points.names) == 2 else "Inputs: measured grain properties"
    )


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
    return f"The distributions of {inputs_named(results)} were given, not fitted to measurements. {known}{fixed}"


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
        what = "pairs" if len(results.points.names) == 2 else "measured rows"
        how = f"The {what} were resampled, and every sample chose its marginals and its copula again"
    else:
        what = "measurements behind it"
        how = f"Samples of {behind} were drawn from it, and its parameters were fitted again (families kept)"
    return (
        f"With {behind} {what} the input distribution is itself uncertain. {how}; "
        "no run is repeated. The intervals contain this and the error of the model. The last column is the share of "
        "the squared width of the mean's interval that more or larger runs could remove; the rest comes from the "
        f"number of {'pairs' if what == 'pairs' else 'measurements'}. The bands around the PDFs at the peak, at the "
        "critical state and of the stiffness in the figures contain the uncertainty of the "
        f"{'pairs' if what == 'pairs' else 'inputs'} only, from {facts['refitted']} refits."
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
            f"variance into the part that only one of them adds once {known} known, the part that {either} (shared), "
            "and the noise of packings and single runs, which a model of all runs separates."
        )
        if len(names) > 2:
            head += " The Shapley effects divide what is shared among the inputs; they add up to what all explain."
    return (
        f"{head} The next table compares moments and quantiles of the points with Monte Carlo samples through this "
        "model, without noise for mean and sd and with it for the quantiles. The last one compares PDEM's PDFs along "
        "strain with such samples, noise included."
    )


def caption_of_inputs(results: Results, name: str) -> str:
    """Caption of a figure that depends on the inputs, where these are not measured pairs of mu_s and G_p; else ""."""
    names, count = results.points.names, len(results.points.names)
    usual = count == 2 and len(results.pairs) > 0
    if name == "fig04" and {"sigma_ln", "d50"} & {*names}:
        return "Figure 4. Grading of one specimen; every point has grains of its own."
    if name == "fig13" and "G_p" not in names:
        return ("Figure 13. (a, b) Small-strain stiffness and (c, d) dilatancy at the peak: PDFs, and every point "
                f"against {inputs_named(results) if count == 1 else 'an input'}.")  # fmt: skip
    if name == "fig16" and names != PAIR:
        others = "" if count == 1 else ", the other inputs at their regressions on friction,"
        return ("Figure 16. Not in the paper: peak and critical state along interparticle friction. Every point, with "
                f"its peak at the strain that is pooled over the points, and the denoised values{others} with their "
                "95 % band.")  # fmt: skip
    if usual or name not in ("fig02", "fig03"):
        return ""
    shown = "measurements" if len(results.pairs) else "representative points"
    if name == "fig02":
        if count == 1:
            return f"Figure 2. Distribution of {inputs_named(results)}, with the {shown} as ticks."
        return (
            f"Figure 2. On the diagonal the marginal PDFs of {inputs_named(results)}; below it the joint PDF of each "
            f"two of them as contours, with the {shown}."
        )
    parts = "The representative points" if count == 1 else "The representative points in each two of the inputs"
    return (
        f"Figure 3. {parts}, area by probability, and the distribution functions that they carry against the exact "
        "ones."
    )


def is_pair_of_friction_and_modulus(results: Results) -> bool:
    """Whether mu_s and G_p are the two random inputs, as in the paper."""
    return results.points.names == PAIR


def band_note(results: Results) -> str:
    """What the shaded band of a PDF is, for captions; "" without a band."""
    if results.bootstrap_probability(results.family_densities()[0]) is None:
        return ""
    what = "resampling the pairs alone" if are_measured(results) else "refits of the inputs alone"
    return (f" Shaded, here and wherever the PDF of a state is shown: the 95 % band from {what}, without packing "
            "noise.")  # fmt: skip


def _value(symbol: str, value: float) -> str:
    quantity = QUANTITIES[symbol]
    return f"{value * quantity.shown_factor:.4g} {quantity.shown_unit}".rstrip()


def _lower(name: str) -> str:
    return name[0].lower() + name[1:]


def _upper(name: str) -> str:
    return name[0].upper() + name[1:]
