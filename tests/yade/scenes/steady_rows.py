"""When a shear run may stop as steady, asked of made-up windows; prints the answers as one line of JSON."""

import json
import os
import sys
from types import SimpleNamespace

sys.path.insert(0, os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0])

import numpy as np

from yade_scripts.paths import Drained
from yade_scripts.proofs import is_steady


def rows(end=0.40, eta=0.7, drift_eta=0.0, drift_e=0.0, scatter=0.0):
    """Windows of 0.5 % strain; drifts relative, over 10 % of strain, scatter relative, each window by itself."""
    rng = np.random.default_rng(1)
    out = []
    for strain in np.arange(0.005, end + 1e-9, 0.005):
        now = eta * (1 + drift_eta * (strain - end) / 0.1 + scatter * rng.normal())
        axial = 100e3 * (3 + 2 * now) / (3 - now)
        out.append({"eps_a": strain, "e": 0.6 * (1 + drift_e * (strain - end) / 0.1),
                    "sigma": np.diag([100e3, 100e3, axial])})  # fmt: skip
    path = SimpleNamespace(steady=Drained.steady)
    return SimpleNamespace(rows=out, path=path, strain=lambda row: row["eps_a"])


cases = {
    "still": rows(),
    "too early": rows(end=0.28),
    "eta drifts": rows(drift_eta=0.05, scatter=1e-4),
    "e drifts": rows(drift_e=0.02),
    "scatter": rows(scatter=0.02),
    "nothing known": rows(scatter=0.2),
}
print("JSON" + json.dumps({name: bool(is_steady(case)) for name, case in cases.items()}), flush=True)
os._exit(0)
