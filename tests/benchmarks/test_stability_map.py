"""The stability map's cells and verdicts, and the rows of resumable benchmarks, from numbers that are known."""

from __future__ import annotations

import bench_stability
import numpy as np
import pandas as pd
import pytest
from bench_rows import append, finished


def rows(count=60, seed=1):
    """Cells that scatter about their references as packings of 64, 200 and 500 grains do, none of them wrong."""
    rng, out = np.random.default_rng(seed), []
    for k in range(count):
        N = (64, 200, 500)[k % 3]
        width = 0.012 * (200 / N) ** 0.5
        mine = {"e_0": 0.6, "Z_0": 5.0, "eta": 0.7, "e": 0.6, "Z": 4.5}
        cell = {f"{name}_reference": value * (1 + 1e-9 * k) for name, value in mine.items()}
        cell |= {f"{name}_scatter": width for name in ("e_0", "Z_0")} | mine
        cell |= {name: mine[name] * (1 + width * rng.normal()) for name in ("e_0", "Z_0", "eta")}
        out.append({"axis": "size", "N": N, "outcome": np.nan, "reason": np.nan} | cell)
    return pd.DataFrame(out)


def test_there_are_150_cells_and_no_two_come_to_the_same_run():
    cells = list(bench_stability.cells())
    texts = {str(sorted((bench_stability.BASE | bench_stability.DEFAULT_SERVO | changes).items()))
             for *_, changes in cells}  # fmt: skip
    assert len(cells) == len(texts) >= 150


def test_of_twelve_cells_sheared_to_the_end_plan_refuses_those_that_are_too_thin():
    refused = []
    for axis, N, words, changes in bench_stability.cells():
        if axis == "full strain":
            try:
                bench_stability.check_cell(bench_stability._campaign(bench_stability.BASE | changes))
            except bench_stability.ConfigError as error:
                assert f"N = {N} " in str(error)
                refused.append((N, words.split()[1]))
    assert refused == [(80, "0.4"), (100, "0.4"), (400, "1"), (1000, "0.4"), (1000, "0.4")]
    assert len(bench_stability.FULL_STRAIN) == 12


def test_every_path_in_every_direction_has_its_cells_and_the_other_cells_are_drained_compression():
    """24 cells or more; which keys a run gets must not change where none was given, or its product is not found."""
    tests = [(changes["path"], changes["direction"]) for axis, *_, changes in bench_stability.cells()
             if axis == "path x direction"]  # fmt: skip
    assert len(tests) >= 24 and len(set(tests)) == 5 and ("drained", "compression") not in tests
    assert all("path" not in changes for axis, *_, changes in bench_stability.cells() if axis != "path x direction")
    assert "path" not in bench_stability.BASE
    fine = bench_stability.finer(bench_stability.BASE | {"path": "undrained", "direction": "extension"})
    assert (fine["path"], fine["direction"]) == ("undrained", "extension")


def test_the_mean_stress_counts_where_it_is_compared():
    """p' of an undrained cell that is off is wrong; a cell without p' is judged by the rest."""
    frame = rows().assign(p=np.nan, p_reference=np.nan)
    frame.loc[[1, 4, 7], "p_reference"] = 2e5
    frame.loc[[1, 4], "p"] = 2.5e5, 2.01e5
    found = bench_stability.judged(frame)
    assert found.loc[[0, 1, 4, 7], "reason"].tolist() == ["", "p", "", "p"]


def test_a_reference_is_sheared_no_further_than_its_cell_is_compared():
    case = bench_stability.BASE | {"strain_end": 0.4}
    assert "strain_end" not in bench_stability.finer(case)


def test_what_packings_scatter_by_is_not_called_wrong():
    outcome = pd.concat([bench_stability.judged(rows(seed=seed)) for seed in range(20)]).outcome
    assert set(outcome) <= {"right", "wrong"} and (outcome == "wrong").mean() < 0.02


def test_a_wrong_number_is_named():
    frame = rows()
    for name, factor in (("e_0", 1.05), ("eta", 1.08), ("e", 1.01), ("Z", 0.9)):
        frame.loc[1, name] = factor * frame.loc[1, f"{name}_reference"]  # row 1 is a cell of 200 grains
    frame.loc[4, "Z_0"] = np.nan
    found = bench_stability.judged(frame)
    assert found.loc[1, ["outcome", "reason"]].tolist() == ["wrong", "e_0 eta e Z"]
    assert found.loc[4, ["outcome", "reason"]].tolist() == ["wrong", "Z_0"]


CELLS = ("0.03", "0.06", "0.1", "0.15", "0.4", "0.65")


def off_cells(*changes):
    """Six cells of friction CELLS, of which the first has collapsed; changes: (number, quantity, factor)."""
    frame = rows(6).assign(axis="friction", value=CELLS, second="", repeats=1)
    for k, name, factor in changes:
        frame.loc[k, name] = factor * frame.loc[k, f"{name}_reference"]
    return frame


