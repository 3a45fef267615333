#!/usr/bin/python3
"""Stands in for `lmp` and `mpirun` where a test needs a fault: FAKE_LMP in the environment names it."""

import os
import signal
import sys
from pathlib import Path

LOST = """LAMMPS (29 Sep 2021 - Update 2)
Step v_pressure c_coordination Lx Ly Lz
    5000 100019.93 5.5 0.0016 0.0016 0.0016
ERROR: Lost atoms: original 100 current 58 (src/thermo.cpp:439)
Last command: run 10000
"""
BLOWN = LOST.replace("Lost atoms: original 100 current 58", "Fix halt condition for fix-id blow_up met on step 5000")
RESTLESS = """LAMMPS (29 Sep 2021 - Update 2)
PROOF settled stress_error 3e-4 F_unb 8e-3 Z_change 5e-4
NOT AT REST
"""
SLOTS = "There are not enough slots available in the system to satisfy the 4 slots that were requested"


def main() -> None:
    fault = os.environ.get("FAKE_LMP", "")
    log = Path(sys.argv[sys.argv.index("-log") + 1])
    if fault.startswith("SIG"):
        log.write_text("LAMMPS (29 Sep 2021 - Update 2)\n")
        os.kill(os.getpid(), getattr(signal, fault))
    if fault == "mpirun says SIGKILL":
        sys.exit(print("mpirun noticed that process rank 1 exited on signal 9 (Killed)", file=sys.stderr) or 137)
    if fault == "mpirun says SIGSEGV":
        sys.exit(print("mpirun noticed that process rank 0 exited on signal 11 (Segmentation fault)") or 139)
    if fault == "slots":
        sys.exit(SLOTS)
    texts = {"lost": LOST, "blown": BLOWN, "restless": RESTLESS, "silent": "LAMMPS (29 Sep 2021 - Update 2)\n"}
    log.write_text(texts[fault])
    sys.exit({"restless": 3, "silent": 0}.get(fault, 1))


if __name__ == "__main__":
    main()
