"""The parameters of a distribution from figures that are stated of it.

Two figures determine a distribution, three a triangular one. Families of a location and a scale (normal, Gumbel,
uniform) are solved in closed form. Families of a scale and a shape (lognormal, gamma, Weibull) have a closed form or
one equation for the shape; triangular distributions one for the place of the mode; truncated ones two nested equations.
Equations are solved by bracketed root searches over the whole range of the unknown, so that a second solution is found,
too. The result is compared with the figures to a relative 1e-9.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy import optimize

from .family import MarginalError
from .figures_stated import PARENT, check_figures, figure, known_figures
from .marginal_families import family_of
from .marginals import Marginal
from .truncated_figures import truncated

#: A coefficient of variation outside these limits belongs to no grain property, or to a constant.
SMALLEST_COV, LARGEST_COV = 1e-3, 2.0
#: Largest relative difference of a stated figure that is not needed from what the other figures give.
AGREEMENT = 0.01
_ACCURACY = 1e-9
#: More solutions mean that the figures do not depend on the place of the mode.
_MOST_ROOTS = 4
#: Families of a scale and a shape: names of both, and the range of the shape.
_SHAPED = {
    "lognormal": ("median", "sigma_ln", 5e-4, 1.6),
    "gamma": ("scale", "shape", 0.1, 4e6),
    "weibull": ("scale", "shape", 0.4, 2500.0),
}
_LINEAR = ("normal", "gumbel", "uniform")


def from_figures(family: str, figures: Mapping[str, float], positive: bool = True) -> Marginal:
    """The distribution of a family that has the stated figures, all in one unit; `low` and `high` if it is truncated.

    `positive`: the mean must be positive, and the coefficient of variation within its limits.

    Raises MarginalError, in one line with the figure, its value and the limit, for figures that are unknown, too few,
    impossible or contradictory, or that two distributions of the family have.
    """
    check_figures(family, figures, positive)
    values = {name: float(value) for name, value in figures.items()}
    bounds = {name: values.pop(name) for name in ("low", "high") if family in PARENT}
    stated = [name for name in known_figures(family) if name in values]
    stated += [name for name in values if name not in stated]
    if family in PARENT:
        _check_one_kind(family, stated)
    needed = 3 if family == "triangular" else 2
    for names in itertools.combinations(stated, needed):
        found = _solutions(family, {name: values[name] for name in names}, bounds)
        if found is not None:
            break
    else:
        raise MarginalError(_too_few(family, stated, needed))
    rest = [name for name in stated if name not in names]
    agreeing = [one for one in found if all(_near(one, name, values[name], AGREEMENT) for name in rest)]
    if not agreeing:
        wrong = next(name for name in rest if not _near(found[0], name, values[name], AGREEMENT))
        raise MarginalError(
            f"{wrong} = {values[wrong]:g} contradicts {_listed(names, values)}, with which it is "
            f"{figure(found[0], wrong):.4g} (limit of the difference {AGREEMENT:.0%})"
        )
    if len(agreeing) > 1:
        texts = [", ".join(f"{name} = {value:.4g}" for name, value in one.params.items()) for one in agreeing]
        raise MarginalError(
            f"{len(agreeing)} {family} distributions have {_listed(stated, values)}: one with "
            f"{' and one with '.join(texts)}; state another figure"
        )
    if positive:
        _check_size(agreeing[0], names, values)
    _check_met(agreeing[0], names, values)
    return agreeing[0]


def _check_one_kind(family: str, stated: Sequence[str]) -> None:
    before = [name for name in stated if name.startswith("parent_")]
    after = [name for name in stated if name not in before]
    if before and after:
        raise MarginalError(
            f"{before[0]} is a figure of the {PARENT[family]} distribution before the truncation, and {after[0]} one "
            "after it; state two of the same kind"
        )


def _too_few(family: str, stated: Sequence[str], needed: int) -> str:
    count = {2: "two", 3: "three"}[needed]
    if len(stated) >= needed:
        return f"{', '.join(stated)} do not determine a {family} distribution; state another figure"
    given = ", ".join(stated) or "none"
    beside = " beside low and high" if family in PARENT else ""
    known = ", ".join(name for name in known_figures(family) if not beside or name not in ("low", "high"))
    return f"a {family} distribution needs {count} figures{beside}; stated: {given}; known: {known}"


def _solutions(family: str, figures: dict[str, float], bounds: dict[str, float]) -> list[Marginal] | None:
    """The distributions with these figures; None if the figures do not determine one."""
    if family in _LINEAR:
        return _linear(family, figures)
    if family == "triangular":
        return _triangular(figures)
    if family in PARENT:
        if next(iter(figures)).startswith("parent_"):
            before = {name.removeprefix("parent_"): value for name, value in figures.items()}
            base = from_figures(PARENT[family], before, positive=False)
            own = dict(zip(family_of(family).names, base.params.values(), strict=False))
            return [Marginal(family, own | bounds)]
        return truncated(family, figures, **bounds)
    return _shaped(family, figures)


def _row(base: Marginal, name: str, value: float) -> tuple[float, float, float]:
    """(a, b, c) of the equation a m + b s = c that a figure is for X = m + s Y with Y distributed as `base`."""
    if name == "cov":
        return value, value * base.mean - base.std, 0.0
    if name in ("sd", "scale"):
        return 0.0, base.std if name == "sd" else 1.0, value
    return 1.0, figure(base, name), value


def _linear(family: str, figures: dict[str, float]) -> list[Marginal] | None:
    names = family_of(family).names
    if set(figures) == set(names):
        return [Marginal(family, {name: figures[name] for name in names})]
    base = Marginal(family, dict(zip(names, (0.0, 1.0), strict=True)))
    (a, b, c), (d, e, f) = (_row(base, name, value) for name, value in figures.items())
    determinant = a * e - b * d
    if abs(determinant) <= 1e-12 * max(abs(a * e), abs(b * d)):
        return None
    m, s = (c * e - b * f) / determinant, (a * f - c * d) / determinant
    if s <= 0.0:
        raise MarginalError(f"no {family} distribution has {_listed(figures, figures)}")
    return [Marginal(family, dict(zip(names, (m, m + s if family == "uniform" else s), strict=True)))]


def _shaped(family: str, figures: dict[str, float]) -> list[Marginal] | None:
    size, shape, low, high = _SHAPED[family]

    def at(k: float, scale: float = 1.0) -> Marginal:
        params = {size: scale, shape: k}
        return Marginal(family, {name: params[name] for name in family_of(family).names})

    shapes = [name for name in figures if name in (shape, "cov", "sigma_ln")]
    sizes = [name for name in figures if name not in shapes]
    if len(shapes) == 2:
        return None
    if len(sizes) == 1:
        roots = [figures[shape]] if shape in figures else _shape(family, shapes[0], figures[shapes[0]], at)
    else:
        one, other = sizes
        target = math.log(figures[one]) - math.log(figures[other])
        if {one, other} <= {size, "median"} and family == "lognormal":
            return None

        def ratio(log_k: float) -> float:
            base = at(math.exp(log_k))
            return math.log(figure(base, one)) - math.log(figure(base, other))

        roots, least, most = roots_between(ratio, target, math.log(low), math.log(high))
        roots = [math.exp(root) for root in roots]
        if not roots:
            raise MarginalError(
                f"{_listed(sizes, figures)}: {one} / {other} = {math.exp(target):.4g} is outside "
                f"[{math.exp(least):.4g}, {math.exp(most):.4g}], what a {family} distribution can have"
            )
    return [at(root, figures[sizes[0]] / figure(at(root), sizes[0])) for root in roots]


def _shape(family: str, name: str, value: float, at: Callable[[float], Marginal]) -> list[float]:
    """The shape with a cov or a sigma_ln: closed forms but for the Weibull's cov and the gamma's sigma_ln."""
    if name == "cov":
        _check_cov(value)
    if family == "lognormal":
        return [math.sqrt(math.log1p(value**2))]
    if family == "gamma" and name == "cov":
        return [value**-2.0]
    if family == "weibull" and name == "sigma_ln":
        return [math.pi / (math.sqrt(6.0) * value)]
    _, _, low, high = _SHAPED[family]
    roots, least, most = roots_between(
        lambda log_k: figure(at(math.exp(log_k)), name), value, math.log(low), math.log(high)
    )
    if not roots:
        raise MarginalError(f"{name} = {value:g} is outside [{least:.3g}, {most:.3g}]")
    return [math.exp(root) for root in roots]


def _triangular(figures: dict[str, float]) -> list[Marginal] | None:
    names = family_of("triangular").names
    if set(figures) == set(names):
        return [Marginal("triangular", {name: figures[name] for name in names})]

    def system(c: float) -> np.ndarray:
        base = Marginal("triangular", {"low": 0.0, "mode": c, "high": 1.0})
        rows = np.array([_row(base, name, value) for name, value in figures.items()])
        return rows / np.abs(rows).max(axis=1, keepdims=True) / [1.0, 1.0, size]

    size = max(abs(value) for name, value in figures.items() if name != "cov")
    if all(abs(np.linalg.det(system(c))) < 1e-12 for c in (0.1, 0.37, 0.8)):
        return None
    roots, _, _ = roots_between(lambda c: float(np.linalg.det(system(c))), 0.0, 0.0, 1.0, slack=1e-12)
    if len(roots) > _MOST_ROOTS:
        return None
    found = []
    for c in roots:
        rows = system(c) * [1.0, 1.0, size]
        m, s = np.linalg.lstsq(rows[:, :2], rows[:, 2], rcond=None)[0]
        if s > 0.0:
            one = Marginal("triangular", {"low": float(m), "mode": float(m + c * s), "high": float(m + s)})
            if all(_near(one, name, value, 1e-8) for name, value in figures.items()):
                found.append(one)
    if not found:
        raise MarginalError(f"no triangular distribution has {_listed(figures, figures)}")
    return found


def roots_between(
    function: Callable[[float], float], target: float, low: float, high: float, slack: float = 0.0, nodes: int = 201
) -> tuple[list[float], float, float]:
    """All x in [low, high] with function(x) = target at a change of sign on a grid, and the range of the function.

    At the ends of the interval a difference of `slack` counts as none.
    """
    x = np.linspace(low, high, nodes)
    gap = np.array([function(float(value)) - target for value in x])
    roots = [float(end) for end, off in ((x[0], gap[0]), (x[-1], gap[-1])) if 0.0 < abs(off) <= slack]
    roots += [float(value) for value in x[gap == 0.0]]
    for k in np.flatnonzero(gap[:-1] * gap[1:] < 0.0):
        root = optimize.brentq(lambda value: function(value) - target, x[k], x[k + 1], xtol=1e-15, rtol=1e-15)
        if not any(abs(root - other) < 1e-6 * (high - low) for other in roots):
            roots.append(float(root))
    return sorted(roots), float(target + gap.min()), float(target + gap.max())


def _near(one: Marginal, name: str, value: float, tolerance: float) -> bool:
    scale = abs(value) if name in ("cov", "sd", "sigma_ln", "shape") else max(abs(value), one.std)
    return abs(figure(one, name) - value) <= tolerance * scale


def _check_cov(value: float) -> None:
    if not SMALLEST_COV <= value <= LARGEST_COV:
        more = '; use family = "constant" with the key value' if value < SMALLEST_COV else ""
        raise MarginalError(f"cov = {value:.4g} is outside [{SMALLEST_COV:g}, {LARGEST_COV:g}]{more}")


def _check_size(one: Marginal, names: Sequence[str], values: Mapping[str, float]) -> None:
    """Refuse a distribution without a positive mean, or with a scatter that no property has."""
    if one.mean <= 0.0:
        raise MarginalError(f"{_listed(names, values)} give a mean of {one.mean:.4g}; it must be positive")
    _check_cov(figure(one, "cov"))


def _check_met(one: Marginal, names: Sequence[str], values: Mapping[str, float]) -> None:
    for name in names:
        if not _near(one, name, values[name], _ACCURACY):
            raise MarginalError(
                f"{name} = {values[name]:g} is met by {figure(one, name):.12g} only; state other figures"
            )


def _listed(names: Sequence[str] | Mapping[str, float], values: Mapping[str, float]) -> str:
    return " and ".join(f"{name} = {values[name]:g}" for name in names)
