"""Each claim of the paper as a number of this campaign with a 95 % interval, and whether it holds at this size.

Intervals come from resampling the representative points, all densities together, with their probabilities.  All points
of a density share a packing, so part of a run's noise is common to them and resampling cannot see it: every resample
also shifts each density by a normal error, measured on replicate packings where there are some and else one run's
standard error, as if all of it were common (`analysis.packing_noise`); along strain, where only replicates tell how it
wiggles, it is drawn from these.  Where nothing tells it, a number that such an error would move cannot be told.
Points that were not run come from another response surface each time.  Noise mostly adds to a distance, in the value
and again in its resamples, so the interval of a distance is the value plus and minus what 95 % of them are off by.
The representative points are spread more evenly than a random sample, so the intervals are rather too wide.
A claim is held if the whole interval meets its criterion, not held if none of it does, and cannot be told otherwise;
each by itself: among thirty intervals one or two miss their number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from analysis import claim_numbers as numbers
from analysis import paper
from analysis.results import read_results

HELD, NOT_HELD, OPEN = "held", "not held", "can't be told"


@dataclass(frozen=True)
class Claim:
    """What the paper says, the number that tests it, and the criterion the number has to meet.

    `sense`: "<=", ">=", or "|x| <=" for a number with a sign.  `distance` marks a number that cannot be negative and
    that noise mostly raises.  `refutable` tells from the full samples whether the claim can be refuted: a number that
    noise raises on its own does not do so unless the noise is known and taken off, nor a difference between densities
    unless replicate packings tell how much of it is the packings'.
    """

    statement: str
    measure: str
    number: Callable
    sense: str
    limit: float
    distance: bool = False
    refutable: Callable = lambda samples: True


def claims_table(results, n_boot=200, seed=1) -> pd.DataFrame:
    """One row per claim: statement, number, value, 95 % interval, criterion and verdict.

    results: a path or open results; n_boot resamplings of the points.  A claim whose quantities the campaign does not
    have, or whose number is not finite, cannot be told.
    """
    results = read_results(results)
    rng = np.random.default_rng(seed)
    base = {family: numbers.full_sample(results, family) for family in results.families if family in ("coupled", "G_p")}
    drawn = [{family: numbers.drawn_sample(sample, rng) for family, sample in base.items()} for _ in range(n_boot)]
    rows = []
    for claim in claims(results):
        value = _evaluate(claim, base)
        said = _interval(np.array([_evaluate(claim, samples) for samples in drawn]), value, claim.distance)
        outcome = verdict(*said, claim.sense, claim.limit)
        rows.append(
            {
                "claim": claim.statement,
                "number": claim.measure,
                "value": value,
                "from": said[0],
                "to": said[1],
                "criterion": f"{claim.sense} {claim.limit:g}",
                "verdict": OPEN if outcome == NOT_HELD and not claim.refutable(base) else outcome,
            }
        )
    return pd.DataFrame(rows)


def verdict(low, high, sense, limit) -> str:
    """Held, not held or open, for an interval low ... high against "<= limit", ">= limit" or "|x| <= limit"."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return OPEN
    if sense == "|x| <=":
        return verdict(max(low, -high, 0.0), max(-low, high), "<=", limit)
    inside, outside = (high <= limit, low > limit) if sense == "<=" else (low >= limit, high < limit)
    return HELD if inside else NOT_HELD if outside else OPEN


