#!/usr/bin/python3
"""Stands in for `yade` where a test needs many runs or a fault; writes the products of `synthetic_runs`.

FAKE_YADE in the environment is JSON: seconds or cpu_seconds (a run's length), products (a folder with consolidate.h5,
probe.h5 and shear.h5 to copy, which is quicker), temporary (leave a temporary file) and faults ({part of a run id:
"abort", "hang", ...}).
"""

import json
import math
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

SUPPORT = Path(__file__).resolve().parent
sys.path[:0] = [str(SUPPORT.parents[1]), str(SUPPORT)]

import synthetic_runs  # noqa: E402

from campaign.folder import write_failure  # noqa: E402
from campaign.plan import PlannedRun  # noqa: E402
from campaign.run_one import read_task  # noqa: E402


def row_of(table: str, line: int, stage: str) -> PlannedRun:
    """The row as the script sees it: every cell evaluated."""
    task = read_task(Path(table), line)
    values = {k: eval(v) for k, v in task.cells.items() if k not in ("description", "product")}
    start = Path(values["start"]).stem
    return PlannedRun(task.text("description"), stage, "coupled", 0, values["seed"], values["mu_iso"],
                      values.get("mu_s", math.nan), values["G_p"], start, 0.0, 0.0, values)  # fmt: skip


def main() -> None:
    began = time.monotonic()
    settings = json.loads(os.environ.get("FAKE_YADE", "{}"))
    table, line = os.environ["YADE_BATCH"].rsplit(":", 1)
    row = row_of(table, int(line), Path(sys.argv[-1]).stem)
    fault = next((name for part, name in settings.get("faults", {}).items() if part in row.run_id), "")
    products = Path("products")
    with open("started.txt", "a") as file:
        file.write(f"{row.run_id}\n")
    time.sleep(settings.get("seconds", 0.0))
    while time.process_time() < settings.get("cpu_seconds", 0.0):
        pass
    if settings.get("temporary"):  # a file as YADE's scripts and libraries make them, and where it lies
        with open("temporary.txt", "a") as file:
            file.write(f"{tempfile.mkstemp()[1]}\n")
    if fault == "abort":
        os.kill(os.getpid(), signal.SIGABRT)
    if fault.startswith("SIG"):
        (products / f"{row.run_id}.checkpoint").write_text("half of the work")
        os.kill(os.getpid(), getattr(signal, fault))
    if fault == "interrupt":
        write_failure(products, row.run_id, "KeyboardInterrupt: ")
        sys.exit(1)
    if fault == "hang":
        time.sleep(3600)
    if fault == "spin":
        while True:
            pass
    if fault == "script error":
        raise NameError("name 'sigma3' is not defined")
    if fault == "silent":
        sys.exit(0)
    if fault == "proof":
        write_failure(products, row.run_id, "not quasi-static: I = 4.1e-3 > 2.5e-3 at strain 0.12")
        sys.exit(1)
    if fault == "unstable" or (fault == "unstable once" and "retry" not in table):
        write_failure(products, row.run_id, "energy error 0.31 > 0.05 at strain 0.02")
        sys.exit(1)
    if fault == "fill the disk":
        with open("ballast", "wb") as file:
            while True:
                file.write(bytes(1 << 16))
    source = Path(settings["products"], f"{row.stage}.h5") if "products" in settings else None
    path = synthetic_runs.write_product(Path(), row, source)
    with open("own_seconds.txt", "a") as file:
        file.write(f"{time.monotonic() - began:.3f}\n")
    if fault == "nan":
        import h5py

        with h5py.File(path, "r+") as file:
            file["record/sigma"][3, 2, 2] = math.nan


if __name__ == "__main__":
    main()
