"""Counts with a constant total, core-hours spent and predicted, and what a script reads."""

import json

import h5py
import pytest
from campaign_cases import ROOT, finish, make_small

from campaign.config import jobs
from campaign.estimate import estimate
from campaign.files import code_digest
from campaign.folder import record_sum, write_failure
from campaign.products import RunStatus, run_statuses
from campaign.progress import Progress, bar, span
from campaign.status import campaign_status, status_text, summary


@pytest.fixture
def small(tmp_path):
    small = make_small(tmp_path, n=4)
    finish(small, *small.rows[-3:])
    write_failure(small.folder / "products", small.rows[-1].run_id, "blew up: energy error 0.3 > 0.05")
    return small


def test_counts_add_up_to_a_constant_total(small):
    status = campaign_status(small.config, small.folder, small.rows)
    for counts in status["counts"].values():
        assert counts["total"] == sum(v for k, v in counts.items() if k != "total")
    assert status["counts"]["total"] | {"done": 15, "failed": 1, "missing": 2, "total": 18} == status["counts"]["total"]
    assert status["failures"][0]["reason"] == "blew up: energy error 0.3 > 0.05"


def test_json_is_the_whole_truth(small):
    assert json.loads(small.command("status", "--json").stdout)["counts"]["total"]["total"] == 18


def test_text_has_counts_core_hours_and_a_line_a_failure(small):
    text = status_text(campaign_status(small.config, small.folder, small.rows))
    assert "15/18 runs" in text and "core-hours" in text
    assert f"failed: {small.rows[-1].run_id}: blew up: energy error 0.3 > 0.05" in text


def test_time_to_go_follows_the_pace_of_the_runs_so_far(small):
    statuses = run_statuses(small.folder, small.rows)
    status = summary(small.config, small.rows, statuses)
    done = [r for r in small.rows if statuses[r.run_id].status == "done"]
    assert status["core_hours_spent"] == pytest.approx(2.0 * len(done) / 3600)
    # each run took 2 CPU seconds and 2.5 s; the two missing shear runs are about as long as the others
    assert status["core_hours_to_go"] == pytest.approx(2 * 2.0 / 3600, rel=0.3)
    at_once = min(jobs(small.config), 2)
    assert status["seconds_to_go"] == pytest.approx(2 * 2.5 / at_once, rel=0.3)


def test_on_a_cluster_the_time_to_go_follows_from_what_runs_at_once(small):
    statuses = run_statuses(small.folder, small.rows)
    words = ["running"] * 3 + ["queued"] * 4
    statuses |= {r.run_id: RunStatus(r.run_id, word) for r, word in zip(small.rows, words, strict=False)}
    status = summary(small.config, small.rows, statuses)
    assert status["counts"]["total"]["queued"] == 4
    assert status["seconds_to_go"] == estimate(small.rows, statuses, 3).seconds > 0


def test_products_of_other_scripts_are_counted_and_said(small):
    """The stand-in's products name no real version of yade_scripts, so all of them are of another."""
    path = small.product(0)
    with h5py.File(path, "r+") as file:
        file.attrs["script_digest"] = code_digest(ROOT / "yade_scripts")
    record_sum(path)
    status = campaign_status(small.config, small.folder, small.rows)
    assert (status["counts"]["total"]["done"], status["other_scripts"], status["script_versions"]) == (15, 14, 2)
    assert "14 products were made by other yade_scripts than the present ones (2 versions in all)" in status_text(
        status
    )


def test_cost_of_looking_grows_linearly(tmp_path, monkeypatch):
    """Counted in system calls on products, not in seconds: one `stat` a product and no opening, at any size."""
    from campaign import products

    for n in (2, 8):
        small = finish(make_small(tmp_path / str(n), n=n))
        run_statuses(small.folder, small.rows)
        calls = []
        stamp = products.file_stamp
        monkeypatch.setattr(
            products, "file_stamp", lambda path, calls=calls, stamp=stamp: calls.append(path) or stamp(path)
        )
        run_statuses(small.folder, small.rows)
        assert len(calls) == len(small.rows) == 2 + 4 * n
        monkeypatch.undo()


def test_words_for_times_and_bar():
    assert [span(s) for s in (5, 600, 9000)] == ["5 s", "10 min", "2.5 h"]
    assert bar(1, 2, 4) == "[##--] 1/2 runs"


def test_progress_survives_a_closed_terminal(monkeypatch):
    class Gone:
        def write(self, text):
            raise OSError(5, "Input/output error")

        def isatty(self):
            return True

    monkeypatch.setattr("sys.stderr", Gone())
    progress = Progress()
    progress.show("1 of 2")
    progress.end()
