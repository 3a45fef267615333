"""How many spheres a grading needs: the rule for thin cells, what a sieve curve asks for, and the cost of that number.

YADE's PeriTriaxController does not shorten an edge below 2.1 spans of the largest grain, and says nothing: the strain
stands still and the run goes on for ever.  A cell of N spheres with the solid volume V_s and the solid fraction phi has
the edge (V_s / phi)^(1/3) at the start of shear, so that it stops at the logarithmic strain

    ln( (V_s / phi)^(1/3) / (2.1 span + step) ),    span = d_max + 0.05 d_min,

with the strain of one time step in m, as the controller compares it.  In extension the lateral edges shorten, by half
the axial strain.  A scatter of the edges is taken off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from campaign.config import Config, ConfigError
from campaign.plan import STAGES, path_parameters, predicted_seconds, predicted_steps

if TYPE_CHECKING:
    import numpy as np

    from analysis.inputs.sieve_curve import SieveCurve

if TYPE_CHECKING:
    from analysis.points import RepresentativePoints

#: Solid fraction of a packing over that of the densest one of its grading, by friction during consolidation (N = 1,000
#: to 4,000, sigma_ln = 0.174). Grains of low mu_s collapse to a denser packing: friction beyond the last value counts
#: as that value.
LOOSER = ((0.001, 1.0), (0.04, 0.968), (0.1, 0.943))
#: Solid fraction that no grading is taken to exceed, and that which the check before consolidation reckons with.
DENSEST, DENSEST_BEFORE = 0.76, 0.68
#: The densest packing of a grading for which the formula gives too much, as measured: N = 1,000, sigma_ln = 0.174.
MEASURED = {"gap_graded": 0.757}
#: Edges of consolidated cells scatter by about this over sqrt(N), relative (2.6 % for N = 100).
EDGE_SCATTER = 0.25
#: The strain of one step is larger than predicted for soft grains and at high mean stress.
STEP_MARGIN = 1.5
MOST_GRAINS = 1_000_000


@dataclass(frozen=True)
class Reach:
    """Strain at which the cell is expected to stop, and up to which it surely goes; negative: it stops before shear."""

    stops: float
    safe: float


def check_cell(config: Config, points: RepresentativePoints | None = None) -> None:
    """Refuse a campaign whose cell stops before `shear.strain_end`, or whose spheres lack its sieve curve.

    With points whose sigma_ln is random, the widest grading counts.  Raises ConfigError with one line that names N,
    grading, the fault, and the N or the strain_end that would do.
    """
    if points is not None and "sigma_ln" in points.names:
        config = replace(config, assembly=replace(config.assembly, sigma_ln=float(points["sigma_ln"].max())))
    grains, wanted, file = config.assembly, config.shear.strain_end, config.source.name
    sizes = _sizes(config, grains.N)
    grading = config.curve.text if config.curve else (
        f"{grains.distribution}, sigma_ln = {grains.sigma_ln:g}, sizes 1 to {sizes.largest / sizes.smallest:.3g}"
    )  # fmt: skip
    reach = reach_of(config, grains.N)
    if reach.safe >= wanted and not sizes.shortfall:
        return
    enough = smallest_number(config)
    advice = [f"N >= {enough} (about {predicted_hours(config, enough):.2g} core-hours)"] if enough else []
    if sizes.shortfall:
        raise ConfigError(
            f"{file}: assembly.N = {grains.N} spheres of {grains.sieve} ({grading}) {sizes.shortfall}; "
            f"use {' or '.join(advice) or 'a curve of a smaller size ratio'}"
        )
    if (strain := math.floor(reach.safe * 100.0) / 100.0) > 0.0:
        advice.append(f"shear.strain_end <= {strain:g}")
    where = f"at a strain of about {reach.stops:.3g}" if reach.stops > 0.0 else "before shear begins"
    stops = "YADE stops it" if config.dem.code == "yade" else "the limit of YADE, which this tool keeps, is"
    why = f" (less {reach.stops - reach.safe:.2g} for the scatter of cells)" if wanted < reach.stops else ""
    raise ConfigError(
        f"{file}: assembly.N = {grains.N} ({grading}) gives too thin a cell: {stops} {where}{why}, "
        f"shear.strain_end = {wanted:g}; use {' or '.join(advice) or 'a narrower grading or larger grains'}"
    )


def reach_of(config: Config, N: int) -> Reach:
    """How far a cell of N of the campaign's grains can be sheared."""
    grains, end = config.assembly, config.shear.strain_end
    volume, largest, smallest, densest, _ = _sizes(config, N)
    d50 = grains.d50_mm * 1e-3
    step = STEP_MARGIN * end / predicted_steps("shear", _values(config)) / d50
    box = _shortest(largest, smallest)
    edge = (volume / (densest * _looser(min(config.consolidation.mu_iso)))) ** (1.0 / 3.0)
    shortening = 0.5 if config.shear.direction == "extension" else 1.0  # of the edge that becomes the shortest
    stops = math.log(edge / (box + step)) / shortening
    # yade_scripts/consolidate.py refuses a cell whose edge will be less than 2.1 diameters at a solid fraction of 0.68
    before = math.log((volume / DENSEST_BEFORE) ** (1.0 / 3.0) / (2.1 * largest))
    safe = stops - EDGE_SCATTER / math.sqrt(N)
    return Reach(stops, safe if before > 0.0 else min(safe, before))


