"""The local engine: runs exactly the missing rows, goes on after any kill, and opens no network port."""

import functools
import os
import random
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from campaign_cases import ROOT, finish, make_small, needs_batch
from kill_runs import kill_and_restart

from campaign import engine_local

pytestmark = needs_batch


def test_runs_every_row_once_and_a_second_run_starts_nothing(tmp_path):
    small = make_small(tmp_path)
    assert small.command("run").returncode == 0
    assert sorted(small.started()) == sorted(r.run_id for r in small.rows)
    place = {run_id: k for k, run_id in enumerate(small.started())}
    assert all(place[row.start] < place[row.run_id] for row in small.rows if row.start)
    sums = small.sums()
    assert small.command("run").returncode == 0
    assert len(small.started()) == 10 and small.sums() == sums


def test_runs_exactly_what_is_missing(tmp_path):
    small = make_small(tmp_path)
    finish(small, small.rows[3], small.rows[-1])
    assert small.command("missing").stdout.split() == [small.rows[3].run_id, small.rows[-1].run_id]
    assert small.command("run").returncode == 0
    assert sorted(small.started()) == [small.rows[3].run_id, small.rows[-1].run_id]


def test_killed_at_random_moments_ends_with_the_same_products(tmp_path):
    whole = make_small(tmp_path / "whole")
    assert whole.command("run").returncode == 0
    small = make_small(tmp_path / "killed", seconds=0.8)
    small.toml.write_text(whole.toml.read_text())
    survived = kill_and_restart(small, 4, random.Random(1), 1.0)
    assert survived.kills == 4 and survived.interrupted
    assert small.sums() == whole.sums()
    finished = {r.run_id for r in small.rows}
    assert set(small.started()) == finished and small.total("done") == 10


def test_command_lines_stay_short_for_30000_runs_of_a_stage(tmp_path, monkeypatch):
    """Linux takes 128 KiB in one argument and 2 MiB in all."""
    small = make_small(tmp_path)
    for name in ("products", "logs"):
        (small.folder / name).mkdir()
    rows = [replace(small.rows[-1], run_id=f"{small.rows[-1].run_id}_{k}", start="") for k in range(60_000)]
    commands = []

    class Ended:
        returncode = 0

        def __init__(self, command, **_):
            commands.append(command)

        wait = poll = terminate = lambda *_, **__: 0

    monkeypatch.setattr(engine_local.subprocess, "Popen", Ended)
    watch = SimpleNamespace(show_progress=lambda folder: None)
    engine_local._run_batches(small.config, small.folder, rows, rows[::2], watch)
    assert len(commands) == 1
    assert max(map(len, commands[0])) < 1 << 17 and sum(map(len, commands[0])) < 1 << 21
    table = small.folder / next(word for word in commands[0] if word.endswith(".table"))
    assert [line.split()[0] for line in table.read_text().splitlines()[2:]] == [row.run_id for row in rows[::2]]


