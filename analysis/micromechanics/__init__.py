"""Metrics of one packing at one instant: stress, fabric, coordination, voids, grading, small-strain stiffness.

A `Snapshot` goes in and numbers in SI units come out; `runs` reads snapshots from files.
Rule: numpy, scipy, `quantities` and `errors_and_files` only; no file and no pandas.  What needs scipy is imported on
first use.
"""

from ..errors_and_files import lazy_names
from .grading import GradingError, active_grading_index, grading_curve, grading_index, stress_grading_index
from .metrics import (
    coordination,
    fabric,
    force_distribution,
    love_stress,
    mean_and_deviator,
    particle_stress,
    snapshot_metrics,
)
from .snapshot import Snapshot, SnapshotError, check_snapshot
from .stress_force_fabric import StressForceFabric

_STIFFNESS = ("Moduli", "StiffnessError", "effective_medium", "network_moduli", "network_stiffness")
__all__ = [
    "GradingError",
    "Moduli",
    "Snapshot",
    "SnapshotError",
    "StiffnessError",
    "StressForceFabric",
    "active_grading_index",
    "check_snapshot",
    "coordination",
    "effective_medium",
    "fabric",
    "force_distribution",
    "grading_curve",
    "grading_index",
    "love_stress",
    "mean_and_deviator",
    "network_moduli",
    "network_stiffness",
    "particle_stress",
    "snapshot_metrics",
    "stress_grading_index",
]

__getattr__, __dir__ = lazy_names(__name__, dict.fromkeys(_STIFFNESS, ".stiffness"))
