"""A bivariate copula with its parameters: PDF, distribution function, conditionals, sampling, Kendall's tau."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import archimedean, elliptical, frank_plackett
from .family import CopulaError, Family, rotated

_TURNED = {"clayton": archimedean.CLAYTON, "gumbel": archimedean.GUMBEL, "joe": archimedean.JOE}

FAMILIES: dict[str, Family] = {
    "gaussian": elliptical.GAUSSIAN,
    "student": elliptical.STUDENT,
    "frank": frank_plackett.FRANK,
    "plackett": frank_plackett.PLACKETT,
    "independence": elliptical.INDEPENDENCE,
    **_TURNED,
    **{f"{name}{turn}": rotated(base, turn) for name, base in _TURNED.items() for turn in (90, 180, 270)},
}


@dataclass(frozen=True)
class Copula:
    """A family of FAMILIES with its parameters; `clayton90` is the Clayton copula turned by 90 degrees, and so on.

    All functions take arrays of probabilities in [0, 1] that broadcast.  Raises CopulaError for an unknown family,
    parameters out of range and probabilities outside [0, 1].
    """

    family: str
    parameters: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        kind = family_of(self.family)
        parameters = tuple(float(value) for value in np.atleast_1d(self.parameters))
        if len(parameters) != len(kind.names):
            raise CopulaError(
                f"{self.family}: expected {len(kind.names)} parameters {kind.names}, got {len(parameters)}"
            )
        for name, value, (low, high) in zip(kind.names, parameters, kind.bounds, strict=True):
            if not low <= value <= high:
                raise CopulaError(f"{self.family}: {name} = {value:g} is outside [{low:g}, {high:g}]")
        object.__setattr__(self, "parameters", parameters)

    def logpdf(self, u: ArrayLike, v: ArrayLike) -> np.ndarray:
        """Log PDF of the copula, ln c(u, v)."""
        return self._evaluate("logpdf", u, v)

    def pdf(self, u: ArrayLike, v: ArrayLike) -> np.ndarray:
        """PDF of the copula, c(u, v)."""
        return np.exp(self.logpdf(u, v))

    def cdf(self, u: ArrayLike, v: ArrayLike) -> np.ndarray:
        """C(u, v) = P(U <= u, V <= v)."""
        return self._evaluate("cdf", u, v)

    def conditional(self, u: ArrayLike, v: ArrayLike) -> np.ndarray:
        """P(V <= v | U = u), the derivative of C with respect to u."""
        return self._evaluate("conditional", u, v)

    def inverse(self, u: ArrayLike, p: ArrayLike) -> np.ndarray:
        """v from P(V <= v | U = u) = p."""
        return self._evaluate("inverse", u, p)[0]

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """n independent pairs, shape (n, 2)."""
        return self.inverse_rosenblatt(rng.random((n, 2)))

    def rosenblatt(self, u: np.ndarray) -> np.ndarray:
        """Pairs (n, 2) of this copula to independent uniforms (n, 2): (u, P(V <= v | U = u))."""
        u = np.asarray(u, dtype=float)
        return np.stack([u[..., 0], self.conditional(u[..., 0], u[..., 1])], axis=-1)

    def inverse_rosenblatt(self, w: np.ndarray) -> np.ndarray:
        """Independent uniforms (n, 2) to pairs (n, 2) of this copula."""
        w = np.asarray(w, dtype=float)
        return np.stack([w[..., 0], self.inverse(w[..., 0], w[..., 1])], axis=-1)

    @property
    def dimension(self) -> int:
        """Number of variables: 2."""
        return 2

    @property
    def tau(self) -> float:
        """Kendall's tau."""
        return float(family_of(self.family).tau(*self.parameters))

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary."""
        return {"family": self.family, "parameters": list(self.parameters)}

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Copula:
        """The inverse of to_dict."""
        return Copula(data["family"], tuple(data["parameters"]))

    def _evaluate(self, name: str, u: ArrayLike, v: ArrayLike) -> Any:
        return evaluate(family_of(self.family), name, u, v, *self.parameters)


def family_of(name: str) -> Family:
    """The family of that name; raises CopulaError if there is none."""
    if name not in FAMILIES:
        raise CopulaError(f"unknown copula family {name!r}; known: {', '.join(FAMILIES)}")
    return FAMILIES[name]


def transposed(name: str) -> str:
    """The family of the same copula with its two variables exchanged: rotations by 90 and 270 degrees change places."""
    for turn, other in (("90", "270"), ("270", "90")):
        if name.endswith(turn):
            return name.removesuffix(turn) + other
    return name


def evaluate(kind: Family, name: str, u: ArrayLike, v: ArrayLike, *params: Any) -> Any:
    """Result of the function `name` of a family at probabilities u, v and parameters that broadcast.

    Adds the complements and moves 0 to 1e-300.  Raises CopulaError for probabilities outside [0, 1].
    """
    u, v = np.asarray(u, dtype=float), np.asarray(v, dtype=float)
    if np.any((u < 0.0) | (u > 1.0) | (v < 0.0) | (v > 1.0)):
        raise CopulaError("probabilities must lie in [0, 1]")
    tiny = 1e-300
    uc, vc = np.maximum(1.0 - u, tiny), np.maximum(1.0 - v, tiny)
    with np.errstate(over="ignore", under="ignore", divide="ignore", invalid="ignore"):
        return getattr(kind, name)(np.maximum(u, tiny), uc, np.maximum(v, tiny), vc, *params)
