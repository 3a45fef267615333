"""One chain consolidate -> probe -> shear as a row of a benchmark, and what it will cost before it is run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from bench_rows import append
from dem_runs import RunCrashed, RunFailed, row_digest, run

from analysis.micromechanics.stiffness import StiffnessError
from analysis.runs.run_file import RunFileError, read_run
from analysis.runs.states import run_states
from campaign.plan import predicted_seconds, predicted_steps

G_REF, SIGMA_3 = 25.7e9, 100e3
#: A stage may use so many times the CPU time that its whole chain should take, and not less than LEAST_LIMIT seconds.
CPU_LIMIT, LEAST_LIMIT = 5.0, 600
#: What a row holds: quantity and state, in SI units.
RESPONSES = (("eta", "peak"), ("eta", "critical"), ("e", "critical"), ("e_m", "critical"), ("Z", "critical"),
             ("Z_m", "critical"), ("Phi_dev", "critical"), ("G_0", "probe"))  # fmt: skip
NAMES = tuple(f"{symbol}_{state}" for symbol, state in RESPONSES)
MEASURED = ("steps", "cpu_seconds", "failure", "energy_error", "servo_mean_error", *NAMES, "eta_error")


@dataclass(frozen=True)
class Chain:
    """One case: the assembly's file, its number of spheres and seed, density and grain properties, settings of shear.

    `swapped` goes to probe and shear alike (per-grain properties); `finer` is how many times more steps the grading
    needs than the standard one, its smallest grain being smaller.
    """

    assembly: Path
    N: int
    seed: int
    mu_iso: float
    mu_s: float
    G_p: float
    shear: dict
    swapped: dict = field(default_factory=dict)
    finer: float = 1.0

    def stages(self) -> dict:
        """Stage -> the values that its script is given, the product that it starts from left out."""
        own = {"mu_s": self.mu_s, "G_p": self.G_p, **self.swapped}
        first = {"assembly": self.assembly, "mu_iso": self.mu_iso, "G_p": G_REF, "seed": self.seed}
        return {"consolidate": first, "probe": own, "shear": own | {"snapshots": ""} | self.shear}


def fill(path: Path, columns: tuple[str, ...], cases) -> int:
    """Append the row of every (columns of its own, chain); how many crashed, which are printed and have no row."""
    crashed = 0
    for case, chain in cases:
        try:
            append(path, columns, case | row(chain))
        except RunCrashed as error:
            crashed += 1
            print(f"crashed, no row: {error}", flush=True)
    return crashed


def row(chain: Chain) -> dict:
    """Run what is missing of a chain; its responses in SI units, or the failure in words."""
    stages, found = chain.stages(), {"scripts": row_digest(), "failure": ""}
    limit = int(max(LEAST_LIMIT, CPU_LIMIT * cpu_seconds([chain])))
    try:
        start = run("consolidate", cpu_limit=limit, **stages["consolidate"])
        start = run("probe", cpu_limit=limit, start=start, **stages["probe"])
        probe, shear = read_run(start), read_run(run("shear", cpu_limit=limit, start=start, **stages["shear"]))
        sheared = run_states(shear)
        states = sheared.states | run_states(probe).states
    except (RunFailed, RunFileError, StiffnessError) as error:
        return found | {"failure": str(error)}
    found |= {f"{symbol}_{state}": float(states[state][symbol]) for symbol, state in RESPONSES}
    found |= {name: float(shear.proofs[name]) for name in ("energy_error", "servo_mean_error")}
    found |= {"eta_error": float(sheared.errors["critical"]["eta"]), "steps": int(shear.timing["steps"])}
    return found | {"cpu_seconds": float(shear.timing["cpu_seconds"])}


def cpu_seconds(chains: list[Chain]) -> float:
    """Predicted CPU time of chains, each consolidation and probe counted once."""
    runs = {}
    for chain in chains:
        for stage, values in chain.stages().items():
            asked = {"sigma_3": SIGMA_3, "stiffness_scale": 1.0, "density_scaling": 1, "timestep_factor": 1.0} | values
            steps = predicted_steps(stage, asked) * chain.finer
            kept = sorted((k, str(v)) for k, v in values.items())
            start = () if stage == "consolidate" else (chain.assembly, chain.mu_iso)
            runs[stage, start, *kept] = predicted_seconds(stage, steps * chain.N)
    return sum(runs.values())
