"""Builds results.h5: collects the products of a campaign's plan and adds the PDFs of every response."""

from __future__ import annotations

import dataclasses
import datetime
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd

from ..errors_and_files import atomic_write, write_hdf5
from ..inputs.joint import Joint
from ..inputs.measurements import refitted_joints
from ..inputs.variables import NEEDED
from ..pdem.conditional import evolve_known
from ..points.representative_points import RepresentativePoints
from ..points.selection import probabilities_under
from ..quantities import DRAINED, QUANTITIES, Loading
from ..runs.archive import NAME, Archive
from .collect import Collected, FamilyDensity, ResponsesError, collect
from .ends import write_ends
from .reader import JUDGED_STATES
from .standing import DensityCurve, curves_standing
from .tables_of_file import FORMAT, FORMAT_VERSION, VERSION_OF_INPUTS, VERSION_OF_PAIRS

SQUEEZE = {"compression": "gzip", "shuffle": True, "fletcher32": True}
#: Packages whose versions results.h5 states.
PACKAGES = ("numpy", "scipy", "pandas", "h5py", "matplotlib")


@dataclass(frozen=True)
class CampaignInfo:
    """What results.h5 states of a campaign beside its runs; every field may be left out.

    name; config: the TOML file's text; settings: every key with its default; pairs (n, d) of the random variables in SI
    units, such as mu_s and G_p (Pa), and their source; marginals {symbol: fits}, best first, and copulas, best first,
    as objects or as their dicts; joint: the joint distribution or its dict; specified: the dictionary of
    `inputs.SpecifiedInputs` if distributions were given in place of pairs, and pairs_behind, the number of measurements
    behind them (0: not known); point_attrs: how the points were made (method, seed, discrepancy); versions: name ->
    text, beside those of the packages; warnings: sentences about the inputs and their fits.
    """

    name: str = ""
    config: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    pairs: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    source: str = ""
    marginals: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    copulas: Sequence[Any] = ()
    joint: Joint | Mapping[str, Any] | None = None
    specified: Mapping[str, Any] = field(default_factory=dict)
    pairs_behind: int = 0
    point_attrs: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    warnings: Sequence[str] = ()


def build_results(
    folder: str | Path,
    plan: pd.DataFrame,
    points: RepresentativePoints,
    info: CampaignInfo | None = None,
    *,
    max_lost_probability: float = 0.05,
    pdf_method: str = "exact",
    cells: int = 400,
    input_bootstrap: int = 0,
) -> Path:
    """Read every product of the plan, or its summary in <folder>/runs.h5, and write <folder>/results.h5.

    Returns the path of results.h5.

    plan: frame run_id, stage, family, point, packing, mu_iso, mu_s, G_p (Pa), further random variables of the points,
    product (path), start; optionally status, "spared" for runs that need no product: points without any are filled by
    regression and marked.
    max_lost_probability: probability that failed runs may take from a density.  pdf_method: "exact" or "tvd", on so
    many cells.  input_bootstrap: refits of the inputs (`inputs.measurements`) under which the points get other
    probabilities, for bands (needs the joint distribution, and pairs or `pairs_behind`).

    Raises ResponsesError or RunFileError, and writes nothing, if a product is missing, truncated or was run with other
    parameters than the plan's, or if failed runs take more than max_lost_probability from a density.
    """
    info = info or CampaignInfo()
    folder = Path(folder)
    collected = collect(plan, points, Archive(folder / NAME))
    for density in collected.densities:
        if density.lost_probability > max_lost_probability:
            raise ResponsesError(
                f"{density.family.name}, mu_iso = {density.mu_iso:g}: failed runs lose {density.lost_probability:.3f} "
                f"of the probability, limit {max_lost_probability:g}"
            )
    target = folder / "results.h5"
    with atomic_write(target) as part, write_hdf5(part) as file:
        file.attrs["max_lost_probability"] = max_lost_probability
        _write_head(file, points, info, collected)
        if input_bootstrap and (refitted := refitted_joints(_inputs(info), info.pairs, input_bootstrap)):
            file["inputs/bootstrap_probability"] = probabilities_under(refitted, points.x)
        for density in collected.densities:
            _write_density(file, density, collected, pdf_method, cells)
        _write_table(file.create_group("runs"), collected.runs)
    return target


def _inputs(info: CampaignInfo) -> dict[str, Any]:
    """What the refits of the inputs need, as results.h5 and inputs.json hold it."""
    joint = info.joint.to_dict() if isinstance(info.joint, Joint) else info.joint
    fits = {"marginals": info.marginals, "copulas": info.copulas}
    return {"joint": joint, "specified": info.specified, "pairs_behind": info.pairs_behind, **fits}


def _write_head(file: h5py.File, points: RepresentativePoints, info: CampaignInfo, collected: Collected) -> None:
    versions = {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}
    file.attrs.update(
        format=FORMAT,
        format_version=_version_of_layout(points, collected.loading),
        campaign=info.name,
        config=info.config,
        settings=json.dumps(dict(info.settings)),
        versions=json.dumps(versions | dict(info.versions)),
        created=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    )
    if collected.loading != DRAINED:
        file.attrs.update(collected.loading._asdict())
    inputs = file.create_group("inputs")
    inputs["pairs"] = np.asarray(info.pairs, float)
    inputs.attrs["source"] = str(info.source)
    fits: dict[str, Any] = {"marginals": dict(info.marginals), "copulas": list(info.copulas), "joint": info.joint or {}}
    if info.warnings:
        fits["warnings"] = list(info.warnings)
    if info.specified:
        fits |= {"specified": dict(info.specified), "pairs_behind": info.pairs_behind}
    if points.names != NEEDED or points.constants:
        fits |= {"names": list(points.names), "constants": dict(points.constants)}
    for name, value in fits.items():
        inputs.attrs[name] = json.dumps(value, default=_jsonable)
    _write_table(file.create_group("points"), points.to_frame())
    file["points"].attrs.update(info.point_attrs)
    file["strain"] = collected.strain
    file["strain"].attrs.update(unit=QUANTITIES["eps_a"].unit, name=QUANTITIES["eps_a"].name)
    file["densities"] = sorted({density.mu_iso for density in collected.densities})
    grading = file.create_group("grading")
    grading.create_dataset("diameter", data=collected.diameters, **SQUEEZE)
    grading.attrs.update(collected.grading)


