"""Preparation of a campaign: fit the inputs, choose the representative points, make the assemblies.

`prepare` writes points.csv (id, mu_s, G_p, G_p_GPa, probability), inputs.json (the fits), assembly_<seed>.h5, and with
`heterogeneity = "grain"` a file grains_<point>_<hash>.h5 per point. The points are chosen once: they stay the same as
long as [inputs], [points] and the pairs do.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.errors_and_files import GrainScatterError, atomic_write, digest
from campaign.config import Config, grains_file
from campaign.files import read_json, write_json, write_text

if TYPE_CHECKING:
    import numpy as np

    from analysis.inputs.joint import Joint
    from analysis.points import RepresentativePoints


class PlanError(GrainScatterError):
    """A campaign's folder cannot be planned or used as it is; the text is one line that names the file."""


def prepare(config: Config, folder: Path) -> tuple[RepresentativePoints, str]:
    """Return the points of the campaign and what was done: "chosen", "chosen anew" or "kept".

    Raises PlanError, ConfigError or another GrainScatterError of the analysis if the inputs cannot be used, before
    anything is written, and OSError if a file cannot be written.
    """
    inputs = read_json(folder / "inputs.json", {})
    keep = inputs.get("digest") == inputs_digest(config) and (folder / "points.csv").exists()
    outcome = "kept" if keep else "chosen anew" if inputs else "chosen"
    points, inputs = (read_points(folder), inputs) if keep else _choose(config)
    if config.material.heterogeneity == "grain":
        _sample_grains(config, folder, points, inputs, anew=not keep)
    if not keep:
        text = points.to_csv()
        write_text(folder / "points.csv", text)
        write_json(folder / "inputs.json", inputs | points_note(config, text))
    _make_assemblies(config, folder)
    write_text(folder / "config.toml", config.text)
    return points, outcome


def read_points(folder: Path) -> RepresentativePoints:
    """Return the points in a folder's points.csv.

    Raises PlanError if the folder has no plan, or if the file was edited since the points were chosen.
    """
    from analysis.points import RepresentativePoints

    path = folder / "points.csv"
    inputs = read_json(folder / "inputs.json", {})
    try:
        text = path.read_text(encoding="utf-8")
    except OSError:
        raise PlanError(f"{folder}: has no plan yet; run `python3 -m campaign plan CONFIG` first") from None
    if inputs.get("points_digest") != digest(text.encode(), 16):
        raise PlanError(f"{path}: was changed since the points were chosen; restore it, or delete it to choose again")
    return RepresentativePoints.from_csv(text)


def read_planned_points(config: Config, folder: Path) -> RepresentativePoints:
    """Return the points of a plan made from the inputs of this very campaign file.

    Raises PlanError if there is no plan, or if the inputs changed since the points were chosen.
    """
    points = read_points(folder)
    if read_json(folder / "inputs.json", {}).get("digest") != inputs_digest(config):
        raise PlanError(
            f"{folder}: [inputs], [points], the pairs or (with E_p_GPa) material.nu "
            "changed since the points were chosen; run `plan`"
        )
    return points


def inputs_digest(config: Config) -> str:
    """Return the hash of what the points depend on: [inputs], [points], the pairs file, and material.nu with E_p_GPa.

    Raises ConfigError if the pairs file is missing, OSError if it cannot be read.
    """
    settings = json.dumps({"inputs": asdict(config.inputs), "points": asdict(config.points)}, sort_keys=True)
    pairs = config.pairs_path.read_bytes()
    nu = f"nu {config.material.nu}" if b"E_p_GPa" in pairs else ""  # G_p of a measured Young's modulus depends on it
    return digest(settings.encode() + pairs + nu.encode(), 16)


def points_note(config: Config, text: str) -> dict[str, str]:
    """Return the part of inputs.json that ties the text of points.csv to its inputs: the hashes of both."""
    return {"digest": inputs_digest(config), "points_digest": digest(text.encode(), 16)}


