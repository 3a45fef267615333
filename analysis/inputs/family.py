"""The functions that define a family of one-dimensional distributions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors_and_files import GrainScatterError


class MarginalError(GrainScatterError):
    """A marginal distribution cannot be fitted or does not exist."""


@dataclass(frozen=True)
class MarginalFamily:
    """One family: names of its parameters, which of them must be positive, and whether x must be.

    logpdf(x, *params), cdf, sf = 1 - cdf; ppf(u, *params); mle(samples (R, n)) -> parameters (R, k);
    moments(*params) -> (mean, variance); wrong(*params) -> why parameters do not fit together, or "".
    """

    names: tuple[str, ...]
    positive_params: tuple[str, ...]
    positive: bool
    logpdf: Callable[..., np.ndarray]
    cdf: Callable[..., np.ndarray]
    sf: Callable[..., np.ndarray]
    ppf: Callable[..., np.ndarray]
    mle: Callable[[np.ndarray], np.ndarray]
    moments: Callable[..., tuple[float, float]]
    wrong: Callable[..., str] = lambda *params: ""

    def check(self, params: dict[str, float]) -> None:
        """Raise MarginalError unless params are exactly the parameters of this family, finite and in range."""
        if tuple(params) != self.names:
            raise MarginalError(f"expected the parameters {', '.join(self.names)}; got {', '.join(params) or 'none'}")
        for name, value in params.items():
            if not np.isfinite(value) or (name in self.positive_params and value <= 0.0):
                raise MarginalError(f"parameter {name} = {value} is out of range")
        if text := self.wrong(*params.values()):
            raise MarginalError(text)
