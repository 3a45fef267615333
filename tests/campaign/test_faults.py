"""Every fault is injected for real: the message, the exit status, and that no other run is harmed.

The tests write a table of faults, build/faults.csv, which is kept as data/benchmarks/campaign_faults.csv.
"""

import csv
import json
import os
import shutil
import subprocess
import time

import h5py
import pytest
import synthetic_runs
from campaign_cases import ROOT, finish, make_small, needs_batch

from campaign.__main__ import main

pytestmark = needs_batch
TABLE = ROOT / "build" / "faults.csv"


@pytest.fixture
def small(tmp_path):
    """A finished campaign: 2 consolidations, 4 probes, 4 shear runs."""
    return finish(make_small(tmp_path))


@pytest.fixture(scope="module")
def table():
    rows = []
    yield rows
    TABLE.parent.mkdir(exist_ok=True)
    with open(TABLE, "w", newline="") as file:
        csv.writer(file).writerows([("fault", "what the user sees", "exit status", "harm to other runs"), *rows])


def _note(table, fault, done, before, after, touched=()):
    """Add a line to the table; everything but the touched runs must be as before."""
    lines = [line for line in done.stderr.splitlines() if line.strip() and "[#" not in line and "[-" not in line]
    assert "Traceback" not in done.stderr
    same = {k: v for k, v in before.items() if k not in touched} == {k: v for k, v in after.items() if k not in touched}
    assert same
    table.append((fault, lines[0] if lines else done.stdout.splitlines()[-1], done.returncode, "none"))
    return table[-1][1]


@pytest.mark.parametrize("damage", ["truncated", "flipped bytes", "of another plan"])
def test_damaged_product_is_named_set_aside_and_made_again(small, table, damage):
    assert small.total("done") == 10
    before, path = small.sums(), small.product()
    row = small.rows[-1]
    if damage == "truncated":
        path.write_bytes(path.read_bytes()[:4000])
    elif damage == "flipped bytes":
        data = bytearray(path.read_bytes())
        data[-64:] = bytes(byte ^ 0xFF for byte in data[-64:])
        path.write_bytes(data)
    else:
        synthetic_runs.write_product(small.folder, row, path, mu_s=0.777)
        small.folder.joinpath("products/SHA256SUMS").unlink()
    refused = small.command("analyse")
    assert refused.returncode == 2
    message = _note(table, f"product {damage}", refused, before, small.sums(), [row.run_id])
    assert row.run_id in message
    again = small.command("run")
    assert again.returncode == 0, again.stderr
    assert small.started() == [row.run_id] and small.total("done") == 10
    others = {k: v for k, v in small.sums().items() if k != row.run_id}
    assert others == {k: v for k, v in before.items() if k != row.run_id}
    assert len(list((small.folder / "products" / "refused").iterdir())) == 1


#: fault -> (words that the reason must have, tries)
FAULTS = {
    "abort": ("signal 6 (SIGABRT)", 2),
    "hang": ("no CPU used", 1),
    "spin": ("CPU-s used, limit", 1),
    "script error": ("NameError: name 'sigma3' is not defined", 1),
    "nan": ("sigma that are not finite", 1),
    "proof": ("not quasi-static: I = 4.1e-3 > 2.5e-3", 1),
    "unstable": ("energy error 0.31", 2),
    "silent": ("YADE ended without a product", 1),
}


