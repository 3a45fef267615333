"""Starts LAMMPS on an input script, on one core or over MPI, and states in one line why it did not reach its end."""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import subprocess
from functools import partial
from pathlib import Path

from campaign.config import INSTALL_LAMMPS
from campaign.lammps.outputs import LammpsError
from campaign.run_one import CRASHES, die_with_parent

#: How the reason begins of a run whose packing did not come to rest.
RESTLESS = "no equilibrium in the windows allowed"
_STRIPPED = ("OMPI_", "PMIX_")


class MachineError(RuntimeError):
    """The machine is at fault, not the run, which stays missing; the text is one line."""


def program() -> str:
    """The name of LAMMPS; CAMPAIGN_LMP in the environment can name another one."""
    return os.environ.get("CAMPAIGN_LMP") or "lmp"


def command(name: str, ranks: int) -> list[str]:
    """The command line that runs the script <name>.lammps in the present folder; its log is <name>.log."""
    words = [program(), "-in", f"{name}.lammps", "-log", f"{name}.log", "-screen", "none"]
    if ranks == 1:
        return words
    root = ["--allow-run-as-root"] if os.geteuid() == 0 else []
    return [os.environ.get("CAMPAIGN_MPIRUN") or "mpirun", *root, "--bind-to", "none", "-np", str(ranks), *words]


def run_lammps(folder: Path, name: str, ranks: int) -> tuple[str, float]:
    """Run the script <name>.lammps of a folder; returns its log and the CPU seconds of all ranks.

    Raises LammpsError with the reason if the run failed, MachineError if the machine did: no program, no slots for the
    ranks, killed from outside.
    """
    words = command(name, ranks)
    for needed in (program(), *words[:1]):
        if shutil.which(needed) is None:
            raise MachineError(f"{needed}: no such program on this machine; {INSTALL_LAMMPS}")
    env = {k: v for k, v in os.environ.items() if not k.startswith(_STRIPPED)} | {"OMP_NUM_THREADS": "1"}
    if ranks == 1:
        env["OMPI_MCA_ess_singleton_isolated"] = "1"  # Open MPI starts no daemon beside LAMMPS
    # mpirun removes what its ranks share in memory only if it is asked to end; killed, it leaves 4 MiB for each
    end = signal.SIGKILL if ranks == 1 else signal.SIGTERM
    before = _cpu_of_children()
    ended = subprocess.run(words, cwd=folder, env=env, stdin=subprocess.DEVNULL, capture_output=True, text=True,
                           errors="replace", preexec_fn=partial(die_with_parent, end), check=False)  # fmt: skip
    path = folder / f"{name}.log"
    log = path.read_text(errors="replace") if path.exists() else ""
    said = ended.stdout + ended.stderr
    if reason := machine_fault(ended.returncode, said, ranks):
        raise MachineError(reason)
    if ended.returncode or not log:
        raise LammpsError(failure(ended.returncode, log, said))
    return log, _cpu_of_children() - before


def machine_fault(code: int, said: str, ranks: int) -> str:
    """What the machine did to a run that ended with this exit code and these words, in one line; "" if nothing."""
    if re.search(r"(?i)not enough slots|all nodes which are allocated", said):
        return f"mpirun: not enough slots for run.ranks = {ranks} on this machine; use fewer ranks"
    number = ended_by(code, said)
    if number and number not in CRASHES:
        return f"LAMMPS was killed by signal {number} ({signal.Signals(number).name})"
    return ""


def ended_by(code: int, said: str) -> int:
    """The signal that ended LAMMPS or one of its ranks, 0 if none did; a shell around it, and mpirun, add 128."""
    by_mpirun = re.search(r"exited on signal (\d+)", said)
    number = int(by_mpirun[1]) if by_mpirun else -code if code < 0 else code - 128
    return number if number in {*signal.Signals} else 0


def failure(code: int, log: str, said: str) -> str:
    """Why a run failed, in one line."""
    text = log + said
    if lost := re.search(r"Lost atoms: original (\d+) current (\d+)", text):
        return f"blow-up: LAMMPS lost {int(lost[1]) - int(lost[2])} of {lost[1]} grains at step {_last_step(log)}"
    if re.search(r"Fix halt condition for fix-id blow_up", text):
        return f"blow-up: the mean stress exceeds 100 times sigma_3 at step {_last_step(log)}"
    if "\nNOT AT REST" in log:
        found = re.findall(r"^PROOF \w+ (.*)$", log, re.M)
        return f"{RESTLESS}; the last one: {found[-1] if found else 'none'}"
    if errors := re.findall(r"^ERROR[^:\n]*: (.*)$", text, re.M):
        return f"LAMMPS: {' '.join(errors[-1].split())}"
    if number := ended_by(code, said):
        return f"LAMMPS ended by signal {number} ({signal.Signals(number).name})"
    return f"LAMMPS ended with status {code}" + ("" if log else " and wrote no log")


def _last_step(log: str) -> str:
    steps = re.findall(r"^ *(\d+) +-?[\d.einaf+-]+ +[\d.]+ ", log, re.M)
    return steps[-1] if steps else "0"


def _cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def version(log: str) -> str:
    """LAMMPS' version as its log states it."""
    found = re.match(r"LAMMPS \((.*)\)", log)
    return found[1] if found else ""
