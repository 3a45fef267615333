"""What the campaign tests share: small campaigns in their own folders, and commands run as a user runs them."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
import pytest
import synthetic_runs
from paths import ROOT

from campaign.config import Config, read_config
from campaign.plan import PlannedRun, make_rows, write_plan
from campaign.prepare import prepare

FAKE = str(ROOT / "tests" / "support" / "fake_yade.py")
needs_batch = pytest.mark.skipif(shutil.which("yade-batch") is None, reason="yade-batch is not installed")


@dataclass
class Small:
    """A planned campaign in its own folder, run by the stand-in for YADE unless `yade` says otherwise."""

    toml: Path
    folder: Path
    rows: list[PlannedRun]
    config: Config
    fake: dict = field(default_factory=dict)
    yade: str = FAKE

    def command(self, *words: str, **env: str) -> subprocess.CompletedProcess:
        """python3 -m campaign WORDS, as from a shell."""
        return subprocess.run(self.line(*words), env=self.env(**env), cwd=ROOT, capture_output=True, text=True)

    def line(self, *words: str) -> list[str]:
        return [sys.executable, "-m", "campaign", words[0], str(self.toml), "--folder", str(self.folder), *words[1:]]

    def env(self, **env: str) -> dict[str, str]:
        return os.environ | {"CAMPAIGN_YADE": self.yade, "FAKE_YADE": json.dumps(self.fake)} | env

    def status(self) -> dict:
        return json.loads(self.command("status", "--json").stdout)

    def total(self, word: str) -> int:
        return self.status()["counts"]["total"][word]

    def product(self, k: int = -1) -> Path:
        return self.folder / self.rows[k].product

    def sums(self) -> dict[str, str]:
        """Run id -> digest of the product's bytes."""
        paths = sorted((self.folder / "products").glob("*.h5"))
        return {path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}

    def started(self) -> list[str]:
        """Run ids in the order in which the stand-in was started for them."""
        path = self.folder / "started.txt"
        return path.read_text().split() if path.exists() else []


def make_small(place: Path, n: int = 2, more: str = "", fitted: bool = False, **fake) -> Small:
    """A planned campaign without products; the stand-in for YADE copies ready products, which takes little time.

    fitted: choose the points from the pairs, as `plan` does, instead of taking synthetic ones.
    """
    toml = synthetic_runs.write_config(place, n, more)
    config, folder = read_config(toml), place / "run"
    rows = make_rows(config, prepare(config, folder)[0]) if fitted else synthetic_runs.planned(config, folder, n)
    write_plan(rows, folder)
    ready = place / "ready"
    for stage in ("consolidate", "probe", "shear"):
        row = next(row for row in rows if row.stage == stage)
        ready.mkdir(exist_ok=True)
        synthetic_runs.write_product(place, row).rename(ready / f"{stage}.h5")
    return Small(toml, folder, rows, config, {"products": str(ready), **fake})


def make_real(place: Path, n: int = 2, spheres: int = 100, packings: int = 1) -> Small:
    """A planned campaign of n points at one density for YADE itself: some five CPU seconds per run."""
    small = make_small(place, n)
    text = small.toml.read_text().replace("N = 64", f"N = {spheres}").replace("[0.001, 0.04]", "[0.04]")
    text = text.replace("packings = [1]", f"packings = {packings}")
    text = text.replace("inertial_number = 2.5e-3", "inertial_number = 2e-3")
    small.toml.write_text(text.replace("strain_end = 0.1", "strain_end = 0.05") + "[dem]\ntimestep_factor = 1.0\n")
    small.config, small.yade = read_config(small.toml), "yade"
    small.rows = synthetic_runs.planned(small.config, small.folder, n)
    write_plan(small.rows, small.folder)
    return small


def plan_real(toml: Path, folder: Path, like: Path | None = None) -> Small:
    """The campaign of a file, planned in `folder` as `plan` does it, for YADE itself.

    like: a folder whose points to take. Points chosen with another numpy version differ in the 13th digit, and so do
    the run ids.
    """
    config = read_config(toml)
    if like:
        folder.mkdir(parents=True)
        for name in ("points.csv", "inputs.json"):
            shutil.copy(like / name, folder)
    rows = make_rows(config, prepare(config, folder)[0])
    write_plan(rows, folder)
    return Small(toml, folder, rows, config, yade="yade")


def undisturbed(toml: Path, folder: Path) -> Small:
    """The campaign of a file, run in `folder` without disturbance; finished runs there are used as they are.

    AssertionError if a run failed, or if a product was made by other scripts than the present ones.
    """
    whole = plan_real(toml, folder)
    done = whole.command("run", "--quiet")
    assert done.returncode == 0, done.stderr
    status = whole.status()
    assert status["other_scripts"] == 0, f"{folder}: {status['other_scripts']} products are of other scripts than now"
    return whole


def same_arrays(a: h5py.File, b: h5py.File) -> bool:
    """Whether all arrays and proofs of two products agree to the last bit (except the saved scene: it holds times)."""
    names = []
    a.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) and name != "state" else None)
    pairs = [(a[name][()], b[name][()]) for name in names]
    pairs += [(value, b["proofs"].attrs[name]) for name, value in a["proofs"].attrs.items()]
    return all(np.array_equal(x, y, equal_nan=np.asarray(x).dtype.kind == "f") for x, y in pairs)


def finish(small: Small, *but: PlannedRun) -> Small:
    """Write the products of all rows, except some."""
    for row in small.rows:
        if row not in but:
            synthetic_runs.write_product(small.folder, row, Path(small.fake["products"], f"{row.stage}.h5"))
    return small


#: An sbatch that notes what it was given, and numbers its jobs.
SUBMIT = 'echo "$2" >> submitted.txt; wc -l < submitted.txt'


def slurm_of(folder: Path, **commands: str) -> str:
    """A search path that begins with these stand-ins for SLURM's commands."""
    for name, text in commands.items():
        (folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (folder / name).chmod(0o755)
    return f"{folder}:{os.environ['PATH']}"
