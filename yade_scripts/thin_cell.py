"""The shortest edge to which YADE's servo shortens a cell, and the check that a shear run does not stand still there.

PeriTriaxController limits the rate of an axis to (edge - 2.1 span) / dt, where span is the largest bounding box of a
grain when the controller first ran.  Edge and rate have different units in that formula, and so the axis is slowed down
from where edge - 2.1 span, in m, is less than the strain of one step, and never gets to 2.1 spans.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.assembly import SHORTEST_EDGE
from yade_scripts import rve
from yade_scripts.rve import O, ProofError

#: Share of the predicted steps after which the strain must have grown, and by which share of what it should have.
LATEST, LEAST = 0.01, 0.1


def span() -> float:
    """Largest bounding box of a grain (m) that the servo reckons with: that of its first step, or today's before it."""
    known = max(rve.engine("servo").maxBodySpan)
    if known > 0.0:
        return known
    boxes = [np.array(b.bound.max) - np.array(b.bound.min) for b in O.bodies if b.bound]
    return float(np.max(boxes))


class Advance:
    """Watches that the axial strain of a shear run grows as it should.

    The edge that shortens is the axial one in compression and the lateral one, at half the strain, in extension.
    """

    def __init__(self, p, path, strain: float):
        self.p, self.path, self.limit = p, path, SHORTEST_EDGE * span()
        self.axis, self.share = (2, 1.0) if path.sign > 0 else (0, 0.5)
        self.steps = LATEST * p.strain_end / (rve.strain_rate(p) * O.dt)
        self.since = (O.iter, strain)

    def check_end(self) -> None:
        """Refuse, before a run begins, an end that its cell cannot be shortened to."""
        edge, step = O.cell.hSize[self.axis, self.axis], rve.strain_rate(self.p) * O.dt
        reached = math.log(edge / (self.limit + step)) / self.share
        if reached < self.p.strain_end:
            raise ProofError(
                f"thin cell: strain_end = {self.p.strain_end:g} cannot be reached, YADE stops the cell at strain "
                f"{reached:.3g}, edge {edge * math.exp(-reached * self.share):.4g} m (now {edge:.4g} m), limit "
                f"{SHORTEST_EDGE:g} spans of the largest grain = {self.limit:.4g} m"
            )

    def check(self, strain: float) -> None:
        """Refuse a run whose strain stands still, with strain, edge and limit."""
        edge, step = O.cell.hSize[self.axis, self.axis], self.path.rate * O.dt
        if edge - self.limit < step:
            raise ProofError(
                f"thin cell: the strain stands still at {strain:.4g} of {self.p.strain_end:g}, edge {edge:.4g} m, "
                f"limit {SHORTEST_EDGE:g} spans of the largest grain = {self.limit:.4g} m"
            )
        if O.iter - self.since[0] < self.steps:
            return
        grown, wanted = strain - self.since[1], LATEST * self.p.strain_end
        if not grown > LEAST * wanted:
            raise ProofError(
                f"the strain stands still at {strain:.4g} of {self.p.strain_end:g}: {grown:.3g} in "
                f"{O.iter - self.since[0]} steps, should be {wanted:.3g}; edge {edge:.4g} m, limit {self.limit:.4g} m"
            )
        self.since = (O.iter, strain)
