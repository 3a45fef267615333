"""Every fault is injected for real: the message, the exit status, and that no other run is harmed.

The tests write a table of faults, build/faults.csv, which is kept as data/benchmarks/campaign_faults.csv.
"""

import contextlib
import csv
import errno
import fcntl
import json
import os
import shutil
import subprocess
import time
from datetime import UTC, datetime, timedelta

import h5py
import pytest
import synthetic_runs
from campaign_cases import ROOT, SUBMIT, Small, finish, make_small, needs_batch, slurm_of

from campaign import engine_slurm, products
from campaign.__main__ import main
from campaign.config import read_config

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


def _here(small, monkeypatch, capsys, *words, **env):
    """A command in this process, where parts of it can be replaced."""
    for name, value in small.env(**env).items():
        monkeypatch.setenv(name, value)
    capsys.readouterr()
    code = main(small.line(*words)[3:])
    output = capsys.readouterr()
    return subprocess.CompletedProcess([], code, output.out, output.err)


def _lock(path, monkeypatch):
    file = open(path, "rb")  # noqa: SIM115  held until the test ends
    fcntl.flock(file, fcntl.LOCK_EX)
    return file.close


def _fail_once(path, monkeypatch):
    """Reading the file in blocks fails once."""
    read, failures = products.file_sum, [OSError(errno.EIO, "Input/output error")]

    def file_sum(asked):
        if asked == path and failures:
            raise failures.pop()
        return read(asked)

    monkeypatch.setattr(products, "file_sum", file_sum)
    return lambda: None


def _fail_in_hdf5_once(path, monkeypatch):
    File, failures = h5py.File, [OSError("Can't read data (errno = 5, error message = 'Input/output error')")]

    def open_file(asked, *words, **options):
        if str(asked) == str(path) and failures:
            raise failures.pop()
        return File(asked, *words, **options)

    monkeypatch.setattr(h5py, "File", open_file)
    return lambda: None


UNREADABLE = {
    "locked by another process": (_lock, "another process holds a lock on it", 3),
    "reading fails once": (_fail_once, "cannot be read now: Input/output error", 0),
    "reading fails once in HDF5": (_fail_in_hdf5_once, "cannot be read now: Input/output error", 0),
}


@pytest.mark.parametrize("fault", UNREADABLE)
def test_product_that_cannot_be_read_now_is_unknown_and_stays(small, table, fault, monkeypatch, capsys):
    disturb, words, code_of_run = UNREADABLE[fault]
    path, before = small.product(), small.sums()
    assert small.total("done") == 10
    os.utime(path)  # so that it is checked again
    undisturb = disturb(path, monkeypatch)
    status = _here(small, monkeypatch, capsys, "status")
    (line,) = [line for line in status.stdout.splitlines() if path.name in line]
    assert words in line and status.returncode == 3
    table.append((f"product {fault}", line, status.returncode, "none"))
    entry = json.loads((small.folder / "products" / products.CHECKED).read_text())[small.rows[-1].run_id]
    assert entry["stamp"] != products.file_stamp(path) and entry["reason"] == ""
    run = _here(small, monkeypatch, capsys, "run", "--quiet")
    assert run.returncode == code_of_run, run.stderr
    undisturb()
    assert small.started() == [] and small.sums() == before and not (small.folder / "products" / "refused").exists()
    assert _here(small, monkeypatch, capsys, "status").returncode == 0 and small.total("done") == 10


def test_what_starts_from_an_unknown_product_waits_and_nothing_is_computed(small, table, monkeypatch, capsys):
    (first, shear) = small.rows[0], small.rows[-1]
    chain = [row for row in small.rows if row.mu_iso == first.mu_iso and row is not first]
    for row in [*chain, shear]:
        (small.folder / row.product).unlink(missing_ok=True)
    undisturb = _lock(small.folder / first.product, monkeypatch)
    done = small.command("run", "--quiet")
    assert done.returncode == 3 and small.started() == [shear.run_id]
    refused = _here(small, monkeypatch, capsys, "archive")
    assert refused.returncode == 2 and "another process holds a lock on it" in refused.stderr
    undisturb()
    assert small.command("run", "--quiet").returncode == 0 and small.total("done") == 10


