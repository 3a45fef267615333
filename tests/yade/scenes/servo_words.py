"""What a shear run says when it lost what it should hold, asked of made-up windows; prints one line of JSON."""

import json
import os
import sys
from types import SimpleNamespace

sys.path.insert(0, os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0])

import numpy as np

from yade_scripts.paths import Drained
from yade_scripts.proofs import check_shear, shear_proofs
from yade_scripts.rve import ProofError
from yade_scripts.stage import COMMON


def said(check, mu_s: float, damping: float, error: float) -> str:
    """The reason that `check` gives for windows whose mean sigma_3 is off by `error`."""
    p = SimpleNamespace(**COMMON | {"mu_s": mu_s, "damping": damping})
    rows = [{"eps_a": strain, "sigma": np.diag([1e5, 1e5, 2e5]), "servo_mean": error, "servo_max": error, "I": 2e-3,
             "F_unb": 0.1, "e": 0.6} for strain in (0.0, 0.01, 0.02)]  # fmt: skip
    windows = SimpleNamespace(
        rows=rows, path=Drained(p), balance=None, strain=lambda row: row["eps_a"], energy_balance=lambda: (0.01, 0.02),
        arrays=lambda: {k: np.array([row[k] for row in rows]) for k in rows[0]},
    )  # fmt: skip
    try:
        check(p, windows)
    except ProofError as reason:
        return str(reason)
    return ""


def on_the_way(p, windows):
    check_shear(p, windows.rows[-1], windows)


cases = {
    "slippery": (shear_proofs, 0.001, 0.0, 0.02),
    "a sample": (shear_proofs, 0.001, 0.0, 0.009),
    "lost": (on_the_way, 0.001, 0.0, 0.06),
    "damped": (shear_proofs, 0.001, 0.2, 0.02),
    "rough": (shear_proofs, 0.25, 0.0, 0.02),
}
print("JSON" + json.dumps({name: said(*case) for name, case in cases.items()}), flush=True)
os._exit(0)
