"""The assembly that all runs of a campaign share: sphere sizes of a grading and first positions without contacts.

Sizes are quantiles of the grading, not random draws, so that even 400 spheres have the requested d50 and grading index.
Positions are random; soft spheres in the periodic cell then move apart until no pair touches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from .errors_and_files import GrainScatterError, atomic_write, open_hdf5
from .quantities import QUANTITIES

DISTRIBUTIONS = ("lognormal", "loguniform", "well_graded", "gap_graded")
#: Solid fraction of the densest start that is read.  Denser spheres overlap, and the packing becomes denser while they
#: separate: overlaps of 10 % give e a tenth too low, which no proof of equilibrium detects.
DENSEST_START = 0.60
_FORMAT = "dem-assembly"


class AssemblyError(GrainScatterError):
    """An assembly that cannot be made, or a file that does not contain one."""


@dataclass(frozen=True)
class Assembly:
    """Spheres in a periodic box: position (N, 3) m inside the box, radius (N,) m, cell (3,) edge lengths m."""

    position: np.ndarray
    radius: np.ndarray
    cell: np.ndarray


def make_assembly(
    N: int,
    d50: float,
    sigma_ln: float,
    seed: int,
    distribution: str = "lognormal",
    solid_fraction: float = 0.52,
    *,
    size_ratio: float = 4.0,
    fines: float = 0.25,
) -> Assembly:
    """N spheres of a given grading at random positions in a periodic cube, without contacts.

    d50 (m) is the median by mass, sigma_ln the standard deviation of ln d by mass; `distribution`, `size_ratio` and
    `fines` as in `diameters`.  The same arguments give the same assembly.
    Raises AssemblyError for arguments out of range and if no state without contacts is found.
    """
    if not 0.0 < solid_fraction <= 0.58:
        raise AssemblyError(f"assembly: solid_fraction = {solid_fraction:g} is outside (0, 0.58]")
    rng = np.random.default_rng(seed)
    radius = rng.permutation(0.5 * diameters(N, d50, sigma_ln, distribution, size_ratio=size_ratio, fines=fines))
    edge = (np.sum(4.0 / 3.0 * np.pi * radius**3) / solid_fraction) ** (1.0 / 3.0)
    if 4.0 * radius.max() > edge:
        raise AssemblyError(
            f"assembly: the cell edge {edge:.3g} m is less than two diameters of the largest sphere; N = {N} is too few"
        )
    position = _push_apart(rng.uniform(0.0, edge, (N, 3)), radius, edge)
    return Assembly(position, radius, np.full(3, edge))


def diameters(
    N: int,
    d50: float,
    sigma_ln: float,
    distribution: str = "lognormal",
    *,
    size_ratio: float = 4.0,
    fines: float = 0.25,
) -> np.ndarray:
    """Diameters (N,) in m, ascending, at the mid-quantiles by number of a grading defined by mass.

    - "lognormal": by mass, cut at three standard deviations (the default).
    - "loguniform": uniform in ln d, with the same standard deviation of ln d.
    - "well_graded": Fuller's curve, mass finer ~ sqrt(d), largest over smallest = size_ratio; sigma_ln is not used.
    - "gap_graded": two lognormals of width sigma_ln each, ratio of their medians size_ratio; the finer one has the mass
      share `fines`.
    The median by mass of the result is exactly d50.  Raises AssemblyError for arguments out of range.
    """
    _check_grading(N, d50, sigma_ln, distribution, size_ratio, fines)
    x, mass = _mass_distribution(sigma_ln, distribution, size_ratio, fines)
    number = mass * np.exp(-3.0 * x)
    below = np.concatenate([[0.0], np.cumsum(0.5 * (number[1:] + number[:-1]))])
    d = np.exp(np.interp((np.arange(N) + 0.5) / N, below / below[-1], x))
    return d * (d50 / mass_median(d))


def mass_median(d: np.ndarray) -> float:
    """Median diameter (m) by mass of spheres of diameter d (N,) m, interpolated in ln d."""
    d = np.sort(d)
    finer = np.cumsum(d**3) - 0.5 * d**3
    return float(np.exp(np.interp(0.5 * np.sum(d**3), finer, np.log(d))))


def write_assembly(path: str | Path, assembly: Assembly, attrs: Mapping[str, Any] | None = None) -> Path:
    """Write an assembly to an HDF5 file, complete or not at all; attrs become attributes of the file."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as part, h5py.File(part, "w") as file:
        file.attrs.update({"format": _FORMAT, "format_version": 1, **(attrs or {})})
        for name in ("position", "radius", "cell"):
            file.create_dataset(name, data=getattr(assembly, name)).attrs["unit"] = QUANTITIES["d50"].unit
    return path


def read_assembly(path: str | Path) -> Assembly:
    """Read what `write_assembly` wrote; raises AssemblyError with the file and the fault."""
    path = Path(path)
    try:
        with open_hdf5(path, AssemblyError, "assembly file") as file:
            if file.attrs.get("format") != _FORMAT:
                raise AssemblyError(f"{path}: not an assembly file (format = {file.attrs.get('format')!r})")
            assembly = Assembly(*(file[name][()] for name in ("position", "radius", "cell")))
    except (OSError, KeyError) as error:
        raise AssemblyError(f"{path}: truncated or not an assembly file ({error})") from error
    n = len(assembly.radius)
    if assembly.position.shape != (n, 3) or assembly.cell.shape != (3,) or n == 0:
        raise AssemblyError(f"{path}: position {assembly.position.shape} does not fit radius {assembly.radius.shape}")
    solid = np.sum(4.0 / 3.0 * np.pi * assembly.radius**3) / np.prod(assembly.cell)
    if not solid <= DENSEST_START:
        raise AssemblyError(f"{path}: solid fraction {solid:.3g} > {DENSEST_START:g}: consolidation cannot loosen it")
    return assembly