def test_temporary_files_end_with_their_run_also_when_it_is_killed(tmp_path):
    small = make_small(tmp_path, temporary=True, faults={"shear": "hang"})
    finish(small, *small.rows[-3:])
    run = subprocess.Popen(small.line("run", "--jobs", "1"), env=small.env(), cwd=ROOT, start_new_session=True,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
    while not (small.folder / "temporary.txt").exists():
        time.sleep(0.05)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    small.fake["faults"] = {}
    assert small.command("run", "--jobs", "1").returncode == 0 and small.total("done") == 10
    paths = (small.folder / "temporary.txt").read_text().split()
    assert len(paths) == 4 and not any(map(os.path.exists, paths))
    assert all(path.startswith(f"{small.folder}/products/.") for path in paths)
    assert not list((small.folder / "products").glob(".*.tmp"))


def test_a_temporary_folder_is_removed_also_where_nothing_is_missing(tmp_path):
    """A supervisor that is killed after its product is complete leaves one."""
    small = finish(make_small(tmp_path))
    left = small.folder / "products" / f".{small.rows[-1].run_id}.tmp"
    left.mkdir()
    assert small.command("run", "--jobs", "1").returncode == 0
    assert not left.exists()


def test_interrupt_ends_in_one_line_and_leaves_nothing_running(tmp_path):
    small = make_small(tmp_path, seconds=30.0)
    # a shell that runs the tests in the background makes them ignore Ctrl-C, and children inherit this
    heed_interrupt = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    run = subprocess.Popen(small.line("run"), env=small.env(), cwd=ROOT, start_new_session=True, text=True,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=heed_interrupt)  # fmt: skip
    while len(small.started()) < 2:
        time.sleep(0.05)
    os.kill(run.pid, signal.SIGINT)
    _, errors = run.communicate(timeout=20)
    assert run.returncode == 130 and "the same command goes on from here" in errors and "Traceback" not in errors
    time.sleep(0.3)
    assert not _group(run.pid)
    assert small.total("running") == 0


def test_killing_only_the_front_end_stops_its_runs(tmp_path):
    small = make_small(tmp_path, seconds=30.0)
    run = subprocess.Popen(small.line("run"), env=small.env(), cwd=ROOT, start_new_session=True,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
    while len(small.started()) < 2:
        time.sleep(0.05)
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    time.sleep(0.5)
    assert not _group(run.pid)


def _group(pgid: int) -> list[str]:
    """Command lines of the living processes of a process group or session."""
    commands = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
            if int(fields[3]) == pgid and fields[0] != "Z":
                commands.append((path.parent / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return commands


def listening(pids: set[int]) -> list[tuple[str, int]]:
    """(address, port) of every TCP socket, IPv4 or IPv6, that the processes listen on."""
    inodes = set()
    for pid in pids:
        for fd in Path(f"/proc/{pid}/fd").glob("*"):
            try:
                inodes.add(os.readlink(fd))
            except OSError:
                continue
    sockets = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            part = line.split()
            if part[3] == "0A" and f"socket:[{part[9]}]" in inodes:
                address, port = part[1].split(":")
                sockets.append((address, int(port, 16)))
    return sockets


LOOPBACK = ("0100007F", "00000000000000000000000001000000")


@pytest.mark.yade
def test_only_loopback_pages_of_yade_batch_listen_during_a_run(tmp_path):
    """A real YADE process in a real campaign: nothing on any other address, and nothing at all opened by YADE."""
    small = make_small(tmp_path)
    (tmp_path / "sleep.py").write_text(
        "import os, time\nopen('its_folder.txt', 'w').write(os.path.dirname(O.tmpFilename()))\n"
        "open('up.txt', 'w').write('')\ntime.sleep(2)\n"
    )
    wrapper = tmp_path / "yade"
    wrapper.write_text(f"#!/bin/sh\nexec yade -n -x -j1 {tmp_path / 'sleep.py'}\n")
    wrapper.chmod(0o755)
    run = subprocess.Popen(small.line("run", "--quiet"), env=small.env(CAMPAIGN_YADE=str(wrapper)), cwd=ROOT,
                           start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
    while not (small.folder / "up.txt").exists():
        time.sleep(0.05)
        assert run.poll() is None
    pids = {int(p.name) for p in Path("/proc").glob("[0-9]*") if _session(p) == run.pid}
    names = {pid: Path(f"/proc/{pid}/cmdline").read_text() for pid in pids}
    sockets = listening(pids)
    yade = {pid for pid, name in names.items() if "/yade\0" in name or "yade-double" in name}
    opened_by_yade = listening(yade)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    assert yade and opened_by_yade == []
    its_folder = (small.folder / "its_folder.txt").read_text()
    assert its_folder.startswith("/tmp/yade-") and not os.path.exists(its_folder)  # even after SIGKILL
    assert 1 <= len(sockets) <= 3  # a page of each stage's yade-batch
    assert all(address in LOOPBACK and 9080 <= port < 11000 for address, port in sockets)


def _session(proc: Path) -> int:
    try:
        return int((proc / "stat").read_text().rpartition(")")[2].split()[3])
    except OSError:
        return -1
