"""Several campaigns side by side: settings that differ, responses along strain, moments of the states and differences.

Densities are compared where mu_iso agrees; what only some campaigns have is listed with the reason, never left out in
silence. The first campaign is the reference of all differences.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from ..inputs.measurements import measurements_behind
from ..quantities import QUANTITIES
from ..results.models import POWER, STRESSES, input_refits, joint_samples, runs_with_moments
from ..results.reader import Results
from ..surrogates import distribution
from ..surrogates.distribution import Estimate, Sampled
from .columns import named, unit, with_interval
from .critical_line import critical_lines, critical_offsets, critical_points
from .moments import AS_SIMULATED, DENOISED, NUMBERS
from .pooled_states import PooledState, pooled, pooled_states
from .strength import EXTENSION, directions

#: Sections of the settings that do not change results.
LEFT_OUT = ("run",)
#: The family of runs that is compared.
FAMILY = "coupled"
#: Quantities that have the other sign in extension: their difference from compression means nothing.
SIGNED = ("eta", "q")
OTHER_SIGN = "It has the other sign: compression and extension are beside each other in the tables of directions."
DIFFERENCES = ["campaign", "mu_iso", "state", "quantity", "unit", "kind", "number", "reference", "value",
               *with_interval("difference"), "excludes_zero", "packings_reference", "packings"]  # fmt: skip


@dataclass(frozen=True)
class Comparison:
    """Campaigns to compare: a name of its own for each, and their results; the first is the reference."""

    names: tuple[str, ...]
    results: tuple[Results, ...]

    @property
    def pairs(self) -> Iterator[tuple[str, Results]]:
        """Name and results of each campaign."""
        return zip(self.names, self.results, strict=True)

    @property
    def strain_label(self) -> str:
        """Axis label of the axial strain: extension only if all campaigns are in extension."""
        labels = {results.loading.strain_label for results in self.results}
        return labels.pop() if len(labels) == 1 else QUANTITIES["eps_a"].label

    @cached_property
    def densities(self) -> tuple[float, ...]:
        """All values of mu_iso, ascending."""
        found: list[float] = []
        for results in self.results:
            found += [m for m in results.family_densities(FAMILY) if not any(_same(m, k) for k in found)]
        return tuple(sorted(found))

    def with_density(self, mu_iso: float) -> list[tuple[str, Results, float]]:
        """Name and results of the campaigns with a density, and its mu_iso there."""
        return [(name, results, m) for name, results in self.pairs
                for m in results.family_densities(FAMILY) if _same(m, mu_iso)]  # fmt: skip

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        """Responses along strain that a density of at least two campaigns has, in the order of the registry."""
        count: dict[tuple[float, str], int] = {}
        for mu_iso in self.densities:
            for _, results, m in self.with_density(mu_iso):
                for symbol in results.symbols(m, FAMILY):
                    count[mu_iso, symbol] = count.get((mu_iso, symbol), 0) + 1
        shared = {symbol for (_, symbol), number in count.items() if number > 1}
        return tuple(symbol for symbol in QUANTITIES if symbol in shared)


def comparison(results: Sequence[Results]) -> Comparison:
    """The campaigns under their names; campaigns of the same name get a number."""
    names: list[str] = []
    for result in results:
        name = str(result.attrs.get("campaign") or result.path.parent.name)
        k = 1
        while (numbered := name if k == 1 else f"{name} ({k})") in names:
            k += 1
        names.append(numbered)
    return Comparison(tuple(names), tuple(results))


def comparison_tables(of: Comparison) -> dict[str, pd.DataFrame]:
    """Table name -> frame: settings, moments, differences, responses, not_compared.

    With campaigns of more than drained compression at one p', also critical_lines and critical_offsets, where p' varies
    enough, and directions, where both are there (without rows otherwise); critical_points is for the figure.
    """
    moments, differences, left_out = _states(of)
    points, of_directions = critical_points(list(of.pairs)), directions(list(of.pairs))
    lines = critical_lines(points)
    return {
        "settings": settings(of),
        "differences": differences,
        "moments": moments,
        "responses": responses(of),
        "not_compared": pd.DataFrame([*_missing(of), *left_out], columns=["what", "campaign", "reason"]),
        "critical_points": points if len(lines) or len(of_directions) else points.iloc[:0],
        "critical_lines": lines,
        "critical_offsets": critical_offsets(points),
        "directions": of_directions,
    }


def settings(of: Comparison) -> pd.DataFrame:
    """One row per setting that differs: its key, and its value in each campaign; sizes and versions are rows, too."""
    tables = [_settings(results) for results in of.results]
    keys = dict.fromkeys(key for table in tables for key in table)
    rows = []
    for key in keys:
        values = [table.get(key, "not stated") for table in tables]
        if len(set(values)) > 1:
            rows.append({"setting": key, **dict(zip(of.names, values, strict=True))})
    return pd.DataFrame(rows, columns=["setting", *of.names])


def responses(of: Comparison) -> pd.DataFrame:
    """Mean, standard deviation and 5 and 95 % quantiles of the shared responses, on each campaign's own strains."""
    parts = []
    for mu_iso in of.densities:
        for name, results, m in of.with_density(mu_iso):
            for symbol in (s for s in of.symbols if s in results.symbols(m, FAMILY)):
                response = results.response(symbol, m, FAMILY)
                factor = response.quantity.shown_factor
                columns: dict[str, Any] = {"campaign": name, "mu_iso": mu_iso, **named(symbol)}
                columns |= {"eps_a_pct": 100 * response.strain, "mean": factor * response.mean}
                columns |= {"sd": factor * response.std}
                columns |= {q: factor * response.quantile(p) for q, p in (("q05", 0.05), ("q95", 0.95))}
                parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def predicted_extension(table: pd.DataFrame) -> dict[str, float]:
    """Surface -> mean critical stress ratio in extension that it gives for compression, from the table `directions`."""
    critical = table[table["state"] == "critical"]
    return {name: float(critical[name].mean()) for name in EXTENSION if critical[name].notna().any()}


