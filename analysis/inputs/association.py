"""Pearson's, Spearman's and Kendall's correlation of two variables with given marginals and copula, and the inverse.

Pearson's correlation is the quadrature of standardised values over independent standard normals z1, z2 of the copula's
Rosenblatt map, E[X1 X2] = int int F1^-1(u) F2^-1(C^-1(p | u)) phi(z1) phi(z2) dz1 dz2 with u = Phi(z1), p = Phi(z2), by
Gauss-Legendre rules on panels that end where a quantile function has a kink. The number of nodes is doubled until the
result is known to 1e-6 or better. Spearman's correlation is that of uniform marginals.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from scipy import optimize, special

from ..copulas import Copula, CopulaError
from ..copulas.model import family_of
from .marginals import Marginal

MEASURES = ("pearson", "kendall", "spearman", "parameter")
#: Largest error of a correlation from the quadrature.
ACCURACY = 1e-6
_UNIFORM = Marginal("uniform", {"low": 0.0, "high": 1.0})
#: Limit of the quadrature in standard deviations, as in `joint`; the probability beyond it is 6e-14.
_REACH = 7.5
#: Nodes per panel: of the search for a parameter, and those with which its result is checked.
_SEARCH, _CHECKS = 48, (48, 96, 192, 384)
#: Below so many degrees of freedom Student's copula has steep edges along the axes, and its PDF is integrated instead.
_FEW_DEGREES, _DENSITY_NODES = 3.0, (256, 512)


def association(measure: str, copula: Copula, first: Marginal, second: Marginal) -> float:
    """The value of a measure of MEASURES for two variables; `parameter` is the copula's first parameter.

    Raises CopulaError where the quadrature does not reach ACCURACY.
    """
    if measure == "parameter":
        return copula.parameters[0] if copula.parameters else 0.0
    if measure == "kendall":
        return copula.tau
    if copula.family == "independence":
        return 0.0
    if measure == "spearman" and copula.family == "gaussian":
        return float(6.0 / np.pi * np.arcsin(0.5 * copula.parameters[0]))
    pair = (_UNIFORM, _UNIFORM) if measure == "spearman" else (first, second)
    if copula.family == "student" and copula.parameters[1] < _FEW_DEGREES:
        value = _over_density(copula, *pair)
        if value is not None:
            return value
    before, error = _over_normals(copula, *pair, _CHECKS[0]), np.inf
    for nodes in _CHECKS[1:]:
        value = _over_normals(copula, *pair, nodes)
        error, before = abs(value - before), value
        if error < 0.1 * ACCURACY:
            break
    if not error <= ACCURACY:
        raise CopulaError(
            f"{copula.family} copula with the parameters {_listed(copula)}: the {measure} correlation is known to "
            f'{error:.1g} only, limit {ACCURACY:g}; state measure = "kendall" or "parameter"'
        )
    return before


def attainable(first: Marginal, second: Marginal) -> tuple[float, float]:
    """The smallest and the largest Pearson correlation of two marginals: U2 = 1 - U1, and U2 = U1 (Hoeffding 1940)."""
    edges = np.array(
        [-_REACH, *sorted({*_kinks(first), *(sign * z for z in _kinks(second) for sign in (1, -1))}), _REACH]
    )
    z, weight = _panels(edges[None], 200)
    z, weight = z[0], weight[0]
    x, y, reverse = (_standardised(one, special.ndtr(at)) for one, at in ((first, z), (second, z), (second, -z)))
    return float(weight @ (x * reverse) / weight.sum()), float(weight @ (x * y) / weight.sum())


def reachable(measure: str, copula_of: Callable[[float], Copula], family: str, *pair: Marginal) -> tuple[float, float]:
    """The smallest and the largest value of a measure that a family can have; copula_of: first parameter -> copula."""
    low, high = (association(measure, copula_of(bound), *pair) for bound in family_of(family).bounds[0])
    return min(low, high), max(low, high)


def with_association(
    measure: str, value: float, copula_of: Callable[[float], Copula], family: str, first: Marginal, second: Marginal
) -> Copula:
    """The copula of a family for which a measure has a value; copula_of: first parameter -> copula.

    Raises CopulaError if the marginals, or the family, cannot have this value, with the range that they can have.
    """
    if measure == "parameter":
        return copula_of(value)
    limit = attainable(first, second) if measure == "pearson" else (-1.0, 1.0)
    if not limit[0] <= value <= limit[1]:
        what = "these two distributions" if measure == "pearson" else "any two variables"
        raise CopulaError(f"is outside [{limit[0]:.4g}, {limit[1]:.4g}], the range of {what}")
    kind = family_of(family)
    rest = [bound[1] for bound in kind.bounds[1:]]
    ends = sorted(float(kind.to_free(bound, *rest)[0]) for bound in kind.bounds[0])

    def copula_at(free: float) -> Copula:
        bounds = kind.bounds[0]
        return copula_of(float(np.clip(kind.from_free(free, *(1.0 / r for r in rest))[0], *bounds)))

    quadrature = measure == "pearson" or (measure == "spearman" and family not in ("gaussian", "independence"))
    pair = (_UNIFORM, _UNIFORM) if measure == "spearman" else (first, second)

    def rough(free: float) -> float:
        copula = copula_at(free)
        return _over_normals(copula, *pair, _SEARCH) if quadrature else association(measure, copula, first, second)

    if (rough(ends[0]) - value) * (rough(ends[1]) - value) >= 0.0:
        low, high = reachable(measure, copula_of, family, first, second)
        if not low <= value <= high:
            raise CopulaError(
                f"is outside [{low:.4g}, {high:.4g}], what a {family} copula can have{_turned(family, value)}"
            )
    target = value
    for _ in range(5):
        found = copula_at(_root(rough, target, ends))
        off = association(measure, found, first, second) - value if quadrature else 0.0
        if abs(off) <= 0.5 * ACCURACY:
            return found
        target -= off
    raise CopulaError(f"is met by no {family} copula to {ACCURACY:g}; the nearest differs by {off:.2g}")


def _root(function: Callable[[float], float], target: float, ends: list[float]) -> float:
    """The argument between two ends where a monotonic function is `target`; an end, if it is beyond its value there."""
    low, high = (function(end) - target for end in ends)
    if low * high >= 0.0:
        return ends[0] if abs(low) < abs(high) else ends[1]
    return float(optimize.brentq(lambda free: function(free) - target, *ends, xtol=1e-13))


def _turned(family: str, value: float) -> str:
    """What to take in place of a family that has one sign of dependence only."""
    sign, base = family_of(family).sign, family.rstrip("0123456789")
    if not sign or sign * value > 0.0:
        return ""
    if value == 0.0:
        return "; leave the section [dependence] out for independence"
    return f"; take {base}90 or {base}270" if sign > 0 else f"; take {base} or {base}180"


def _over_normals(copula: Copula, first: Marginal, second: Marginal, nodes: int) -> float:
    z, weight = _panels(np.array([[-_REACH, *_kinks(first), _REACH]]), nodes)
    u, weight = special.ndtr(z[0]), weight[0] / weight[0].sum()
    places = [special.ndtr(kink) for kink in _kinks(second)]
    with np.errstate(divide="ignore"):
        shares = [np.clip(copula.conditional(u, place), 0.0, 1.0) for place in places]  # rounding may exceed 1
        inner = [np.clip(special.ndtri(share), -_REACH, _REACH) for share in shares]
    edges = np.stack([np.full(u.shape, -_REACH), *inner, np.full(u.shape, _REACH)], axis=1)
    z2, weight2 = _panels(edges, nodes)
    v = copula.inverse(u[:, None], special.ndtr(z2))
    of_second = (weight2 * _standardised(second, v)).sum(axis=1) / weight2.sum(axis=1)
    return float(weight @ (_standardised(first, u) * of_second))


def _over_density(copula: Copula, first: Marginal, second: Marginal) -> float | None:
    """As `_over_normals` from the copula's PDF; None where the PDF is too steep for the grid."""
    values = []
    for nodes in _DENSITY_NODES:
        (z1, weight1), (z2, weight2) = (
            _panels(np.array([[-_REACH, *_kinks(one), _REACH]]), nodes) for one in (first, second)
        )
        u, v = special.ndtr(z1[0]), special.ndtr(z2[0])
        weight = weight1[0][:, None] * copula.pdf(u[:, None], v) * weight2[0] / (2.0 * np.pi)
        if abs(weight.sum() - 1.0) > 0.1 * ACCURACY:
            return None
        values.append(float(_standardised(first, u) @ weight @ _standardised(second, v)))
    return values[1] if abs(values[1] - values[0]) < ACCURACY else None


