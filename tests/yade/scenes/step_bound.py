"""The step that a sheared packing is in fact integrated with, beside the largest stable one; prints one line of JSON.

Goes on from the example probe of the laptop campaign (1,000 spheres), with the engines of a shear run.
"""

import json
import math
import os
import sys
from types import SimpleNamespace

sys.path.insert(0, os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0])
sys.path.insert(1, os.path.join(sys.path[0], "tests", "support"))

import h5py
import numpy as np
from step_bound import PROBE, balanced_inertia, largest_step, stepper_step

from analysis.micromechanics.snapshot import Snapshot
from yade_scripts import rve
from yade_scripts.paths import PATHS
from yade_scripts.record import snapshot
from yade_scripts.rve import O
from yade_scripts.stage import COMMON
from yade_scripts.start import begin

STRAINS = [0.002, 0.008]
with h5py.File(PROBE) as file:
    used = {k: file["parameters"].attrs[k] for k in ("mu_s", "G_p")}
p = SimpleNamespace(**COMMON | used | {"start": str(PROBE), "inertial_number": 2.4e-3, "strain_end": 0.02})
begin(p)
rve.engine("stepper").timeStepUpdateInterval = 1  # so that the step belongs to the contacts that are looked at
path = PATHS["drained"](p)
path.start()
found = []


def look():
    strain = -math.log(O.cell.trsf[2, 2])
    path.follow({"sigma": rve.stress()})
    if strain < STRAINS[len(found)]:
        return
    s = Snapshot(**snapshot("strain", strain))
    mass, moment = balanced_inertia(s.radius, p.rho)
    real = np.array([(b.state.mass, b.state.inertia[0]) for b in O.bodies])
    steps = {"dt": O.dt, "stepper": stepper_step(s, mass, moment), "largest": largest_step(s, mass, moment)}
    error = float(np.abs(real / np.column_stack([mass, moment]) - 1.0).max())
    found.append({"strain": strain, "inertia_error": error, **steps})
    if len(found) == len(STRAINS):
        rve.stop()


rve.every(20, look)
rve.run(10**6)
print("JSON" + json.dumps(found), flush=True)
os._exit(0)