def _version_of_layout(points: RepresentativePoints, loading: Loading) -> int:
    """The earliest version of the format that has all that is written."""
    if loading != DRAINED:
        return FORMAT_VERSION
    return VERSION_OF_PAIRS if points.variables == points.names == NEEDED else VERSION_OF_INPUTS


def _version(package: str) -> str:
    """The version of a package: its own word where it is loaded, since Debian registers h5py under another name."""
    if package in sys.modules:
        return str(sys.modules[package].__version__)
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _write_density(file: h5py.File, density: FamilyDensity, collected: Collected, method: str, cells: int) -> None:
    family, strain, loading = density.family, collected.strain, collected.loading
    base = file.require_group(f"families/{family.name}")
    if "points" not in base:
        _write_table(base.create_group("points"), family.points.to_frame())
        base["points"].attrs["planned_share"] = family.planned_share
        file[f"nearest/{family.name}"] = family.nearest
    out = base.create_group(f"{density.mu_iso:g}")
    out.attrs.update(density.counts | {"lost_probability": density.lost_probability})
    out["weight"], out["bearer"], out["packing"] = density.probability, density.bearer, density.packing
    for stage, points in density.filled.items():
        out[f"filled/{stage}"] = points
    for symbol, values in density.values.items():
        response = out.create_group(f"responses/{symbol}")
        _write_pdf(response, symbol, values, density.probability, strain, method, cells)
        _write_array(response, "values", values, symbol)
        response.create_dataset("extended", data=density.extended, **SQUEEZE)
        response.attrs["filled"] = int(density.filled["shear"].sum())
    if loading.is_undrained:
        ended = density.ends.kind[:, None] != ""
        still = np.isfinite(density.values["eta"].T) if density.values else ~ended
        write_ends(out.create_group("ends"), density, ended & ~still)
    _write_standings(out, density, strain, loading)
    for place, states in (("states", density.states), ("errors", density.errors)):
        for state, table in states.items():
            for symbol, values in table.items():
                _write_array(out, f"{place}/{state}/{symbol}", values, symbol)
    _write_peaks(out, density)


def _write_standings(out: h5py.Group, density: FamilyDensity, strain: np.ndarray, loading: Loading) -> None:
    """The standing of peak and critical state, as attributes of their groups."""
    if not {*loading.steady} <= set(density.values):
        return
    curves = {symbol: DensityCurve(density.values[symbol], density.probability, density.extended, density.packing)
              for symbol in loading.steady}  # fmt: skip
    for state in JUDGED_STATES:
        standing = curves_standing(state, strain, curves, loading)
        out.require_group(f"states/{state}").attrs.update(standing=standing.status, standing_reason=standing.reason)


def _write_peaks(out: h5py.Group, density: FamilyDensity) -> None:
    """How the peaks of the points were estimated; beside the states, because every dataset of a state is a quantity."""
    if "peak" not in density.states:
        return
    peaks = density.peaks
    out["states/peak"].attrs["estimate"] = "single runs" if peaks is None else "pooled over the points"
    if peaks is not None:
        _write_array(out, "peak_estimate/bias", peaks.bias, "eta")
        out["peak_estimate/interior"] = peaks.interior


def _write_pdf(
    out: h5py.Group,
    symbol: str,
    values: np.ndarray,
    probability: np.ndarray,
    strain: np.ndarray,
    method: str,
    cells: int,
) -> None:
    kept = probability > 0
    pdf = evolve_known(values[:, kept], probability[kept], strain, method=method, cells=cells)
    with h5py.File("pdf", "w", driver="core", backing_store=False) as memory:
        pdf.to_hdf5(memory)
        for name, dataset in memory.items():
            data = _rounded(dataset[()]) if name == "pdf" else dataset[()]
            out.create_dataset(name, data=data, **(SQUEEZE if dataset.size > 1000 else {}))
        out.attrs.update(dict(memory.attrs) | {"unit": QUANTITIES[symbol].unit, "name": QUANTITIES[symbol].name})


def _rounded(values: np.ndarray, bits: int = 31) -> np.ndarray:
    """Values rounded to so many binary digits, a relative error of 2^-bits: they take half the room when compressed."""
    mantissa, exponent = np.frexp(values)
    return np.ldexp(np.round(np.ldexp(mantissa, bits)), exponent - bits)


def _write_array(out: h5py.Group, name: str, values: np.ndarray, symbol: str) -> None:
    values = np.asarray(values, float)
    dataset = out.create_dataset(name, data=values, **(SQUEEZE if values.size > 200 else {}))
    dataset.attrs.update(unit=QUANTITIES[symbol].unit, name=QUANTITIES[symbol].name)


def _write_table(group: h5py.Group, frame: pd.DataFrame) -> None:
    for name in frame.columns:
        column = frame[name].to_numpy()
        text = column.dtype.kind in "OSU"
        group.create_dataset(name, data=[str(v) for v in column] if text else column,
                             dtype=h5py.string_dtype() if text else None)  # fmt: skip
    group.attrs["columns"] = [str(name) for name in frame.columns]


def _jsonable(value: Any) -> Any:
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)
