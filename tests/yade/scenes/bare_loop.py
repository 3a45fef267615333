"""A bare loop over a run's packing: collider, interactions, integrator and nothing else; prints its CPU seconds.

    yade -n -x -j1 tests/yade/scenes/bare_loop.py PRODUCT STEPS DT RATE       PRODUCT: a probe's; RATE of shear in 1/s

The cell is squeezed along z at constant volume, so that contacts slide, open and close as in a shear run.
"""

import os
import sys
import time
from types import SimpleNamespace

sys.path.insert(0, os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0])

from minieigenHP import Matrix3

from yade_scripts import rve
from yade_scripts.product import load_start
from yade_scripts.rve import O
from yade_scripts.stage import COMMON

product, steps, dt, rate = sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4])
load_start(product)
rve.set_engines(SimpleNamespace(**COMMON))
bare = ("ForceResetter", "InsertionSortCollider", "InteractionLoop", "NewtonIntegrator")
O.engines = [engine for engine in O.engines if type(engine).__name__ in bare]
O.dt = dt
O.cell.velGrad = Matrix3(0.5 * rate, 0, 0, 0, 0.5 * rate, 0, 0, 0, -rate)
O.run(steps, True)
print("cpu_seconds", time.process_time(), flush=True)
os._exit(0)
