"""Preparation of a campaign: fit the inputs, choose the representative points, make the assemblies.

`prepare` writes points.csv (id, mu_s, G_p, G_p_GPa, further variables, probability), inputs.json (the fits or the
distributions), assembly_<seed>.h5, and with `heterogeneity = "grain"` a file grains_<point>_<hash>.h5 per point. If the
sizes of the grains are random, each point has a file assembly_<seed>_point_<point>.h5 instead. The points are chosen
once: they stay the same as long as [inputs], [points] and the pairs or [variables] do.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.errors_and_files import atomic_write, digest, write_hdf5
from campaign.choice import PlanError, choose, refuse_impossible
from campaign.config import COMMAND, Config, assembly_file, grains_file, inputs_settings
from campaign.files import read_json, write_json, write_text
from campaign.folder import folder_lock
from campaign.plan import OWN_GRAINS, packing_of_points
from campaign.progress import Progress

if TYPE_CHECKING:
    import numpy as np

    from analysis.points import RepresentativePoints


#: What inputs.json holds, by type; `points_digest` and `digest` tie it to points.csv and to the campaign file.
INPUTS: dict[str, type] = {"digest": str, "points_digest": str, "pairs": list, "source": str, "marginals": dict,
                           "copulas": list, "joint": dict, "point_attrs": dict}  # fmt: skip
#: Path -> a function that writes the file.
Writes = dict[Path, Callable[[Path], Any]]


def prepare(
    config: Config, folder: Path, check: Callable[[RepresentativePoints], None] = lambda points: None
) -> tuple[RepresentativePoints, str]:
    """Return the points of the campaign and what was done: "chosen", "chosen anew" or "kept".

    check: raises an error for points that cannot be run; it is called before anything is written. Everything is
    computed before the first file is written, and inputs.json, which makes the others valid, is written
    last. Raises PlanError, ConfigError or another GrainScatterError of the analysis if the inputs cannot be used, and
    RunError if another process runs in the folder and files would change, before anything is written; OSError if a file
    cannot be written.
    """
    inputs = read_inputs(folder)
    keep = inputs.get("digest") == inputs_digest(config) and (folder / "points.csv").exists()
    outcome = "kept" if keep else "chosen anew" if inputs else "chosen"
    points, inputs = (read_points(folder), inputs) if keep else choose(config)
    check(points)
    writes: Writes = {}
    if config.material.heterogeneity == "grain":
        writes |= _sample_grains(config, folder, points, inputs, anew=not keep)
    writes |= _make_assemblies(config, folder, points)
    if not _has_text(folder / "config.toml", config.text):
        writes[folder / "config.toml"] = partial(write_text, text=config.text)
    if not keep:
        text = points.to_csv()
        writes[folder / "points.csv"] = partial(write_text, text=text)
        writes[folder / "inputs.json"] = partial(write_json, value=inputs | points_note(config, text))
    if writes:
        _write_all(folder, writes)
    return points, outcome


def _has_text(path: Path, text: str) -> bool:
    try:
        return path.read_text(encoding="utf-8") == text
    except (OSError, UnicodeDecodeError):
        return False


def _write_all(folder: Path, writes: Writes) -> None:
    """Write files in this order while no other process runs in the folder; after an error the new ones are removed."""
    was_there = folder.exists()
    new = [path for path in writes if not path.exists()]
    try:
        with folder_lock(folder):
            for path, write in writes.items():
                write(path)
    except OSError:
        for path in new:
            path.unlink(missing_ok=True)
        if not was_there:
            with contextlib.suppress(OSError):
                (folder / ".lock").unlink(missing_ok=True)
                (folder / "tables").rmdir()
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def read_inputs(folder: Path) -> dict[str, Any]:
    """Return the contents of inputs.json, {} without the file.

    Raises PlanError if it is damaged: the points of the runs cannot be read from it, OSError if it cannot be
    read now.
    """
    path = folder / "inputs.json"
    inputs = read_json(path, {})
    if path.exists() and not (INPUTS.keys() <= inputs.keys() and all(isinstance(inputs[k], INPUTS[k]) for k in INPUTS)):
        raise PlanError(f"{path}: is damaged; restore it, or delete it and points.csv to choose the points again")
    return inputs


def read_points(folder: Path) -> RepresentativePoints:
    """Return the points in a folder's points.csv.

    Raises PlanError if the folder has no plan, or if the file was edited since the points were chosen.
    """
    from analysis.points import RepresentativePoints

    path = folder / "points.csv"
    inputs = read_inputs(folder) if path.exists() else {}
    try:
        text = path.read_text(encoding="utf-8")
    except OSError:
        raise PlanError(f"{folder}: has no plan yet; run `{COMMAND} plan CONFIG` first") from None
    if inputs.get("points_digest") != digest(text.encode(), 16):
        raise PlanError(f"{path}: was changed since the points were chosen; restore it, or delete it to choose again")
    names = {"names": tuple(inputs["names"])} if "names" in inputs else {}
    return RepresentativePoints.from_csv(text, **names, constants=inputs.get("constants"))


def read_planned_points(config: Config, folder: Path) -> RepresentativePoints:
    """Return the points of a plan made from the inputs of this very campaign file.

    Raises PlanError if there is no plan, or if the inputs changed since the points were chosen.
    """
    points = read_points(folder)
    if read_inputs(folder).get("digest") != inputs_digest(config):
        raise PlanError(
            f"{folder}: [inputs], [points], the pairs or distributions, or (with E_p) material.nu "
            "changed since the points were chosen; run `plan`"
        )
    return points


def describe_inputs(folder: Path, points: RepresentativePoints) -> tuple[list[str], list[str]]:
    """Return lines on the fits in inputs.json and the range of the points, and the warnings about the inputs.

    The warnings of an inputs.json that an earlier version wrote are found anew. Raises PlanError for a damaged file.
    """
    inputs = read_inputs(folder)
    try:
        return _inputs_text(inputs, points), _warnings(inputs)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        text = f"{type(error).__name__}: {error}"
        raise PlanError(
            f"{folder / 'inputs.json'}: its fits cannot be read ({text}); restore it, or delete it and points.csv to "
            "choose the points again"
        ) from error


def _inputs_text(inputs: dict[str, Any], points: RepresentativePoints) -> list[str]:
    from analysis.inputs.summary import fit_lines, variable_range

    pairs, source, probability = inputs.get("pairs", []), inputs.get("source") or "unnamed", points.probability
    first = inputs.get("understood") or f"{len(pairs)} pairs, {source}"
    lines = fit_lines(inputs)
    if inputs.get("specified"):
        behind = inputs.get("pairs_behind", 0)
        known = (
            f"{behind} measurements are behind them"
            if behind
            else "how many measurements are behind them is not stated (inputs.pairs_behind), so there is no band"
        )
        first, lines = f"distributions of [variables]; {known}", inputs["specified"]["text"]
    ranges = [variable_range(symbol, points[symbol]) for symbol in points.variables]
    return [
        f"inputs: {first}",
        *(f"  {line}" for line in lines),
        f"points: {', '.join(ranges)}, probabilities {probability.min():.2g} to {probability.max():.2g}",
    ]


def _warnings(inputs: dict[str, Any]) -> list[str]:
    if "warnings" in inputs or not inputs.get("marginals") or inputs.get("specified"):
        return [str(text) for text in inputs.get("warnings", [])]
    import numpy as np

    from analysis.copulas import CopulaFit
    from analysis.inputs.marginals import Marginal
    from analysis.inputs.plausibility import input_warnings

    tables = {symbol: [Marginal.from_dict(fit) for fit in table] for symbol, table in inputs["marginals"].items()}
    return input_warnings(np.asarray(inputs["pairs"], float), tables, list(map(CopulaFit.from_dict, inputs["copulas"])))


def inputs_digest(config: Config) -> str:
    """Return the hash of what the points depend on: [inputs], [points], the pairs file or [variables], and material.nu
    where a Young's modulus is given.

    Raises ConfigError if the pairs file is missing, OSError if it cannot be read.
    """
    inputs = inputs_settings(config)
    if config.inputs.pairs_behind:
        inputs["pairs_behind"] = config.inputs.pairs_behind
    settings = json.dumps({"inputs": inputs, "points": asdict(config.points)}, sort_keys=True)
    pairs = json.dumps(config.variables).encode() if config.variables else config.pairs_path.read_bytes()
    young = any(key.startswith("E_p") for key, _ in config.inputs.columns) or b"E_p" in pairs.replace(b"\0", b"")
    packed = pairs.startswith(b"PK")  # a workbook: the names of its columns cannot be seen
    nu = f"nu {config.material.nu}" if young or packed else ""  # G_p of a measured Young's modulus depends on it
    return digest(settings.encode() + pairs + nu.encode(), 16)


def points_note(config: Config, text: str) -> dict[str, str]:
    """Return the part of inputs.json that ties the text of points.csv to its inputs: the hashes of both."""
    return {"digest": inputs_digest(config), "points_digest": digest(text.encode(), 16)}


def _make_assemblies(config: Config, folder: Path, points: RepresentativePoints) -> Writes:
    """Make the assembly of every packing, or of every point if sizes are random, unless it is there as it must be."""
    writes: Writes = {}
    grains = config.assembly
    sizes = {"d50": grains.d50_mm * 1e-3, "sigma_ln": grains.sigma_ln}
    wanted = [(seed, -1, sizes) for seed in grains.packings[: config.points.n]]
    if OWN_GRAINS & {*points.names}:
        packing = packing_of_points(config, points)
        wanted = [(packing[p.id], p.id, {name: p.further.get(name, sizes[name]) for name in sizes}) for p in points]
    for seed, point, of_sizes in wanted:
        path = folder / assembly_file(seed, point)
        made_with = {"N": grains.N, **of_sizes, "seed": seed, "distribution": grains.distribution}
        if config.curve:
            made_with = {"N": grains.N, "seed": seed, "sieve": config.curve.name}
        note = folder / "tables" / f"{path.stem}.json"
        if path.exists() and read_json(note) == made_with:
            continue
        from analysis.assembly import make_assembly, place, write_assembly

        line = Progress()
        make = partial(make_assembly, **made_with)
        if config.curve:
            make = partial(place, config.curve.diameters(grains.N), seed, grading=config.curve.text)
        assembly = make(progress=lambda text: line.show(f"{path.name}: {text}"))  # noqa: B023
        line.end()
        writes[path] = partial(write_assembly, assembly=assembly, attrs=made_with)
        writes[note] = partial(write_json, value=made_with)
    return writes


def _sample_grains(
    config: Config, folder: Path, points: RepresentativePoints, inputs: dict[str, Any], *, anew: bool
) -> Writes:
    """Draw mu_s and G_p for every grain of every point from their joint distribution; one of them may be a constant.

    Raises PlanError for a value at or below zero. Files that are there are kept, unless the points are chosen `anew`.
    """
    import numpy as np

    from analysis.inputs.joint import Joint

    joint, drawn = Joint.from_dict(inputs["joint"]), {}
    for point in points:
        path = folder / grains_file(config, point.id)
        if anew or not path.exists():
            rng = np.random.default_rng([config.inputs.seed, point.id])
            x = joint.sample(config.assembly.N, rng)
            refuse_impossible(x, points.names, joint, f"the {config.assembly.N} grains of point {point.id}", config)
            drawn[path] = {name: np.full(len(x), value) for name, value in points.constants.items()}
            drawn[path] |= dict(zip(points.names, x.T, strict=True))
    return {path: partial(_write_grains, grains=grains) for path, grains in drawn.items()}


def _write_grains(path: Path, grains: Mapping[str, np.ndarray]) -> None:
    """Write mu_s (n,) and G_p (n,), in Pa, of a specimen's grains."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as part, write_hdf5(part) as file:
        file["mu_s"], file["G_p"] = grains["mu_s"], grains["G_p"]
