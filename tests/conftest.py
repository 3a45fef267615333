"""Makes the packages importable from the repository's root, numpy in one thread."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import campaign  # noqa: F401  sets OpenBLAS' threads before numpy is there
from analysis import errors_and_files

#: The products of tests have no checksums, and a child process for each would take minutes; tests of it switch it on.
errors_and_files.TRIALS = False
