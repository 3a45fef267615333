"""PDFs along strain of the points that still have a value there: conditional on their tests going on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .evolution import evolve
from .pdf import PDF

#: Probability that may have no value at a strain, as long as a point has one.
_NEARLY_ALL = 1.0 - 1e-12


def evolve_known(h: ArrayLike, probability: ArrayLike, strain: ArrayLike, **options: Any) -> PDF:
    """`evolution.evolve` of values (T, Q) of which any may be NaN: at every strain the PDF of the points with a value.

    Their probabilities are normalised.  Where no point has a value the PDF is zero everywhere, mean and standard
    deviation are NaN, and the lost probability is 1.  Raises PdemError if no point has a value at any strain.
    """
    h, strain = np.asarray(h, float), np.asarray(strain, float)
    known = np.isfinite(h).any(axis=1)
    if np.isfinite(h).all() or not known.any():
        return evolve(h, probability, strain, **options)
    pdf = evolve(h[known], probability, strain[known], **(options | {"max_lost": _NEARLY_ALL}))
    rows: dict[str, Any] = {"strain": strain, "values": h, "p": _at(pdf.p, known, 0.0)}
    rows |= {name: _at(getattr(pdf, name), known, np.nan) for name in ("mean", "std")}
    rows |= {name: _at(getattr(pdf, name), known, 0.0) for name in ("bandwidth", "numerical_width", "spacing")}
    rows |= {"lost_probability": _at(pdf.lost_probability, known, 1.0)}
    if pdf.probability is not None:
        rows["probability"] = _at(pdf.probability, known, 0.0)
    return replace(pdf, **rows)


def _at(values: np.ndarray, known: np.ndarray, rest: float) -> np.ndarray:
    """Rows of values at the known places of an array (T, ...), and `rest` elsewhere."""
    out = np.full((len(known), *values.shape[1:]), rest)
    out[known] = values
    return out