def test_rows_that_fail_do_not_harm_the_others(tmp_path, table):
    """Eight rows of one campaign, each with a fault of its own; a ninth run is in order."""
    small = make_small(tmp_path, n=5, more="[run]\nhang_minutes = 0.02\ncpu_limit = 1.0\n")
    shear = [row for row in small.rows if row.stage == "shear"]
    faulty, good = dict(zip(FAULTS, shear, strict=False)), shear[len(FAULTS)]
    finish(small, *faulty.values(), good)
    before = small.sums()
    small.fake["faults"] = {row.run_id: fault for fault, row in faulty.items()}
    done = small.command("run")
    assert done.returncode == 1 and "Traceback" not in done.stderr
    after = small.sums()
    assert set(after) - set(before) == {good.run_id} and before.items() <= after.items()
    for fault, row in faulty.items():
        words, tries = FAULTS[fault]
        (line,) = [line for line in done.stderr.splitlines() if row.run_id in line]
        assert words in line
        assert small.started().count(row.run_id) == tries
        table.append((f"{fault} in one row", line, done.returncode, "none"))
    counts = small.status()["counts"]["total"]
    assert (counts["done"], counts["failed"], counts["total"]) == (22 - 8, 8, 22)
    assert not any((small.folder / "products").glob(".*.part"))
    spun = json.loads((small.folder / "products" / f"{faulty['spin'].run_id}.failed.json").read_text())
    assert spun["cpu_seconds"] > 2.0 and small.status()["core_hours_spent"] > (14 * 2.0 + 2.0) / 3600
    tries = len(small.started())
    assert small.command("run").returncode == 1 and len(small.started()) == tries  # not tried for ever
    small.fake["faults"] = {}
    assert small.command("run", "--failed").returncode == 0 and small.total("done") == 22


def test_smaller_step_cures_an_unstable_run(tmp_path):
    small = make_small(tmp_path)
    row = small.rows[-1]
    finish(small, row)
    small.fake["faults"] = {row.run_id: "unstable once"}
    assert small.command("run").returncode == 0
    status = small.status()
    assert status["counts"]["total"]["done"] == 10 and status["retried"] == 1
    with h5py.File(small.product(), "r") as file:
        assert file["parameters"].attrs["timestep_factor"] == 0.5 * row.values["timestep_factor"]


def test_failed_start_fails_what_follows_and_counts_it(tmp_path):
    small = make_small(tmp_path, faults={"consolidate_G25.7_iso0.001": "proof"})
    finish(small, *(row for row in small.rows if row.mu_iso == 0.001))
    assert small.command("run").returncode == 1
    counts = small.status()["counts"]
    assert counts["total"] | {"done": 5, "failed": 5, "missing": 0} == counts["total"]
    assert len(list((small.folder / "products").glob("*.failed.json"))) == 5
    small.fake["faults"] = {}
    assert small.command("run", "--failed").returncode == 0 and small.total("done") == 10


def test_yade_missing(tmp_path, table):
    small = finish(make_small(tmp_path))
    before = small.sums()
    small.product().unlink()
    del before[small.rows[-1].run_id]
    done = small.command("run", CAMPAIGN_YADE="/no/such/yade")
    assert done.returncode == 2
    assert "no such program" in _note(table, "YADE missing", done, before, small.sums())
    assert small.command("run").returncode == 0 and small.total("done") == 10