def _panels(edges: np.ndarray, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights (r, m) of the standard normal density (times sqrt(2 pi)) on panels between edges (r, k)."""
    t, w = _rule(nodes)
    half, middle = 0.5 * np.diff(edges, axis=1)[..., None], 0.5 * (edges[:, 1:] + edges[:, :-1])[..., None]
    z = (middle + half * t).reshape(len(edges), -1)
    return z, (half * w).reshape(len(edges), -1) * np.exp(-0.5 * z * z)


@functools.lru_cache(maxsize=16)
def _rule(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(nodes)


def _kinks(marginal: Marginal) -> list[float]:
    """Standard normal scores where the quantile function has a kink: the mode of a triangular distribution."""
    if marginal.family != "triangular":
        return []
    share = float(marginal.cdf(marginal.params["mode"]))
    return [float(special.ndtri(share))] if 0.0 < share < 1.0 else []


def _standardised(marginal: Marginal, u: np.ndarray) -> np.ndarray:
    return (marginal.ppf(np.clip(u, 1e-300, 1.0 - 2.0**-53)) - marginal.mean) / marginal.std


def _listed(copula: Copula) -> str:
    return ", ".join(
        f"{name} = {value:.4g}" for name, value in zip(family_of(copula.family).names, copula.parameters, strict=True)
    )