def shared_packings(of: Comparison) -> list[str]:
    """Names of the campaigns that have packings of the reference: the same spheres at the same places."""
    reference = _packings(of.results[0])
    return [name for name, results in list(of.pairs)[1:] if reference & _packings(results)]


def _packings(results: Results) -> set[tuple[Any, ...]]:
    grains = {k: v for k, v in results.attrs["settings"].get("assembly", {}).items() if k != "packings"}
    seeds = {int(seed) for m in results.family_densities(FAMILY) for seed in results.packing(m, FAMILY)}
    return {(json.dumps(grains, sort_keys=True), seed) for seed in seeds} if grains else set()


def _settings(results: Results) -> dict[str, str]:
    """Every setting as text, then what the results state of their own: pairs, points, spheres, versions."""
    table: dict[str, str] = {}
    for section, keys in results.attrs["settings"].items():
        if section not in LEFT_OUT and isinstance(keys, dict):
            table |= {f"{section}.{key}": json.dumps(value) for key, value in keys.items()}
    table |= {"test": results.loading.words}
    table |= {"measured pairs": str(len(results.pairs)), "points": str(len(results.points))}
    runs = results.runs
    if "N" in runs:
        table["spheres"] = ", ".join(f"{n:g}" for n in sorted(set(runs["N"].dropna())) if n > 0)
    table["largest strain"] = f"{results.strain[-1]:.4g}"
    table |= {f"version of {name}": str(value) for name, value in results.attrs["versions"].items()}
    if "yade_version" in runs:
        table["version of the DEM code"] = ", ".join(sorted({str(v) for v in runs["yade_version"] if v}))
    return table


def _same(one: float, other: float) -> bool:
    return abs(one - other) <= 1e-9 * max(abs(one), abs(other))


def _missing(of: Comparison) -> Iterator[tuple[str, str, str]]:
    """Densities and responses that some campaigns lack: what, campaign, reason in one sentence."""
    for mu_iso in of.densities:
        there = of.with_density(mu_iso)
        have = {name for name, _, _ in there}
        for name in of.names:
            if name not in have:
                yield f"mu_iso = {mu_iso:g}", name, "This campaign has no such density."
        symbols = dict.fromkeys(s for _, results, m in there for s in results.symbols(m, FAMILY))
        for symbol in symbols:
            for name, results, m in there:
                if symbol not in results.symbols(m, FAMILY):
                    yield f"{symbol} along strain, mu_iso = {mu_iso:g}", name, "The results do not contain it."


