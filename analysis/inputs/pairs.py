"""Measured pairs of interparticle friction and particle stiffness, read from a file and checked line by line."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .checks import FEWEST_PAIRS, InputError, check_pairs
from .table import POISSON_RATIO, read_input_table

__all__ = ["FEWEST_PAIRS", "POISSON_RATIO", "InputError", "check_pairs", "read_numbered_pairs", "read_pairs"]


def read_pairs(path: str | Path, nu: float = POISSON_RATIO) -> np.ndarray:
    """Read measured pairs of interparticle friction and particle stiffness from a file.

    Parameters
    ----------
    path : str or Path
        CSV or `.xlsx` with the columns `mu_s` and either `G_p_GPa` or `E_p_GPa` (Young's modulus; G_p = E_p /
        (2 (1 + nu))), or the same in MPa or Pa. Other columns are ignored, and lines that start with `#` are comments.
        Cells are separated by commas, semicolons or tabs, and the decimal mark is a point or a comma.
    nu : float
        Poisson's ratio of the grains, used with a Young's modulus only.

    Returns
    -------
    array (n, 2)
        mu_s (1) and G_p (Pa).

    Raises
    ------
    InputError
        With file, line and value, for a missing file or column, text, NaN, infinite or non-positive values, values that
        no mineral can have, values that can be read in two ways, fewer than 5 distinct values of a property, or fewer
        than 10 pairs.

    Examples
    --------
    >>> pairs = read_pairs("data/pairs_reconstructed.csv")
    >>> pairs.shape
    (94, 2)
    """
    return read_numbered_pairs(path, nu)[0]


def read_numbered_pairs(path: str | Path, nu: float = POISSON_RATIO) -> tuple[np.ndarray, list[int]]:
    """As `read_pairs`, and the line numbers (n,) of the pairs in the file."""
    table = read_input_table(path, nu)
    return table.values[:, :2], table.lines
