"""What a statistician would ask about measured pairs and their fits: one sentence per doubt, nothing is changed.

Outliers are sought in logarithms. Scatter is their median absolute deviation times 1.4826, that of a normal
distribution. Values are outliers if a gap separates them from the rest and they lie far from the median: above it more
than 4.5 times the scatter behind a gap of 1.5, below it 6 behind 3, because the logarithms of normal and Weibull
variables have a long lower tail. In 94 values of a lognormal, gamma or Gumbel distribution this calls less than 1 in 50
samples doubtful.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..copulas.fitting import CopulaFit
from ..copulas.multivariate_fits import MultivariateFit
from ..quantities import QUANTITIES, Quantity
from .independence import LEVEL, kendall
from .marginals import Marginal, verdict

#: (smallest distance from the median, smallest gap) in units of the scatter.
_ABOVE, _BELOW = (4.5, 1.5), (6.0, 3.0)
#: Largest share of all comparisons of two values of one property that may be ties.
LARGEST_TIES = 0.05
#: Largest share of pairs that may repeat an earlier pair, unless ties explain the repetition.
LARGEST_REPEATED = 0.10
#: With fewer pairs it is said which families they cannot tell apart: those whose AIC is this near to the smallest one.
FEW_PAIRS, NEAR_AIC = 40, 2.0
#: Usual range of the median of a property, SI units, and what to ask below and above it.
USUAL = {
    "mu_s": (0.01, 1.5, "is it divided by 100?", "is it an angle, or in per cent?"),
    "G_p": (5e8, 2e11, "is it in TPa, or divided by 1,000?", "is it 1,000 times too large, or in another unit?"),
}
#: Values that one sentence lists at most.
_LISTED = 5


def input_warnings(
    pairs: np.ndarray,
    marginals: Mapping[str, Sequence[Marginal]],
    copulas: Sequence[CopulaFit | MultivariateFit],
    lines: Sequence[int] | None = None,
) -> list[str]:
    """Sentences on pairs (n, d) and their fits, best first; an empty list if there is nothing to ask.

    `marginals` is keyed by the symbols of the columns, in their order. `lines` (n,) are line numbers in the file of the
    pairs; without them pairs are counted from 1.
    """
    places = [f"pair {k + 1}" for k in range(len(pairs))] if lines is None else [f"line {k}" for k in lines]
    found: list[str] = []
    for symbol, column in zip(marginals, pairs.T, strict=False):
        found += [*_unit(symbol, column), *_outliers(symbol, column, places), *_ties(symbol, column)]
    found += _repeated(pairs, places)
    for symbol, table in marginals.items():
        found += _rejected_marginals(symbol, table)
    found += _rejected_copulas(copulas) + _at_bounds(copulas) + _independent(pairs, copulas)
    return found + _not_told_apart(len(pairs), marginals, copulas)


def outliers(values: np.ndarray) -> np.ndarray:
    """Indices of the gross outliers of positive values (n,), by the rule of this module; largest distance first."""
    logs = np.log(values)
    distance = logs - np.median(logs)
    scatter = 1.4826 * np.median(np.abs(distance))
    if scatter == 0.0:
        return np.array([], dtype=int)
    z = distance / scatter
    far = np.zeros(z.size, dtype=bool)
    for sign, (least, gap) in ((1.0, _ABOVE), (-1.0, _BELOW)):
        ordered = np.sort(sign * z)
        beyond = ordered[1:][(np.diff(ordered) > gap) & (ordered[1:] > least)]
        if beyond.size:
            far |= sign * z >= beyond[0]
    return np.flatnonzero(far)[np.argsort(-np.abs(z[far]), kind="stable")]


def _outliers(symbol: str, column: np.ndarray, places: Sequence[str]) -> list[str]:
    found = outliers(column)
    if not found.size:
        return []
    median = float(np.median(column))
    ratios = column[found] / median
    listed = [f"{_value(symbol, column[k])} ({places[k]})" for k in found[:_LISTED]]
    if found.size > _LISTED:
        listed.append(f"and {found.size - _LISTED} more")
    thousand = np.any(np.abs(np.abs(np.log10(ratios)) - 3.0) < 0.5)
    error = "an error" if found.size == 1 else "errors"
    ask = "another unit (a factor of 1,000)?" if thousand else f"{error} of typing?"
    verb, them = ("lies", "it") if found.size == 1 else ("lie", "them")
    scatter = [_value(symbol, float(np.std(part, ddof=1))) for part in (np.delete(column, found), column)]
    return [
        f"{symbol}: {found.size} of {column.size} values {verb} far from all others: {', '.join(listed)}; "
        f"the median is {_value(symbol, median)}, and without {them} the standard deviation is {scatter[0]} instead of "
        f"{scatter[1]}; {ask}"
    ]


def _ties(symbol: str, column: np.ndarray) -> list[str]:
    counts = np.unique(column, return_counts=True)[1].astype(float)
    n = column.size
    share = float((counts * (counts - 1.0)).sum()) / (n * (n - 1.0))
    if share <= LARGEST_TIES:
        return []
    return [
        f"{symbol}: {n} pairs have only {counts.size} distinct values, and {share:.0%} of all comparisons are ties "
        f"(limit {LARGEST_TIES:.0%}); the tests of fit allow for ties, the fitted parameters do not"
    ]


def _repeated(pairs: np.ndarray, places: Sequence[str]) -> list[str]:
    """Pairs that repeat an earlier one, where ties of the single properties would make far fewer."""
    _, first, counts = np.unique(pairs, axis=0, return_index=True, return_counts=True)
    n, repeats = len(pairs), len(pairs) - len(counts)
    if repeats <= LARGEST_REPEATED * n:
        return []
    by_chance = n * (n - 1.0) / 2.0
    for column in pairs.T:
        of_column = np.unique(column, return_counts=True)[1].astype(float)
        by_chance *= float((of_column * (of_column - 1.0)).sum()) / (n * (n - 1.0))
    if repeats <= 5.0 * by_chance:
        return []
    example = places[int(first[np.argmax(counts)])]
    return [
        f"{repeats} of {n} pairs repeat an earlier pair (that of {example} occurs {counts.max()} times); were they "
        "measured or copied?"
    ]


def _unit(symbol: str, column: np.ndarray) -> list[str]:
    if symbol not in USUAL:
        return []
    low, high, ask_low, ask_high = USUAL[symbol]
    median = float(np.median(column))
    if low <= median <= high:
        return []
    ask = ask_low if median < low else ask_high
    return [f"{symbol}: the median {_value(symbol, median)} is outside {_range(symbol, low, high)}; {ask}"]


def _rejected_marginals(symbol: str, table: Sequence[Marginal]) -> list[str]:
    """All families rejected, or the chosen one while another is not."""
    if not table or table[0].ks_p_fitted is None:
        return []
    accepted = [m for m in table if verdict(m) == "accepted"]
    if verdict(table[0]) == "accepted":
        return []
    if not accepted:
        best = max(min(m.ks_p_fitted or 0.0, m.ad_p_fitted or 0.0) for m in table)
        families = "the family" if len(table) == 1 else f"all {len(table)} families"
        return [
            f"{symbol}: the tests reject {families} of marginals (largest p = {best:.2g}, level 0.05); "
            f"{table[0].family} has the smallest AIC{_distances(table[0])} and is taken nevertheless; "
            'inputs.marginals = ["kernel"] takes a kernel density, which needs no family'
        ]
    other = accepted[0]
    return [
        f"{symbol}: {table[0].family} has the smallest AIC but is {verdict(table[0])}; {other.family} is accepted, "
        f"with an AIC larger by {(other.aic or 0.0) - (table[0].aic or 0.0):.1f}"
    ]


def _distances(fit: Marginal) -> str:
    """Both statistics of a fit in brackets."""
    return "" if fit.ks is None or fit.ad is None else f" (KS D = {fit.ks:.3f}, AD = {fit.ad:.2f})"


def _rejected_copulas(fits: Sequence[CopulaFit | MultivariateFit]) -> list[str]:
    if not fits or any(fit.accepted is not False for fit in fits):
        return []
    best = max(fit.p_bootstrap or 0.0 for fit in fits)
    families = "the family" if len(fits) == 1 else f"all {len(fits)} families"
    return [
        f"copula: the bootstrap rejects {families} (largest p = {best:.2g}, level 0.05); {fits[0].family} has the "
        "smallest AIC and is taken nevertheless"
    ]


def _independent(pairs: np.ndarray, fits: Sequence[CopulaFit | MultivariateFit]) -> list[str]:
    """The test of independence does not reject, and another copula is chosen; or the other way round."""
    if not fits or pairs.shape[1] != 2:
        return []
    found = kendall(pairs[:, 0], pairs[:, 1])
    taken = fits[0].family
    if found.p > LEVEL and taken != "independence":
        return [
            f"copula: independence cannot be rejected: {found.text}, {found.p_text}, level {LEVEL}; {taken} is taken; "
            'inputs.copulas = ["independence"] takes no dependence'
        ]
    if found.p <= LEVEL and taken == "independence":
        return [f"copula: independence is taken, but rejected: {found.text}, {found.p_text}, level {LEVEL}"]
    return []


def _not_told_apart(
    n: int, tables: Mapping[str, Sequence[Marginal]], fits: Sequence[CopulaFit | MultivariateFit]
) -> list[str]:
    """Families whose AIC is near the smallest one, where the pairs are few."""
    if n >= FEW_PAIRS:
        return []
    texts = []
    named: dict[str, Sequence[Marginal | CopulaFit | MultivariateFit]] = {**tables, "the copula": fits}
    for what, table in named.items():
        aic = [(fit.aic, fit.family) for fit in table if fit.aic is not None]
        near = [family for value, family in aic if value - min(aic)[0] < NEAR_AIC]
        if len(near) > 1:
            texts.append(f"{', '.join(near)} of {what}")
    if not texts:
        return []
    return [
        f"{n} pairs cannot distinguish these families: AIC within {NEAR_AIC:g} of the smallest: {'; '.join(texts)}; "
        "every bootstrap sample of the pairs chooses again, so that the bands allow for the choice"
    ]


def _at_bounds(fits: Sequence[CopulaFit | MultivariateFit]) -> list[str]:
    """Fits at an end of their range: any family at a wall, the chosen one also where it only becomes simpler."""
    texts = []
    for k, fit in enumerate(fits):
        for name, limit, simpler in fit.at_bounds:
            if not simpler or k == 0:
                value = fit.parameters[fit.names.index(name)]
                what = f", where it is practically the {simpler} copula" if simpler else ""
                chosen = " (chosen)" if k == 0 else ""
                texts.append(f"{fit.family}{chosen} {name} = {value:.5g}, limit {limit:g}{what}")
    if not texts:
        return []
    if len(texts) > _LISTED:
        texts = [*texts[:_LISTED], f"and {len(texts) - _LISTED} more"]
    walls = any(not simpler for fit in fits for _, _, simpler in fit.at_bounds)
    why = "; one property is nearly a function of the other, or values are tied" if walls else ""
    return [f"copula: a parameter is at the end of its range: {'; '.join(texts)}{why}"]


def _value(symbol: str, value: float) -> str:
    quantity = _quantity(symbol)
    unit = f" {quantity.shown_unit}" if quantity.shown_unit else ""
    return f"{value * quantity.shown_factor:.4g}{unit}"


def _range(symbol: str, low: float, high: float) -> str:
    quantity = _quantity(symbol)
    return f"{low * quantity.shown_factor:g} to {_value(symbol, high)}"


def _quantity(symbol: str) -> Quantity:
    return QUANTITIES.get(symbol) or Quantity(symbol, symbol, "1", "")
