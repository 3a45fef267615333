"""Start a stage in LAMMPS from a test: one row of parameters, as the supervisor of a campaign starts it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from paths import ROOT

from analysis.assembly import make_assembly, write_assembly

needs_lmp = pytest.mark.skipif(shutil.which("lmp") is None, reason="lmp is not installed (Debian's package lammps)")


def grains(folder: Path, N: int, seed: int = 1) -> str:
    """The assembly file of that size in a folder, by its name."""
    write_assembly(folder / "assembly.h5", make_assembly(N, 0.248e-3, 0.174, seed), {"N": N, "seed": seed})
    return "assembly.h5"


def stage(name: str, folder: Path, row: dict, supervised: bool = False, **env: str) -> subprocess.CompletedProcess:
    """One row through a stage in `folder`; the product is products/<description>.h5.

    supervised: through `campaign.run_one`, which judges the outcome.
    """
    command, environment = _prepared(name, folder, row, supervised)
    return subprocess.run(command, cwd=folder, env=environment | env, capture_output=True, text=True,
                          stdin=subprocess.DEVNULL, timeout=600)  # fmt: skip


def started(name: str, folder: Path, row: dict, supervised: bool = True, **env: str) -> subprocess.Popen:
    """The same, started and not waited for; its output is in one pipe."""
    command, environment = _prepared(name, folder, row, supervised)
    return subprocess.Popen(command, cwd=folder, env=environment | env, text=True, stdin=subprocess.DEVNULL,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # fmt: skip


def _prepared(name: str, folder: Path, row: dict, supervised: bool) -> tuple[list[str], dict[str, str]]:
    """Command and environment of a row, whose table is written."""
    (folder / "products").mkdir(exist_ok=True)
    (folder / "logs").mkdir(exist_ok=True)
    cells = {"code": "lammps", "timestep_factor": 1.0} | row
    cells["product"] = f"products/{row['description']}.h5"
    text = {k: str(v) if k == "description" else repr(v) for k, v in cells.items()}
    table = folder / f"{row['description']}.table"
    table.write_text("  ".join(text) + "\n" + "  ".join(text.values()) + "\n")
    words = ["campaign.run_one", f"{name}.py"] if supervised else ["campaign.lammps", name]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "YADE_BATCH": f"{table.name}:2"}
    return [sys.executable, "-m", *words], environment
