"""Every claim of the paper as a number of this campaign with a 95 % interval, and whether this campaign supports it.

Numbers are those of the denoised values of the points (`pooled_states`).  Intervals come from draws of the model, which
contain the error that the noise of packings and runs leaves; with fewer than three packings a difference between
densities cannot contradict a claim, because it may be that of the packings.  Errors increase a distance, in the
denoised values and again in the draws.  The value is therefore the true distance that would on average give what is
found, and the interval holds the true distances with which this would not be unusual (`inverted`).
A claim is supported if the whole interval meets its criterion, contradicted if no part of it does, and inconclusive
otherwise.  Each interval stands alone: of thirty 95 % intervals, one or two are expected to miss the true value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ..quantities import DRAINED
from ..results.reader import Results, ResultsError
from ..surrogates.surrogate import FEWEST_PACKINGS
from . import claim_statistics as statistics
from . import published
from .claim_intervals import CONTRADICTED, INCONCLUSIVE, drawn, inverted, times_to_decide, verdict
from .claim_samples import Samples, sample

#: What decides a claim about differences between densities where too few packings are there to tell.
PACKINGS = f"at least {FEWEST_PACKINGS} packings"


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, the number that tests it, and the criterion that the number has to meet.

    `sense`: "<=", ">=", or "|x| <=" for a number with a sign.  `distance` marks a number that cannot be negative and
    that errors mostly increase.  `refutable` decides from the denoised samples whether the claim can be contradicted.
    It cannot where noise alone increases the number, nor for a difference between densities unless there are enough
    packings to know how much of it is due to them; `refuted_by` then states what could contradict the claim.  `applies`
    decides whether the campaign has what the claim is about.
    """

    statement: str
    measure: str
    number: Callable[[Samples], Any]
    sense: str
    limit: float
    distance: bool = False
    refutable: Callable[[Samples], bool] = lambda samples: True
    refuted_by: str = ""
    applies: Callable[[Results], bool] = lambda results: True


def _has_G_p_family(results: Results) -> bool:
    return "G_p" in results.families


def _has_no_G_p_family(results: Results) -> bool:
    return "G_p" not in results.families and _varies_in(results, "G_p", "mu_s")


def _varies_in(results: Results, *symbols: str) -> bool:
    return all(symbol in results.points.names for symbol in symbols)


def _has_one_grading(results: Results) -> bool:
    """Whether all points have the same grains and the same stress, so that a density is one state before shear."""
    return not {"sigma_ln", "d50", "sigma_3"} & {*results.points.names}


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
            refuted_by=PACKINGS,
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
        refuted_by=PACKINGS,
    )


def _within_range(state: str, symbol: str, mu_iso: float, low: float, high: float) -> Claim:
    return Claim(
        statement=f"{symbol} lies within {low:g}-{high:g} at the {state} state, mu_iso = {mu_iso:g}",
        measure="probability of the range, for a specimen of the paper's size",
        number=partial(statistics.share_within, state=state, symbol=symbol, mu_iso=mu_iso, low=low, high=high),
        sense=">=",
        limit=0.9,  # the paper reads the ranges off figures, where the outermost tenth is hard to see
        applies=partial(_has_density, mu_iso=mu_iso),
    )