def _check_grading(N: int, d50: float, sigma_ln: float, distribution: str, size_ratio: float, fines: float) -> None:
    if distribution not in DISTRIBUTIONS:
        raise AssemblyError(f"assembly: unknown distribution {distribution!r}, choose from {', '.join(DISTRIBUTIONS)}")
    for name, value, good, limit in (
        ("N", N, N >= 8, "at least 8"),
        ("d50", d50, 0.0 < d50 < np.inf, "positive"),
        ("sigma_ln", sigma_ln, 0.0 <= sigma_ln <= 1.0, "within [0, 1]"),
        ("size_ratio", size_ratio, 1.0 < size_ratio <= 20.0, "within (1, 20]"),
        ("fines", fines, 0.0 < fines < 1.0, "within (0, 1)"),
    ):
        if not good:
            raise AssemblyError(f"assembly: {name} = {value} must be {limit}")


def _mass_distribution(
    sigma_ln: float, distribution: str, size_ratio: float, fines: float
) -> tuple[np.ndarray, np.ndarray]:
    """Grid of ln d (up to a shift) and the mass per unit of ln d on it (up to a factor)."""
    sigma = max(sigma_ln, 1e-9)
    if distribution == "lognormal":
        x = np.linspace(-3.0 * sigma, 3.0 * sigma, 4001)
        return x, _normal(x / sigma)
    if distribution == "loguniform":
        x = np.linspace(-np.sqrt(3.0) * sigma, np.sqrt(3.0) * sigma, 4001)
        return x, np.ones_like(x)
    if distribution == "well_graded":
        x = np.linspace(-np.log(size_ratio), 0.0, 4001)
        return x, np.exp(0.5 * x)
    apart = np.log(size_ratio)
    x = np.linspace(-apart - 3.0 * sigma, 3.0 * sigma, 20001)
    modes = [np.where(np.abs(x - m) <= 3.0 * sigma, _normal((x - m) / sigma), 0.0) for m in (-apart, 0.0)]
    return x, fines * modes[0] + (1.0 - fines) * modes[1]


def _normal(z: np.ndarray) -> np.ndarray:
    """PDF of the standard normal distribution."""
    return np.exp(-(z**2) / 2.0) / np.sqrt(2.0 * np.pi)


def _push_apart(position: np.ndarray, radius: np.ndarray, edge: float, gap: float = 0.02) -> np.ndarray:
    """Positions (N, 3) after soft spheres, radii inflated by `gap`, have moved apart until no pair touches."""
    x, inflated = position.copy(), (1.0 + gap) * radius
    skin = 0.3 * np.median(radius)
    velocity = np.zeros_like(x)
    moved = np.inf
    for _ in range(4000):
        if moved > 0.5 * skin:
            i, j = _near_pairs(x % edge, inflated, edge, skin).T
            moved = 0.0
            reach = inflated[i] + inflated[j]
        d = x[j] - x[i]
        d -= edge * np.round(d / edge)
        length = np.sqrt(np.einsum("ij,ij->i", d, d))
        hit = length < reach
        overlap = reach[hit] - length[hit]
        if np.all(overlap < 0.75 * gap / (1.0 + gap) * reach[hit]):
            return x % edge
        push = d[hit] * (overlap / np.maximum(length[hit], 1e-12 * edge))[:, None]
        for k in range(3):
            force = np.bincount(j[hit], push[:, k], len(x)) - np.bincount(i[hit], push[:, k], len(x))
            velocity[:, k] = 0.6 * velocity[:, k] + 0.25 * force
        x += velocity
        moved += np.sqrt(np.max(np.einsum("ij,ij->i", velocity, velocity)))
    raise AssemblyError(f"assembly: {len(radius)} spheres still touch after 4000 steps; lower solid_fraction")


def _near_pairs(x: np.ndarray, radius: np.ndarray, edge: float, skin: float) -> np.ndarray:
    """Pairs (P, 2) closer than the sum of their radii plus skin, by pairs of size classes."""
    # Imported here because every run reads an assembly, and importing scipy takes a third of a second.
    from scipy.spatial import cKDTree

    x = np.where(x >= edge, 0.0, x)
    classes = _size_classes(radius)
    pairs = []
    for a, first in enumerate(classes):
        tree = cKDTree(x[first], boxsize=edge)
        pairs.append(first[tree.query_pairs(2.0 * radius[first].max() + skin, output_type="ndarray")])
        for second in classes[a + 1 :]:
            other = cKDTree(x[second], boxsize=edge)
            near = tree.sparse_distance_matrix(
                other, radius[first].max() + radius[second].max() + skin, output_type="coo_matrix"
            )
            pairs.append(np.column_stack([first[near.row], second[near.col]]))
    return np.concatenate(pairs)


def _size_classes(radius: np.ndarray) -> list[np.ndarray]:
    """Groups of indices; within a group, radii differ by less than a factor of two."""
    octave = np.floor(np.log2(radius / radius.min()) + 1e-9).astype(int)
    return [np.flatnonzero(octave == k) for k in np.unique(octave)]
