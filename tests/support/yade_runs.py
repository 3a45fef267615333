"""Start YADE from a test: a scene of `tests/yade/scenes`, or a stage of `yade_scripts` with one row of parameters."""

from __future__ import annotations

import json
import os
import subprocess
import time
from pathlib import Path

from paths import ROOT, SCENES


def scene(name: str, yade: str = "yade") -> dict:
    """What a scene prints after JSON; an AssertionError with YADE's output when it prints none."""
    done = _yade(yade, SCENES / f"{name}.py", {})
    lines = [line for line in done.stdout.splitlines() if line.startswith("JSON")]
    assert lines, done.stdout + done.stderr
    return json.loads(lines[-1][4:])


def stage(name: str, folder: Path, **row) -> subprocess.CompletedProcess:
    """One row through a stage in `folder`; text is quoted, the description is the run's id and the product's name."""
    return _yade("yade", ROOT / "yade_scripts" / f"{name}.py", {"YADE_BATCH": f"{_table(folder, row)}:2"}, folder)


def stage_killed_when(name: str, folder: Path, there: Path, **row) -> None:
    """Start a stage and kill it without warning once the file `there` exists."""
    command = _command("yade", ROOT / "yade_scripts" / f"{name}.py")
    env = _environment({"YADE_BATCH": f"{_table(folder, row)}:2"})
    run = subprocess.Popen(command, cwd=folder, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not there.exists() and run.poll() is None:
        time.sleep(0.01)
    run.kill()
    run.wait()


def scene_of_a_row(name: str, folder: Path, **row) -> subprocess.CompletedProcess:
    """One row through a scene of `tests/yade/scenes` that works like a stage."""
    return _yade("yade", SCENES / f"{name}.py", {"YADE_BATCH": f"{_table(folder, row)}:2"}, folder)


def _table(folder: Path, row: dict) -> Path:
    row = {"product": f"{row['description']}.h5"} | row
    cells = {k: f"'{v}'" if isinstance(v, (str, Path)) else repr(v) for k, v in row.items()}
    table = folder / f"{row['description']}.table"
    table.write_text("  ".join(cells) + "\n" + "  ".join(cells.values()) + "\n")
    return table


def _yade(yade: str, script: Path, env: dict, folder: Path | None = None) -> subprocess.CompletedProcess:
    return subprocess.run(_command(yade, script), cwd=folder, env=_environment(env), capture_output=True, text=True,
                          stdin=subprocess.DEVNULL, timeout=900)  # fmt: skip


def _command(yade: str, script: Path) -> list[str]:
    return [yade, "-n", "-x", "-j1", str(script)]


def _environment(extra: dict) -> dict:
    return os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT / "campaign" / "no_servers")} | extra
