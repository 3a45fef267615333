"""A run that is stopped from within a step that has long to go; prints where it stood when `run` returned and later."""

import json
import os
import sys
import time

sys.path.insert(0, os.path.abspath(sys.argv[0]).rsplit(os.sep + "tests" + os.sep, 1)[0])

from yade.wrapper import PyRunner

from yade_scripts import rve
from yade_scripts.rve import O

O.engines = [
    PyRunner(iterPeriod=1, dead=True, label="watch"),
    PyRunner(command="import time; time.sleep(0.3)", iterPeriod=1),
]
rve.every(2, rve.stop)
rve.run(100)
returned = O.iter
time.sleep(0.6)
print("JSON" + json.dumps({"returned": returned, "later": O.iter}), flush=True)
os._exit(0)
