"""On the PYTHONPATH of every run: YADE opens no network port, and the page of yade-batch serves this machine only.

By default `yade` serves a Python prompt (TCP 9000 and up) and XML-RPC (21000 and up), and `yade-batch` an overview page
(9080 and up), all on every network interface. Python imports this file before anything else. It replaces YADE's
`remote.runServers` by a function that does nothing, and binds every other server to 127.0.0.1.
"""

import sys
from importlib.machinery import PathFinder


class _PatchingFinder:
    """Finds `yade.remote` and `socketserver` as usual and patches them once they are loaded."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        patch = {"yade.remote": _start_no_servers, "socketserver": _bind_to_loopback}.get(name)
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


def _bind_to_loopback(socketserver):
    bind = socketserver.TCPServer.server_bind

    def server_bind(server):
        if server.server_address[0] in ("", "0.0.0.0", "::"):
            server.server_address = ("127.0.0.1", *server.server_address[1:])
        bind(server)

    socketserver.TCPServer.server_bind = server_bind


sys.meta_path.insert(0, _PatchingFinder)