def test_two_at_once(tmp_path, table):
    small = make_small(tmp_path, seconds=2.0)
    finish(small, *small.rows[-2:])
    first = subprocess.Popen(
        small.line("run"), env=small.env(), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    while not small.started():
        time.sleep(0.05)
    running = small.status()["counts"]["total"]
    second = small.command("run")
    assert second.returncode == 2 and running["running"] >= 1 and running["total"] == 10
    assert "another `run` is at work here" in _note(table, "two `campaign run` at once", second, {}, {})
    first.communicate()
    assert first.returncode == 0 and sorted(small.started()) == sorted(row.run_id for row in small.rows[-2:])


def test_clock_that_jumps(small, table, monkeypatch, capsys):
    """Products dated 1980 and 2037, and a clock that goes back a day at every look."""
    assert small.total("done") == 10
    before = small.sums()
    os.utime(small.product(0), (315532800, 315532800))
    os.utime(small.product(1), (2114380800, 2114380800))
    small.product().unlink()
    now = iter(range(2_000_000_000, 0, -86_400))
    monkeypatch.setattr(time, "time", lambda: float(next(now)))
    for name, value in small.env().items():
        monkeypatch.setenv(name, value)
    assert main(["run", str(small.toml), "--folder", str(small.folder), "--quiet"]) == 0
    output = capsys.readouterr()
    done = subprocess.CompletedProcess([], 0, output.out, output.err)
    _note(table, "a clock that jumps", done, before, small.sums(), [small.rows[-1].run_id])
    assert small.started() == [small.rows[-1].run_id] and small.total("done") == 10


def test_table_edited_by_hand(small, table):
    """A table row changed by hand and run by hand: its product is refused; the next `run` writes the table anew."""
    assert small.total("done") == 10
    row, before = small.rows[-1], small.sums()
    small.product().unlink()
    path = small.folder / "batch" / "shear.table"
    lines = path.read_text().splitlines()
    line = next(k for k, text in enumerate(lines) if text.startswith(row.run_id))
    lines[line] = lines[line].replace(f" {row.mu_s!r} ", " 0.777 ")
    path.write_text("\n".join(lines) + "\n")
    env = small.env(YADE_BATCH=f"batch/shear.table:{line + 1}", PYTHONPATH=str(ROOT))
    subprocess.run(["/usr/bin/python3", "-m", "campaign.run_one", "shear.py"], env=env, cwd=small.folder, check=True)
    failures = small.status()["failures"]
    assert [f["reason"] for f in failures] == [f"belongs to another plan: mu_s = 0.777, planned {row.mu_s:g}"]
    done = small.command("run")
    assert done.returncode == 0
    assert "was edited by hand" in _note(table, "a table edited by hand", done, before, small.sums(), [row.run_id])
    assert small.total("done") == 10


def test_points_edited_by_hand(small, table):
    before, path = small.sums(), small.folder / "points.csv"
    text = path.read_text()
    path.write_text(text.replace("0,0.", "0,1.", 1))
    done = small.command("status")
    assert done.returncode == 2
    assert "was changed since" in _note(table, "points.csv edited by hand", done, before, small.sums())
    path.write_text(text)
    assert small.total("done") == 10


@pytest.fixture
def small_disk(tmp_path):
    """A file system of its own with 64 MiB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = os.geteuid() == 0 and subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(place)], capture_output=True
    ).returncode == 0  # fmt: skip
    if not mounted:
        pytest.skip("a file system of its own needs root")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_disk_full_while_writing(small_disk, table):
    small = make_small(small_disk)
    row = small.rows[-1]
    finish(small, row)
    before = small.sums()
    small.fake["faults"] = {row.run_id: "fill the disk"}
    done = small.command("run")
    assert done.returncode == 3
    assert "space left" in _note(table, "disk full while writing", done, before, small.sums(), [row.run_id])
    assert small.status()["counts"]["total"]["failed"] == 0  # the machine's fault, not the run's
    refused = small.command("run")
    assert refused.returncode == 2 and "MiB free" in refused.stderr
    (small.folder / "ballast").unlink()
    small.fake["faults"] = {}
    assert small.command("run").returncode == 0 and small.total("done") == 10


def test_read_only_folder(small_disk, table):
    small = make_small(small_disk)
    finish(small, small.rows[-1])
    assert small.command("plan").returncode == 0
    before = small.sums()
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    done = small.command("run")
    assert done.returncode == 2
    assert "Read-only file system" in _note(table, "read-only output folder", done, before, small.sums())
    assert small.total("done") == 9  # looking still works
    subprocess.run(["mount", "-o", "remount,rw", str(small_disk)], check=True)
    assert small.command("run").returncode == 0 and small.total("done") == 10


def test_leftovers_of_killed_runs_are_removed(small):
    part = small.folder / "products" / ".x.h5.123.part"
    part.write_bytes(b"half")
    shutil.copy(small.product(0), small.folder / "products" / "shear_of_an_old_plan.h5")
    small.product().unlink()
    assert small.command("run").returncode == 0
    assert not part.exists()
    status = small.status()
    assert status["stale"] == ["shear_of_an_old_plan"] and status["counts"]["total"]["total"] == 10
