"""Measured pairs of interparticle friction and particle stiffness, read from a CSV file and checked line by line."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..errors_and_files import GrainScatterError

POISSON_RATIO = 0.2
FEWEST_PAIRS = 10
#: A larger modulus is an error of the unit: diamond, the stiffest mineral, has a shear modulus of about 535 GPa.
LARGEST_MODULUS_GPA = 1000.0
#: A larger friction coefficient is an error of the column or the unit (an angle in degrees).
LARGEST_FRICTION = 5.0


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
        no mineral can have, a constant column, or fewer than 10 pairs.

    Examples
    --------
    >>> pairs = read_pairs("data/pairs_reconstructed.csv")
    >>> pairs.shape
    (94, 2)
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a UTF-8 text file") from None
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise InputError(f"{path}: is empty; expected a header with mu_s and G_p_GPa (or E_p_GPa)")
    header = [name.strip() for name in next(csv.reader([lines[0][1]]))]
    modulus = _modulus_column(path, header)
    columns = {name: header.index(name) for name in ("mu_s", modulus)}
    rows = []
    for number, line in lines[1:]:
        cells = next(csv.reader([line]))
        rows.append([_number(path, number, cells, name, index) for name, index in columns.items()])
    pairs = np.array(rows, dtype=float).reshape(-1, 2)
    pairs[:, 1] *= 1e9 / (2.0 * (1.0 + nu)) if modulus == "E_p_GPa" else 1e9
    _check_set(path, pairs, modulus)
    return pairs


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
    return pairs


def _modulus_column(path: Path, header: list[str]) -> str:
    repeated = sorted({name for name in header if header.count(name) > 1 and name})
    if repeated:
        raise InputError(f"{path}: column {repeated[0]} appears more than once")
    moduli = [name for name in ("G_p_GPa", "E_p_GPa") if name in header]
    if "mu_s" not in header or not moduli:
        raise InputError(f"{path}: needs the columns mu_s and G_p_GPa (or E_p_GPa); found {', '.join(header)}")
    if len(moduli) == 2:
        raise InputError(f"{path}: has both G_p_GPa and E_p_GPa; keep one, so that the modulus is unambiguous")
    return moduli[0]


def _number(path: Path, line: int, cells: list[str], name: str, index: int) -> float:
    text = cells[index].strip() if index < len(cells) else ""
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{path}, line {line}: {name} = {text!r} is not a number") from None
    if not math.isfinite(value):
        raise InputError(f"{path}, line {line}: {name} = {text} is not finite")
    if value <= 0.0:
        raise InputError(f"{path}, line {line}: {name} = {text} must be positive")
    limit = LARGEST_FRICTION if name == "mu_s" else LARGEST_MODULUS_GPA
    if value > limit:
        unit = "" if name == "mu_s" else " GPa (is it in Pa or MPa?)"
        raise InputError(f"{path}, line {line}: {name} = {text} exceeds {limit:g}{unit}")
    return value


def _check_set(source: str | Path, pairs: np.ndarray, modulus: str) -> None:
    if len(pairs) < FEWEST_PAIRS:
        raise InputError(f"{source}: {len(pairs)} pairs, need at least {FEWEST_PAIRS} to fit a joint distribution")
    for column, name in zip(pairs.T, ("mu_s", modulus), strict=False):
        if np.ptp(column) == 0.0:
            raise InputError(
                f"{source}: every {name} is the same, so neither its scatter nor a dependence can be fitted"
            )