def _states(of: Comparison) -> tuple[pd.DataFrame, pd.DataFrame, list[tuple[str, str, str]]]:
    """Moments of each campaign, differences from the reference, and states without a comparison."""
    found = _models(of)
    rows: list[tuple] = []
    differences: list[tuple] = []
    left_out: list[tuple[str, str, str]] = []
    statistics = {key: _sampled(of, key[0], state) for key, state in found.items()}
    same_pairs = [np.array_equal(of.results[0].pairs, results.pairs) for results in of.results]
    for mu_iso in of.densities:
        for state, symbol in dict.fromkeys(pair for results in of.results for pair in pooled(results)):
            there = [k for k in range(len(of.names)) if (k, mu_iso, state, symbol) in found]
            for k in sorted({*range(len(of.names))} - {*there}):
                if there and any(name == of.names[k] for name, _, _ in of.with_density(mu_iso)):
                    reason = _why_no_model(of.results[k], mu_iso, state, symbol)
                    left_out.append((f"{symbol}, {state}, mu_iso = {mu_iso:g}", of.names[k], reason))
            factor = QUANTITIES[symbol].shown_factor
            for k in there:
                key = (k, mu_iso, state, symbol)
                head = (of.names[k], mu_iso, state, symbol, unit(symbol))
                rows += [(*head, kind, *(factor * values)) for kind, values in _values(statistics[key])]
                first = (0, mu_iso, state, symbol)
                signs = {of.results[i].loading.sign for i in (0, k)}
                if k and first in found and len(signs) > 1 and symbol in SIGNED:
                    left_out.append((f"{symbol}, {state}, mu_iso = {mu_iso:g}", of.names[k], OTHER_SIGN))
                elif k and first in found:
                    pair = distribution.difference(statistics[first], statistics[key], same_pairs[k])
                    packings = (found[first].model.packings, found[key].model.packings)
                    differences += _difference_rows(head, statistics[first], statistics[key], pair, factor, packings)
    columns = ["campaign", "mu_iso", "state", "quantity", "unit", "kind", *NUMBERS]
    return pd.DataFrame(rows, columns=columns), pd.DataFrame(differences, columns=DIFFERENCES), left_out


def _models(of: Comparison) -> dict[tuple[int, float, str, str], PooledState]:
    """Place of the campaign, density, state, quantity -> its model."""
    found = {}
    for k, results in enumerate(of.results):
        for each in pooled_states(results, POWER, runs_with_moments(results)):
            mu_iso = next(m for m in of.densities if _same(m, each.mu_iso))
            found[k, mu_iso, each.state, each.symbol] = each
    return found


def _sampled(of: Comparison, k: int, pooled: PooledState) -> Sampled:
    """Statistics with draws of their own; campaigns with the same pairs share the refits of the inputs."""
    results = of.results[k]
    refits = input_refits(results)
    pairs = None if refits is None else measurements_behind(results.inputs, results.pairs)
    rng = np.random.default_rng([k, *f"{pooled.state}/{pooled.symbol}".encode()])
    return distribution.sampled(pooled.model, joint_samples(results, POWER), refits=refits, pairs=pairs, rng=rng)


def _values(found: Sampled) -> Iterator[tuple[str, np.ndarray]]:
    for kind, statistics in zip((DENOISED, AS_SIMULATED), found.centre, strict=True):
        yield kind, np.array([statistics[0, 0], np.exp(statistics[0, 1]), *statistics[0, 2:]])


def _difference_rows(
    head: tuple,
    first: Sampled,
    second: Sampled,
    pair: tuple[Estimate, Estimate],
    factor: float,
    packings: tuple[int, int],
) -> Iterator[tuple]:
    """One row per kind and number: both values, the difference with its interval, whether that excludes zero."""
    for (kind, before), (_, after), estimate in zip(_values(first), _values(second), pair, strict=True):
        for at, number in enumerate(NUMBERS):
            value, low, high = (factor * float(part[0, at]) for part in (estimate.value, estimate.low, estimate.high))
            numbers = (factor * before[at], factor * after[at], value, low, high)
            yield (*head, kind, number, *numbers, bool(low > 0 or high < 0), *packings)


def _why_no_model(results: Results, mu_iso: float, state: str, symbol: str) -> str:
    """Why a state of a campaign has no moments, in one sentence."""
    if not results.inputs["joint"]:
        return "The results state no distribution of the inputs."
    if symbol not in results.state_symbols(state, mu_iso):
        return "The results do not contain it."
    standing = results.standing(state, mu_iso)
    if not standing.shown:
        return f"The state is withheld: {standing.status}."
    if (share := results.holds_for(state, symbol, mu_iso)) < 1.0:
        return f"The state is that of {100 * share:.0f} % of the probability only; the other tests did not reach it."
    count, needed = int(np.isfinite(results.measured(state, symbol, mu_iso)).sum()), runs_with_moments(results)
    if count < needed:
        return f"It has values of {count} runs; at least {needed} runs are needed."
    spread = results.loading.is_undrained and symbol in STRESSES
    return "It varies by more than a factor of 5; no model follows it." if spread else "It does not vary."
