"""The fidelity ladder and the runs beyond the paper: bias, scatter and verdict from rows that are known."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent / "benchmarks"))

import bench_beyond
import bench_fidelity
from chain_rows import NAMES, Chain, cpu_seconds

SHEAR = {"inertial_number": 2e-3, "strain_end": 0.35, "timestep_factor": 0.8, "stiffness_scale": 1.0}


def rows(bias, scatter, rungs=(("laptop", 1000, 4), ("N = 8000", 8000, 1), ("rate / 2", 1000, 2)), seed=1):
    """Five points; a rung's values are those of the truth, the laptop's are off by `bias`; both scatter by packing."""
    rng, out = np.random.default_rng(seed), []
    for name, N, packings in rungs:
        noise = scatter * (1000 / N) ** 0.5
        for packing in range(1, packings + 1):
            for k in range(5):
                factor = (1 + (bias if name == "laptop" else 0.0)) * (1 + noise * rng.normal())
                case = {"rung": name, "N": N, "packing": packing, "mu_iso": 0.04, "point": f"p{k}"}
                out.append(case | {"failure": np.nan} | dict.fromkeys(NAMES, (0.5 + 0.1 * k) * factor))
    return pd.DataFrame(out)


def test_bias_and_scatter_are_found_apart():
    table = bench_fidelity.errors(rows(0.03, 0.01), 0.02).set_index(["against", "response"])
    row = table.loc[("N = 8000", "eta_peak")]
    assert abs(row["bias (%)"] - 3) < row["± (%)"] < 2.5
    assert row["scatter, laptop (%)"] == pytest.approx(1.0, rel=0.5) and np.isnan(row["scatter, rung (%)"])
    assert table.loc[("rate / 2", "eta_peak"), "scatter, rung (%)"] == pytest.approx(1.0, rel=0.7)


@pytest.mark.parametrize("bias, scatter, word", [(0.03, 1e-4, "no"), (0.005, 1e-4, "yes"), (0.02, 0.02, "open")])
def test_the_verdict_follows_the_whole_interval(bias, scatter, word):
    assert set(bench_fidelity.errors(rows(bias, scatter), 0.02)["bias within"]) == {word}


def test_a_failed_run_is_counted_and_its_point_left_out():
    frame = rows(0.0, 1e-3)
    frame.loc[(frame.rung == "N = 8000") & (frame.point == "p0"), "failure"] = "servo error"
    table = bench_fidelity.errors(frame, 0.02).set_index("against")
    assert set(table.loc["N = 8000", "cases"]) == {4} and set(table.loc["N = 8000", "failed"]) == {1}


def test_packings_that_both_have_are_compared_at_the_same_size():
    """Common noise of a packing cancels: two packings that are off by 10 % both ways, in both rungs alike."""
    frame = rows(0.0, 0.0)
    frame[list(NAMES)] = frame[list(NAMES)].mul(1 + 0.1 * (-1.0) ** frame.packing, axis=0)
    row = bench_fidelity.errors(frame, 0.02).set_index(["against", "response"]).loc[("rate / 2", "eta_peak")]
    assert row["bias (%)"] == pytest.approx(0, abs=1e-9) and row["± (%)"] == pytest.approx(0, abs=1e-9)


def test_the_predicted_cost_counts_shared_stages_once_and_grows_with_the_size():
    one, two = (Chain(Path("a.h5"), 1000, 1, 0.04, mu_s, 25.7e9, SHEAR) for mu_s in (0.2, 0.3))
    both, alone = cpu_seconds([one, two]), cpu_seconds([one])
    assert alone < both < 2 * alone
    assert cpu_seconds([one, one]) == pytest.approx(alone)
    assert cpu_seconds([Chain(Path("b.h5"), 8000, 1, 0.04, 0.2, 25.7e9, SHEAR)]) == pytest.approx(8 * alone, rel=0.1)


def test_gradings_and_own_pairs_stand_beside_what_they_are_compared_with():
    def row(case, point, packing, draw, value):
        told = {"case": case, "point": point, "packing": packing, "draw": draw, "failure": np.nan}
        return told | dict.fromkeys(NAMES, value)

    frame = pd.DataFrame(
        [row(bench_beyond.STANDARD, "rough", 1, 0, 2.0), row("gap graded", "rough", 1, 0, 2.2)]
        + [row(bench_beyond.ONE_PAIR, "median", p, 0, 1.0 + 0.1 * (p - 2)) for p in (1, 2, 3)]
        + [row(bench_beyond.OWN_PAIRS, "median", 1, d, 1.1 + 0.01 * (d - 2)) for d in (1, 2, 3)]
    )
    table = bench_beyond.compared(frame).set_index(["case", "response"]).sort_index()
    gap, own = table.loc[("gap graded", "Z")].iloc[0], table.loc[(bench_beyond.OWN_PAIRS, "e")].iloc[0]
    assert gap["difference (%)"] == pytest.approx(10) and np.isnan(gap["scatter between draws (%)"])
    assert own["difference (%)"] == pytest.approx(10)
    assert own["scatter between draws (%)"] == pytest.approx(100 * 0.01 / 1.1)
    assert own["scatter between packings (%)"] == pytest.approx(10)
