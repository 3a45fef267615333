"""Time and memory of `plan` for 100 to 100,000 measured pairs.

/usr/bin/python3 tests/benchmarks/bench_plan_size.py [PAIRS ...]       (five minutes)

Writes data/benchmarks/plan_size.csv. The pairs are drawn from the distribution fitted to the 94 reconstructed pairs and
rounded to 1e-4 and 1 MPa. Each `plan` is a process of its own with 8 points and the default settings: 200 replicates of
the test of a copula, 2,000 of that of a marginal, fewer above 2,000 pairs. `cpu_seconds` and `memory_MiB` (largest
resident set) are those of the whole process. Above 5,000 pairs the replicates of the copulas have 5,000 pairs, above
20,000 those of the marginals 20,000.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from bench_rows import append

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from analysis.inputs.joint import fit_joint  # noqa: E402
from analysis.inputs.pairs import read_pairs  # noqa: E402

TABLE = ROOT / "data" / "benchmarks" / "plan_size.csv"
SIZES = (100, 1_000, 5_000, 10_000, 20_000, 100_000)
COLUMNS = ("pairs", "replicates", "cpu_seconds", "memory_MiB")
CONFIG = "[inputs]\npairs = 'pairs.csv'\nbootstrap = 200\n[points]\nn = 8\n[assembly]\nN = 400\n"


def main(sizes: list[int]) -> None:
    """Plan with every number of pairs and write the table anew."""
    joint = fit_joint(read_pairs(ROOT / "data" / "pairs_reconstructed.csv"), n_boot=0).joint
    TABLE.unlink(missing_ok=True)
    for n in sizes:
        with tempfile.TemporaryDirectory() as folder:
            write_pairs(Path(folder) / "pairs.csv", joint.sample(n, np.random.default_rng(n)))
            (Path(folder) / "size.toml").write_text(CONFIG)
            seconds, mebibytes = plan(Path(folder))
        append(TABLE, COLUMNS, dict(zip(COLUMNS, (n, 200, seconds, mebibytes), strict=True)))


def write_pairs(path: Path, pairs: np.ndarray) -> None:
    """Write pairs (n, 2) as a user's CSV file."""
    np.savetxt(path, pairs * [1.0, 1e-9], fmt=("%.4f", "%.3f"), delimiter=",", header="mu_s,G_p_GPa", comments="")


def plan(folder: Path) -> tuple[float, float]:
    """CPU seconds and largest resident set (MiB) of one `plan`."""
    command = [sys.executable, "-m", "campaign", "plan", str(folder / "size.toml"), "--folder", str(folder / "run")]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
    _, code, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(code)
    if process.returncode:
        raise SystemExit(f"plan ended with {process.returncode}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0


if __name__ == "__main__":
    main([int(text) for text in sys.argv[1:]] or list(SIZES))
