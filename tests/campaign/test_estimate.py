"""The time to go in simulated campaigns, whose runs take other times than predicted, and the line of progress."""

import heapq
from dataclasses import replace

import numpy as np
import pytest
import synthetic_results
from laptop_plan import rows as laptop_rows
from paths import ROOT

from campaign.config import read_config
from campaign.engine_local import _Watch
from campaign.estimate import estimate
from campaign.plan import make_rows
from campaign.products import RunStatus
from campaign.progress import progress_line
from campaign.status import summary


def demo_rows():
    return make_rows(read_config(ROOT / "campaign" / "demo.toml"), synthetic_results.representative_points(8))


def simulated(rows, places, seconds):
    """Begin and end of every run: the costliest first by prediction, each once its start has ended."""
    span, busy, now = {}, [], 0.0
    ready = sorted((row for row in rows if not row.start), key=lambda row: row.cpu_seconds)
    while ready or busy:
        while ready and len(busy) < places:
            run_id = ready.pop().run_id
            span[run_id] = (now, now + seconds[run_id])
            heapq.heappush(busy, (span[run_id][1], run_id))
        now, ended = heapq.heappop(busy)
        ready = sorted([*ready, *(row for row in rows if row.start == ended)], key=lambda row: row.cpu_seconds)
    return span


def at(rows, span, now):
    """The status of every run at a time, as it follows from products and locks."""
    statuses = {}
    for row in rows:
        begin, end = span[row.run_id]
        facts = {"cpu_seconds": end - begin, "wall_seconds": end - begin}
        done = RunStatus(row.run_id, "done", "", facts)
        running = RunStatus(row.run_id, "running", "", {"elapsed": now - begin})
        statuses[row.run_id] = done if end <= now else running if begin <= now else RunStatus(row.run_id, "missing")
    return statuses


#: Time over predicted time of consolidate, probe and shear: as predicted, stages apart by a third, a machine that is
#: thrice as slow, and one that is so busy with other work that everything takes 25 times as long.
PACES = [(1.0, 1.0, 1.0), (1.5, 1.3, 1.1), (0.8, 1.0, 1.1), (3.0, 3.0, 3.0), (25.0, 25.0, 25.0)]


@pytest.mark.parametrize("plan, places, paces", [
    *((demo_rows, places, paces) for places in (1, 2) for paces in PACES),
    *((laptop_rows, places, paces) for places in (2, 8) for paces in PACES[1:4:2]),
])  # fmt: skip
def test_after_a_tenth_of_the_work_the_time_to_go_is_right_within_a_factor_of_1_5(plan, places, paces):
    rows, rng = plan(), np.random.default_rng(1)
    pace = dict(zip(("consolidate", "probe", "shear"), paces, strict=True))
    seconds = {row.run_id: row.cpu_seconds * pace[row.stage] * np.exp(0.2 * rng.normal()) for row in rows}
    span = simulated(rows, places, seconds)
    total, last = sum(seconds.values()), max(end for _, end in span.values())
    begins, ends = np.array(list(span.values())).T
    for share in (0.1, 0.2, 0.35, 0.5, 0.7, 0.9):
        times = np.linspace(0, last, 400)
        work = np.clip(times[:, None] - begins, 0.0, ends - begins).sum(axis=1)
        now = float(np.interp(share * total, work, times))
        found = estimate(rows, at(rows, span, now), places)
        assert 1 / 1.5 < found.seconds / (last - now) < 1.5, (share, found.seconds, last - now)
        assert 1 / 1.5 < found.cpu_seconds / ((1 - share) * total) < 1.5


def test_run_and_status_report_the_same_time_to_go(monkeypatch):
    rows = demo_rows()
    pace = 2 * 1000.0 / sum(row.cpu_seconds for row in rows)  # about 1,000 s in two places, whatever is predicted
    span = simulated(rows, 2, {row.run_id: pace * row.cpu_seconds for row in rows})
    statuses = at(rows, span, 400.0)
    config = read_config(ROOT / "campaign" / "demo.toml")
    config = replace(config, run=replace(config.run, jobs=2))
    status = summary(config, rows, statuses)
    line = _Watch(rows, statuses, config, quiet=False).line(statuses, 400.0)
    done = sum(s.status == "done" for s in statuses.values())
    assert f"{done}/{len(rows)} runs" in line and "2 running" in line and len(line) <= 79
    assert line.endswith(f"about {status['seconds_to_go'] / 60:.0f} min to go")


def test_without_a_finished_run_the_prediction_counts_and_in_the_end_nothing_is_left():
    rows = demo_rows()
    nothing = {row.run_id: RunStatus(row.run_id, "missing") for row in rows}
    predicted = sum(row.cpu_seconds for row in rows)
    assert estimate(rows, nothing, 1).seconds == pytest.approx(predicted)
    assert estimate(rows, nothing, 10_000).seconds < predicted / 10
    ended = {row.run_id: RunStatus(row.run_id, word) for row, word in zip(rows, ["failed", "spared"] * 30, strict=True)}
    assert estimate(rows, ended, 1) == type(estimate(rows, ended, 1))(0.0, 0.0)


def test_a_run_that_takes_longer_than_expected_still_needs_something():
    rows = demo_rows()[:1]
    late = {rows[0].run_id: RunStatus(rows[0].run_id, "running", "", {"elapsed": 1e6})}
    assert estimate(rows, late, 1).seconds == pytest.approx(1e5)  # a tenth of what it has taken


@pytest.mark.parametrize("width", [20, 40, 79, 132])
def test_a_line_of_progress_fits_and_keeps_the_time_to_go(width):
    words = ["4096 running", "10000 failed", "999.9 h so far", "about 999.9 h to go"]
    line = progress_line(9999, 10000, words, width)
    assert len(line) <= width
    assert width < 40 or line.endswith("about 999.9 h to go") and "9999/10000 runs" in line
    assert ("so far" in line) == (width > 100)
    short = progress_line(3, 60, ["2 running", "90 s so far", "about 9 min to go"], width)
    assert len(short) <= width and short.endswith("about 9 min to go" if width >= 40 else "")


def test_the_line_of_the_default_campaign_has_a_bar_in_80_columns():
    line = progress_line(27, 60, ["2 running", "3 min so far", "about 3 min to go"], 79)
    assert line.startswith("[###") and line.endswith("] 27/60 runs · 2 running · 3 min so far · about 3 min to go")
