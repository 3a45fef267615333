"""A consolidation with other constants than those of `consolidate.py`, and, if asked for, an agitated start.

    yade -n -x -j1 tests/yade/scenes/consolidate_otherwise.py        with the row in YADE_BATCH as usual

Columns of the row that are named after a constant of `consolidate.py` (COMPRESSION_I, DAMPING, ...) replace it; the
damping of the last part, in which the packing comes to rest, stays as it is.
`agitation` gives the grains random velocities before the compression, with this root mean square over
sqrt(sigma_3 / rho).
"""

import math
import os
import sys

import numpy as np

ROOT = os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0]
sys.path.insert(0, ROOT)

from minieigenHP import Vector3  # noqa: E402

from yade_scripts import equilibrium, stage  # noqa: E402
from yade_scripts.rve import O  # noqa: E402

start, reach = stage.main, equilibrium.reach
REST_DAMPING = 0.3


def with_other_constants(name, protocol) -> None:
    def changed(p, product) -> None:
        constants = protocol.__globals__
        constants.update({key: value for key, value in vars(p).items() if key.isupper() and key in constants})
        compress = constants["compress"]

        def agitated(p, history) -> None:
            velocity = np.random.default_rng(p.seed).standard_normal((len(O.bodies), 3)) / math.sqrt(3.0)
            velocity = (velocity - velocity.mean(axis=0)) * getattr(p, "agitation", 0.0) * math.sqrt(p.sigma_3 / p.rho)
            for body, v in zip(O.bodies, velocity, strict=True):
                body.state.vel = Vector3(*map(float, v))
            compress(p, history)

        constants["compress"] = agitated
        protocol(p, product)

    start(name, changed)


stage.main = with_other_constants
equilibrium.reach = lambda p, window, steps, damping: reach(p, window, steps, REST_DAMPING)
sys.argv = [os.path.join(ROOT, "yade_scripts", "consolidate.py")]
with open(sys.argv[0]) as script:
    exec(compile(script.read(), sys.argv[0], "exec"))
