"""Synthetic products of planned runs: the files that the scripts would write, with responses in closed form."""

from __future__ import annotations

import os
from math import sin
from pathlib import Path
from types import SimpleNamespace

import h5py

from campaign.files import write_json, write_text
from campaign.plan import PlannedRun, make_rows
from campaign.prepare import points_note

PAIRS = "mu_s,G_p_GPa\n" + "".join(f"{0.1 + 0.02 * k:.3f},{60 - 2.1 * k + 7 * sin(3 * k):.2f}\n" for k in range(20))
TOML = """
name = "small"
[inputs]
pairs = "pairs.csv"
bootstrap = 19
[points]
n = {n}
[assembly]
packings = [1]
N = 64
[consolidation]
mu_iso = [0.001, 0.04]
[shear]
strain_end = 0.1
inertial_number = 2.5e-3
"""


def write_product(folder: Path, row: PlannedRun, source: Path | None = None, **parameters) -> Path:
    """The product of one row; `parameters` replace what the run says it used.  `source`: a product to start from."""
    path = folder / row.product
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    if source is None:
        import synthetic_results

        facts = vars(row) | {"product": str(part)}
        if row.stage == "consolidate":
            facts |= {"mu_s": 0.25, "point": 0}
        synthetic_results.write_run(SimpleNamespace(**facts), end=row.values.get("strain_end", 0.4))
    else:
        part.write_bytes(source.read_bytes())
    with h5py.File(part, "r+") as file:
        file.attrs.update(run_id=row.run_id, stage=row.stage)
        file["parameters"].attrs.update({**row.values, **parameters})
    os.replace(part, path)
    return path


def write_config(folder: Path, n: int = 4, more: str = "") -> Path:
    """A campaign file for n points x 2 densities (2 + 4 n runs) with its pairs beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "pairs.csv").write_text(PAIRS)
    path = folder / "campaign.toml"
    path.write_text(TOML.format(n=n) + more)
    return path


def planned(config, folder: Path, n: int) -> list[PlannedRun]:
    """Rows of n synthetic points, with points.csv and inputs.json as if chosen from the config's own inputs."""
    import synthetic_results

    points = synthetic_results.representative_points(n)
    text = points.to_csv()
    write_text(folder / "points.csv", text)
    inputs = {"pairs": [[0.2, 25e9]], "source": "", "marginals": {}, "copulas": [], "joint": {}, "point_attrs": {}}
    write_json(folder / "inputs.json", inputs | points_note(config, text))
    return make_rows(config, points)