def smallest_number(config: Config) -> int:
    """A number of grains whose cell reaches `shear.strain_end` and which have the sieve curve: the least, rounded up.

    0 if a million are not enough.
    """
    wanted, low, N = config.shear.strain_end, 32, 64

    def suffices(number: int) -> bool:
        return reach_of(config, number).safe >= wanted and not _sizes(config, number).shortfall

    while not suffices(N):  # edges grow as N^(1/3), the largest grain a little
        if N == MOST_GRAINS:
            return 0
        lacking = max(0.0, wanted - reach_of(config, N).safe)
        low, N = N, min(MOST_GRAINS, math.ceil(N * math.exp(max(0.05, 3.5 * lacking))))
    while (1.03 if N < 10_000 else 1.15) * low + 1 < N:
        middle = round(math.sqrt(low * N))
        low, N = (low, middle) if suffices(middle) else (middle, N)
    unit = 10 ** max(0, len(str(N)) - 2)
    return -(-N // unit) * unit


def predicted_hours(config: Config, N: int) -> float:
    """Return the predicted core-hours of a campaign of N spheres, from its settings alone: no points are needed.

    Each point counts with the modulus of the consolidation and mu_s <= 0.3; larger mu_s are sheared more slowly.
    """
    n = config.points.n
    packings = n if config.consolidation.per_point else min(n, len(config.assembly.packings))
    chains = n
    if config.families.G_p_only:
        chains += n if config.families.G_p_points < 0 else min(n, config.families.G_p_points)
    values = _values(config)
    seconds = sum(
        runs * predicted_seconds(stage, N * predicted_steps(stage, values | softer), config.dem.code)
        for stage, runs, softer in zip(
            STAGES, (packings, chains, chains), ({"stiffness_scale": 1.0}, {"stiffness_scale": 1.0}, {}), strict=True
        )
    )
    return len(config.consolidation.mu_iso) * seconds / 3600.0


def _values(config: Config) -> dict[str, float]:
    """The parameters of a shear run at the reference modulus, for the number of its steps."""
    return {"G_p": config.consolidation.G_ref_GPa * 1e9, "stiffness_scale": config.dem.stiffness_scale,
            "sigma_3": config.consolidation.sigma_3_kPa * 1e3, "timestep_factor": config.dem.timestep_factor,
            "density_scaling": int(config.dem.density_scaling), "strain_end": config.shear.strain_end,
            "inertial_number": config.shear.inertial_number, "mu_s": 0.0, "code": config.dem.code,
            **path_parameters(config)}  # fmt: skip


def _looser(mu_iso: float) -> float:
    """Solid fraction over that of the densest packing, interpolated in LOOSER."""
    if mu_iso <= LOOSER[0][0]:
        return LOOSER[0][1]
    for (mu, share), (next_mu, next_share) in zip(LOOSER, LOOSER[1:], strict=False):
        if mu_iso <= next_mu:
            return share + (next_share - share) * (mu_iso - mu) / (next_mu - mu)
    return LOOSER[-1][1]


def _shortest(largest: float, smallest: float) -> float:
    from analysis.assembly import BOX_MARGIN, SHORTEST_EDGE

    return SHORTEST_EDGE * (largest + BOX_MARGIN * smallest)


class Sizes(NamedTuple):
    """Solid volume, largest and smallest diameter in units of d50, densest solid fraction; what the curve lacks."""

    volume: float
    largest: float
    smallest: float
    densest: float
    shortfall: str


def _sizes(config: Config, N: int) -> Sizes:
    grains = config.assembly
    return _curve_sizes(N, config.curve) if config.curve else _grading(N, grains.sigma_ln, grains.distribution)


@cache
def _grading(N: int, sigma_ln: float, distribution: str) -> Sizes:
    from analysis.assembly import diameters

    return _described(diameters(N, 1.0, sigma_ln, distribution), MEASURED.get(distribution, DENSEST), "")


@cache
def _curve_sizes(N: int, curve: SieveCurve) -> Sizes:
    from analysis.inputs.sieve_curve import shortfall

    d = curve.diameters(N)
    return _described(d / curve.sizes["D50"], DENSEST, shortfall(curve, d))


def _described(d: np.ndarray, densest: float, shortfall: str) -> Sizes:
    from analysis.assembly import densest_fraction

    volume = float(math.pi / 6.0 * (d**3).sum())
    return Sizes(volume, float(d[-1]), float(d[0]), min(densest, densest_fraction(d)), shortfall)
