"""Stage 3, triaxial shear: the z axis shortens or lengthens at a given inertial number on one of the paths.

    YADE_BATCH=runs.table:2 yade -n -x -j1 yade_scripts/shear.py        one row
    yade-batch runs.table yade_scripts/shear.py                         all rows

Starts from a probe's product (the packing at rest with mu_s and G_p) or from a consolidation's, which it first brings
to rest.  `paths.py` says what a path holds (sigma_3, p' or the volume).  The product holds the window averages, the
snapshots asked for, and the proofs: what is held, inertial number, energy balance, steady state.
"""

import os
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from yade_scripts import rve
from yade_scripts.checkpoint import Checkpoint
from yade_scripts.paths import PATHS
from yade_scripts.proofs import check_shear, is_steady, shear_proofs
from yade_scripts.record import Windows, snapshot
from yade_scripts.rve import O
from yade_scripts.stage import main
from yade_scripts.start import begin
from yade_scripts.thin_cell import Advance

SAMPLES_PER_WINDOW = 20


def protocol(p, product) -> None:
    """Bring the packing to rest, shear it window by window, prove the run, write the product."""
    path = PATHS[p.path](p)
    checkpoint = Checkpoint(p, product)
    windows = checkpoint.resume(path)
    if windows is None:
        begin(p, calc_energy=True)
        O.trackEnergy = p.damping > 0.0
        path.start()
        windows = Windows(p, path)
        product.snapshots = [snapshot("start", 0.0)]
    advance = Advance(p, path, windows.strain(windows.rows[-1]))
    if not (product.resumed or p.stop_when_steady):
        advance.check_end()
    wanted = [s for s in strains(p.snapshots) if s > windows.strain(product.snapshots[-1])]

    def watch():
        sample = windows.add()
        strain = windows.strain(sample)
        check_shear(p, sample, windows)
        path.follow(sample)
        while wanted and strain >= wanted[0]:
            product.snapshots.append(snapshot("strain", sample["eps_a"]))
            wanted.pop(0)
        product.exit_reason = why_ended(p, windows, sample)
        if product.exit_reason:
            windows.end()
            product.snapshots.append(snapshot("end", sample["eps_a"]))
            rve.stop()
        else:
            advance.check(strain)
            checkpoint.save_when_due(windows)

    rve.every(sampling_period(p, windows), watch)
    rve.run(10**9)
    product.record = windows.arrays()
    product.proofs = shear_proofs(p, windows)
    if product.exit_reason == "liquefied":
        product.facts["liquefied_from"] = path.low_since
    product.write()
    checkpoint.remove()


def why_ended(p, windows, sample: dict) -> str:
    """The reason why a test ends with this sample; "" while it goes on."""
    if windows.full():
        return "strain_end"
    if p.stop_when_steady and is_steady(windows):
        return "steady"
    return windows.path.ended(windows.strain(sample), sample["sigma"])


def strains(text) -> list[float]:
    """Strains at which a full snapshot is taken, from the table's comma-separated text, ascending."""
    return sorted(float(part) for part in str(text).split(",") if part.strip())


def sampling_period(p, windows) -> int:
    """Steps between two samples: twenty in the typical (median) window, never more often than each tenth step."""
    edges = windows.edges
    width = float(sorted(b - a for a, b in zip([0.0, *edges[:-1]], edges, strict=True))[len(edges) // 2])
    return max(10, round(width / rve.strain_rate(p) / O.dt / SAMPLES_PER_WINDOW))


main("shear", protocol)
