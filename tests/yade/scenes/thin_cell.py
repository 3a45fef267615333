"""How short YADE's controller makes an edge, and when the checks of a shear run say so; prints one line of JSON."""

import json
import os
import sys
from types import SimpleNamespace

sys.path.insert(0, os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0])

import numpy as np

from analysis.assembly import Assembly
from yade_scripts import rve
from yade_scripts.paths import Drained
from yade_scripts.rve import O, ProofError
from yade_scripts.thin_cell import Advance, span

EDGE, RADIUS = 1.0, (0.12, 0.06)  # m: so large that the controller's metres do not blur where it stops
p = SimpleNamespace(G_p=1e6, stiffness_scale=1.0, nu=0.2, rho=2670.0, mu_iso=0.1, mu_s=0.1, density_scaling=0,
                    timestep_factor=1.0, servo_damping=0.8, servo_mass=0.005, damping=0.0, d50=0.2, sigma_3=1e3,
                    inertial_number=2e-3, strain_end=1.0, direction="compression")  # fmt: skip


def build(edge=EDGE):
    """Two grains far apart that never touch, so that nothing but the controller acts."""
    position = np.array([[0.25, 0.25, 0.25], [0.75, 0.75, 0.75]]) * edge
    rve.build(Assembly(position, np.array(RADIUS), np.full(3, edge)), p)
    O.dt = 1e-4
    O.run(1, True)
    Drained(SimpleNamespace(**vars(p) | {"strain_end": 2.0})).start()
    servo = rve.engine("servo")
    servo.stressMask, servo.goal = 0, (0, 0, -2.0)
    servo.maxStrainRate = (0.1, 0.1, 10.0)
    return servo


def said(check) -> str:
    try:
        check()
    except ProofError as error:
        return str(error)
    return ""


servo = build()
before = span()
O.run(40_000, True)
edge = O.cell.hSize[2, 2]
found = {"stopped": edge / max(servo.maxBodySpan), "span": max(servo.maxBodySpan), "before": before,
         "box": 2 * (RADIUS[0] + 0.05 * RADIUS[1])}  # fmt: skip

build()
advance = Advance(p, Drained(p), 0.0)
found["refused at once"] = said(advance.check_end)
advance.p = SimpleNamespace(**vars(p) | {"strain_end": 0.3})
found["short enough"] = said(advance.check_end)

build(0.99 * 2.1 * before + 0.0055)  # m: 0.6 mm above the limit, less than a step of 1 mm
moving = Drained(p)
moving.rate = 10.0  # as the servo of `build`
found["at the limit"] = said(lambda: Advance(p, moving, 0.3).check(0.3))

build()
advance = Advance(p, Drained(p), 0.1)
advance.steps = 50
O.run(40, True)
found["early"] = said(lambda: advance.check(0.1))
O.run(20, True)
found["no growth"] = said(lambda: advance.check(0.1))
found["growth"] = said(lambda: advance.check(0.11))
print("JSON" + json.dumps(found), flush=True)
os._exit(0)
