"""Real YADE runs for the benchmarks: one stage at a time, each run once, its product kept in build/ and found again.

A run is named after a hash of all its parameters, the packing it starts from and the scripts' own digest included:
change the protocol, and the benchmark's runs are made anew.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import resource
import signal
import subprocess
import sys
import threading
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.assembly import make_assembly, write_assembly  # noqa: E402
from analysis.runs.run_file import Run, read_run  # noqa: E402
from campaign.run_one import MACHINE, die_with_parent, run_environment  # noqa: E402

BUILD = Path(os.environ.get("BENCH_FOLDER", ROOT / "build" / "bench"))
D50, SIGMA_LN = 0.248e-3, 0.174
LONG_DOUBLE = ROOT / "tests" / "yade" / "scenes" / "in_long_double.py"
#: The analysis that makes a row of a run, beside the scripts that make the run.
MEASURING = (
    "runs/run_file", "runs/states", "runs/peak_critical", "micromechanics/snapshot", "micromechanics/metrics",
    "micromechanics/grading", "micromechanics/stiffness",
)  # fmt: skip
#: Scripts whose runs repeat earlier ones' to the last digit; rows go by the earlier name.  To be entered, proven by
#: `bench_dem.py --again`, and taken out if that fails.
SAME_NUMBERS = {"514e813fcc": "168d003437", "e57397b0ee": "168d003437", "8be99cf698": "168d003437"}
#: A stated reason that tells of a bug, not of physics.
BUG = re.compile(r"\w*(Error|Exception|Interrupt)\b")
_busy: dict[str, threading.Lock] = defaultdict(threading.Lock)  # one a file, so that threads share its run


class RunFailed(RuntimeError):
    """A run that stated its failure; the text is its reason."""


class RunStopped(RunFailed):
    """A run that used more CPU time than it may."""


class RunCrashed(RuntimeError):
    """A run that ended by a bug, a signal or the machine's fault: no result, and no row of a benchmark."""


def scripts() -> str:
    """Which scripts make the runs: the first figures of a sha256 over their code, comments and docstrings left out."""
    return _sha256(sorted((ROOT / "yade_scripts").glob("*.py")))[:10]


def digest() -> str:
    """Whose numbers the scripts make: their own, or earlier scripts' where they are known to be the same."""
    return SAME_NUMBERS.get(scripts(), scripts())


def row_digest() -> str:
    """Which code makes a row of runs: that of the scripts and, after a dash, of the analysis that measures them."""
    sha = hashlib.sha256()
    for name in MEASURING:
        sha.update(ast.dump(_Bare().visit(_code(ROOT / "analysis" / f"{name}.py"))).encode())
    return f"{digest()}-{sha.hexdigest()[:4]}"


def _sha256(paths) -> str:
    sha = hashlib.sha256()
    for path in paths:
        sha.update(ast.dump(_code(path)).encode())
    return sha.hexdigest()


