"""Real YADE runs for the benchmarks: one stage at a time, each run once, its product kept in build/ and found again.

A run is named after a hash of all its parameters, the packing it starts from and the scripts' own digest included:
change the protocol, and the benchmark's runs are made anew.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import subprocess
import sys
import threading
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.assembly import make_assembly, write_assembly  # noqa: E402
from analysis.runfile import Run, read_run  # noqa: E402
from campaign.row import closed_doors  # noqa: E402

BUILD = Path(os.environ.get("BENCH_FOLDER", ROOT / "build" / "bench"))
D50, SIGMA_LN = 0.248e-3, 0.174
_busy: dict[str, threading.Lock] = defaultdict(threading.Lock)  # one a file, so that threads share its run


class RunFailed(RuntimeError):
    """A run that stated its failure; the text is its reason."""


def digest() -> str:
    """Which scripts make the runs: the first figures of a sha256 over their code, comments and docstrings left out."""
    sha = hashlib.sha256()
    for path in sorted((ROOT / "yade_scripts").glob("*.py")):
        tree = ast.parse(path.read_text())
        for node in ast.walk(tree):
            if isinstance(node, (ast.Module, ast.FunctionDef, ast.ClassDef)) and ast.get_docstring(node) is not None:
                node.body = node.body[1:]
        sha.update(ast.dump(tree).encode())
    return sha.hexdigest()[:10]


def assembly(N: int, seed: int, sigma_ln: float = SIGMA_LN, distribution: str = "lognormal") -> Path:
    """The assembly file of that size and seed, made when missing."""
    path = BUILD / f"assembly_{distribution}_{sigma_ln:g}_{N}_{seed}.h5"
    with _busy[path.name]:
        if not path.exists():
            write_assembly(
                path, make_assembly(N, D50, sigma_ln, seed, distribution), {"N": N, "seed": seed, "sigma_ln": sigma_ln}
            )
    return path


def run(stage: str, yade: str = "yade", **values) -> Path:
    """The product of a stage with these parameters (SI), run when missing.  Raises RunFailed with the stated reason."""
    identity = json.dumps([stage, digest(), {k: str(v) for k, v in values.items()}, yade], sort_keys=True)
    name = f"{stage}_{hashlib.sha256(identity.encode()).hexdigest()[:12]}"
    product, failure = BUILD / f"{name}.h5", BUILD / f"{name}.failed.json"
    with _busy[name]:
        _run_if_missing(stage, yade, name, values)
    if not product.exists():
        raise RunFailed(json.loads(failure.read_text())["reason"])
    return product


def _run_if_missing(stage: str, yade: str, name: str, values: dict) -> None:
    """One YADE process for the row, unless its product or its stated failure is there."""
    product, failure = BUILD / f"{name}.h5", BUILD / f"{name}.failed.json"
    if not product.exists() and not failure.exists():
        BUILD.mkdir(parents=True, exist_ok=True)
        row = {"description": name, "product": f"'{product}'"} | {
            k: f"'{v}'" if isinstance(v, (str, Path)) else repr(v) for k, v in values.items()
        }
        table = BUILD / f"{name}.table"
        table.write_text("  ".join(row) + "\n" + "  ".join(row.values()) + "\n")
        log = BUILD / f"{name}.log"
        with open(log, "w") as out:
            subprocess.run(
                [yade, "-n", "-x", "-j1", str(ROOT / "yade_scripts" / f"{stage}.py")], stdin=subprocess.DEVNULL,
                env=closed_doors() | {"YADE_BATCH": f"{table}:2"}, stdout=out, stderr=subprocess.STDOUT, check=False,
            )  # fmt: skip
        if not product.exists() and not failure.exists():
            raise RunFailed(f"{name}: YADE ended without a word, see {log.name}")


def chain(
    N: int, seed: int, mu_iso: float, mu_s: float, G_p: float, probe: dict | None = None, **shear
) -> tuple[Run, Run]:
    """Consolidate (at the reference modulus), probe and shear; returns the probe's and the shear's run."""
    first = run("consolidate", assembly=assembly(N, seed), mu_iso=mu_iso, G_p=25.7e9, seed=seed)
    rest = run("probe", start=first, mu_s=mu_s, G_p=G_p, **(probe or {}))
    return read_run(rest), read_run(run("shear", start=rest, mu_s=mu_s, G_p=G_p, **shear))
