"""What to run, and getting it run: config, plan, engines, status."""

import os

# Here numpy solves small systems: OpenBLAS' threads gain nothing, and where the cores are busy with runs they wait for
# each other (a solve of ten unknowns takes 9 ms instead of 10 us).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
