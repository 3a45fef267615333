"""The fidelity ladder and the runs beyond the paper: bias, scatter and verdict from rows that are known."""

from __future__ import annotations

import sys
from pathlib import Path

import bench_beyond
import bench_fidelity
import numpy as np
import pandas as pd
import pytest
from bench_rows import append
from chain_rows import NAMES, Chain, cpu_seconds

from campaign.config import read_config

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
    return pd.DataFrame(out).astype({"failure": object})


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
    assert set(table["failed, laptop"]) == {0} and set(table.loc["rate / 2", "failed"]) == {0}


def test_a_rung_whose_chains_all_failed_keeps_its_count():
    frame = rows(0.0, 1e-3)
    frame.loc[frame.rung == "N = 8000", "failure"] = "servo error"
    table = bench_fidelity.errors(frame, 0.02).set_index("against").loc["N = 8000"]
    assert set(table["cases"]) == {0} and set(table["failed"]) == {5} and set(table["bias within"]) == {"open"}


def test_packings_that_both_have_are_compared_at_the_same_size():
    """Common noise of a packing cancels: two packings that are off by 10 % both ways, in both rungs alike."""
    frame = rows(0.0, 0.0)
    frame[list(NAMES)] = frame[list(NAMES)].mul(1 + 0.1 * (-1.0) ** frame.packing, axis=0)
    for lost in (None, "laptop", "rate / 2"):  # with a failure a point has one packing less, in both rungs
        frame.loc[(frame.rung == lost) & (frame.packing == 1) & (frame.point == "p2"), "failure"] = "servo error"
        row = bench_fidelity.errors(frame, 0.02).set_index(["against", "response"]).loc[("rate / 2", "eta_peak")]
        assert row["cases"] == 5 and row["failed, laptop"] == (lost is not None)
        assert row["bias (%)"] == pytest.approx(0, abs=1e-9) and row["± (%)"] == pytest.approx(0, abs=1e-9)


def test_noise_that_all_points_share_widens_by_the_quantile_of_its_few_packings():
    frame = rows(0.0, 0.0)
    offset = np.array([0.01, -0.01, 0.02, -0.02])[frame.packing - 1] * (frame.rung == "laptop")
    frame[list(NAMES)] = frame[list(NAMES)].mul(1 + offset, axis=0)
    row = bench_fidelity.errors(frame, 0.02).set_index(["against", "response"]).loc[("N = 8000", "eta_peak")]
    noise = np.std([0.01, -0.01, 0.02, -0.02], ddof=1) * np.sqrt(1 / 4 + 1 / 8)
    assert row["± (%)"] == pytest.approx(100 * 3.182 * noise, rel=1e-3)


@pytest.fixture
def ladder(tmp_path, monkeypatch):
    """The rungs of today, with the benchmark's files in an empty folder and its command line set to --table."""
    monkeypatch.setattr(bench_fidelity, "ROWS", tmp_path / "rows.csv")
    monkeypatch.setattr(bench_fidelity, "TABLE", tmp_path / "table.csv")
    monkeypatch.setattr(sys, "argv", ["bench_fidelity.py", "--table"])
    return bench_fidelity.rungs(read_config(bench_fidelity.ROOT / "campaign" / "laptop.toml"))


def told(ladder, **columns):
    """Rows of all points in one packing of the lowest rung and of the one at half its rate."""
    frame = rows(0.01, 0.0, (("laptop", 1000, 1), ("rate / 2", 1000, 1)))
    frame["settings"] = frame.rung.map({name: bench_fidelity.hashed(values) for name, (values, _) in ladder.items()})
    return frame.assign(scripts="abc", **columns).reindex(columns=bench_fidelity.COLUMNS)


def test_without_rows_to_compare_one_line_says_so(ladder):
    with pytest.raises(SystemExit, match="rows.csv is missing: no rung has been run$"):
        bench_fidelity.main()
    frame = told(ladder)
    frame[frame.rung != "laptop"].to_csv(bench_fidelity.ROWS, index=False)
    with pytest.raises(SystemExit, match="no finished chain of the rung 'laptop' to compare with"):
        bench_fidelity.main()
    frame[frame.rung == "laptop"].to_csv(bench_fidelity.ROWS, index=False)
    with pytest.raises(SystemExit, match="no rung but 'laptop' has rows yet"):
        bench_fidelity.main()
    assert not bench_fidelity.TABLE.exists()