def test_file_system_without_locks(tmp_path, table, monkeypatch, capsys):
    """No process can lock a file; each `run`, and each run, takes an exclusive file instead."""
    small = make_small(tmp_path)
    finish(small, *small.rows[-2:])
    for module in ("sitecustomize.py", "usercustomize.py"):  # runs load another sitecustomize, venvs no usercustomize
        (tmp_path / module).write_text(
            "import fcntl, errno\n"
            "def flock(*_): raise OSError(errno.ENOLCK, 'No locks available')\n"
            "fcntl.flock = flock\n"
        )
    done = small.command("run", "--quiet", PYTHONPATH=str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "has no locks" in _note(table, "file system without locks", done, {}, {})
    assert len(done.stderr.splitlines()) == 1 and set(small.started()) == {r.run_id for r in small.rows[-2:]}
    assert not list(small.folder.rglob("*.owner")) and small.total("done") == 10


def test_run_killed_from_outside_is_missing_and_keeps_its_checkpoint(tmp_path, table):
    small = make_small(tmp_path, n=3, more="[failures]\nretry = false\n")
    killed = dict(zip(("SIGKILL", "SIGTERM", "SIGXCPU", "interrupt"), small.rows[-6:], strict=False))
    crashed = dict(zip(("SIGSEGV", "SIGBUS"), small.rows[-2:], strict=True))
    finish(small, *small.rows[-6:])
    before = small.sums()
    small.fake["faults"] = {row.run_id: fault for fault, row in (killed | crashed).items()}
    done = small.command("run", "--quiet")
    assert done.returncode == 3
    line = _note(table, "YADE killed", subprocess.CompletedProcess([], 3, "", done.stderr.splitlines()[-1]), before,
                 small.sums())  # fmt: skip
    assert "YADE was killed by signal" in line or "KeyboardInterrupt" in line
    counts = small.status()["counts"]["total"]
    assert (counts["missing"], counts["failed"], counts["done"]) == (4, 2, 8)
    assert "signal 11 (SIGSEGV)" in done.stderr and "signal 7 (SIGBUS)" in done.stderr
    small.fake["faults"] = {}
    assert small.command("run", "--quiet").returncode == 1
    kept = {path.stem for path in (small.folder / "products").glob("*.checkpoint")}
    assert {killed[name].run_id for name in ("SIGKILL", "SIGTERM", "SIGXCPU")} <= kept
    assert small.total("done") == 12


def test_disk_full_while_analysing(small_disk, table):
    """Without room and with some: HDF5 itself would end the process by a signal, or leave half a file."""
    small = finish(make_small(small_disk))
    assert small.command("archive").returncode == 0
    for name in ("results.h5", "tables/peak_critical.csv"):
        (small.folder / name).write_bytes(b"of yesterday")
    old = {name: (small.folder / name).read_bytes() for name in ("results.h5", "runs.h5", "tables/peak_critical.csv")}
    ballast = small_disk / "ballast"
    with contextlib.suppress(OSError), open(ballast, "wb", buffering=0) as file:
        while True:
            file.write(bytes(1 << 12))
    for kib, commands in ((0, ("analyse", "archive")), (40, ("analyse",))):
        os.truncate(ballast, ballast.stat().st_size - (kib << 10))
        for command in commands:
            done = small.command(command)
            assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1, (done.returncode, done.stderr)
            assert "space" in _note(table, f"{kib} KiB left for `{command}`", done, {}, {})
            assert not list(small.folder.rglob("*.part"))
            assert all((small.folder / name).read_bytes() == data for name, data in old.items())
    ballast.unlink()
    assert small.command("analyse").returncode == 0 and (small.folder / "results.h5").read_bytes() != old["results.h5"]


@pytest.mark.parametrize("setting", ["strain_end = 0.05", "G_p_only = true"])
def test_other_settings_are_not_planned_while_a_run_is_at_work(small, table, setting, monkeypatch, capsys):
    assert _here(small, monkeypatch, capsys, "plan").returncode == 0
    release = _lock(small.folder / ".lock", monkeypatch)
    same = _here(small, monkeypatch, capsys, "plan")
    assert same.returncode == 0  # nothing changes
    before = {path: path.read_bytes() for path in small.folder.rglob("*") if path.is_file()}
    section = "[families]\n" if "only" in setting else ""
    text = small.toml.read_text()
    small.toml.write_text(text.replace("strain_end = 0.1", setting) if not section else f"{text}{section}{setting}\n")
    done = _here(small, monkeypatch, capsys, "plan")
    assert done.returncode == 2
    assert "another `run` is at work here" in _note(table, "`plan` with other settings during a run", done, {}, {})
    assert {path: path.read_bytes() for path in small.folder.rglob("*") if path.is_file()} == before
    release()
    assert _here(small, monkeypatch, capsys, "plan").returncode == 0


@pytest.mark.parametrize("step", ["make_assembly", "write_assembly"])
def test_error_of_the_assembly_leaves_nothing_of_the_first_plan(tmp_path, table, step, monkeypatch, capsys):
    from analysis import assembly

    toml = synthetic_runs.write_config(tmp_path, n=8)
    small = Small(toml, tmp_path / "run", [], read_config(toml))

    def fail(*_, **__):
        if step == "make_assembly":
            raise assembly.AssemblyError("64 spheres: no room for them")
        raise OSError(errno.ENOSPC, "No space left on device", "assembly_1.h5")

    monkeypatch.setattr(assembly, step, fail)
    done = _here(small, monkeypatch, capsys, "plan")
    assert done.returncode == 2
    _note(table, f"error of the assembly in the first `plan` ({step})", done, {}, {})
    assert not small.folder.exists()
    monkeypatch.undo()
    assert main(small.line("plan")[3:]) == 0 and "points chosen" in capsys.readouterr().out


def _made_again(small, when):
    row = small.rows[-1]
    small.product().unlink()
    synthetic_runs.write_product(small.folder, row)
    with h5py.File(small.product(), "r+") as file:
        file.attrs["created"] = when.isoformat(timespec="seconds")
        file["timing"].attrs["cpu_seconds"] = 7.0
    return row


def test_product_made_again_by_hand_is_accepted_and_its_checksum_updated(small, table, monkeypatch, capsys):
    assert _here(small, monkeypatch, capsys, "status").returncode == 0
    row = _made_again(small, datetime.now(UTC) + timedelta(seconds=1))
    while datetime.now(UTC).timestamp() < os.stat(small.product()).st_mtime + 1.1:
        time.sleep(0.1)
    done = _here(small, monkeypatch, capsys, "status")
    assert "its checksum is updated" in _note(table, "product made again by hand", done, {}, {})
    assert small.total("done") == 10 and row.run_id in done.stderr
    sums = ["sha256sum", "--quiet", "--strict", "--check", "SHA256SUMS"]
    lines = (small.folder / "products" / "SHA256SUMS").read_text().splitlines()
    assert sum(row.run_id in line for line in lines) == 2 and row.run_id in lines[-1]
    (small.folder / "products" / "last").write_text(lines[-1] + "\n")
    assert subprocess.run([*sums[:-1], "last"], cwd=small.folder / "products").returncode == 0
    assert _here(small, monkeypatch, capsys, "status").stderr == ""  # said once


def test_product_that_is_older_than_its_checksum_has_changed(small, monkeypatch, capsys):
    assert _here(small, monkeypatch, capsys, "status").returncode == 0
    _made_again(small, datetime.now(UTC) - timedelta(days=1))
    assert "bytes have changed" in _here(small, monkeypatch, capsys, "status").stdout


NOTES = ("products/{}.failed.json", "products/checked.json", "inputs.json", "tables/written.json",
         "tables/analysed.json", "tables/enough.json", "batch/slurm.json")  # fmt: skip
CONTENTS = {"list": "[1]", "number": "3", "null": "null", "text": '"x"', "object": '{"a": 1}', "half": '[{"job": "1"',
            "nested": "[" * 2000 + "]" * 2000, "deep": '{"a":' * 2000 + "1" + "}" * 2000,
            "bytes": "\xff"}  # fmt: skip


@pytest.mark.parametrize("name", NOTES)
def test_damaged_notes_end_in_a_line_or_count_as_absent(small, table, name, monkeypatch, capsys):
    stop = '[pdem]\nstop_when = "5%"\n' if "enough" in name else ""
    small.toml.write_text(small.toml.read_text() + stop)
    path = small.folder / name.format(small.rows[-1].run_id)
    if "failed" in name:
        small.product().unlink()
    (small.folder / "results.h5").write_text("no HDF5")
    path.parent.mkdir(exist_ok=True)
    seen = set()
    for content in CONTENTS.values():
        path.write_text(content, encoding="latin-1")
        for words in (["status"], ["missing"], ["plan"], ["report"], ["run", "--quiet"], ["run", "--engine", "slurm"]):
            if "slurm" in words and "slurm" not in name or "run" in words and "enough" in name:
                continue
            slurm = {"PATH": slurm_of(small.folder, sbatch=SUBMIT, squeue="exit 0", scontrol="exit 0")}
            done = _here(small, monkeypatch, capsys, *words, **(slurm if "slurm" in name else {}))
            assert done.returncode in (0, 1, 2, 3) and "Traceback" not in done.stderr
            assert len(done.stderr.strip().splitlines()) <= 2
            seen |= {done.stderr.strip()}
            path.write_text(content, encoding="latin-1")
    assert small.started() == [] and not (small.folder / "submitted.txt").exists()
    table.append(
        (f"{name.format('RUN')} damaged", "counts as absent" if seen <= {""} else "one line", "0 to 3", "none")
    )


def test_damaged_failure_file_still_counts_as_a_failed_run(small):
    """`analyse` reads the failure files, too: the run is failed, and the reason is that its file is damaged."""
    from analysis.results.collect import _read_failure

    for content in CONTENTS.values():
        path = small.folder / "a.failed.json"
        path.write_text(content, encoding="latin-1")
        reason = _read_failure(path).get("reason", "its failure file is damaged")
        assert reason == "its failure file is damaged"


#: A damaged answer or note at the second submission -> (stand-ins for SLURM's commands, what the line must name).
QUEUES = {
    "squeue prints an error with exit 0": ({"squeue": "echo 'slurm_load_jobs error: Unable to contact'"}, "squeue"),
    "squeue prints an error on stderr": ({"squeue": "echo 'slurm_load_jobs error: timed out' >&2"}, "squeue"),
    "squeue prints bytes that are no UTF-8": ({"squeue": r"printf '1 0 \377\376\n'"}, "squeue"),
    "squeue never answers": ({"squeue": "sleep 600"}, "no answer after 0.5 s"),
    "slurm.json truncated": ({}, "slurm.json: is damaged"),
}


@pytest.mark.parametrize("fault", QUEUES)
def test_unreadable_queue_submits_nothing(tmp_path, table, fault, monkeypatch, capsys):
    small = make_small(tmp_path)
    good = {"sbatch": SUBMIT, "squeue": "exit 0", "scontrol": "exit 0", "scancel": "exit 0"}
    path = {"PATH": slurm_of(tmp_path, **good)}
    assert _here(small, monkeypatch, capsys, "run", "--engine", "slurm", **path).returncode == 0
    commands, words = QUEUES[fault]
    slurm_of(tmp_path, **commands)
    if "json" in fault:
        note = small.folder / "batch" / "slurm.json"
        note.write_text(note.read_text()[:60])
    monkeypatch.setattr(engine_slurm, "SECONDS", 0.5 if "never" in fault else 60.0, raising=False)
    done = _here(small, monkeypatch, capsys, "run", "--engine", "slurm", **path)
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1
    assert words in _note(table, fault, done, {}, {}) and "not known" in done.stderr
    assert len((small.folder / "submitted.txt").read_text().split()) == 3
    status = _here(small, monkeypatch, capsys, "status", **path)
    assert status.returncode == 0 and "not known" in status.stdout


#: What sbatch answers -> its stand-in.
ANSWERS = {
    "a notice": "echo 'sbatch: notice: maintenance on 17 May'",
    "nothing": "exit 0",
    "Submitted batch job 17": "echo 'Submitted batch job 17'",
    "two numbers": "echo 17; echo 18",
    "bytes that are no UTF-8": r"printf '17\377\n'",
    "never": "sleep 600",
    "a refusal": "echo 'sbatch: error: QOSMaxSubmitJobPerUserLimit' >&2; exit 1",
}


@pytest.mark.parametrize("answer", ANSWERS)
def test_answers_of_sbatch_that_are_no_number(tmp_path, table, answer, monkeypatch, capsys):
    """The first stage is submitted, the second is not: the first is cancelled. What may still come stays noted."""
    small = make_small(tmp_path)
    sbatch = f"case $2 in *consolidate*) echo '11;cluster-a';; *) {ANSWERS[answer]};; esac"
    cancel = 'echo "$@" >> cancelled.txt'
    path = {"PATH": slurm_of(tmp_path, sbatch=sbatch, squeue="exit 0", scontrol="exit 0", scancel=cancel)}
    monkeypatch.setattr(engine_slurm, "SECONDS", 0.5 if answer == "never" else 60.0, raising=False)
    monkeypatch.chdir(tmp_path)
    done = _here(small, monkeypatch, capsys, "run", "--engine", "slurm", **path)
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1
    line = _note(table, f"sbatch answers {answer}", done, {}, {})
    assert line.startswith("campaign: sbatch: ") and "job 11, submitted before it, was cancelled" in line
    noted = [job["job"] for job in json.loads((small.folder / "batch" / "slurm.json").read_text())]
    assert noted == (["11", ""] if answer == "never" else ["11"])
    cancelled = (tmp_path / "cancelled.txt").read_text().split()
    assert cancelled[-1] == "11" and (answer == "a refusal" or cancelled[0].startswith("--name=small-probe-"))


def test_link_in_place_of_the_lock(small, table, monkeypatch, capsys):
    victim = small.folder.parent / "letters.txt"
    victim.write_text("dear reader")
    small.product().unlink()
    (small.folder / ".lock").unlink(missing_ok=True)
    (small.folder / ".lock").symlink_to(victim)
    done = _here(small, monkeypatch, capsys, "run", "--quiet")
    assert done.returncode == 2 and victim.read_text() == "dear reader"
    assert "symbolic link" in _note(table, "a link in place of .lock", done, {}, {})
