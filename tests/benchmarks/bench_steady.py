"""What `stop_when_steady` would save and change: every shear run of the laptop campaign, ended where its proof would.

    /usr/bin/python3 tests/benchmarks/bench_steady.py        (half a minute, no YADE; --table: only the table there is)

The proof is the scripts' own (`yade_scripts.proofs.is_steady`), asked after every window of the records in
data/laptop/runs.h5.  Writes data/benchmarks/steady.csv: a row a density and one for all: runs, how many end early, the
share of strain saved, and by how much eta, e and Z of the critical state differ from those of the whole run (mean and
standard deviation over the runs, relative).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
# Of these two, which need YADE, the proofs take one error and one number; steadiness uses neither.
for name, content in (("rve", {"ProofError": RuntimeError}), ("paths", {"RATE_FLOOR": 0.0})):
    sys.modules[f"yade_scripts.{name}"] = ModuleType(f"yade_scripts.{name}")
    vars(sys.modules[f"yade_scripts.{name}"]).update(content)

from analysis.runs.archive import Archive  # noqa: E402
from analysis.runs.peak_critical import critical_state  # noqa: E402
from yade_scripts.proofs import is_steady  # noqa: E402

RUNS, OUT = ROOT / "data" / "laptop" / "runs.h5", ROOT / "data" / "benchmarks" / "steady.csv"
SYMBOLS = ("eta", "e", "Z")
#: What must be steady in a drained test, as in yade_scripts/paths.py.
DRAINED = SimpleNamespace(steady={"eta": 0.05, "e": 0.01})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="store_true", help="only print the table there is")
    if not parser.parse_args().table:
        archive = Archive(RUNS)
        runs = pd.DataFrame([density(name) | ended(archive[name]) for name in archive if name.startswith("shear_")])
        parts = [(f"{mu_iso:g}", part) for mu_iso, part in runs.groupby("mu_iso")] + [("all", runs)]
        pd.DataFrame([summary(*part) for part in parts]).to_csv(OUT, index=False, float_format="%.4g")
    print(pd.read_csv(OUT).to_string(index=False))


def density(run_id: str) -> dict:
    """The friction of consolidation that a run's id carries."""
    return {"mu_iso": next(float(part[3:]) for part in run_id.split("_") if part.startswith("iso"))}


def windows(rows: list[dict]) -> SimpleNamespace:
    """The rows of a drained compression as the proofs read them."""
    return SimpleNamespace(rows=rows, path=DRAINED, strain=lambda row: row["eps_a"])


def ended(run) -> dict:
    """One run (a Contribution): where it ends with `stop_when_steady`, and what that does to its critical state."""
    strain, values = run.states.eps_a, {symbol: run.states.responses[symbol] for symbol in SYMBOLS}
    rows = [{"eps_a": a, "e": e, "sigma": stress(eta)} for a, e, eta in zip(strain, values["e"], values["eta"],
                                                                            strict=True)]  # fmt: skip
    end = next((k for k in range(4, len(rows)) if is_steady(windows(rows[:k]))), len(rows))
    whole = critical_state(strain, values).mean
    short = critical_state(strain[:end], {symbol: v[:end] for symbol, v in values.items()}).mean
    off = {symbol: short[symbol] / whole[symbol] - 1.0 for symbol in SYMBOLS}
    return {"early": end < len(rows), "end": strain[end - 1] / strain[-1]} | off


def stress(eta: float) -> np.ndarray:
    """A triaxial stress (3, 3) of that stress ratio, in units of the lateral stress."""
    return np.diag([1.0, 1.0, (3.0 + 2.0 * eta) / (3.0 - eta)])


def summary(name: str, runs: pd.DataFrame) -> dict:
    told = {"mu_iso": name, "runs": len(runs), "early": int(runs["early"].sum()), "saved": 1.0 - runs["end"].mean()}
    return told | {f"{symbol}_{word}": getattr(runs[symbol], how)() for symbol in SYMBOLS
                   for word, how in (("bias", "mean"), ("sd", "std"))}  # fmt: skip


if __name__ == "__main__":
    main()
