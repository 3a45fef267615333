"""A stage in yade-longdouble, whose numbers come to Python as mpmath's: arrays made of them become doubles.

    yade-longdouble -n -x -j1 tests/yade/scenes/in_long_double.py STAGE     with the row in YADE_BATCH as usual

Forces, positions and the integration stay in long double; what the scripts read, record and steer by is double.
"""

import os
import sys
from functools import wraps

import h5py
import mpmath
import numpy as np

ROOT = os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0]


def in_doubles(function):
    """The function with its array arguments, or its array result, in doubles where they hold objects."""

    @wraps(function)
    def wrapped(*args, **named):
        return _double(function(*(_double(arg) for arg in args), **named))

    return wrapped


def _double(value):
    if isinstance(value, mpmath.mpf):
        return float(value)
    if isinstance(value, list) and value and isinstance(value[0], mpmath.mpf):
        return [float(v) for v in value]
    if isinstance(value, np.ndarray) and value.dtype == object and value.size and isinstance(value.flat[0], mpmath.mpf):
        return value.astype(float)
    return value


for name in ("array", "log", "sqrt", "sum", "mean"):
    setattr(np, name, in_doubles(getattr(np, name)))
for name in ("create", "__setitem__"):
    setattr(h5py.AttributeManager, name, in_doubles(getattr(h5py.AttributeManager, name)))
sys.argv = [os.path.join(ROOT, "yade_scripts", f"{sys.argv[1]}.py")]
with open(sys.argv[0]) as script:
    exec(compile(script.read(), sys.argv[0], "exec"))