def claims(results) -> list[Claim]:
    """The paper's claims as tests of this campaign; the criteria are this project's reading of its words."""
    out = []
    for symbol, name in (
        ("eta", "stress ratio"),
        ("e", "void ratio"),
        ("e_m", "mechanical void ratio"),
        ("Phi_dev", "fabric anisotropy"),
    ):
        out.append(
            Claim(
                f"At the critical state the PDFs of the {name} coincide for all densities",
                "largest Wasserstein distance of two densities over the standard deviation, critical state",
                partial(numbers.largest_distance, states=("critical",), symbol=symbol),
                "<=",
                0.25,
                distance=True,
                refutable=partial(numbers.packings_tell, states=("critical",), symbol=symbol),
            )
        )
        out.append(
            Claim(
                f"At the peak the PDFs of the {name} differ between densities",
                "Wasserstein distance of densest and loosest over the standard deviation, peak",
                partial(numbers.end_distance, state="peak", symbol=symbol),
                ">=",
                0.5,
                distance=True,
            )
        )
    for symbol, name in (("Z", "coordination number"), ("Z_m", "mechanical coordination number")):
        out.append(
            Claim(
                f"The {name} forgets the density",
                "largest Wasserstein distance of two densities over the standard deviation, peak and critical state",
                partial(numbers.largest_distance, states=("peak", "critical"), symbol=symbol),
                "<=",
                0.25,
                distance=True,
                refutable=partial(numbers.packings_tell, states=("peak", "critical"), symbol=symbol),
            )
        )
    for (state, symbol, mu_iso), (low, high) in paper.STATE_RANGE.items():
        if mu_iso in results.family_densities():
            share = partial(numbers.share_within, state=state, symbol=symbol, mu_iso=mu_iso, low=low, high=high)
            out.append(
                Claim(
                    f"{symbol} lies within {low:g}-{high:g} at the {state} state, mu_iso = {mu_iso:g}",
                    "probability of the shown density within the range",
                    share,
                    ">=",
                    0.9,
                )
            )
    alone = "G_p" in results.families
    out += [
        Claim(
            "G_p alone hardly moves the stress ratio at large strain",
            "change of critical eta by one sd of ln G_p over the sd of eta with both varying, mean of the densities, "
            + ("mu_s fixed" if alone else "by regression on ln mu_s and ln G_p"),
            partial(numbers.effect_of_G_p, alone=alone),
            "|x| <=",
            0.2,
        ),
        Claim(
            "G_p moves the small-strain stiffness",
            "least exponent of G_0 in G_p over the densities, by regression on ln mu_s and ln G_p (Hertz: 2/3)",
            numbers.stiffness_exponent,
            ">=",
            0.3,
        ),
        Claim(
            "Dense samples have the higher G_0",
            "mean of G_0 densest over G_0 loosest at the same point, minus 1",
            numbers.stiffness_gain,
            ">=",
            0.0,
        ),
        Claim(
            "A higher critical eta goes with a larger void ratio",
            "least correlation of eta and e of any density",
            partial(numbers.least_correlation, symbol="e", sign=1),
            ">=",
            0.5,
        ),
        Claim(
            "A higher critical eta goes with a smaller coordination number",
            "least correlation of eta and -Z of any density",
            partial(numbers.least_correlation, symbol="Z", sign=-1),
            ">=",
            0.5,
        ),
        Claim(
            "The critical state is reached by 25 % strain",
            "strain beyond which every density's mean eta stays within 3 % of its final average",
            partial(numbers.steady_strain, symbol="eta", tolerance=0.03),
            "<=",
            paper.STEADY_STRAIN,
            refutable=numbers.never,
        ),
        Claim(
            "The void ratio is steady by 25 % strain",
            "strain beyond which every density's mean e stays within 1 % of its final average",
            partial(numbers.steady_strain, symbol="e", tolerance=0.01),
            "<=",
            paper.STEADY_STRAIN,
            refutable=numbers.never,
        ),
        Claim(
            "I_G_active and I_G_stress are about 1.19 at peak and critical state",
            "largest distance of a mean from 1.19",
            numbers.grading_distance,
            "<=",
            0.01,
        ),
        Claim(
            "I_G_active and I_G_stress hardly vary (COV about 0.001)",
            "largest COV, what packings scatter by taken off where it is known",
            numbers.grading_cov,
            "<=",
            0.002,
            refutable=numbers.grading_noise_is_known,
        ),
        Claim(
            "e and e_m grow and Z and Z_m fall with mu_iso",
            "least relative step between neighbouring densities, after consolidation",
            numbers.initial_step,
            ">=",
            0.0,
        ),
        Claim(
            "The initial states are those of Table 3",
            "largest relative difference of means, after consolidation",
            numbers.initial_difference,
            "<=",
            0.05,
        ),
        Claim(
            "Initial states of one density hardly vary (COV at most 0.011)",
            "largest COV of e, e_m, Z, Z_m after consolidation, told only if every point has its own",
            numbers.initial_cov,
            "<=",
            0.011,
        ),
    ]
    return out


def _evaluate(claim, samples):
    try:
        return float(claim.number(samples))
    except (ValueError, KeyError):
        return float("nan")


def _interval(drawn, value, distance):
    """95 % interval of resampled drawn; NaN if more than a tenth of them could not be computed."""
    known = drawn[np.isfinite(drawn)]
    if len(known) < 0.9 * len(drawn):
        return np.nan, np.nan
    if distance:
        off = np.quantile(np.abs(known - value), 0.95)
        return max(value - off, 0.0), value + off
    low, high = np.quantile(known, [0.025, 0.975])
    return low, high
