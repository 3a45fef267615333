"""Runs to responses: collects the products of a campaign's plan into results.h5, densities included."""

from __future__ import annotations

import dataclasses
import datetime
import json
import os
import platform
from pathlib import Path

import h5py
import matplotlib
import numpy as np
import pandas as pd
import scipy

from analysis import pdem
from analysis.archive import NAME, Archive
from analysis.collect import FamilyDensity, ResponsesError, collect
from analysis.input_bands import bootstrap_probabilities
from analysis.joint import Joint
from analysis.quantities import QUANTITIES
from analysis.results import FORMAT, FORMAT_VERSION

DEFAULTS = {"max_lost_probability": 0.05, "density_method": "exact", "cells": 400, "input_bootstrap": 0}
SQUEEZE = {"compression": "gzip", "shuffle": True, "fletcher32": True}


def build_results(folder, plan, points, settings=None) -> Path:
    """Read every product of the plan, or what <folder>/runs.h5 keeps of it, and write <folder>/results.h5.

    Returns its path.

    plan: frame run_id, stage, family, point, packing, mu_iso, mu_s, G_p (Pa), product (path), start; optionally status,
    "spared" for runs that need no product: points without any are filled by regression and marked.
    points: frame id, mu_s, G_p (Pa), probability (sum 1); optionally family, where a family has points of its own.
    settings: dict, all optional: campaign (name), config (TOML text), settings (dict of every key, defaults included),
    pairs (n, 2), source (where the pairs come from), marginals (dicts with a "variable", best first, or two lists in
    the order mu_s, G_p), copulas (best first), joint, all as objects or as their dicts, point_attrs (dict of method,
    seed, discrepancy ...), versions (dict),
    max_lost_probability (0.05), density_method ("exact" or "tvd"), cells (400),
    input_bootstrap (0): resamplings of the pairs under which the points get other probabilities, for bands
    (where the joint distribution is given and the points have no family column).

    Raises ResponsesError or runfile.RunFileError, and writes nothing, if a product is missing, truncated or was run
    with other parameters than the plan's, or if failed runs take more than max_lost_probability from a density.
    """
    settings = DEFAULTS | dict(settings or {})
    folder = Path(folder)
    groups, strain, runs, grains = collect(plan, points, Archive(folder / NAME))
    for group in groups:
        if group.lost_probability > settings["max_lost_probability"]:
            raise ResponsesError(
                f"{group.family}, mu_iso = {group.mu_iso:g}: failed runs lose {group.lost_probability:.3f} of the "
                f"probability, limit {settings['max_lost_probability']:g}"
            )
    target = folder / "results.h5"
    part = folder / f".results.{os.getpid()}.part"
    try:
        with h5py.File(part, "w") as file:
            _write_head(file, points, settings, strain, groups, grains)
            for group in groups:
                _write_density(file, group, strain, settings)
            _write_frame(file.create_group("runs"), runs)
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)
    return target


def _write_head(file, points, settings, strain, groups, grains):
    versions = {"python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__,
                "pandas": pd.__version__, "h5py": h5py.__version__, "matplotlib": matplotlib.__version__}  # fmt: skip
    file.attrs.update(
        format=FORMAT, format_version=FORMAT_VERSION, campaign=settings.get("campaign", ""),
        config=settings.get("config", ""), settings=json.dumps(settings.get("settings", {})),
        versions=json.dumps(versions | settings.get("versions", {})),
        created=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        max_lost_probability=settings["max_lost_probability"],
    )  # fmt: skip
    inputs = file.create_group("inputs")
    inputs["pairs"] = np.asarray(settings.get("pairs", np.empty((0, 2))), float)
    inputs.attrs["source"] = str(settings.get("source", ""))
    content = {"marginals": _by_variable(settings.get("marginals", [])), "copulas": settings.get("copulas", []),
               "joint": settings.get("joint", {})}  # fmt: skip
    for name, value in content.items():
        inputs.attrs[name] = json.dumps(value, default=_jsonable)
    if settings["input_bootstrap"] and settings.get("joint") and "family" not in points:
        joint = settings["joint"]
        joint = joint if isinstance(joint, Joint) else Joint.from_dict(joint)
        x = points[["mu_s", "G_p"]].to_numpy()
        inputs["bootstrap_probability"] = bootstrap_probabilities(
            settings["pairs"], joint, x, settings["input_bootstrap"]
        )
    _write_frame(file.create_group("points"), points)
    file["points"].attrs.update(settings.get("point_attrs", {}))
    file["strain"] = strain
    file["strain"].attrs.update(unit=QUANTITIES["eps_a"].unit, name=QUANTITIES["eps_a"].name)
    file["densities"] = sorted({group.mu_iso for group in groups})
    grading = file.create_group("grading")
    grading.create_dataset("diameter", data=grains[0], **SQUEEZE)
    grading.attrs.update(grains[1])


