"""Checkpoint files that fit and that do not, as `packed` and `unpacked` treat them; prints one line of JSON."""

import json
import os
import pickle
import sys

sys.path.insert(0, os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0])

import numpy as np

from yade_scripts.checkpoint import CheckpointError, packed, unpacked

RAN = []


class Bomb:
    """Runs code when it is unpickled."""

    def __reduce__(self):
        return (exec, ("import __main__; __main__.RAN.append(1)",))


rng = np.random.default_rng(1)
data = {
    "windows": {"rows": [{"sigma": rng.normal(size=(3, 3)), "e": float(rng.normal()), "E": float("nan")}],
                "last": (rng.normal(size=3), rng.normal(size=3)), "balance": None, "count": 3, "n": np.int64(7)},
    "snapshots": [{"label": "start", "position": rng.normal(size=(100, 3)), "ids": np.empty((0, 2), np.int64)}],
    "inherited": {"assembly": "a.h5", "N": np.int64(100)},
}  # fmt: skip
identity = {"run_id": "r", "scripts": "0" * 64, "parameters": {"mu_s": 0.1, "strain_end": 0.4, "heading": float("nan")}}
content = packed(identity, b"scene", data)
scene, back = unpacked(content, identity)


def same(a, b):
    """Whether b is a to the last bit, lists standing for tuples."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    return a == b or (a != a and b != b)


def said(content, identity=identity):
    try:
        unpacked(content, identity)
    except CheckpointError as error:
        return str(error)
    return "taken up"


at = len(content) - 2000
heading, body = content.split(b"\n", 1)
print("JSON" + json.dumps({
    "same": same(data, back) and scene == b"scene",
    "pickle": said(pickle.dumps({"identity": identity, "scene": Bomb()})),
    "pickle inside": said(heading + b"\n" + pickle.dumps(Bomb())),
    "nested": said(b"[" * 60000),
    "empty": said(b""),
    "other run": said(content, identity | {"run_id": "s"}),
    "other scripts": said(content, identity | {"scripts": "1" * 64}),
    "other value": said(content, identity | {"parameters": {"mu_s": 0.2, "strain_end": 0.4, "heading": float("nan")}}),
    "flipped": said(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]),
    "cut": said(content[:at]),
    "newer": said(content.replace(b'"format_version": 1', b'"format_version": 2')),
    "ran": len(RAN),
}), flush=True)  # fmt: skip
os._exit(0)
