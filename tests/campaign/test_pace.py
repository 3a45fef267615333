"""The pace of a machine: kept by a campaign that ran, and used by `plan` for the campaigns beside it."""

import json
from dataclasses import replace

import pytest
import synthetic_results
from paths import ROOT

from campaign import pace, plan
from campaign.config import read_config
from campaign.plan import make_rows
from campaign.products import RunStatus


@pytest.fixture(scope="module")
def rows():
    return make_rows(read_config(ROOT / "campaign" / "demo.toml"), synthetic_results.representative_points(8))


def done(rows, times):
    return {row.run_id: RunStatus(row.run_id, "done", "", {"cpu_seconds": times * row.cpu_seconds}) for row in rows}


def test_a_campaign_beside_another_is_planned_at_its_pace(rows, tmp_path):
    """A machine that takes 0.4 of the predicted time, found in the folder beside and in a campaign's own."""
    pace.keep(tmp_path / "first", rows, done(rows, 0.4))
    predicted = sum(row.cpu_seconds for row in rows) / 3600
    for name in ("first", "second"):
        known = pace.newest(tmp_path / name)
        assert known.core_hours(rows) == pytest.approx(0.4 * predicted)
        assert (known.runs, known.folder.name) == (len(rows), "first")
    assert f"about {0.4 * predicted:.2g} core-hours" in pace.sentence(rows, tmp_path / "second")


def test_without_a_finished_run_or_on_another_machine_nothing_is_said(rows, tmp_path, monkeypatch):
    pace.keep(tmp_path / "first", rows, {row.run_id: RunStatus(row.run_id, "missing") for row in rows})
    assert not (tmp_path / "first").exists() and pace.sentence(rows, tmp_path / "first") == ""
    pace.keep(tmp_path / "first", rows, done(rows, 0.4))
    monkeypatch.setattr(pace, "machine", lambda: "another")
    assert pace.sentence(rows, tmp_path / "first") == ""


@pytest.mark.parametrize("text", [
    "", "[]", '{"machine": "here", "code": "yade", "pace": 3}',
    '{"machine": "here", "code": "yade", "pace": {"shear": "fast"}}',
])  # fmt: skip
def test_a_damaged_file_is_passed_over(rows, tmp_path, monkeypatch, text):
    monkeypatch.setattr(pace, "machine", lambda: "here")
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / pace.FILE).write_text(text)
    assert pace.newest(tmp_path / "second") is None


def test_a_pace_of_other_constants_of_the_prediction_is_not_taken(rows, tmp_path, monkeypatch):
    pace.keep(tmp_path / "first", rows, done(rows, 0.4))
    monkeypatch.setattr(plan, "SHEAR_STEPS", 16.0)
    assert pace.newest(tmp_path / "second") is None


def test_the_pace_of_another_dem_code_is_not_taken(rows, tmp_path):
    pace.keep(tmp_path / "first", rows, done(rows, 0.4))
    lammps = [replace(row, values=row.values | {"code": "lammps"}) for row in rows]
    assert pace.sentence(rows, tmp_path / "second") and pace.sentence(lammps, tmp_path / "second") == ""
    assert pace.sentence([*rows, *lammps], tmp_path / "second") == ""  # a sweep over the code


def test_a_pace_from_before_there_was_a_choice_is_that_of_yade(rows, tmp_path):
    pace.keep(tmp_path / "first", rows, done(rows, 0.4))
    path = tmp_path / "first" / pace.FILE
    kept = json.loads(path.read_text())
    del kept["code"]
    path.write_text(json.dumps(kept))
    assert pace.newest(tmp_path / "second").by_stage and pace.newest(tmp_path / "second", "lammps") is None


def test_stages_keep_their_own_pace(rows, tmp_path):
    """Shear runs three times as slow as predicted, all others as predicted."""
    slow = {row.run_id: replace(status, facts={"cpu_seconds": (3 if row.stage == "shear" else 1) * row.cpu_seconds})
            for row, status in zip(rows, done(rows, 1).values(), strict=True)}  # fmt: skip
    pace.keep(tmp_path / "first", rows, slow)
    by_stage = json.loads((tmp_path / "first" / pace.FILE).read_text())["pace"]
    assert by_stage["shear"] == pytest.approx(3, rel=0.05) and by_stage["consolidate"] < 1.5
