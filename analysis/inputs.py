"""Measured pairs of interparticle friction and particle stiffness, read from a CSV file and checked row by row."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

POISSON_RATIO = 0.2
FEWEST_PAIRS = 10
#: Anything stiffer than this is a unit error: diamond, the stiffest mineral, has a shear modulus of about 535 GPa.
LARGEST_MODULUS_GPA = 1000.0
LARGEST_FRICTION = 5.0


class InputError(ValueError):
    """The measured pairs cannot be used; the message names the file, the line and the value."""


def read_pairs(path: str | Path, nu: float = POISSON_RATIO) -> np.ndarray:
    """Read measured pairs: an (n, 2) float array of mu_s (1) and G_p (Pa).

    The file is a CSV with the columns `mu_s` and either `G_p_GPa` or `E_p_GPa` (Young's modulus, turned into
    G_p = E_p / (2 (1 + nu))); other columns are ignored and lines that start with `#` are comments.
    Raises InputError, one line, for a missing file or column, text, NaN, infinite or non-positive values, values no
    mineral can have, a constant column, or fewer than 10 pairs.
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


def check_pairs(pairs, source: str = "pairs") -> np.ndarray:
    """Return pairs as an (n, 2) float array, or raise InputError if they cannot carry a joint distribution."""
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
    doubled = sorted({name for name in header if header.count(name) > 1 and name})
    if doubled:
        raise InputError(f"{path}: column {doubled[0]} appears more than once")
    found = [name for name in ("G_p_GPa", "E_p_GPa") if name in header]
    if "mu_s" not in header or not found:
        raise InputError(f"{path}: needs the columns mu_s and G_p_GPa (or E_p_GPa); found {', '.join(header)}")
    if len(found) == 2:
        raise InputError(f"{path}: has both G_p_GPa and E_p_GPa; keep one, so that the modulus is unambiguous")
    return found[0]


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


def _check_set(source, pairs: np.ndarray, modulus: str) -> None:
    if len(pairs) < FEWEST_PAIRS:
        raise InputError(f"{source}: {len(pairs)} pairs, need at least {FEWEST_PAIRS} to fit a joint distribution")
    for column, name in zip(pairs.T, ("mu_s", modulus), strict=False):
        if np.ptp(column) == 0.0:
            raise InputError(
                f"{source}: every {name} is the same, so neither its scatter nor a dependence can be fitted"
            )
