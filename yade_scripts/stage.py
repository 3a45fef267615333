"""What every stage shares around its protocol: parameters in, one product or one stated failure out.

`main(stage, protocol)` reads the row of YADE's parameter table over the defaults, runs `protocol(p, product)`
and leaves either the product (moved into place when complete) or `<run_id>.failed.json` and exit status 1.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

from yade import utils

from analysis.assembly import AssemblyError
from analysis.quantities import DIRECTIONS
from yade_scripts.paths import PATHS
from yade_scripts.product import Product, ProductError
from yade_scripts.proofs import I_LIMIT
from yade_scripts.rve import O, ProofError

#: Parameters that every stage takes, SI units; a table's columns replace them, a command line's table is optional.
COMMON = {
    "product": "",
    "assembly": "",
    "start": "",
    "mu_s": 0.25,
    "G_p": 25.7e9,
    "mu_iso": 0.04,
    "sigma_3": 100e3,
    "nu": 0.2,
    "rho": 2670.0,
    "d50": 0.248e-3,
    "seed": 1,
    "timestep_factor": 1.0,
    "damping": 0.0,
    "stiffness_scale": 1.0,
    "density_scaling": 1,
    "heterogeneity": "specimen",
    "grains": "",
    "inertial_number": 2e-3,
    "path": "drained",
    "direction": "compression",
    "stiff_cap": 10e6,  # p' at which an undrained test ends: grains would crush
    "strain_end": 0.40,
    "windows": "default",
    "energy_strain": 0.05,  # strain up to which energies are summed and their balance is proven
    "snapshots": "",
    "probe_strain": 1e-6,
    "stop_when_steady": 0,
    "checkpoint_seconds": 120.0,
    "servo_mass": 0.005,  # of the grains' mass over the cell's edge, and the servo's damping: hold sigma_3 for any N
    "servo_damping": 0.8,
}

#: What a parameter must be; a table edited by hand is refused before anything is spent.
LIMITS = {
    "mu_s": (0.0, 5.0),
    "mu_iso": (0.0, 5.0),
    "G_p": (1e6, 1e13),
    "sigma_3": (1.0, 1e9),
    "nu": (0.0, 0.49),
    "rho": (1.0, 1e6),
    "d50": (1e-7, 1.0),
    "timestep_factor": (1e-3, 10.0),
    "damping": (0.0, 0.99),
    "stiffness_scale": (1e-6, 10.0),
    "inertial_number": (1e-6, I_LIMIT),
    "strain_end": (1e-4, 2.0),
    "stiff_cap": (1.0, 1e12),
    "energy_strain": (0.0, 2.0),
    "probe_strain": (1e-9, 1e-2),
    "servo_mass": (1e-6, 10.0),
    "servo_damping": (0.0, 1.0),
}


def main(stage: str, protocol) -> None:
    """Run one row of the table through `protocol(p, product)`; exit with 0 (product there) or 1 (failure stated)."""
    p = read_parameters(stage)
    product = Product(p)
    try:
        check(p)
        if product.is_complete():
            print(f"{p.run_id}: already done, {p.product} is complete")
        else:
            protocol(p, product)
            print(f"{p.run_id}: done, {product.path}")
        status = 0
    except (ProofError, ProductError, AssemblyError, OSError) as error:
        status = 1
        fail(p, str(error).replace("\n", " "))
    except BaseException as error:  # a bug: state it too, with the traceback in the log
        status = 1
        traceback.print_exc()
        fail(p, f"{type(error).__name__}: {error}".replace("\n", " "))
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # YADE's own exit may crash after a run, and would hide the status


def read_parameters(stage: str) -> SimpleNamespace:
    """The row's parameters over the defaults; unknown columns are carried along and recorded."""
    utils.readParamsFromTable(unknownOk=True, noTableOk=True, **COMMON)
    from yade.params import table

    p = SimpleNamespace(**{key: value for key, value in vars(table).items() if not key.startswith("_")})
    p.stage, p.started, p.script = stage, time.time(), sys.argv[0]
    p.run_id = dict(O.tags).get("description", "").strip("'\"") or f"{stage}_by_hand"
    p.product = p.product or f"{p.run_id}.h5"
    return p


def check(p) -> None:
    """Refuse a parameter that is no number or out of its limits, naming run, quantity, value and limit."""
    for name, (low, high) in LIMITS.items():
        value = getattr(p, name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            raise ProofError(f"{name} = {value!r} is outside [{low:g}, {high:g}]")
    for name, choices in (("path", tuple(PATHS)), ("direction", DIRECTIONS)):
        if getattr(p, name) not in choices:
            raise ProofError(f"{name} = {getattr(p, name)!r} is none of {', '.join(choices)}")
    if p.path != "drained" and p.stiffness_scale != 1.0:
        raise ProofError(
            f"stiffness_scale = {p.stiffness_scale:g} with path = {p.path!r}: this path needs the grains' own stiffness, 1"
        )
    if p.heterogeneity not in ("specimen", "grain") or (p.heterogeneity == "grain" and not p.grains):
        raise ProofError(
            f"heterogeneity = {p.heterogeneity!r} with grains = {p.grains!r}: want 'specimen', or 'grain' and a file"
        )


def fail(p, reason: str) -> None:
    """State the failure on stderr and in `<run_id>.failed.json` beside the product that is missing."""
    print(f"{p.run_id}: failed: {reason}", file=sys.stderr)
    path = Path(p.product).with_suffix(".failed.json")
    note = {
        "run_id": p.run_id,
        "reason": reason,
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "log": os.environ.get("YADE_LOG", ""),
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        part.write_text(json.dumps(note) + "\n")
        os.replace(part, path)
    except OSError as error:
        print(f"{p.run_id}: the failure could not be written: {error}", file=sys.stderr)