def _choose(config: Config) -> tuple[RepresentativePoints, dict[str, Any]]:
    """Fit marginals and copulas, join the best of them, choose the points. Returns the points and inputs.json."""
    import numpy as np

    from analysis.inputs.joint import fit_joint
    from analysis.inputs.pairs import read_pairs
    from analysis.points.selection import select_points

    pairs = read_pairs(config.pairs_path, nu=config.material.nu)
    families: dict[str, Any] = {"copula_families": config.inputs.copulas or None}
    if config.inputs.marginals:
        families["marginal_families"] = config.inputs.marginals
    fit = fit_joint(pairs, n_boot=config.inputs.bootstrap, seed=config.inputs.seed, **families)
    wanted = config.points
    points = select_points(fit.joint, wanted.n, method=wanted.method, seed=wanted.seed, nested=wanted.nested)
    _refuse_impossible(points.x, fit.joint, f"the {wanted.n} points", config)
    fits = fit.to_dict()
    fits["marginals"] = dict(zip(("mu_s", "G_p"), fits["marginals"], strict=True))
    inputs = {
        "source": config.inputs.pairs,
        "pairs": pairs.tolist(),
        **fits,
        "point_attrs": {"method": points.method, "seed": wanted.seed, "discrepancy": points.discrepancy},
    }
    return points, json.loads(json.dumps(inputs, default=lambda value: np.asarray(value).tolist()))


def _refuse_impossible(x: np.ndarray, joint: Joint, what: str, config: Config) -> None:
    """Raise PlanError for values x (n, 2) at or below zero, which a family that is unbounded below may give."""
    from analysis.inputs.marginal_families import FAMILIES

    positive = ", ".join(f'"{name}"' for name, family in FAMILIES.items() if family.positive)
    for name, column, marginal in zip(("mu_s", "G_p"), x.T, joint.marginals, strict=True):
        if count := int((column <= 0.0).sum()):
            raise PlanError(
                f"{config.pairs_path}: the {marginal.family} distribution fitted to {name} puts {count} of {what} at "
                f"or below zero (least {column.min():.3g}); choose inputs.marginals from {positive}"
            )


def _make_assemblies(config: Config, folder: Path) -> None:
    """Write assembly_<seed>.h5 for every packing, unless it is there and was made with the same settings."""
    grains = config.assembly
    for seed in grains.packings:
        path = folder / f"assembly_{seed}.h5"
        made_with = {"N": grains.N, "d50": grains.d50_mm * 1e-3, "sigma_ln": grains.sigma_ln, "seed": seed,
                     "distribution": grains.distribution}  # fmt: skip
        note = folder / "tables" / f"assembly_{seed}.json"
        if path.exists() and read_json(note) == made_with:
            continue
        from analysis.assembly import make_assembly, write_assembly

        write_assembly(path, make_assembly(**made_with), made_with)
        write_json(note, made_with)


def _sample_grains(
    config: Config, folder: Path, points: RepresentativePoints, inputs: dict[str, Any], *, anew: bool
) -> None:
    """Draw a pair (mu_s, G_p) for every grain of every point from the fitted joint distribution and write the files.

    All values are checked before a file is written; raises PlanError for a value at or below zero. Files that are there
    are kept, unless the points are chosen `anew`.
    """
    import h5py
    import numpy as np

    from analysis.inputs.joint import Joint

    joint, drawn = Joint.from_dict(inputs["joint"]), {}
    for point in points:
        path = folder / grains_file(config, point.id)
        if anew or not path.exists():
            rng = np.random.default_rng([config.inputs.seed, point.id])
            drawn[path] = joint.sample(config.assembly.N, rng)
            _refuse_impossible(drawn[path], joint, f"the {config.assembly.N} grains of point {point.id}", config)
    for path, grains in drawn.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as part, h5py.File(part, "w") as file:
            file["mu_s"], file["G_p"] = grains.T
