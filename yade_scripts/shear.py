"""Stage 3, drained triaxial shear: the z axis shortens at a given inertial number, the servo holds sigma_3 on x and y.

    YADE_BATCH=runs.table:2 yade -n -x -j1 yade_scripts/shear.py        one row
    yade-batch runs.table yade_scripts/shear.py                         all rows

Starts from a probe's product (the packing at rest with mu_s and G_p) or from a consolidation's, which it first brings
to rest.  The product holds the window averages, the snapshots asked for, and the proofs: servo, inertial number,
energy balance, steady state.
"""

import os
import sys

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from yade_scripts import rve
from yade_scripts.checkpoint import Checkpoint
from yade_scripts.proofs import check_shear, is_steady, shear_proofs
from yade_scripts.record import Windows, snapshot
from yade_scripts.rve import O
from yade_scripts.stage import main
from yade_scripts.start import begin
from yade_scripts.thin_cell import Advance

SAMPLES_PER_WINDOW = 20


def protocol(p, product) -> None:
    """Bring the packing to rest, shear it window by window, prove the run, write the product."""
    checkpoint = Checkpoint(p, product)
    windows = checkpoint.resume()
    if windows is None:
        begin(p, calc_energy=True)
        O.trackEnergy = p.damping > 0.0
        rve.servo_triaxial(p, p.strain_end)
        windows = Windows(p)
        product.snapshots = [snapshot("start", 0.0)]
    advance = Advance(p, windows.rows[-1]["eps_a"])
    if not (product.resumed or p.stop_when_steady):
        advance.check_end()
    wanted = [s for s in strains(p.snapshots) if s > product.snapshots[-1]["eps_a"]]

    def watch():
        sample = windows.add()
        check_shear(p, sample, windows)
        rve.trim_servo(p, sample["sigma"])
        while wanted and sample["eps_a"] >= wanted[0]:
            product.snapshots.append(snapshot("strain", sample["eps_a"]))
            wanted.pop(0)
        if windows.full() or (p.stop_when_steady and is_steady(windows.rows)):
            product.snapshots.append(snapshot("end", sample["eps_a"]))
            rve.stop()
        else:
            advance.check(sample["eps_a"])
            checkpoint.save_when_due(windows)

    rve.every(sampling_period(p, windows), watch)
    rve.run(10**9)
    product.record = windows.arrays()
    product.proofs = shear_proofs(p, windows)
    product.exit_reason = "strain_end" if windows.full() else "steady"
    product.write()
    checkpoint.remove()


def strains(text) -> list[float]:
    """Strains at which a full snapshot is taken, from the table's comma-separated text, ascending."""
    return sorted(float(part) for part in str(text).split(",") if part.strip())


def sampling_period(p, windows) -> int:
    """Steps between two samples: twenty in the typical (median) window, never more often than each tenth step."""
    edges = windows.edges
    width = float(sorted(b - a for a, b in zip([0.0, *edges[:-1]], edges, strict=True))[len(edges) // 2])
    return max(10, round(width / rve.strain_rate(p) / O.dt / SAMPLES_PER_WINDOW))


main("shear", protocol)
