"""Distances between densities as the claims estimate them, on synthetic campaigns whose true distance is known.

    /usr/bin/python3 tests/benchmarks/bench_distances.py            (about 15 minutes)
    /usr/bin/python3 tests/benchmarks/bench_distances.py --table

Resumes case by case; 100 to 400 campaigns per row.  A campaign has three densities.  Each has the same surface (see
bench_rotation.py), moved so that the neighbours are half the true distance apart, in standard deviations of the
surface at the points, and its own noise of packings and runs.  Designs: the laptop campaign (100 points, 20 packings)
and the default (8 points, 4 packings; the noise is that of 400 spheres).  Where `response` has "spread" in its name,
the densities have the same mean and differ in their spread.

distances.csv: `number` is the largest distance of two of the three densities, or that of the first and the last.
`found`: mean distance of the denoised values; `estimate`: mean of the value that the claims table states, with its 95 %
half width; `low` and `high`: mean ends of the interval; `covers`: share of campaigns whose interval contains the truth;
`above` and `below`: share whose interval lies above or below it.  `coincide` and `differ` are the claims that a
distance is at most 0.25 and at least 0.5; the columns have the share of campaigns with each verdict, and the rest is
inconclusive.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support"), str(Path(__file__).parent)]

import bench_rotation as synthetic  # noqa: E402
import bench_rows  # noqa: E402

from analysis.pdem import weighted  # noqa: E402
from analysis.surrogates import surrogate  # noqa: E402
from analysis.tables import claim_intervals, claim_samples, claim_statistics  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "distances.csv"
DENSITIES = 3
DISTANCES, OF_SPREADS = (0.0, 0.1, 0.2, 0.32, 0.5), (0.2, 0.5)
#: Design -> points, packings and the factor on the noise.
DESIGNS = {"laptop": (100, 20, 1.0), "default": (8, 4, np.sqrt(1000 / 400))}
#: Response -> surface, own noise and noise of packings over the spread.
RESPONSES = {"critical eta": ("smooth", 0.3, 0.1), "Phi_dev": ("plateau", 0.45, 0.2), "e": ("kinked", 0.25, 0.05),
             "critical eta, spread": ("smooth", 0.3, 0.1)}  # fmt: skip
NUMBERS = {
    "largest": partial(claim_statistics.largest_distance, states=("critical",), symbol="eta"),
    "ends": partial(claim_statistics.end_distance, state="critical", symbol="eta"),
}
#: Design, response, numbers, and number of campaigns of each case.
CASES = [("laptop", "critical eta", ("largest", "ends"), 400), ("default", "critical eta", ("largest", "ends"), 400),
         ("laptop", "Phi_dev", ("largest",), 400), ("laptop", "e", ("largest",), 400),
         ("laptop", "critical eta, spread", ("largest",), 100)]  # fmt: skip
KEYS = ("design", "response", "number", "distance")
CRITERIA = {"coincide": ("<=", 0.25), "differ": (">=", 0.5)}
VERDICTS = [
    (name, outcome) for name in CRITERIA for outcome in (claim_intervals.SUPPORTED, claim_intervals.CONTRADICTED)
]
COLUMNS = (*KEYS, "campaigns", "own", "packing", "found", "estimate", "estimate_ci95", "low", "high", "covers", "above",
           "below", *map("_".join, VERDICTS))  # fmt: skip


class Points(NamedTuple):
    """Inputs (n, 2) of the points."""

    x: np.ndarray


@dataclass
class Campaign:
    """What a `Sample` reads of results: points, and the model of one state per density, moved by `shift` (D,).

    A constant that is added to all runs of a density is added to its model and nothing else changes, so that one fit
    serves all distances.
    """

    x: np.ndarray
    of_points: np.ndarray
    models: list[surrogate.Surrogate]
    kept: dict[Any, Any] = field(default_factory=dict)

    def probability(self, mu_iso: float, family: str) -> np.ndarray:
        return self.of_points

    def family_points(self, family: str) -> Points:
        return Points(self.x)

    def cached(self, key: tuple, make: Callable[[], Any]) -> Any:
        if key[0] == "state model":
            return self.models[int(key[3])]
        if key not in self.kept:
            self.kept[key] = make()
        return self.kept[key]

    def moved(self, shift: np.ndarray) -> Campaign:
        """The same campaign with the densities moved apart."""
        sample = sample_of(self)
        sample.values("critical", "eta")  # fits and draws once
        place = ("claims", "coupled", ("state", "critical", "eta"))
        fitted, drawn, unknown = self.kept[place]
        moved = fitted + shift[:, None], drawn + shift[:, None, None], unknown
        return replace(self, kept={place: moved})


def sample_of(campaign: Campaign) -> claim_samples.Sample:
    """The three densities of a campaign as the claims see them; their names are 0, 1 and 2."""
    return claim_samples.Sample(campaign, "coupled", tuple(float(k) for k in range(DENSITIES)))


def surfaces(response: str, x: np.ndarray, probability: np.ndarray, distance: float) -> np.ndarray:
    """True values (D, n) of the densities at the points."""
    true = synthetic.SURFACES[RESPONSES[response][0]](x)
    centre, spread = weighted.moments(true, probability)
    apart = distance * np.linspace(-0.5, 0.5, DENSITIES)[:, None]
    if "spread" in response:
        absolute = float(weighted.mean(np.abs(true - centre), probability))
        return centre + (true - centre) * (1.0 + apart * spread / absolute)
    return true + apart * spread


def found_at(
    design: str, response: str, distances: tuple[float, ...], numbers: tuple[str, ...], count: int
) -> np.ndarray:
    """Distance found, estimate and interval (count, distances, numbers, 4) of all campaigns of a case."""
    n, packings, factor = DESIGNS[design]
    surface, own, shared = RESPONSES[response]
    (x, probability), dealt = synthetic.points(n), synthetic.packings(n, packings)
    runs = [synthetic.campaigns(surface, "normal", factor * own, factor * shared, n, packings, seed=20 + k)
            for k in range(DENSITIES)]  # fmt: skip
    base = synthetic.SURFACES[surface](x)
    found = np.full((count, len(distances), len(numbers), 4), np.nan)
    for k in range(count):
        campaign = None
        for j, distance in enumerate(distances):
            true = surfaces(response, x, probability, distance)
            if campaign is None or "spread" in response:
                start = true if "spread" in response else np.tile(base, (DENSITIES, 1))
                values = [of_density[k] - base + at for of_density, at in zip(runs, start, strict=True)]
                campaign = Campaign(x, probability, [surrogate.fit(x, value, dealt) for value in values])
            sample = sample_of(campaign.moved((true - start) @ probability))
            for i, name in enumerate(numbers):
                number = partial(measured, name, sample)
                found[k, j, i] = number(), *claim_intervals.inverted(number)
    return found


def measured(name: str, sample: claim_samples.Sample, **settings: Any) -> Any:
    """A number of the claims, of the values found or of a supposed truth and its draws."""
    return NUMBERS[name]({"coupled": replace(sample, **settings)})


def row_of(case: tuple[str, str, str, float], found: np.ndarray) -> dict[str, Any]:
    """One row from distance, estimate and interval (n, 4)."""
    design, response, _, distance = case
    factor = DESIGNS[design][2]
    _, _, low, high = found.T
    row: dict[str, Any] = dict(zip(KEYS, case, strict=True)) | {"campaigns": len(found)}
    row |= {"own": float(factor * RESPONSES[response][1]), "packing": float(factor * RESPONSES[response][2])}
    row |= dict(zip(("found", "estimate", "low", "high"), map(float, found.mean(axis=0)), strict=True))
    row["estimate_ci95"] = float(1.96 * found[:, 1].std(ddof=1) / np.sqrt(len(found)))
    row |= {"above": float(np.mean(low > distance + 1e-9)), "below": float(np.mean(high < distance))}
    row["covers"] = 1.0 - row["above"] - row["below"]
    for name, outcome in VERDICTS:
        verdicts = [claim_intervals.verdict(a, b, *CRITERIA[name]) for a, b in zip(low, high, strict=True)]
        row[f"{name}_{outcome}"] = verdicts.count(outcome) / len(found)
    return row


def main() -> None:
    if "--table" not in sys.argv:
        done = bench_rows.finished(TABLE, KEYS)
        for design, response, numbers, count in CASES:
            distances = OF_SPREADS if "spread" in response else DISTANCES
            rows = [(design, response, name, distance) for distance in distances for name in numbers]
            if all(tuple(map(bench_rows.written, case)) in done for case in rows):
                continue
            found = found_at(design, response, distances, numbers, count)
            for j, distance in enumerate(distances):
                for i, name in enumerate(numbers):
                    case = design, response, name, distance
                    bench_rows.append(TABLE, COLUMNS, row_of(case, found[:, j, i]))
    print(pd.read_csv(TABLE).to_string(index=False, float_format="%.3f"))


if __name__ == "__main__":
    main()
