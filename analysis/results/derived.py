"""What `Results` computes from its states: friction angles, PDFs of a state, joint PDFs and the numbers to quote."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..pdem import weighted
from ..pdem.pdf import PDF
from .friction_angle import friction_angle

if TYPE_CHECKING:
    import pandas as pd

    from ..pdem.joint_pdf import JointPDF
    from .reader import Results


@dataclass(frozen=True)
class StatePDF:
    """PDF of a quantity at a state: x (X,) cell centres and p (X,) in 1 / unit of x; moments of the points as numbers.

    `exceedance` and `quantile` come from the points, as those of `PDF`.  `pdf` is the same with one row per state.
    """

    pdf: PDF

    @property
    def x(self) -> np.ndarray:
        """Cell centres (X,), in SI units."""
        return np.ravel(self.pdf.x)

    @property
    def p(self) -> np.ndarray:
        """Probability density (X,), in 1 / unit of x."""
        return self.pdf.p[0]

    @property
    def mean(self) -> float:
        """Mean of the points."""
        return float(self.pdf.mean[0])

    @property
    def std(self) -> float:
        """Standard deviation of the points."""
        return float(self.pdf.std[0])

    def exceedance(self, threshold: float) -> float:
        """Probability that the quantity exceeds a value."""
        return float(self.pdf.exceedance(threshold)[0])

    def quantile(self, level: float) -> float:
        """Quantile at a probability."""
        return float(self.pdf.quantile(level)[0])


class DerivedQuantities:
    """Methods of `Results` that need nothing but its other methods.  A density is given as mu_iso or by its name."""

    def friction_angle(self, state: str, mu_iso: float | str, family: str = "coupled", **options: Any) -> np.ndarray:
        """Friction angles (Q,) of the points at a state, in degrees: sin phi = 3 eta / (6 + eta).

        In extension sin phi = 3 |eta| / (6 - |eta|).  options, values and errors as in `state`.
        """
        eta = _results(self).state(state, "eta", mu_iso, family, **options)
        return friction_angle(eta, _results(self).loading.direction)

    def state_pdf(self, state: str, symbol: str, mu_iso: float | str, family: str = "coupled") -> StatePDF:
        """PDF of a quantity at a state over the points, with mean, std, exceedance and quantile as numbers.

        Raises NotReachedError for a state that was not reached, PdemError for fewer than two points.
        """
        from ..pdem.evolution import state_pdf

        values = _results(self).state(state, symbol, mu_iso, family)
        probability = _results(self).probability(mu_iso, family)
        return StatePDF(state_pdf(values, weighted.normalised(probability, np.isfinite(values))))

    def joint(
        self, first: str, second: str, state: str = "critical", mu_iso: float | str | None = None,
        family: str = "coupled",
    ) -> JointPDF:  # fmt: skip
        """Joint PDF of two quantities at a state: x1, x2, p, correlation, conditional_mean, ... in SI units.

        At one density, or over the points of all densities together.  Raises NotReachedError for a state that was not
        reached, PdemError for fewer than two points with both values.
        """
        from ..pdem.joint_pdf import joint_pdf

        densities = _results(self).family_densities(family) if mu_iso is None else (mu_iso,)
        one, two, probability = self.pooled(state, (first, second), densities, family, withheld="raise")
        return joint_pdf(one, two, probability)

    def pooled(
        self, state: str, symbols: tuple[str, ...], densities: tuple[float | str, ...], family: str = "coupled",
        withheld: str = "nan",
    ) -> tuple[np.ndarray, ...]:  # fmt: skip
        """Values of each symbol at a state, the densities one after the other, and their probabilities of sum 1."""
        results = _results(self)
        values = [
            np.concatenate([results.state(state, symbol, m, family, withheld) for m in densities]) for symbol in symbols
        ]
        probability = np.concatenate([results.probability(m, family) for m in densities])
        return (*values, weighted.normalised(probability, np.all(np.isfinite(values), axis=0)))

    def quote(self) -> pd.DataFrame:
        """The numbers to quote: one row per density, state and quantity, rounded by their uncertainties.

        Mean, standard deviation, 5 and 95 % quantile with half widths of their 95 % intervals (`..._pm`), in displayed
        units, and the standing of the state; see `analysis.results.quote`.
        """
        from .quote import quote

        return _results(self).cached("quote", lambda: quote(_results(self))).copy()


def _results(this: Any) -> Results:
    """The object as what it is, for the type checker: `Results` has the other methods."""
    return this
