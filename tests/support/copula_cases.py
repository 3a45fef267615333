"""Copulas of every family, and a grid of probabilities that reaches into the corners."""

from __future__ import annotations

import numpy as np

CASES = [
    ("gaussian", (-0.738,)),
    ("gaussian", (0.95,)),
    ("student", (-0.722, 6.05)),
    ("student", (0.5, 3.0)),
    ("frank", (-5.4,)),
    ("frank", (12.0,)),
    ("plackett", (0.09,)),
    ("plackett", (7.0,)),
    ("independence", ()),
    *[(f"clayton{turn}", (2.0,)) for turn in ("", 90, 180, 270)],
    *[(f"gumbel{turn}", (1.7,)) for turn in ("", 90, 180, 270)],
    *[(f"joe{turn}", (2.3,)) for turn in ("", 90, 180, 270)],
]
#: Powers of two, so that 1 - u is exact and a difference in the corners is the formula's and not the rounding's.
LEVELS = np.array([2.0**-30, 2.0**-20, 2.0**-10, 0.0625, 0.25, 0.5])
LEVELS = np.concatenate([LEVELS, 1.0 - LEVELS[4::-1]])
U, V = (grid.ravel() for grid in np.meshgrid(LEVELS, LEVELS, indexing="ij"))
