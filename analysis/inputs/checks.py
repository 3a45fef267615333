"""The error of measured inputs, and what a set of measured values must have before a distribution can be fitted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..errors_and_files import GrainScatterError

FEWEST_PAIRS = 10
#: A copula of fewer distinct ranks, or a marginal of fewer distinct values, cannot be told from another.
FEWEST_DISTINCT = 5
#: Values of one property that differ from its median by a larger factor are no values of one unit.
LARGEST_RATIO = 1e12


class InputError(GrainScatterError):
    """The measured pairs cannot be used; the message names the file, the line and the value."""


def check_pairs(pairs: ArrayLike, source: str | Path = "pairs") -> np.ndarray:
    """Return pairs as an (n, d) float array with d >= 2; raises InputError if no joint distribution can be fitted.

    `source` names the pairs in the message.
    """
    pairs = np.asarray(pairs, dtype=float)
    if pairs.ndim != 2 or pairs.shape[1] < 2:
        raise InputError(f"{source}: expected an (n, 2) array of mu_s and G_p, got shape {pairs.shape}")
    bad = np.argwhere(~np.isfinite(pairs) | (pairs <= 0.0))
    if bad.size:
        row, column = bad[0]
        raise InputError(f"{source}: pair {row + 1}, column {column + 1} is {pairs[row, column]:g}; must be positive")
    check_set(source, pairs, ("mu_s", "G_p"))
    ratio = pairs / np.median(pairs, axis=0)
    bad = np.argwhere((ratio > LARGEST_RATIO) | (ratio < 1.0 / LARGEST_RATIO))
    if bad.size:
        row, column = bad[0]
        raise InputError(
            f"{source}: pair {row + 1}, column {column + 1} is {pairs[row, column]:g}; it differs from the median "
            f"{np.median(pairs[:, column]):g} by more than a factor of {LARGEST_RATIO:g}"
        )
    return pairs


def check_set(source: str | Path, pairs: np.ndarray, names: Sequence[str]) -> None:
    """Raise InputError if the values (n, d), called `names`, are too few or too much alike for a fit."""
    if len(pairs) < FEWEST_PAIRS:
        raise InputError(f"{source}: {len(pairs)} pairs, need at least {FEWEST_PAIRS} to fit a joint distribution")
    for column, name in zip(pairs.T, names, strict=False):
        if np.ptp(column) == 0.0:
            raise InputError(
                f"{source}: every {name} is the same, so neither its scatter nor a dependence can be fitted"
            )
        distinct = len(np.unique(column))
        if distinct < FEWEST_DISTINCT:
            raise InputError(
                f"{source}: {name} has {distinct} distinct values in {len(pairs)} pairs; "
                f"a fit needs at least {FEWEST_DISTINCT}"
            )
