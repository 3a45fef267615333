"""Every claim of the paper as a number of this campaign with a 95 % interval, and whether this campaign supports it.

Intervals come from resampling the representative points, all densities together, with their probabilities.  All points
of a density share a packing, so part of the noise of a run is common to them and resampling cannot show it.  Every
resample therefore also shifts each density by a normal error (`packing_noise.common_error`): measured on replicate
packings where they exist, otherwise the standard error of one run, as if all of it were common.  Along strain the error
is drawn from the replicate packings.  Where the error is not known, a number that it would change is inconclusive.
Points that were not run come from another response surface in each resample.
Noise mostly increases a distance, in the value and again in its resamples, so the interval of a distance is the value
plus and minus the 95 % quantile of the resamples' deviations.  The representative points are spread more evenly than a
random sample, so the intervals are rather too wide.
A claim is supported if the whole interval meets its criterion, contradicted if no part of it does, and inconclusive
otherwise.  Each interval stands alone: of thirty 95 % intervals, one or two are expected to miss the true value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from ..results.reader import Results, ResultsError
from . import claim_statistics as statistics
from . import published
from .claim_statistics import Samples

SUPPORTED, CONTRADICTED, INCONCLUSIVE = "supported", "contradicted", "inconclusive"


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, the number that tests it, and the criterion that the number has to meet.

    `sense`: "<=", ">=", or "|x| <=" for a number with a sign.  `distance` marks a number that cannot be negative and
    that noise mostly increases.  `refutable` decides from the full samples whether the claim can be contradicted.  It
    cannot where noise alone increases the number, unless the noise is known and subtracted, nor for a difference
    between densities unless replicate packings measure how much of it is due to the packings.  `applies` decides
    whether the campaign has what the claim is about.
    """

    statement: str
    measure: str
    number: Callable[[Samples], float]
    sense: str
    limit: float
    distance: bool = False
    refutable: Callable[[Samples], bool] = lambda samples: True
    applies: Callable[[Results], bool] = lambda results: True


def _has_G_p_family(results: Results) -> bool:
    return "G_p" in results.families


def _has_no_G_p_family(results: Results) -> bool:
    return "G_p" not in results.families


def _has_density(results: Results, mu_iso: float) -> bool:
    return mu_iso in results.family_densities()


def _by_density(symbol: str, name: str) -> tuple[Claim, Claim]:
    """The two claims about a response that depends on the density at the peak and not at the critical state."""
    return (
        Claim(
            statement=f"At the critical state the PDFs of the {name} coincide for all densities",
            measure="largest Wasserstein distance of two densities over the standard deviation, critical state",
            number=partial(statistics.largest_distance, states=("critical",), symbol=symbol),
            sense="<=",
            limit=0.25,  # a quarter of a standard deviation: two normal PDFs that far apart overlap by 90 %
            distance=True,
            refutable=partial(statistics.packing_noise_is_known, states=("critical",), symbol=symbol),
        ),
        Claim(
            statement=f"At the peak the PDFs of the {name} differ between densities",
            measure="Wasserstein distance of densest and loosest over the standard deviation, peak",
            number=partial(statistics.end_distance, state="peak", symbol=symbol),
            sense=">=",
            limit=0.5,  # half a standard deviation: two normal PDFs that far apart overlap by 80 %
            distance=True,
        ),
    )


def _independent_of_density(symbol: str, name: str) -> Claim:
    states = ("peak", "critical")
    return Claim(
        statement=f"The {name} at the peak and at the critical state is independent of the initial density",
        measure="largest Wasserstein distance of two densities over the standard deviation, peak and critical state",
        number=partial(statistics.largest_distance, states=states, symbol=symbol),
        sense="<=",
        limit=0.25,
        distance=True,
        refutable=partial(statistics.packing_noise_is_known, states=states, symbol=symbol),
    )


def _within_range(state: str, symbol: str, mu_iso: float, low: float, high: float) -> Claim:
    return Claim(
        statement=f"{symbol} lies within {low:g}-{high:g} at the {state} state, mu_iso = {mu_iso:g}",
        measure="probability of the range under the PDF",
        number=partial(statistics.share_within, state=state, symbol=symbol, mu_iso=mu_iso, low=low, high=high),
        sense=">=",
        limit=0.9,  # the paper reads the ranges off figures, where the outermost tenth is hard to see
        applies=partial(_has_density, mu_iso=mu_iso),
    )


def _effect_of_G_p(alone: bool) -> Claim:
    method = "mu_s fixed" if alone else "by regression on ln mu_s and ln G_p"
    return Claim(
        statement="G_p alone hardly changes the stress ratio at large strain",
        measure="change of critical eta by one sd of ln G_p over the sd of eta with both varying, mean of the "
        f"densities, {method}",
        number=partial(statistics.effect_of_G_p, alone=alone),
        sense="|x| <=",
        limit=0.2,  # 4 % of the variance
        applies=_has_G_p_family if alone else _has_no_G_p_family,
    )