def _code(path: Path) -> ast.Module:
    """A file's code without comments and docstrings."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.FunctionDef, ast.ClassDef)) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return tree


class _Bare(ast.NodeTransformer):
    """Code without what cannot change a number: imports, and the type hints of functions."""

    def visit_Import(self, node):
        return None

    visit_ImportFrom = visit_Import

    def visit_arg(self, node):
        node.annotation = None
        return node

    def visit_AnnAssign(self, node):
        if node.value is None:
            return None
        return ast.copy_location(ast.Assign([node.target], self.visit(node.value)), node)

    def visit_FunctionDef(self, node):
        node.returns = None
        return self.generic_visit(node)


def assembly(N: int, seed: int, sigma_ln: float = SIGMA_LN, distribution: str = "lognormal") -> Path:
    """The assembly file of that size and seed, made when missing."""
    path = BUILD / f"assembly_{distribution}_{sigma_ln:g}_{N}_{seed}.h5"
    with _busy[path.name]:
        if not path.exists():
            write_assembly(
                path, make_assembly(N, D50, sigma_ln, seed, distribution), {"N": N, "seed": seed, "sigma_ln": sigma_ln}
            )
    return path


def run(stage: str, yade: str = "yade", cpu_limit: int = 7200, scene: Path | None = None, **values) -> Path:
    """The product of a stage with these parameters (SI), run when missing, for at most cpu_limit seconds of CPU time.

    scene: a script in place of the stage's own.

    Raises RunFailed with the stated reason, which is kept as the product is, and RunCrashed, which is not.
    """
    script, *words = _scene(stage, yade) if scene is None else [str(scene)]
    own = [_sha256([Path(script)])] if scene or words else []
    texts = {k: str(v) for k, v in values.items()}
    identity = json.dumps([stage, scripts(), texts, yade, *own], sort_keys=True)
    name = f"{stage}_{hashlib.sha256(identity.encode()).hexdigest()[:12]}"
    product, failure = BUILD / f"{name}.h5", BUILD / f"{name}.failed.json"
    with _busy[name]:
        _run_if_missing([script, *words], yade, name, values, cpu_limit)
    if not product.exists():
        told = json.loads(failure.read_text())
        raise (RunStopped if "cpu_limit" in told else RunFailed)(told["reason"])
    return product


def _run_if_missing(script: list[str], yade: str, name: str, values: dict, cpu_limit: int) -> None:
    """One YADE process for the row, unless its product or its stated failure is there; it dies with this process."""
    product, failure = BUILD / f"{name}.h5", BUILD / f"{name}.failed.json"
    if failure.exists() and json.loads(failure.read_text()).get("cpu_limit", cpu_limit) < cpu_limit:
        failure.unlink()  # it was stopped earlier than it would be now
    if not product.exists() and not failure.exists():
        BUILD.mkdir(parents=True, exist_ok=True)
        row = {"description": name, "product": f"'{product}'"} | {
            k: f"'{v}'" if isinstance(v, (str, Path)) else repr(v) for k, v in values.items()
        }
        table = BUILD / f"{name}.table"
        table.write_text("  ".join(row) + "\n" + "  ".join(row.values()) + "\n")
        log = BUILD / f"{name}.log"

        def limited():
            die_with_parent()
            hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
            resource.setrlimit(resource.RLIMIT_CPU, (cpu_limit if hard < 0 else min(cpu_limit, hard), hard))

        with open(log, "w") as out:
            ended = subprocess.run(
                [yade, "-n", "-x", "-j1", *script], stdin=subprocess.DEVNULL,
                env=run_environment() | {"YADE_BATCH": f"{table}:2"}, stdout=out, stderr=subprocess.STDOUT, check=False,
                preexec_fn=limited,
            )  # fmt: skip
        if product.exists():
            return
        if ended.returncode == -signal.SIGXCPU:
            told = {"reason": f"stopped: CPU time, limit {cpu_limit} s", "cpu_limit": cpu_limit}
            failure.write_text(json.dumps(told))
        reason = json.loads(failure.read_text())["reason"] if failure.exists() else f"signal or exit {ended.returncode}"
        if not failure.exists() or BUG.match(reason) or re.search(MACHINE, reason):
            failure.unlink(missing_ok=True)
            raise RunCrashed(f"{name}: {reason}, see {log}")


def _scene(stage: str, yade: str) -> list[str]:
    """The script of a stage; where YADE's numbers are not doubles, the scene that makes doubles of what it reads."""
    if yade == "yade":
        return [str(ROOT / "yade_scripts" / f"{stage}.py")]
    return [str(LONG_DOUBLE), stage]


def chain(
    N: int, seed: int, mu_iso: float, mu_s: float, G_p: float, probe: dict | None = None, **shear
) -> tuple[Run, Run]:
    """Consolidate (at the reference modulus), probe and shear; returns the probe's and the shear's run."""
    first = run("consolidate", assembly=assembly(N, seed), mu_iso=mu_iso, G_p=25.7e9, seed=seed)
    rest = run("probe", start=first, mu_s=mu_s, G_p=G_p, **(probe or {}))
    return read_run(rest), read_run(run("shear", start=rest, mu_s=mu_s, G_p=G_p, **shear))