def _effect_of_G_p(alone: bool) -> Claim:
    method = "mu_s fixed" if alone else "by regression on ln mu_s and ln G_p"
    return Claim(
        statement="G_p alone hardly changes the stress ratio at large strain",
        measure="change of critical eta by one standard deviation of ln G_p over the standard deviation of eta with "
        f"both varying, mean of the densities, {method}",
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
        applies=lambda results: _varies_in(results, "G_p"),
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
        applies=lambda results: _varies_in(results, "mu_s"),
    ),
    Claim(
        statement="A higher critical eta goes with a smaller coordination number",
        measure="least correlation of eta and -Z of any density",
        number=partial(statistics.least_correlation, symbol="Z", sign=-1),
        sense=">=",
        limit=0.5,
        applies=lambda results: _varies_in(results, "mu_s"),
    ),
    Claim(
        statement="The critical state is reached by 25 % strain",
        measure="strain beyond which every density's mean eta stays within 3 % of its final average",
        number=partial(statistics.steady_strain, symbol="eta", tolerance=0.03),
        sense="<=",
        limit=published.STEADY_STRAIN,
        refutable=statistics.never,
        refuted_by="nothing: noise alone can take the number past the limit",
    ),
    Claim(
        statement="The void ratio is steady by 25 % strain",
        measure="strain beyond which every density's mean e stays within 1 % of its final average",
        number=partial(statistics.steady_strain, symbol="e", tolerance=0.01),
        sense="<=",
        limit=published.STEADY_STRAIN,
        refutable=statistics.never,
        refuted_by="nothing: noise alone can take the number past the limit",
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
        measure="largest COV over the points, without the noise of packings and runs",
        number=statistics.grading_cov,
        sense="<=",
        limit=0.002,
        refutable=statistics.never,
        refuted_by="nothing: noise alone can take the number past the limit",
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
        applies=_has_one_grading,
    ),
    Claim(
        statement="Initial states of one density hardly vary (COV at most 0.011)",
        measure="largest COV of e, e_m, Z, Z_m over the consolidations of a density",
        number=statistics.initial_cov,
        sense="<=",
        limit=0.011,
        refutable=statistics.has_full_size,  # fewer spheres scatter more
        applies=_has_one_grading,
        refuted_by=f"specimens of {published.PARTICLES:,} spheres, as in the paper",
    ),
)


def claims_table(results: Results) -> pd.DataFrame:
    """One row per claim: statement, number, value with its 95 % interval (low, high), criterion and verdict.

    A claim is inconclusive if the campaign lacks its quantities or its number is not finite.  `points_to_decide`: about
    how many points with packings of their own would decide an inconclusive claim, if its value is the true one;
    `to_decide`: in words what would decide it, which need not be more points.  No rows unless the test is the paper's,
    drained compression.
    """
    usual = results.loading == DRAINED
    families = [family for family in results.families if family in ("coupled", "G_p")]
    samples = {family: sample(results, family) for family in families}
    rows = []
    for claim in (claim for claim in CLAIMS if usual and claim.applies(results)):
        number = partial(_evaluate, claim, samples)
        value, low, high = inverted(number) if claim.distance else drawn(number)
        outcome = verdict(low, high, claim.sense, claim.limit)
        if outcome == CONTRADICTED and not claim.refutable(samples):
            outcome = INCONCLUSIVE
        needed, words = np.nan, ""
        if outcome == INCONCLUSIVE:
            needed = len(results.points) * times_to_decide(value, low, high, claim.sense, claim.limit)
            words = _to_decide(claim, samples, needed, low, high)
        criterion = f"{claim.sense} {claim.limit:g}"
        rows.append((claim.statement, claim.measure, value, low, high, criterion, outcome, np.ceil(needed), words))
    columns = ["claim", "number", "value", "low", "high", "criterion", "verdict", "points_to_decide", "to_decide"]
    return pd.DataFrame(rows, columns=columns)


def _to_decide(claim: Claim, samples: Samples, needed: float, low: float, high: float) -> str:
    """What would decide a claim that is inconclusive."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return "the quantities of the claim, in enough runs and packings to know their error"
    if not claim.refutable(samples) and (np.isnan(needed) or claim.refuted_by == PACKINGS):
        return claim.refuted_by
    if np.isnan(needed):
        return "more points, if the true value is not the limit itself"
    return f"about {np.ceil(needed):,.0f} points"


def _evaluate(claim: Claim, samples: Samples, **settings: Any) -> Any:
    """The claim's number; NaN if the results lack the quantity.  Any other exception is a bug and is raised."""
    try:
        return claim.number({family: replace(sample, **settings) for family, sample in samples.items()})
    except ResultsError:
        return float("nan")
