"""One row of a table in LAMMPS, from the campaign's folder:

YADE_BATCH=batch/shear.table:3 python3 -m campaign.lammps shear
"""

from __future__ import annotations

import ast
import os
import shutil
import sys
import time
import traceback
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from analysis.assembly import AssemblyError
from analysis.errors_and_files import GrainScatterError
from campaign.folder import clear_scripts, write_failure
from campaign.lammps import protocol
from campaign.lammps.outputs import LammpsError
from campaign.lammps.product import StartError, is_complete
from campaign.lammps.runner import RESTLESS, MachineError
from campaign.run_one import ENVIRONMENT, FAILED, FREE_BYTES, OK, read_task

#: Parameters that a table may leave out, SI units; the names and values of yade_scripts/stage.py.
COMMON = {
    "assembly": "", "start": "", "mu_s": 0.25, "G_p": 25.7e9, "mu_iso": 0.04, "sigma_3": 100e3, "nu": 0.2,
    "rho": 2670.0, "d50": 0.248e-3, "seed": 1, "timestep_factor": 1.0, "damping": 0.0, "stiffness_scale": 1.0,
    "density_scaling": 1, "heterogeneity": "specimen", "inertial_number": 2e-3, "path": "drained",
    "direction": "compression", "strain_end": 0.40, "windows": "default", "energy_strain": 0.05, "snapshots": "",
    "probe_strain": 1e-6, "stop_when_steady": 0, "code": "lammps",
}  # fmt: skip
#: What this code can do: parameter -> the only value.
ONLY = {"path": "drained", "direction": "compression", "damping": 0.0, "heterogeneity": "specimen",
        "stop_when_steady": 0}  # fmt: skip


def main(stage: str) -> int:
    """Run the row that YADE_BATCH names (TABLE:LINE); returns OK, FAILED, or ENVIRONMENT if the machine failed."""
    table, _, line = os.environ.get("YADE_BATCH", "").rpartition(":")
    try:
        if stage not in protocol.STAGES:
            raise ValueError(f"stage {stage!r} is none of {', '.join(protocol.STAGES)}")
        if not line.isdigit():
            raise ValueError(f"YADE_BATCH = {os.environ.get('YADE_BATCH', '')!r} names no TABLE:LINE")
        task = read_task(Path(table), int(line))
        if (code := task.text("code") or "yade") != "lammps":
            raise ValueError(f"{table}: line {line} has code = {code!r}, so that its product is not for LAMMPS to make")
    except (ValueError, OSError) as error:
        print(f"campaign.lammps: {error}", file=sys.stderr)
        return ENVIRONMENT
    cells = {k: _value(v) for k, v in task.cells.items()}
    p = SimpleNamespace(**COMMON | cells, stage=stage, started=time.time(), run_id=task.text("description"))
    del p.description
    p.ranks = int(os.environ.get("CAMPAIGN_RANKS") or 1)  # no parameter of the run: its result does not depend on it
    p.product = str(cells.get("product") or f"{p.run_id}.h5")
    if is_complete(Path(p.product), p.run_id):
        print(f"{p.run_id}: already done, {p.product} is complete")
        return OK
    folder = None
    try:
        _check(p)
        folder = protocol.make_folder(p)
        product = protocol.STAGES[stage](p, folder)
        protocol.finish(product, folder)
        print(f"{p.run_id}: done, {p.product}")
        return OK
    except MachineError as error:
        print(f"{p.run_id}: {error}", flush=True)
        return ENVIRONMENT
    except (LammpsError, StartError, AssemblyError, GrainScatterError, OSError) as error:
        return _failed(p, str(error), folder)
    except Exception as error:  # a bug: state it too, with the traceback in the log
        traceback.print_exc()
        return _failed(p, f"{type(error).__name__}: {error}", folder)
    finally:
        if folder is not None:
            clear_scripts(folder)


def _failed(p: SimpleNamespace, reason: str, folder: Path | None) -> int:
    """State a failure; on a full disk, which LAMMPS does not notice, it is the machine's. folder: what LAMMPS wrote."""
    if folder is not None and shutil.disk_usage(folder).free < FREE_BYTES // 4:
        print(f"{p.run_id}: no space left on the disk; then: {reason}", flush=True)
        return ENVIRONMENT
    print(f"{p.run_id}: failed: {reason}", file=sys.stderr)
    facts = {"retry": True} if reason.startswith(RESTLESS) else {}  # so it ends, too, if the time step is too large
    write_failure(Path(p.product).parent, p.run_id, reason, log=f"logs/{p.run_id}.log", **facts)
    return FAILED


def _value(cell: str) -> Any:
    """A cell of a table: a number, a text in quotes, or a text without (the description)."""
    try:
        return ast.literal_eval(cell)
    except (ValueError, SyntaxError):
        return float(cell) if cell in ("inf", "nan", "-inf") else cell


#: What a parameter must be, as in yade_scripts/stage.py; a table edited by hand is refused before anything is spent.
LIMITS = {
    "mu_s": (0.0, 5.0), "mu_iso": (0.0, 5.0), "G_p": (1e6, 1e13), "sigma_3": (1.0, 1e9), "nu": (0.0, 0.49),
    "rho": (1.0, 1e6), "d50": (1e-7, 1.0), "timestep_factor": (1e-3, 10.0), "stiffness_scale": (1e-6, 10.0),
    "inertial_number": (1e-6, 2.5e-3), "strain_end": (1e-4, 2.0), "energy_strain": (0.0, 2.0),
    "probe_strain": (1e-9, 1e-2),
}  # fmt: skip


def _check(p: SimpleNamespace) -> None:
    """Refuse what is no number or out of its limits, and what this code cannot do."""
    for name, (low, high) in LIMITS.items():
        value = getattr(p, name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            raise LammpsError(f"{name} = {value!r} is outside [{low:g}, {high:g}]")
    for name, only in ONLY.items():
        if getattr(p, name) != only:
            raise LammpsError(f"{name} = {getattr(p, name)!r}: code = 'lammps' has {only!r} only")


if __name__ == "__main__":
    sys.exit(main(" ".join(sys.argv[1:])))