def test_rows_of_other_settings_are_counted_and_not_used(ladder, capsys):
    old, new = told(ladder, settings="00000000"), told(ladder)
    old[list(NAMES)] *= 2.0
    pd.concat([old, new]).to_csv(bench_fidelity.ROWS, index=False)
    bench_fidelity.main()
    assert "10 of 20 rows left out, of other scripts or settings" in capsys.readouterr().out
    table = pd.read_csv(bench_fidelity.TABLE)
    assert set(table["against"]) == {"rate / 2"} and table["bias (%)"].to_numpy() == pytest.approx(1.0)


def test_a_row_has_the_rate_of_its_run_and_a_key_of_its_own_settings(ladder, monkeypatch):
    monkeypatch.setattr(bench_fidelity, "assembly", lambda N, packing: Path("a.h5"))
    values = ladder["laptop"][0] | {"inertial_number": 2.4e-3}
    some = {case["point"]: case for case, _ in bench_fidelity.cases("laptop", values, (1,), [0.04])}
    assert some["p75"]["inertial_number"] == 2.4e-3
    assert some["p96"]["inertial_number"] == pytest.approx(7.2e-4 / 0.48)
    row = some["p96"] | {"scripts": bench_fidelity.row_digest()}
    append(bench_fidelity.ROWS, bench_fidelity.COLUMNS, row)
    left = bench_fidelity.cases("laptop", values, (1,), [0.04])
    assert {case["point"] for case, _ in left} == {"p04", "p25", "p50", "p75"}
    assert len(bench_fidelity.cases("laptop", values | {"N": 600}, (1,), [0.04])) == 5


def test_the_predicted_cost_counts_shared_stages_once_and_grows_with_the_size():
    one, two = (Chain(Path("a.h5"), 1000, 1, 0.04, mu_s, 25.7e9, SHEAR) for mu_s in (0.2, 0.3))
    both, alone = cpu_seconds([one, two]), cpu_seconds([one])
    assert alone < both < 2 * alone
    assert cpu_seconds([one, one]) == pytest.approx(alone)
    assert cpu_seconds([Chain(Path("b.h5"), 8000, 1, 0.04, 0.2, 25.7e9, SHEAR)]) == pytest.approx(8 * alone, rel=0.1)


def beyond(case, point, packing, draw, value, failure=np.nan):
    kept = {"case": case, "point": point, "packing": packing, "draw": draw, "failure": failure}
    return kept | dict.fromkeys(NAMES, value)


def test_gradings_and_own_pairs_stand_beside_what_they_are_compared_with():
    frame = pd.DataFrame(
        [beyond(bench_beyond.STANDARD, "rough", 1, 0, 2.0), beyond("gap graded", "rough", 1, 0, 2.2)]
        + [beyond(bench_beyond.ONE_PAIR, "median", p, 0, 1.0 + 0.1 * (p - 2)) for p in (1, 2, 3)]
        + [beyond(bench_beyond.OWN_PAIRS, "median", 1, d, 1.1 + 0.01 * (d - 2)) for d in (1, 2, 3)]
    )
    table = bench_beyond.compared(frame).set_index(["case", "response"]).sort_index()
    gap, own = table.loc[[("gap graded", "Z")]].iloc[0], table.loc[[(bench_beyond.OWN_PAIRS, "e")]].iloc[0]
    assert gap["difference (%)"] == pytest.approx(10) and np.isnan(gap["scatter between draws (%)"])
    assert own["difference (%)"] == pytest.approx(100 * (1.1 / 0.9 - 1)) and own["runs"] == 3
    assert own["mean of the other"] == pytest.approx(0.9)
    assert own["scatter between draws (%)"] == pytest.approx(100 * 0.01 / 1.1)
    assert own["scatter between packings (%)"] == pytest.approx(10)


def test_only_points_that_both_gradings_have_are_compared_and_failures_of_both_counted():
    frame = pd.DataFrame(
        [beyond(bench_beyond.STANDARD, "median", 1, 0, 1.0), beyond(bench_beyond.STANDARD, "rough", 1, 0, np.nan, "no")]
        + [beyond("gap graded", "median", 1, 0, 1.2), beyond("gap graded", "rough", 1, 0, 5.0)]
        + [beyond("well graded", point, 1, 0, np.nan, "no") for point in ("median", "rough")]
    )
    table = bench_beyond.compared(frame).set_index("case")
    assert table.loc["gap graded", "difference (%)"].to_numpy() == pytest.approx(20)
    assert set(table.loc["gap graded", "runs"]) == {1}
    assert set(table.loc["gap graded", "failed"]) == {0} and set(table["failed of the other"]) == {1}
    assert set(table.loc["well graded", "failed"]) == {2} and table.loc["well graded", "mean"].isna().all()
