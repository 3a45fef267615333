"""One flipped bit in a file as it is written now is refused in one line; a short version of bench_bitflips.py."""

from __future__ import annotations

import bench_bitflips as bench
import numpy as np
import pytest


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return list(bench.files(tmp_path_factory.mktemp("flips")))


@pytest.mark.parametrize("kind, seed", [("product", 1), ("runs.h5", 2), ("results.h5", 3)])
def test_ten_flipped_bits_are_all_refused_with_a_line(files, kind, seed):
    _, _, paths, numbers = next(row for row in files if row[:2] == (kind, bench.CHECKSUM))
    outcomes, lines = bench.flips(paths, numbers, 10, seed)
    assert outcomes == {"refused": 10}, lines


def test_a_silent_change_and_a_crash_are_told_apart(tmp_path):
    path = tmp_path / "numbers"
    path.write_bytes(bytes(8))
    outcomes, _ = bench.flips([path], lambda p: np.frombuffer(p.read_bytes()), 3, 1)
    assert outcomes == {"silent": 3}
    assert bench._in_child(lambda _: bench.os.kill(bench.os.getpid(), 9), path) == ("signal", "SIGKILL")
    assert bench._in_child(lambda _: 1 / 0, path)[0] == "other"
