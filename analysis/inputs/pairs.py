"""Measured pairs of interparticle friction and particle stiffness, read from a CSV file and checked line by line."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..errors_and_files import GrainScatterError, decoded, shown

POISSON_RATIO = 0.2
FEWEST_PAIRS = 10
#: A copula of fewer distinct ranks, or a marginal of fewer distinct values, cannot be told from another.
FEWEST_DISTINCT = 5
#: A larger modulus is an error of the unit: diamond, the stiffest mineral, has a shear modulus of about 535 GPa.
LARGEST_MODULUS_GPA = 1000.0
#: A larger friction coefficient is an error of the column or the unit (an angle in degrees).
LARGEST_FRICTION = 5.0
#: Smaller values are errors of the unit or of typing: no mineral is that smooth or that soft.
SMALLEST_FRICTION, SMALLEST_MODULUS_GPA = 1e-4, 1e-6
#: Values of one property that differ from its median by a larger factor are no values of one unit.
LARGEST_RATIO = 1e12
#: A number of a CSV file: ASCII digits, a point, an exponent; and the words that are reported as not finite.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.ASCII | re.IGNORECASE)


class InputError(GrainScatterError):
    """The measured pairs cannot be used; the message names the file, the line and the value."""


def read_pairs(path: str | Path, nu: float = POISSON_RATIO) -> np.ndarray:
    """Read measured pairs of interparticle friction and particle stiffness from a CSV file.

    Parameters
    ----------
    path : str or Path
        CSV with the columns `mu_s` and either `G_p_GPa` or `E_p_GPa` (Young's modulus; G_p = E_p / (2 (1 + nu))).
        Other columns are ignored, and lines that start with `#` are comments.
    nu : float
        Poisson's ratio of the grains, used with `E_p_GPa` only.

    Returns
    -------
    array (n, 2)
        mu_s (1) and G_p (Pa).

    Raises
    ------
    InputError
        With file, line and value, for a missing file or column, text, NaN, infinite or non-positive values, values that
        no mineral can have, fewer than 5 distinct values of a property, or fewer than 10 pairs.

    Examples
    --------
    >>> pairs = read_pairs("data/pairs_reconstructed.csv")
    >>> pairs.shape
    (94, 2)
    """
    return read_numbered_pairs(path, nu)[0]


def read_numbered_pairs(path: str | Path, nu: float = POISSON_RATIO) -> tuple[np.ndarray, list[int]]:
    """As `read_pairs`, and the line numbers (n,) of the pairs in the file."""
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    text = decoded(data, path, InputError).replace("\r\n", "\n").replace("\r", "\n")
    lines = [(k, line) for k, line in enumerate(text.split("\n"), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise InputError(f"{path}: is empty; expected a header with mu_s and G_p_GPa (or E_p_GPa)")
    header = [name.strip() for name in _cells(path, *lines[0])]
    modulus = _modulus_column(path, header)
    columns = {name: header.index(name) for name in ("mu_s", modulus)}
    rows = []
    for number, line in lines[1:]:
        cells = _cells(path, number, line)
        rows.append([_number(path, number, cells, name, index) for name, index in columns.items()])
    pairs = np.array(rows, dtype=float).reshape(-1, 2)
    pairs[:, 1] *= 1e9 / (2.0 * (1.0 + nu)) if modulus == "E_p_GPa" else 1e9
    _check_set(path, pairs, modulus)
    return pairs, [number for number, _ in lines[1:]]


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
    _check_set(source, pairs, "G_p")
    ratio = pairs / np.median(pairs, axis=0)
    bad = np.argwhere((ratio > LARGEST_RATIO) | (ratio < 1.0 / LARGEST_RATIO))
    if bad.size:
        row, column = bad[0]
        raise InputError(
            f"{source}: pair {row + 1}, column {column + 1} is {pairs[row, column]:g}; it differs from the median "
            f"{np.median(pairs[:, column]):g} by more than a factor of {LARGEST_RATIO:g}"
        )
    return pairs


def _cells(path: Path, number: int, line: str) -> list[str]:
    """The cells of one line; a quoted cell must end in its line."""
    try:
        return next(csv.reader([line], strict=True))
    except csv.Error as error:
        if "field limit" in str(error):
            raise InputError(
                f"{path}, line {number}: a cell has more than {csv.field_size_limit():,} characters"
            ) from None
        raise InputError(
            f"{path}, line {number}: a quoted cell does not end in this line ({error}); "
            "a cell must have no line break, and text after a closing quote must start with a comma"
        ) from None


def _modulus_column(path: Path, header: list[str]) -> str:
    repeated = sorted({name for name in header if header.count(name) > 1 and name})
    if repeated:
        raise InputError(f"{path}: column {shown(repeated[0])} appears more than once")
    moduli = [name for name in ("G_p_GPa", "E_p_GPa") if name in header]
    if "mu_s" not in header or not moduli:
        raise InputError(
            f"{path}: needs the columns mu_s and G_p_GPa (or E_p_GPa); found {shown(', '.join(header), 200)}"
        )
    if len(moduli) == 2:
        raise InputError(f"{path}: has both G_p_GPa and E_p_GPa; keep one, so that the modulus is unambiguous")
    return moduli[0]


def _number(path: Path, line: int, cells: list[str], name: str, index: int) -> float:
    text = cells[index].strip() if index < len(cells) else ""
    if not _NUMBER.fullmatch(text):
        raise InputError(f"{path}, line {line}: {name} = {shown(repr(text))} is not a number")
    value, said = float(text), shown(text)
    if not math.isfinite(value):
        raise InputError(f"{path}, line {line}: {name} = {said} is not finite")
    if value <= 0.0:
        raise InputError(f"{path}, line {line}: {name} = {said} must be positive")
    low, high = (SMALLEST_FRICTION, LARGEST_FRICTION) if name == "mu_s" else (SMALLEST_MODULUS_GPA, LARGEST_MODULUS_GPA)
    unit = "" if name == "mu_s" else " GPa"
    if value > high:
        ask = "" if name == "mu_s" else " (is it in Pa or MPa?)"
        raise InputError(f"{path}, line {line}: {name} = {said} exceeds {high:g}{unit}{ask}")
    if value < low:
        raise InputError(f"{path}, line {line}: {name} = {said} is below {low:g}{unit}")
    return value


def _check_set(source: str | Path, pairs: np.ndarray, modulus: str) -> None:
    if len(pairs) < FEWEST_PAIRS:
        raise InputError(f"{source}: {len(pairs)} pairs, need at least {FEWEST_PAIRS} to fit a joint distribution")
    for column, name in zip(pairs.T, ("mu_s", modulus), strict=False):
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
