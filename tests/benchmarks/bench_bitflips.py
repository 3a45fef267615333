"""One flipped bit in products, runs.h5 and results.h5: refused with a line, without effect, silent, or a crash?

    python3 tests/benchmarks/bench_bitflips.py [FLIPS]          writes data/benchmarks/bitflips.csv, 100 flips each

Every flip is made at a random place (seeded) of a fresh copy, and a child process reads from it all that the analysis
uses.  Files as they are written now have a checksum (results.h5 and runs.h5 in their first 512 bytes, products in
SHA256SUMS beside them).  The rows "without checksum" show what HDF5 and the checks of the reader find by themselves:
that is how files of earlier versions are read, and products that are opened without their folder.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import pandas as pd  # noqa: E402
import synthetic_results as synthetic  # noqa: E402

from analysis.errors_and_files import GrainScatterError  # noqa: E402
from analysis.results.reader import read_results  # noqa: E402
from analysis.runs.archive import Archive, run_summary, write_archive  # noqa: E402
from analysis.runs.run_file import read_run  # noqa: E402
from campaign.folder import record_sum  # noqa: E402

EXAMPLES = sorted((ROOT / "data" / "laptop" / "example_runs").glob("*.h5"))
OUTCOMES = ("refused", "identical", "silent", "signal", "other")
CRASHES = ("signal", "other")
CHECKSUM, ALONE = "checksum", "without checksum"
#: Bytes before the HDF5 file proper in results.h5 and runs.h5.
USER_BLOCK = 512
SECONDS = 120


def numbers_of_product(path: Path) -> Any:
    """All that `collect` takes from a product."""
    run = read_run(path)
    return (run_summary(run), run.run_id, run.stage, run.parameters, run.timing, run.proofs)


def numbers_of_archive(path: Path) -> Any:
    """All facts, states and curves of an archive."""
    archive = Archive(path)
    return (archive.facts(), [(name, archive[name]) for name in archive])


def numbers_of_results(path: Path) -> Any:
    """All that tables, figures and the report take from a results file."""
    r = read_results(path)
    found: list[Any] = [r.attrs, r.strain, r.densities, r.families, r.points.x, r.points.probability, r.points.id,
                        r.runs.to_csv(), r.pairs, r.inputs, r.diameters, r.grading]  # fmt: skip
    for family in r.families:
        found.append(r.family_points(family).x)
        for mu_iso in r.family_densities(family):
            where = (mu_iso, family)
            found += [r.counts(*where), r.probability(*where), r.bootstrap_probability(*where)]
            for symbol in r.symbols(*where):
                response = r.response(symbol, *where)
                found += [response.values, response.extended, response.packing, vars(response.pdf)]
            for state in ("initial", "peak", "critical", "probe"):
                found.append(r.filled(*where, state))
                found.append(r.standing(state, *where))
                for symbol in r.state_symbols(state, *where):
                    found.append(r.state(state, symbol, *where, withheld="show"))
                    error = r.state_error(state, symbol, *where) if state in ("peak", "critical") else None
                    found.append(error)
    return found


def files(folder: Path) -> Iterator[tuple[str, str, list[Path], Callable[[Path], Any]]]:
    """(kind of file, its protection, the files, what reads them): as they are written now, and without checksums."""
    beside, alone = folder / "products", folder / "alone"
    for place in (beside, alone):
        place.mkdir()
        for path in EXAMPLES:
            shutil.copy(path, place)
            if place == beside:
                record_sum(place / path.name)
    runs, results = folder / "runs.h5", folder / "results.h5"
    write_archive(runs, {path.stem: run_summary(read_run(path)) for path in EXAMPLES})
    shutil.copy(synthetic.example(), results)
    yield "product", CHECKSUM, sorted(beside.glob("*.h5")), numbers_of_product
    yield "runs.h5", CHECKSUM, [runs], numbers_of_archive
    yield "results.h5", CHECKSUM, [results], numbers_of_results
    for path in (runs, results):
        (alone / path.name).write_bytes(path.read_bytes()[USER_BLOCK:])
    yield "product", ALONE, sorted(alone.glob("*_*.h5")), numbers_of_product
    yield "runs.h5", ALONE, [alone / "runs.h5"], numbers_of_archive
    yield "results.h5", ALONE, [alone / "results.h5"], numbers_of_results


def flips(paths: list[Path], numbers: Callable[[Path], Any], count: int, seed: int) -> tuple[Counter, list[str]]:
    """Outcome -> number of flips, and a line for each that was not refused: its place and what happened."""
    rng, outcomes, lines = np.random.default_rng(seed), Counter(), []
    whole = {path: path.read_bytes() for path in paths}
    good = {path: _in_child(numbers, path) for path in paths}
    assert all(outcome == "read" for outcome, _ in good.values()), good
    for k in range(count):
        path = paths[k % len(paths)]
        data = bytearray(whole[path])
        place, bit = int(rng.integers(len(data))), int(rng.integers(8))
        data[place] ^= 1 << bit
        path.write_bytes(data)
        outcome, text = _in_child(numbers, path)
        if outcome == "read":
            outcome = "identical" if text == good[path][1] else "silent"
        outcomes[outcome] += 1
        if outcome != "refused":
            lines.append(f"{path.name}: byte {place}, bit {bit}: {outcome} {text if outcome in CRASHES else ''}")
        elif "\n" in text or path.name not in text and path.stem not in text:
            raise AssertionError(f"not one line that names the file: {text!r}")
        path.write_bytes(whole[path])
    return outcomes, lines


def table(count: int = 100, seed: int = 20) -> tuple[pd.DataFrame, list[str]]:
    """One row per kind of file and protection, and the lines of what was not refused."""
    rows, lines = [], []
    with tempfile.TemporaryDirectory() as folder:
        for kind, protection, paths, numbers in files(Path(folder)):
            outcomes, found = flips(paths, numbers, count, seed)
            rows.append({"file": kind, "protection": protection, "flips": count}
                        | {name: outcomes[name] for name in OUTCOMES})  # fmt: skip
            lines += [f"{protection}: {line}" for line in found]
    return pd.DataFrame(rows), lines


def _in_child(numbers: Callable[[Path], Any], path: Path) -> tuple[str, str]:
    """("read", digest), ("refused", line), ("signal", its name) or ("other", error) of reading a file in a child."""
    inlet, outlet = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            signal.alarm(SECONDS)
            os.write(outlet, pickle.dumps(_outcome(numbers, path)))
        finally:
            os._exit(0)
    os.close(outlet)
    with os.fdopen(inlet, "rb") as pipe:
        text = pipe.read()
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status) or not text:
        return "signal", signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else "no answer"
    return pickle.loads(text)


def _outcome(numbers: Callable[[Path], Any], path: Path) -> tuple[str, str]:
    try:
        return "read", _digest(numbers(path))
    except GrainScatterError as error:
        return "refused", str(error)
    except Exception as error:
        return "other", f"{type(error).__name__}: {error}"[:300]


def _digest(found: Any) -> str:
    """sha256 of nested values, to the last bit."""
    digest = hashlib.sha256()

    def add(value: Any) -> None:
        if is_dataclass(value) and not isinstance(value, type):
            value = asdict(value)
        if isinstance(value, dict):
            value = sorted(value.items())
        if isinstance(value, (list, tuple)):
            digest.update(b"[")
            for item in value:
                add(item)
        elif isinstance(value, np.ndarray):
            plain = value.tolist() if value.dtype == object else np.ascontiguousarray(value).tobytes()
            digest.update(repr((value.dtype, value.shape, plain)).encode())
        else:
            digest.update(repr(value).encode())

    add(found)
    return digest.hexdigest()


if __name__ == "__main__":
    frame, told = table(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
    print(*told, sep="\n")
    print(frame.to_string(index=False))
    frame.to_csv(ROOT / "data" / "benchmarks" / "bitflips.csv", index=False)
