"""What the reader returns: a response along strain, single runs, the estimate of a peak, and the errors it raises."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors_and_files import GrainScatterError
from ..pdem import weighted
from ..pdem.pdf import PDF
from ..quantities import DRAINED, QUANTITIES, Loading, Quantity


class ResultsError(GrainScatterError):
    """A results file that cannot be used, or a name that is not in it; one line names it and the reason."""


class NotReachedError(ResultsError):
    """Values of a state that the tests did not reach; the line gives the reason and how to see them all the same."""


class Runs(NamedTuple):
    """What n single runs gave: values (..., n), the packing (n,) of each, and the place (n,) of its point."""

    values: np.ndarray
    packing: np.ndarray
    place: np.ndarray


@dataclass(frozen=True)
class PeakEstimate:
    """Peaks that were pooled over the points: `bias` (Q,) that was subtracted from the stress ratio, NaN where a point
    has no run, and whether the peak is `interior` (Q,), not at the first or last strain where a peak may lie.
    """

    bias: np.ndarray
    interior: np.ndarray


@dataclass(frozen=True)
class Response:
    """One response at one density: values (T, Q) over the strains (T,) and the points, and its PDF along strain.

    `probability` (Q,) of the points, of sum 1.  `extended` (T, Q) marks values that continue a run which stopped early
    in the steady state.  `packing` (Q,) is the random seed of each point's packing.  `pdf` holds the PDF on its grid
    (pdf.p, pdf.x) and what widens it.  `mean` and `std` (T,) are sums over the points, never integrals of the PDF.
    """

    quantity: Quantity
    strain: np.ndarray
    values: np.ndarray
    probability: np.ndarray
    extended: np.ndarray
    packing: np.ndarray
    pdf: PDF
    loading: Loading = DRAINED

    @property
    def going(self) -> np.ndarray:
        """Whether any test goes on at a strain, (T,): mean and PDF are those of these tests."""
        return np.isfinite(self.values).any(axis=1)

    @property
    def mean(self) -> np.ndarray:
        """Mean of the points at every strain, (T,), in SI units."""
        return weighted.mean(self.values, self.probability)

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of the points at every strain, (T,), in SI units."""
        return weighted.std(self.values, self.probability)

    @property
    def strain_pct(self) -> np.ndarray:
        """Axial strains (T,) in %, the unit of the axis label `loading.strain_label`; positive in extension, too."""
        return self.strain * QUANTITIES["eps_a"].shown_factor

    def quantile(self, q: float) -> np.ndarray:
        """Quantile q of the points at every strain, (T,), in SI units."""
        return np.array([weighted.quantile(row, self.probability, q) for row in self.values])

    @property
    def density(self) -> PDF:
        """Former name of `pdf`; will be removed in the next version."""
        warnings.warn("Response.density is now Response.pdf", DeprecationWarning, stacklevel=2)
        return self.pdf
