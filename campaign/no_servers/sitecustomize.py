"""On the PYTHONPATH of every run: YADE opens no port, yade-batch's page serves localhost only, and /tmp stays clean.

By default `yade` serves a Python prompt (TCP 9000 and up) and XML-RPC (21000 and up), and `yade-batch` an overview page
(9080 and up), all on every network interface. Python imports this file before anything else. It replaces YADE's
`remote.runServers` by a function that does nothing, and binds every other server to 127.0.0.1. A page of another site
that a browser on this machine shows could still ask for the overview under a name of its own that leads to 127.0.0.1:
requests for another host than localhost get status 403.

YADE makes a folder /tmp/yade-XXXXXX when it starts, wherever TMPDIR leads, and leaves it behind when it is killed.
Nothing is ever put there in a campaign, so it is removed as soon as YADE is loaded.
"""

import contextlib
import os
import re
import sys
from importlib import import_module
from importlib.machinery import PathFinder


class _PatchingFinder:
    """Finds the modules below as usual and patches them once they are loaded."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        patch = {
            "yade.system": _remove_temporary_folder,  # the first module that is loaded once the folder is there
            "yade.remote": _start_no_servers,
            "socketserver": _bind_to_loopback,
            "http.server": _answer_localhost_only,
        }.get(name)
        spec = PathFinder.find_spec(name, path, target) if patch else None
        if not (patch and spec and spec.loader):
            return None
        load = spec.loader.exec_module

        def load_and_patch(module):
            load(module)
            patch(module)

        spec.loader.exec_module = load_and_patch  # type: ignore[method-assign]
        return spec


def _start_no_servers(remote):
    remote.runServers = lambda: None


def _remove_temporary_folder(system):
    """Remove YADE's own temporary folder, as long as it is empty."""
    with contextlib.suppress(ImportError, OSError, RuntimeError):
        folder = os.path.dirname(import_module("yade.wrapper").Omega().tmpFilename())
        if re.fullmatch(r"/tmp/yade-\w{6}", folder):
            os.rmdir(folder)


def _bind_to_loopback(socketserver):
    bind = socketserver.TCPServer.server_bind

    def server_bind(server):
        if server.server_address[0] in ("", "0.0.0.0", "::"):
            server.server_address = ("127.0.0.1", *server.server_address[1:])
        bind(server)

    socketserver.TCPServer.server_bind = server_bind


def _answer_localhost_only(server):
    parse = server.BaseHTTPRequestHandler.parse_request

    def parse_request(handler):
        if not parse(handler):
            return False
        hosts = handler.headers.get_all("Host", [])
        if len(hosts) == 1 and re.fullmatch(r"(localhost|127\.0\.0\.1)(:[0-9]+)?", hosts[0].strip()):
            return True
        handler.send_error(403, "for this machine only, as localhost")
        return False

    server.BaseHTTPRequestHandler.parse_request = parse_request


sys.meta_path.insert(0, _PatchingFinder)
