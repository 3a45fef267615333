"""The supervisor of one run: its exit codes, its environment, and the former name that tasks in a queue still use."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from campaign_cases import ROOT, finish, make_small

from campaign import run_one
from campaign.plan import table_line
from campaign.run_one import BUSY, ENVIRONMENT, FAILED, OK, run_environment


@pytest.mark.parametrize("module", ["campaign.run_one", "campaign.row"])
def test_exit_codes_are_those_that_yade_batch_and_slurm_scripts_know(module, tmp_path):
    small = make_small(tmp_path)
    finish(small, *small.rows[-2:])
    (small.folder / "logs").mkdir()
    lines = [row for row in small.rows if row.stage == "shear"]

    def exit_code(row, script="shear.py", **env):
        batch = f"batch/shear.table:{table_line(lines.index(row))}"
        command = [sys.executable, "-m", module, "-x", script]
        env = small.env(**{"YADE_BATCH": batch, "PYTHONPATH": str(ROOT), **env})
        return subprocess.run(command, env=env, cwd=small.folder, capture_output=True, text=True).returncode

    assert exit_code(small.rows[-2], YADE_BATCH="batch/shear.table:1") == ENVIRONMENT == 74
    assert exit_code(small.rows[-2], YADE_BATCH="") == ENVIRONMENT
    assert exit_code(small.rows[-2], CAMPAIGN_YADE="/no/such/yade") == ENVIRONMENT
    assert exit_code(small.rows[-2]) == OK == 0 and small.started() == [small.rows[-2].run_id]
    assert exit_code(small.rows[-2]) == OK and len(small.started()) == 1  # the product is there
    small.fake["faults"] = {small.rows[-1].run_id: "proof"}
    assert exit_code(small.rows[-1]) == FAILED == 1
    assert small.total("failed") == 1 and BUSY == 75


def test_processor_time_of_what_a_run_starts_counts_where_linux_lists_no_children_too(monkeypatch):
    """A run in LAMMPS waits for its child; without the child's time it would seem to hang."""
    work = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'while True: pass'])"
    with subprocess.Popen([sys.executable, "-c", work], start_new_session=True) as run:
        try:
            while not (listed := run_one._children(run.pid)):
                time.sleep(0.01)
            read = Path.read_text

            def without_children(path, *args, **kwargs):
                if path.name == "children":
                    raise FileNotFoundError(str(path))
                return read(path, *args, **kwargs)

            monkeypatch.setattr(Path, "read_text", without_children)
            assert run_one._children(run.pid) == listed
            while run_one._cpu_seconds(run.pid)[0] < 0.3:
                time.sleep(0.01)
            assert run_one._cpu_seconds(run.pid)[0] > 1.5 * sum(map(int, run_one._stat(run.pid)[11:15])) / 100.0
        finally:
            os.killpg(run.pid, signal.SIGKILL)


def test_a_run_that_is_ended_in_the_moment_in_which_yade_starts_leaves_no_temporary_folder(tmp_path):
    """The signal comes as soon as the process of YADE is there, before anything else is done."""
    small = make_small(tmp_path, seconds=60.0)
    (small.folder / "products").mkdir()
    code = (
        "import os, signal, subprocess, sys\n"
        "class Popen(subprocess.Popen):\n"
        "    def __init__(self, *words, **options):\n"
        "        super().__init__(*words, **options)\n"
        "        print(self.pid, flush=True)\n"
        "        os.kill(os.getpid(), signal.SIGTERM)\n"
        "subprocess.Popen = Popen\n"
        "from campaign.run_one import main\n"
        "sys.exit(main(['consolidate.py']))\n"
    )
    env = small.env(YADE_BATCH=f"batch/consolidate.table:{table_line(0)}", PYTHONPATH=str(ROOT))
    done = subprocess.run([sys.executable, "-c", code], env=env, cwd=small.folder, capture_output=True, text=True)
    assert done.returncode == 128 + signal.SIGTERM, done.stderr
    assert not list((small.folder / "products").glob(".*.tmp"))
    began = time.monotonic()
    while Path(f"/proc/{done.stdout.strip()}").exists():
        assert time.monotonic() - began < 30.0
        time.sleep(0.05)


def test_pages_answer_to_the_names_of_this_machine_only():
    """A site's name may lead to 127.0.0.1, so that its page in a browser here could read the answer."""
    code = (
        "import http.server as h, threading, http.client as c\n"
        "class Page(h.BaseHTTPRequestHandler):\n"
        "    def do_GET(self): self.send_response(200); self.end_headers()\n"
        "    def log_message(self, *_): pass\n"
        "server = h.HTTPServer(('', 0), Page)\n"
        "threading.Thread(target=server.serve_forever, daemon=True).start()\n"
        "for host in ('localhost:9080', '127.0.0.1', 'evil.example:9080', 'localhost.evil.example', ''):\n"
        "    page = c.HTTPConnection('127.0.0.1', server.server_port)\n"
        "    page.putrequest('GET', '/', skip_host=True)\n"
        "    page.putheader('Host', host) if host else None\n"
        "    page.endheaders()\n"
        "    print(page.getresponse().status)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], env=run_environment(), capture_output=True, text=True)
    assert done.stdout.split() == ["200", "200", "403", "403", "403"], done.stderr


def test_no_server_starts_in_the_environment_of_a_run():
    env = run_environment()
    code = "import socketserver; s = socketserver.TCPServer(('', 0), None); print(s.server_address[0])"
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert done.stdout == "127.0.0.1\n" and env["OMP_NUM_THREADS"] == "1"
    folder = env["PYTHONPATH"].split(os.pathsep)[0]
    assert folder == str(ROOT / "campaign" / "no_servers") and os.listdir(folder)
