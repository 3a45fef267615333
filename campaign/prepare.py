"""Before the first run: fit the inputs, choose the points, make the assemblies; once, and never again by accident.

`prepare` writes points.csv (id, mu_s, G_p, probability), inputs.json (what was fitted), assembly_<seed>.h5, and where
every grain shall have properties of its own, grains_<point>_<hash>.h5.  As long
as the settings of [inputs] and [points] and the pairs stay the same, the points stay the same.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from dataclasses import asdict
from pathlib import Path

from campaign.config import Config
from campaign.files import read_json, write_json, write_text

POINT_COLUMNS = ("id", "mu_s", "G_p", "G_p_GPa", "probability")


class PlanError(ValueError):
    """A campaign folder that cannot be planned or used as it is; one line that names the file."""


def prepare(config: Config, folder: Path) -> tuple[list[dict], str]:
    """The points of the campaign and a word on them: "chosen", "chosen anew" or "kept".

    Raises PlanError, ConfigError or the analysis' own InputError and the like; then nothing has been written.
    """
    noted = read_json(folder / "inputs.json", {})
    kept = noted.get("digest") == inputs_digest(config) and (folder / "points.csv").exists()
    word = "kept" if kept else "chosen anew" if noted else "chosen"
    points, noted = (read_points(folder), noted) if kept else _choose(config)
    if config.material.heterogeneity == "grain":
        _sample_grains(config, folder, points, noted, anew=not kept)
    if not kept:
        text = points_text(points)
        write_text(folder / "points.csv", text)
        write_json(folder / "inputs.json", noted | points_note(config, text))
    _make_assemblies(config, folder)
    write_text(folder / "config.toml", config.text)
    return points, word


def read_points(folder: Path) -> list[dict]:
    """The points as chosen.  Raises PlanError if there are none, or if the file was edited since."""
    path = folder / "points.csv"
    noted = read_json(folder / "inputs.json", {})
    try:
        text = path.read_text(encoding="utf-8")
    except OSError:
        raise PlanError(f"{folder}: has no plan yet; run `python3 -m campaign plan CONFIG` first") from None
    if noted.get("points_digest") != _digest(text.encode()):
        raise PlanError(f"{path}: was changed since the points were chosen; restore it, or delete it to choose again")
    lines = csv.DictReader(io.StringIO(text))
    return [{"id": int(p["id"]), **{k: float(p[k]) for k in ("mu_s", "G_p", "probability")}} for p in lines]


def read_planned_points(config: Config, folder: Path) -> list[dict]:
    """The points of a plan made from these very inputs.  Raises PlanError if there is none, or if they changed."""
    points = read_points(folder)
    if read_json(folder / "inputs.json", {}).get("digest") != inputs_digest(config):
        raise PlanError(f"{folder}: [inputs], [points], the pairs or (with E_p_GPa) material.nu "
                        "changed since the points were chosen; run `plan`")
    return points


def inputs_digest(config: Config) -> str:
    """What the points depend on: [inputs], [points], the bytes of the pairs file, and with E_p_GPa material.nu."""
    settings = json.dumps({"inputs": asdict(config.inputs), "points": asdict(config.points)}, sort_keys=True)
    pairs = config.pairs_path.read_bytes()
    nu = f"nu {config.material.nu}" if b"E_p_GPa" in pairs else ""  # G_p of a measured Young's modulus depends on it
    return _digest(settings.encode() + pairs + nu.encode())


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def _choose(config: Config) -> tuple[list[dict], dict]:
    """Fit marginals and copulas, join the best, choose the points."""
    import numpy as np

    from analysis import inputs

    given, asked = config.inputs, config.points
    pairs = inputs.read_pairs(config.pairs_path, nu=config.material.nu)
    from analysis import joint, points

    families = {"copula_families": given.copulas or None}
    if given.marginals:
        families["marginal_families"] = given.marginals
    fit = joint.fit_joint(pairs, n_boot=given.bootstrap, seed=given.seed, **families)
    found = points.select_points(fit.joint, asked.n, method=asked.method, seed=asked.seed, nested=asked.nested)
    _refuse_impossible(found.x, fit.joint, f"the {asked.n} points", config)
    rows = [
        {"id": k, "mu_s": float(x[0]), "G_p": float(x[1]), "probability": float(p)}
        for k, (x, p) in enumerate(zip(found.x, found.probability, strict=True))
    ]
    told = fit.to_dict()
    told["marginals"] = dict(zip(("mu_s", "G_p"), told["marginals"], strict=True))
    noted = {
        "source": given.pairs,
        "pairs": pairs.tolist(),
        **told,
        "point_attrs": {"method": found.method, "seed": asked.seed, "discrepancy": found.discrepancy},
    }
    return rows, json.loads(json.dumps(noted, default=lambda value: np.asarray(value).tolist()))


def _refuse_impossible(x, joint, what: str, config: Config) -> None:
    """PlanError for values (n, 2) at or below zero, which a family that is unbounded below may give."""
    from analysis.marginal_families import FAMILIES

    positive = ", ".join(f'"{name}"' for name, family in FAMILIES.items() if family.positive)
    for name, column, marginal in zip(("mu_s", "G_p"), x.T, joint.marginals, strict=True):
        if (bad := int((column <= 0.0).sum())):
            raise PlanError(
                f"{config.pairs_path}: the {marginal.family} distribution fitted to {name} puts {bad} of {what} at or "
                f"below zero (least {column.min():.3g}); choose inputs.marginals from {positive}"
            )


def points_note(config: Config, text: str) -> dict:
    """What inputs.json says of points.csv: the inputs it belongs to, and its own digest."""
    return {"digest": inputs_digest(config), "points_digest": _digest(text.encode())}


def points_text(points: list[dict]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(POINT_COLUMNS)
    for p in points:
        writer.writerow([p["id"], repr(p["mu_s"]), repr(p["G_p"]), f"{p['G_p'] / 1e9:.4f}", repr(p["probability"])])
    return out.getvalue()


def _make_assemblies(config: Config, folder: Path) -> None:
    """assembly_<seed>.h5 for every packing, unless it is there with the same settings."""
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


def grains_file(config: Config, point: int) -> str:
    """Name of the file with a point's per-grain properties; it carries what they are drawn with, and so do run ids."""
    drawn_with = json.dumps([asdict(config.inputs), config.material.nu, config.assembly.N], sort_keys=True)
    return f"grains_{point}_{_digest(drawn_with.encode())[:8]}.h5"


def _sample_grains(config: Config, folder: Path, points: list[dict], noted: dict, *, anew: bool) -> None:
    """A pair (mu_s, G_p) of its own for every grain, drawn from the fitted joint distribution; checked before written.

    Raises PlanError for a value at or below zero.  Files that are there are kept, unless the points are chosen `anew`.
    """
    import h5py
    import numpy as np

    from analysis.joint import Joint

    joint, drawn = Joint.from_dict(noted["joint"]), {}
    for point in points:
        path = folder / grains_file(config, point["id"])
        if anew or not path.exists():
            rng = np.random.default_rng([config.inputs.seed, point["id"]])
            drawn[path] = joint.sample(config.assembly.N, rng)
            _refuse_impossible(drawn[path], joint, f"the {config.assembly.N} grains of point {point['id']}", config)
    for path, grains in drawn.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        with h5py.File(part, "w") as file:
            file["mu_s"], file["G_p"] = grains.T
        part.replace(path)