#: The paper's claims as tests; the criteria are this project's reading of its words.
CLAIMS: tuple[Claim, ...] = (
    *_by_density("eta", "stress ratio"),
    *_by_density("e", "void ratio"),
    *_by_density("e_m", "mechanical void ratio"),
    *_by_density("Phi_dev", "fabric anisotropy"),
    _independent_of_density("Z", "coordination number"),
    _independent_of_density("Z_m", "mechanical coordination number"),
    *(_within_range(*where, *ends) for where, ends in published.STATE_RANGE.items()),
    _effect_of_G_p(alone=True),
    _effect_of_G_p(alone=False),
    Claim(
        statement="G_p changes the small-strain stiffness",
        measure="least exponent of G_0 in G_p over the densities, by regression on ln mu_s and ln G_p (Hertz: 2/3)",
        number=statistics.stiffness_exponent,
        sense=">=",
        limit=0.3,  # half of what Hertzian contacts give
    ),
    Claim(
        statement="Dense samples have the higher G_0",
        measure="mean of G_0 densest over G_0 loosest at the same point, minus 1",
        number=statistics.stiffness_gain,
        sense=">=",
        limit=0.0,
    ),
    Claim(
        statement="A higher critical eta goes with a larger void ratio",
        measure="least correlation of eta and e of any density",
        number=partial(statistics.least_correlation, symbol="e", sign=1),
        sense=">=",
        limit=0.5,
    ),
    Claim(
        statement="A higher critical eta goes with a smaller coordination number",
        measure="least correlation of eta and -Z of any density",
        number=partial(statistics.least_correlation, symbol="Z", sign=-1),
        sense=">=",
        limit=0.5,
    ),
    Claim(
        statement="The critical state is reached by 25 % strain",
        measure="strain beyond which every density's mean eta stays within 3 % of its final average",
        number=partial(statistics.steady_strain, symbol="eta", tolerance=0.03),
        sense="<=",
        limit=published.STEADY_STRAIN,
        refutable=statistics.never,
    ),
    Claim(
        statement="The void ratio is steady by 25 % strain",
        measure="strain beyond which every density's mean e stays within 1 % of its final average",
        number=partial(statistics.steady_strain, symbol="e", tolerance=0.01),
        sense="<=",
        limit=published.STEADY_STRAIN,
        refutable=statistics.never,
    ),
    Claim(
        statement="I_G_active and I_G_stress are about 1.19 at peak and critical state",
        measure="largest distance of a mean from 1.19",
        number=statistics.grading_distance,
        sense="<=",
        limit=0.01,
    ),
    Claim(
        statement="I_G_active and I_G_stress hardly vary (COV about 0.001)",
        measure="largest COV, less the noise of packings where it is known",
        number=statistics.grading_cov,
        sense="<=",
        limit=0.002,
        refutable=statistics.grading_noise_is_known,
    ),
    Claim(
        statement="e and e_m grow and Z and Z_m fall with mu_iso",
        measure="least relative step between neighbouring densities, after consolidation",
        number=statistics.initial_step,
        sense=">=",
        limit=0.0,
    ),
    Claim(
        statement="The initial states are those of Table 3",
        measure="largest relative difference of means, after consolidation",
        number=statistics.initial_difference,
        sense="<=",
        limit=0.05,
    ),
    Claim(
        statement="Initial states of one density hardly vary (COV at most 0.011)",
        measure="largest COV of e, e_m, Z, Z_m after consolidation; needs a consolidation for every point",
        number=statistics.initial_cov,
        sense="<=",
        limit=0.011,
    ),
)


def claims_table(results: Results, n_boot: int = 200, seed: int = 1) -> pd.DataFrame:
    """One row per claim: statement, number, value with its 95 % interval (low, high), criterion and verdict.

    n_boot: resamples of the points.  A claim is inconclusive if the campaign lacks its quantities or its number is not
    finite.
    """
    rng = np.random.default_rng(seed)
    families = [family for family in results.families if family in ("coupled", "G_p")]
    full = {family: statistics.full_sample(results, family) for family in families}
    resamples = [{f: statistics.drawn_sample(sample, rng) for f, sample in full.items()} for _ in range(n_boot)]
    rows = []
    for claim in CLAIMS:
        if not claim.applies(results):
            continue
        value = _evaluate(claim, full)
        low, high = _interval(np.array([_evaluate(claim, s) for s in resamples]), value, claim.distance)
        outcome = verdict(low, high, claim.sense, claim.limit)
        if outcome == CONTRADICTED and not claim.refutable(full):
            outcome = INCONCLUSIVE
        criterion = f"{claim.sense} {claim.limit:g}"
        rows.append((claim.statement, claim.measure, value, low, high, criterion, outcome))
    return pd.DataFrame(rows, columns=["claim", "number", "value", "low", "high", "criterion", "verdict"])


def verdict(low: float, high: float, sense: str, limit: float) -> str:
    """Verdict on an interval low ... high against "<= limit", ">= limit" or "|x| <= limit"."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return INCONCLUSIVE
    if sense == "|x| <=":
        return verdict(max(low, -high, 0.0), max(-low, high), "<=", limit)
    inside, outside = (high <= limit, low > limit) if sense == "<=" else (low >= limit, high < limit)
    return SUPPORTED if inside else CONTRADICTED if outside else INCONCLUSIVE


def _evaluate(claim: Claim, samples: Samples) -> float:
    """The claim's number; NaN if the results lack the quantity.  Any other exception is a bug and is raised."""
    try:
        return float(claim.number(samples))
    except ResultsError:
        return float("nan")


def _interval(resampled: np.ndarray, value: float, distance: bool) -> tuple[float, float]:
    """95 % interval from resampled numbers; NaN if more than a tenth of them could not be computed."""
    known = resampled[np.isfinite(resampled)]
    if len(known) < 0.9 * len(resampled):
        return np.nan, np.nan
    if distance:
        deviation = np.quantile(np.abs(known - value), 0.95)
        return max(value - deviation, 0.0), value + deviation
    low, high = np.quantile(known, [0.025, 0.975])
    return low, high