def _write_density(file, group: FamilyDensity, strain, settings):
    base = file.require_group(f"families/{group.family}")
    if "points" not in base:
        _write_frame(base.create_group("points"), group.points)
        base["points"].attrs["planned_share"] = group.points.attrs["planned_share"]
        file[f"nearest/{group.family}"] = group.points.attrs["nearest"]
    out = base.create_group(f"{group.mu_iso:g}")
    out.attrs.update(group.counts | {"lost_probability": group.lost_probability})
    out["weight"], out["bearer"] = group.weight, group.bearer
    for stage, points in group.filled.items():
        out[f"filled/{stage}"] = points
    for symbol, values in group.values.items():
        _write_response(out.create_group(f"responses/{symbol}"), symbol, values, group, strain, settings)
        if len(group.packings) > 1:
            _write_array(out, f"replicates/{symbol}", group.replicates[symbol], symbol)
    for place, states in (("states", group.states), ("errors", group.errors), ("state_replicates", group.state_sets)):
        for state, table in states.items():
            for symbol, values in table.items():
                _write_array(out, f"{place}/{state}/{symbol}", values, symbol)


def _write_response(out, symbol, values, group, strain, settings):
    kept = group.weight > 0
    weight = group.weight[kept]
    density = pdem.evolve(
        values[:, kept], weight, strain, method=settings["density_method"], cells=settings["cells"]
    )
    with h5py.File("density", "w", driver="core", backing_store=False) as memory:
        density.to_hdf5(memory)
        for name, dataset in memory.items():
            data = _rounded(dataset[()]) if name == "pdf" else dataset[()]
            out.create_dataset(name, data=data, **(SQUEEZE if dataset.size > 1000 else {}))
        out.attrs.update(dict(memory.attrs) | {"unit": QUANTITIES[symbol].unit, "name": QUANTITIES[symbol].name})
    _write_array(out, "values", values, symbol)
    out.create_dataset("extended", data=group.extended, **SQUEEZE)
    out.attrs["filled"] = int(group.filled["shear"].sum())


def _rounded(values, bits=31):
    """Values rounded to so many binary digits, a relative error of 2^-bits: they take half the room when compressed."""
    mantissa, exponent = np.frexp(values)
    return np.ldexp(np.round(np.ldexp(mantissa, bits)), exponent - bits)


def _write_array(out, name, values, symbol):
    values = np.asarray(values, float)
    dataset = out.create_dataset(name, data=values, **(SQUEEZE if values.size > 200 else {}))
    dataset.attrs.update(unit=QUANTITIES[symbol].unit, name=QUANTITIES[symbol].name)


def _write_frame(group, frame):
    for name in frame.columns:
        column = frame[name].to_numpy()
        text = column.dtype.kind in "OSU"
        group.create_dataset(name, data=[str(v) for v in column] if text else column,
                             dtype=h5py.string_dtype() if text else None)  # fmt: skip
    group.attrs["columns"] = [str(name) for name in frame.columns]


def _by_variable(fits):
    """Marginal fits as {"mu_s": [...], "G_p": [...]}, from a flat list of dicts with a variable, or from two lists."""
    if isinstance(fits, dict):
        return fits
    if fits and isinstance(fits[0], dict):
        return {name: [{k: v for k, v in fit.items() if k != "variable"} for fit in fits if fit["variable"] == name]
                for name in ("mu_s", "G_p")}  # fmt: skip
    return {name: list(table) for name, table in zip(("mu_s", "G_p"), fits, strict=False)}


def _jsonable(value):
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if dataclasses.is_dataclass(value):
        return dataclasses.asdict(value)
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)
