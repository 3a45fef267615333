"""On PYTHONPATH of every run: YADE opens no port, and yade-batch's page is for this machine only.

By default `yade` serves a Python prompt (TCP 9000 and up) and XML-RPC (21000 and up), and `yade-batch` an overview page
(9080 and up), all of them on every network interface.  Python imports this file before anything else; it makes YADE's
`remote.runServers` do nothing, and binds whatever else is served to 127.0.0.1.
"""

import sys
from importlib.machinery import PathFinder


class _Doors:
    """Finds `yade.remote` and `socketserver` as usual, and closes them once they are loaded."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        close = {"yade.remote": _close_yade, "socketserver": _loopback_only}.get(name)
        spec = close and PathFinder.find_spec(name, path, target)
        if not spec:
            return None
        load = spec.loader.exec_module

        def load_and_close(module):
            load(module)
            close(module)

        spec.loader.exec_module = load_and_close
        return spec


def _close_yade(remote):
    remote.runServers = lambda: None


def _loopback_only(socketserver):
    bind = socketserver.TCPServer.server_bind

    def server_bind(server):
        if server.server_address[0] in ("", "0.0.0.0", "::"):
            server.server_address = ("127.0.0.1", *server.server_address[1:])
        bind(server)

    socketserver.TCPServer.server_bind = server_bind


sys.meta_path.insert(0, _Doors)
