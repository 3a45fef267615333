"""A grading that is given by a sieve curve: how it is read and checked, its characteristic sizes, and its spheres.

Between two sieves the share that passes is linear in ln d.  This is the straight line that is drawn between the points
of a grading curve on a logarithmic axis.  It does not depend on the unit of the sizes, and no size is invented.  The
curve must therefore begin with a size that nothing passes, and end with one that everything passes.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors_and_files import GrainScatterError, decoded, digest, shown

COLUMNS = ("size_mm", "passing_percent")
#: The characteristic sizes that spheres must reproduce, as shares by mass, and the largest relative error of each.
SHARES = {"D10": 0.10, "D30": 0.30, "D50": 0.50, "D60": 0.60}
TOLERANCE = 0.02
#: Sizes outside these limits (mm) are taken for an error of the unit.
SMALLEST_MM, LARGEST_MM = 1e-3, 200.0
#: Largest over smallest size that is read, and the most lines.
LARGEST_RATIO, MOST_LINES = 1e3, 10_000
#: Largest share of the mass that one sphere may have.
LARGEST_SHARE = 0.10


class SieveError(GrainScatterError):
    """A sieve curve that cannot be used; the text names the file, the line and the value."""


@dataclass(frozen=True)
class SieveCurve:
    """A grading curve: sizes (n,) in m, increasing, and the shares by mass (n,) that pass them, from 0 to 1."""

    size: tuple[float, ...]
    passing: tuple[float, ...]

    @cached_property
    def sizes(self) -> dict[str, float]:
        """The characteristic sizes D10, D30, D50 and D60 (m)."""
        return {name: self.size_at(share) for name, share in SHARES.items()}

    @property
    def uniformity(self) -> float:
        """Coefficient of uniformity C_u = D60 / D10."""
        return self.sizes["D60"] / self.sizes["D10"]

    @property
    def curvature(self) -> float:
        """Coefficient of curvature C_c = D30^2 / (D10 D60)."""
        return self.sizes["D30"] ** 2 / (self.sizes["D10"] * self.sizes["D60"])

    @property
    def ratio(self) -> float:
        """Largest over smallest size."""
        return self.size[-1] / self.size[0]

    @property
    def text(self) -> str:
        """The curve in a few words."""
        return f"a sieve curve, D50 = {self.sizes['D50'] * 1e3:.3g} mm, sizes 1 to {self.ratio:.3g}"

    @property
    def name(self) -> str:
        """The hash of the curve, which stands for it in run ids."""
        return digest(repr((self.size, self.passing)).encode(), 12)

    def size_at(self, share: float) -> float:
        """Size (m) that a share by mass passes; raises SieveError where a gap of the curve gives it no single value."""
        level = np.flatnonzero(np.asarray(self.passing) == share)
        if len(level) > 1:
            low, high = self.size[level[0]] * 1e3, self.size[level[-1]] * 1e3
            raise SieveError(
                f"{share:.0%} passes every size from {low:g} to {high:g} mm, so D{100 * share:.0f} is not defined"
            )
        return float(np.exp(np.interp(share, self.passing, np.log(self.size))))

    def passing_at(self, d: np.ndarray) -> np.ndarray:
        """Share by mass (n,) that passes the sizes d (n,) m."""
        return np.interp(np.log(d), np.log(self.size), self.passing)

    def diameters(self, N: int) -> np.ndarray:
        """Diameters (N,) in m, ascending, of N spheres with this grading; no random numbers.

        The curve's grains, ordered by size, are cut into N groups of the same number.  A group becomes one sphere with
        the mean mass of its grains, so that the spheres' curve passes through the given one at every limit of a group.
        With f_k = dP/d ln d between two sieves, the number of grains below d is the integral of f_k d^-3 d ln d.
        """
        x, share = np.log(np.asarray(self.size) / self.size[0]), np.asarray(self.passing)
        slope = np.diff(share) / np.diff(x)
        number = slope / 3.0 * (np.exp(-3.0 * x[:-1]) - np.exp(-3.0 * x[1:]))
        below = np.concatenate([[0.0], np.cumsum(number)])
        limits = np.linspace(0.0, below[-1], N + 1)
        k = np.clip(np.searchsorted(below, limits, side="right") - 1, 0, len(slope) - 1)
        inside = np.exp(-3.0 * x[k]) - 3.0 * (limits - below[k]) / slope[k]
        at = np.clip(-np.log(np.maximum(inside, np.exp(-3.0 * x[k + 1]))) / 3.0, x[k], x[k + 1])
        mass = np.diff(share[k] + slope[k] * (at - x[k]))
        return self.size[0] * np.cbrt(mass * N / below[-1])


def size_at(d: np.ndarray, share: float) -> float:
    """Size (m) that a share by mass of spheres d (N,) m, ascending, passes; half of each sphere counts as finer."""
    finer = np.cumsum(d**3) - 0.5 * d**3
    return float(np.exp(np.interp(share * np.sum(d**3), finer, np.log(d))))


def curvature(d: np.ndarray) -> float:
    """Coefficient of curvature C_c = D30^2 / (D10 D60) of spheres of diameters d (N,) m."""
    d = np.sort(d)
    return size_at(d, 0.3) ** 2 / (size_at(d, 0.1) * size_at(d, 0.6))


def errors(curve: SieveCurve, d: np.ndarray) -> dict[str, float]:
    """Relative errors of D10, D30, D50, D60, Cu and Cc of spheres d (N,) m, ascending."""
    found = {name: size_at(d, share) / curve.sizes[name] - 1.0 for name, share in SHARES.items()}
    return found | {
        "Cu": size_at(d, 0.6) / size_at(d, 0.1) / curve.uniformity - 1.0,
        "Cc": curvature(d) / curve.curvature - 1.0,
    }


def shortfall(curve: SieveCurve, d: np.ndarray) -> str:
    """What spheres d (N,) m lack of the curve, in words; "" if every characteristic size is within TOLERANCE."""
    found = errors(curve, d)
    worst = max(found, key=lambda name: abs(found[name]))
    if not abs(found[worst]) <= TOLERANCE:
        return f"miss {worst} by {found[worst]:+.1%}, the limit is {TOLERANCE:.0%}"
    if (share := float(d[-1] ** 3 / np.sum(d**3))) > LARGEST_SHARE:
        return f"put {share:.1%} of the mass into one sphere, the limit is {LARGEST_SHARE:.0%}"
    return ""


def read_sieve(path: str | Path) -> SieveCurve:
    """Read a sieve curve from a CSV file with the columns `size_mm` and `passing_percent` (by mass).

    Lines may run from fine to coarse or from coarse to fine.  Columns are separated by a comma, or by a semicolon or a
    tab, and then a decimal comma is read, too.  Other columns are ignored, and lines that start with `#` are comments.
    Of several sizes that nothing passes the largest counts, and of several that everything passes the smallest.
    Raises SieveError with file, line and value for a file that is no sieve curve.
    """
    path = Path(path)
    rows = _rows(path)
    if len(rows) < 2:
        raise SieveError(f"{path}: {len(rows)} sizes; a sieve curve needs at least 2")
    order = 1.0 if rows[0][1] < rows[-1][1] else -1.0
    for (_, size, share), (line, next_size, next_share) in zip(rows, rows[1:], strict=False):
        if order * (next_size - size) <= 0.0:
            raise SieveError(
                f"{path}, line {line}: size_mm = {next_size:g} follows {size:g}; sizes must all increase or decrease"
            )
        if order * (next_share - share) < 0.0:
            raise SieveError(
                f"{path}, line {line}: passing_percent = {next_share:g} at {next_size:g} mm and {share:g} "
                f"at {size:g} mm; more must pass a larger size"
            )
    rows = rows[:: int(order)]
    _check_ends(path, rows)
    while rows[1][2] == 0.0:
        del rows[0]
    while rows[-2][2] == 100.0:
        del rows[-1]
    curve = SieveCurve(tuple(size * 1e-3 for _, size, _ in rows), tuple(share / 100.0 for *_, share in rows))
    try:
        curve.sizes  # noqa: B018  each of them is defined
    except SieveError as error:
        raise SieveError(f"{path}: {error}") from None
    return curve


def _check_ends(path: Path, rows: list[tuple[int, float, float]]) -> None:
    (line, size, share), (last, largest, last_share) = rows[0], rows[-1]
    if 0.0 < last_share <= 1.0:
        raise SieveError(
            f"{path}, line {last}: passing_percent ends at {last_share:g}; is it a share? 100 stands for all"
        )
    if share != 0.0:
        raise SieveError(
            f"{path}, line {line}: {share:g} % passes the finest size, {size:g} mm; add a line with the size that 0 % "
            "passes, which is the smallest grain"
        )
    if last_share != 100.0:
        raise SieveError(
            f"{path}, line {last}: {last_share:g} % passes the coarsest size, {largest:g} mm; add a line with the size "
            "that 100 % passes, which is the largest grain"
        )
    if largest / size > LARGEST_RATIO:
        raise SieveError(f"{path}: sizes run from {size:g} to {largest:g} mm, a ratio above {LARGEST_RATIO:,.0f}")


def _rows(path: Path) -> list[tuple[int, float, float]]:
    """Line number, size (mm) and passing (per cent) of every line of a CSV file."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SieveError(f"{path}: cannot be read ({error.strerror or error})") from None
    text = decoded(data, path, SieveError).replace("\r\n", "\n").replace("\r", "\n")
    lines = [(k, line) for k, line in enumerate(text.split("\n"), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise SieveError(f"{path}: is empty; expected a header with {' and '.join(COLUMNS)}")
    if len(lines) > MOST_LINES:
        raise SieveError(f"{path}: has {len(lines):,} lines, at most {MOST_LINES:,}")
    separator = next((sign for sign in ";\t" if sign in lines[0][1]), ",")
    header = [name.strip() for name in _cells(path, *lines[0], separator)]
    if any(header.count(name) != 1 for name in COLUMNS):
        raise SieveError(
            f"{path}: needs the columns {' and '.join(COLUMNS)}, each once (sizes in mm); "
            f"found {shown(', '.join(header), 200)}"
        )
    places = [header.index(name) for name in COLUMNS]
    rows = []
    for number, line in lines[1:]:
        cells = _cells(path, number, line, separator)
        size, share = (
            _number(path, number, cells, name, k, separator) for name, k in zip(COLUMNS, places, strict=True)
        )
        rows.append((number, size, share))
    return rows


def _cells(path: Path, number: int, line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator, strict=True))
    except csv.Error as error:
        raise SieveError(f"{path}, line {number}: cannot be read as cells ({error})") from None


def _number(path: Path, line: int, cells: list[str], name: str, index: int, separator: str) -> float:
    text = cells[index].strip() if index < len(cells) else ""
    plain = text.replace(",", ".") if separator != "," else text
    try:
        value = float(plain) if plain.isascii() and "_" not in plain else math.nan
    except ValueError:
        value = math.nan
    where = f"{path}, line {line}: {name} = {shown(repr(text) if value != value else text)}"
    if not math.isfinite(value):
        raise SieveError(f"{where} is not a number")
    if name == "passing_percent" and not 0.0 <= value <= 100.0:
        raise SieveError(f"{where} is outside [0, 100] per cent")
    if name == "size_mm" and not SMALLEST_MM <= value <= LARGEST_MM:
        ask = "" if value <= 0.0 else "; is it in metres?" if value < SMALLEST_MM else "; is it in micrometres (µm)?"
        raise SieveError(f"{where} is outside [{SMALLEST_MM:g}, {LARGEST_MM:g}] mm{ask}")
    return value