def repeated(monkeypatch, judged, found, refuse=lambda n: False):
    """The verdicts after repeats in which `found` gives eta and e of a cell from its case; references have 0.7, 0.6."""
    calls = []

    def sheared(start, case):
        calls.append(case)
        if refuse(len(calls)):
            raise bench_stability.RunFailed("servo")
        eta, e = found(case) if case["density_scaling"] else (0.7, 0.6)
        return {"eta": eta, "e": e, "Z": 4.5}, {}

    monkeypatch.setattr(bench_stability, "sheared", sheared)
    monkeypatch.setattr(bench_stability, "consolidated", lambda case: None)
    return bench_stability.judged(bench_stability.repeated(judged, 1)), calls


def test_cells_whose_shear_is_off_are_judged_by_the_mean_of_repeats(monkeypatch):
    """A refused repeat is left out with its partner, a wrong start is not repeated, a collapsed packing is said."""
    judged = bench_stability.judged(off_cells((0, "e", 1.4), (1, "eta", 1.4), (4, "eta", 1.4), (2, "e_0", 1.4)))
    assert judged.outcome.tolist() == ["wrong", "wrong", "wrong", "right", "wrong", "right"]
    factors = {0.03: (1.0, 1.015), 0.4: (1.4, 1.0)}
    done, calls = repeated(monkeypatch, judged, lambda case: np.multiply(
        (0.7, 0.6), factors.get(round(case["mu_s"], 6), (1.0, 1.0))), refuse=lambda n: n == 2)  # fmt: skip
    assert done.outcome.tolist() == ["said", "right", "wrong", "right", "wrong", "right"]
    assert done.reason.tolist() == ["e", "", "e_0", "", "eta", ""]
    assert done.repeats.tolist() == [8, 8, 1, 1, 8, 1] and sorted(done.pairs.dropna()) == [7, 8, 8]
    assert {case["seed"] for case in calls if case["mu_s"] == 0.03} == set(range(2, 10))
    assert len({case["mu_s"] for case in calls if case["seed"] == 1}) == 2 * 8


@pytest.mark.parametrize(("eta", "e", "e_0"), [(1.4, 1.0, 1.0), (1.0, 1.03, 1.0), (1.0, 1.015, 1.1)])
def test_a_collapse_excuses_no_more_than_is_said_of_it(monkeypatch, eta, e, e_0):
    """Nothing but e, and that within 2 %, and not where the packing was wrong before."""
    judged = bench_stability.judged(off_cells((0, "eta", eta), (0, "e", e), (0, "e_0", e_0)))
    done, _ = repeated(monkeypatch, judged, lambda case: (0.7 * eta, 0.6 * e))
    assert done.outcome.tolist() == ["wrong"] + 5 * ["right"]


def test_a_mean_of_repeats_that_is_off_is_open_as_far_as_it_is_not_known(monkeypatch):
    """Repeats that scatter by 20 % about a mean that is off tell nothing; the same mean without scatter is wrong."""
    judged = bench_stability.judged(off_cells((1, "eta", 1.4)))
    for width, word in ((0.2, "open"), (0.0, "wrong")):
        turns = iter(range(8))
        done, _ = repeated(monkeypatch, judged, lambda case: (0.7 * (1.08 + width * (-1) ** next(turns)), 0.6))  # noqa: B023
        assert done.outcome.tolist() == ["right", word, "right", "right", "right", "right"]


def test_too_few_repeats_leave_the_first_run_and_a_crash_is_wrong(monkeypatch):
    judged = bench_stability.judged(off_cells((1, "eta", 1.4)))
    done, _ = repeated(monkeypatch, judged, lambda case: (0.7, 0.6), refuse=lambda n: n > 4)
    assert (done.outcome[1], done.pairs[1], done.eta[1]) == ("wrong", 2, judged.eta[1])

    def crash(case):
        raise bench_stability.RunCrashed("signal")

    done, _ = repeated(monkeypatch, judged, crash)
    assert done.outcome[1] == "wrong" and np.isnan(done.eta[1])


def test_refused_and_crashed_cells_stay_as_they_ended():
    ends = pd.DataFrame([{"N": 200, "outcome": "refused", "reason": "too fast"},
                         {"N": 200, "outcome": "wrong", "reason": "crashed: signal"}])  # fmt: skip
    found = bench_stability.judged(pd.concat([rows(), ends], ignore_index=True)).iloc[-2:]
    assert found.outcome.tolist() == ["refused", "wrong"] and found.reason.tolist() == ["too fast", "crashed: signal"]


def test_rows_of_a_file_with_other_columns_are_kept_under_the_new_ones(tmp_path):
    path = tmp_path / "rows.csv"
    append(path, ("scripts", "old", "value"), {"scripts": "a", "old": 1, "value": 2.5})
    append(path, ("scripts", "value", "new"), {"scripts": "b", "value": 3.5, "new": 4})
    assert path.read_text().splitlines() == ["scripts,value,new", "a,2.5,", "b,3.5,4"]
    assert finished(path, ("scripts",)) == {("a",), ("b",)}
