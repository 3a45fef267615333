"""The assembly that all runs of a campaign share: sphere sizes of a grading and first positions without contacts.

Sizes are quantiles of the grading, not random draws, so that even 400 spheres have the requested d50 and grading index.
Positions are random; soft spheres in the periodic cell then move apart until no pair touches.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .errors_and_files import GrainScatterError, atomic_write, open_hdf5, write_hdf5
from .quantities import QUANTITIES

DISTRIBUTIONS = ("lognormal", "loguniform", "well_graded", "gap_graded")
#: Solid fraction of the densest start that is read.  Denser spheres overlap, and the packing becomes denser while they
#: separate: overlaps of 10 % give e a tenth too low, which no proof of equilibrium detects.
DENSEST_START = 0.60
#: Spans of the largest grain's bounding box below which YADE's PeriTriaxController does not shorten an edge, and by how
#: much of the smallest radius that box is larger than the grain, on each side (the collider's `verletDist`).
SHORTEST_EDGE, BOX_MARGIN = 2.1, 0.05
#: Volumes of the cell, over that asked for, at which a state without contacts is looked for, one after the other.
LOOSER_STARTS = (1.0, 1.1, 1.25, 1.5, 2.0, 3.0)
#: The soft spheres move as they always did, so that a seed stays an assembly, for so many steps (usual: 40 to 160), and
#: not at all where a sphere overlaps more others than this at first (usual: 20 to 155): its steps would be too large.
USUAL_STEPS, MOST_CONTACTS = 300, 180
#: After that they take up to so many steps of another kind, seconds apart when they are reported.
CAREFUL_STEPS, REPORT_SECONDS = 1000, 2.0
MOST_SPHERES = 1_000_000
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
    progress: Callable[[str], None] | None = None,
) -> Assembly:
    """N spheres of a given grading at random positions in a periodic cube, without contacts.

    d50 (m) is the median by mass, sigma_ln the standard deviation of ln d by mass; `distribution`, `size_ratio` and
    `fines` as in `diameters`.  The same arguments give the same assembly.  Where no state without contacts is found at
    `solid_fraction`, which may happen in broad gradings, the cell is made a tenth larger, and so on (`LOOSER_STARTS`).
    `progress` is called with a line of text every few seconds of work.
    Raises AssemblyError for arguments out of range, for a grading that N spheres cannot represent, at once, and if no
    state without contacts is found.
    """
    shape = {"size_ratio": size_ratio, "fines": fines}
    d = diameters(N, d50, sigma_ln, distribution, **shape)
    grading = f"{distribution}, sigma_ln = {sigma_ln:g}, sizes 1 to {d[-1] / d[0]:.3g}"

    def enough() -> str:
        return _smallest_number(N, sigma_ln, distribution, solid_fraction, shape)

    return place(d, seed, solid_fraction, grading=grading, enough=enough, progress=progress)


def place(
    d: np.ndarray,
    seed: int,
    solid_fraction: float = 0.52,
    *,
    grading: str = "given sizes",
    enough: Callable[[], str] = lambda: "use more spheres or a narrower grading",
    progress: Callable[[str], None] | None = None,
) -> Assembly:
    """Spheres of diameters d (N,) m, ascending, at random positions in a periodic cube, without contacts.

    grading: the sizes in words, for the text of errors; enough: what would do where the cell is too small, in words.
    Otherwise as in `make_assembly`, which describes also the errors.
    """
    if not 0.0 < solid_fraction <= 0.58:
        raise AssemblyError(f"assembly: solid_fraction = {solid_fraction:g} is outside (0, 0.58]")
    rng, N = np.random.default_rng(seed), len(d)
    radius = rng.permutation(0.5 * d)
    edge = (np.sum(4.0 / 3.0 * np.pi * radius**3) / solid_fraction) ** (1.0 / 3.0)
    if 4.0 * radius.max() > edge:
        raise AssemblyError(
            f"assembly: the cell edge {edge:.3g} m is less than two diameters of the largest sphere; "
            f"N = {N} is too few for {grading}; {enough()}"
        )
    position = rng.uniform(0.0, edge, (N, 3))
    for looser in LOOSER_STARTS:
        grown = edge * looser ** (1.0 / 3.0)
        found = _push_apart(position * (grown / edge), radius, grown, first=looser == 1.0, progress=progress)
        if found is not None:
            return Assembly(found, radius, np.full(3, grown))
    raise AssemblyError(
        f"assembly: {N} spheres ({grading}) still touch "
        f"at a solid fraction of {solid_fraction / LOOSER_STARTS[-1]:.3g}; use a narrower grading"
    )


def densest_fraction(d: np.ndarray) -> float:
    """Solid fraction of random close packing of spheres of diameters d (N,), any unit.

    0.634 + 0.0658 delta + 0.0857 S delta^2, with the coefficient of variation delta and the skewness S of the diameters
    by number (Desmond and Weeks, Phys. Rev. E 90, 022204, 2014; too large for delta above 0.5).
    """
    x = d / d.mean() - 1.0
    delta_2 = float(np.mean(x**2))
    skewed = float(np.mean(x**3)) / np.sqrt(delta_2) if delta_2 > 1e-18 else 0.0  # S delta^2
    return 0.634 + 0.0658 * float(np.sqrt(delta_2)) + 0.0857 * skewed


def _smallest_number(N: int, sigma_ln: float, distribution: str, solid_fraction: float, shape: dict[str, float]) -> str:
    """In words, the N whose cell is two diameters of the largest sphere long, to one part in fifty."""

    def suffices(n: int) -> bool:
        d = diameters(n, 1.0, sigma_ln, distribution, **shape)
        return bool(np.sum(np.pi / 6.0 * d**3) / solid_fraction >= (2.0 * d[-1]) ** 3)

    low, high = N, 2 * N
    while not suffices(high):
        low, high = high, 2 * high
        if low > MOST_SPHERES:
            return f"more than {MOST_SPHERES:,} are needed, use a narrower grading"
    while high > 1.02 * low + 1:
        middle = (low + high) // 2
        low, high = (low, middle) if suffices(middle) else (middle, high)
    return f"at least N = {high} is needed"


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
    with atomic_write(path) as part, write_hdf5(part) as file:
        file.attrs.update({"format": _FORMAT, "format_version": 1, **(attrs or {})})
        for name in ("position", "radius", "cell"):
            file.create_dataset(name, data=getattr(assembly, name)).attrs["unit"] = QUANTITIES["d50"].unit
    return path


def read_assembly(path: str | Path) -> Assembly:
    """Read what `write_assembly` wrote; raises AssemblyError with the file and the fault."""
    path = Path(path)
    with open_hdf5(path, AssemblyError, "assembly file", trial=False) as file:
        if file.attrs.get("format") != _FORMAT:
            raise AssemblyError(f"{path}: not an assembly file (format = {file.attrs.get('format')!r})")
        assembly = Assembly(*(np.asarray(file[name][()], float) for name in ("position", "radius", "cell")))
    n = assembly.radius.size
    if assembly.radius.shape != (n,):
        raise AssemblyError(f"{path}: radius has shape {assembly.radius.shape}, not (N,)")
    if assembly.position.shape != (n, 3) or assembly.cell.shape != (3,) or n == 0:
        raise AssemblyError(f"{path}: position {assembly.position.shape} does not fit radius {assembly.radius.shape}")
    for name in ("radius", "cell"):
        if not (values := getattr(assembly, name)).min() > 0.0 or not np.isfinite(values).all():
            raise AssemblyError(f"{path}: {name} holds {values.min():g} to {values.max():g} m, want positive lengths")
    if not np.isfinite(assembly.position).all():
        raise AssemblyError(f"{path}: position holds values that are not finite")
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


def _push_apart(
    position: np.ndarray,
    radius: np.ndarray,
    edge: float,
    gap: float = 0.02,
    *,
    first: bool = True,
    progress: Callable[[str], None] | None = None,
) -> np.ndarray | None:
    """Positions (N, 3) after soft spheres, radii inflated by `gap`, have moved apart until no pair touches, or None.

    They move by a quarter of the sum of their overlaps, with momentum.  Where that takes too long, or a large sphere
    overlaps so many small ones that it would be thrown about, a pair shares its overlap by the number of contacts that
    each sphere has, and a sphere moves by the mean of its shares (`_careful_step`); so it does where not `first`.
    """
    x, inflated = position.copy(), (1.0 + gap) * radius
    skin = 0.3 * np.median(radius)
    velocity = np.zeros_like(x)
    moved, careful, reported = np.inf, not first, time.monotonic()
    steps = (USUAL_STEPS if first else 0) + CAREFUL_STEPS
    for step in range(steps):
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
        if progress is not None and time.monotonic() - reported > REPORT_SECONDS:
            reported = time.monotonic()
            progress(f"{len(x)} spheres, solid fraction {_solid(radius, edge):.3f}: step {step} of {steps}, "
                     f"{len(overlap)} pairs touch")  # fmt: skip
        if not careful and (step == USUAL_STEPS or (step == 0 and _most_contacts(i[hit], j[hit]) > MOST_CONTACTS)):
            careful = True
        if careful:
            velocity = 0.5 * velocity + _careful_step(d[hit] / np.maximum(length[hit], 1e-12 * edge)[:, None],
                                                      overlap, i[hit], j[hit], len(x))  # fmt: skip
        else:
            push = d[hit] * (overlap / np.maximum(length[hit], 1e-12 * edge))[:, None]
            for k in range(3):
                force = np.bincount(j[hit], push[:, k], len(x)) - np.bincount(i[hit], push[:, k], len(x))
                velocity[:, k] = 0.6 * velocity[:, k] + 0.25 * force
        x += velocity
        moved += np.sqrt(np.max(np.einsum("ij,ij->i", velocity, velocity)))
    return None


def _careful_step(direction: np.ndarray, overlap: np.ndarray, i: np.ndarray, j: np.ndarray, N: int) -> np.ndarray:
    """Displacements (N, 3) of a step in which no sphere moves by more than its largest overlap.

    direction (P, 3) from sphere i to sphere j of each pair, overlap (P,).
    """
    contacts = np.maximum(np.bincount(i, minlength=N) + np.bincount(j, minlength=N), 1).astype(float)
    share = contacts[j] / (contacts[i] + contacts[j])  # of sphere i: the one with fewer contacts gives way
    step = np.empty((N, 3))
    for k in range(3):
        along = direction[:, k] * overlap
        step[:, k] = np.bincount(j, (1.0 - share) * along, N) - np.bincount(i, share * along, N)
    return step * (1.5 / np.sqrt(contacts))[:, None]


def _most_contacts(i: np.ndarray, j: np.ndarray) -> int:
    return int(np.bincount(np.concatenate([i, j]), minlength=1).max())


def _solid(radius: np.ndarray, edge: float) -> float:
    """Solid fraction of spheres in a cube."""
    return float(np.sum(4.0 / 3.0 * np.pi * radius**3) / edge**3)


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
