"""Whether the deviatoric stress falls when the servo takes over at the start of shear."""

from __future__ import annotations

import numpy as np

#: Strain up to which a record is looked at.
EARLY = 0.01


def lowest_and_scatter(eps_a: np.ndarray, q: np.ndarray, early: float = EARLY) -> tuple[float, float]:
    """Lowest q of the rows up to the strain `early` minus q at rest (row 0), and the scatter of a row, in units of q.

    The scatter is the median of the absolute second differences of the rows after row 1, over 0.6745 sqrt(6): for
    independent normal errors their standard deviation.  A curve that is smooth on the scale of three rows adds nothing
    to it, and a fall in one row hardly anything.  Row 0 is at rest, and the rise to row 1 is elastic.
    """
    rows = q[(eps_a > 0.0) & (eps_a <= early)]
    return float(rows.min() - q[0]), float(np.median(np.abs(np.diff(rows[1:], 2))) / (0.6745 * np.sqrt(6.0)))


def falls(eps_a: np.ndarray, q: np.ndarray, early: float = EARLY) -> bool:
    """Whether q falls below its value at rest by more than its scatter."""
    lowest, scatter = lowest_and_scatter(eps_a, q, early)
    return lowest < -scatter
