"""Checkpoints of a long run: the scene and the record so far in one file, replaced atomically, taken up after a kill.

A resumed run continues gaplessly in strain and record.  It is not bit-identical to an uninterrupted one: YADE reloads
its scene self-consistently, but the collider's order of contacts is new.  `resumed` in the product counts how often.
"""

from __future__ import annotations

import os
import pickle
import time
from pathlib import Path

from yade_scripts import rve
from yade_scripts.product import load_scene, saved_scene, script_digest
from yade_scripts.record import Windows
from yade_scripts.rve import O
from yade_scripts.start import INHERITED


class Checkpoint:
    """The checkpoint file of one run, beside its product."""

    def __init__(self, p, product):
        self.p, self.product = p, product
        self.path = Path(p.product).with_suffix(".checkpoint")
        self.saved_at = time.monotonic()

    def save_when_due(self, windows: Windows) -> None:
        """Save when `checkpoint_seconds` have passed since the last time."""
        if time.monotonic() - self.saved_at < self.p.checkpoint_seconds:
            return
        data = {
            "identity": self._identity(),
            "scene": saved_scene(),
            "windows": windows.to_dict(),
            "snapshots": self.product.snapshots,
            "steps": O.iter + self.product.steps_before,
            "seconds": time.process_time() + self.product.seconds_before,
            "resumed": self.product.resumed,
            "inherited": {name: getattr(self.p, name) for name in INHERITED if hasattr(self.p, name)},
        }
        part = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        part.write_bytes(pickle.dumps(data))
        os.replace(part, self.path)
        self.saved_at = time.monotonic()

    def resume(self) -> Windows | None:
        """The record to go on with, the scene loaded; None when there is nothing of this very run and code."""
        try:
            data = pickle.loads(self.path.read_bytes())
        except (OSError, pickle.UnpicklingError, EOFError, AttributeError):
            return None
        if data["identity"] != self._identity():
            return None
        vars(self.p).update(data["inherited"])
        load_scene(data["scene"])
        O.resetTime()
        rve.engine("watch").dead = True
        O.run(1, True)  # the contact law knows its scene only after a step
        windows = Windows(self.p)
        windows.restore(data["windows"])
        product = self.product
        product.snapshots, product.resumed = data["snapshots"], data["resumed"] + 1
        product.steps_before, product.seconds_before = data["steps"], data["seconds"]
        print(f"{self.p.run_id}: resumed at strain {windows.rows[-1]['eps_a']:.4f}")
        return windows

    def remove(self) -> None:
        self.path.unlink(missing_ok=True)

    def _identity(self) -> tuple:
        fixed = {k: v for k, v in vars(self.p).items() if k in self.keys()}
        return script_digest(), tuple(sorted(fixed.items()))

    @staticmethod
    def keys() -> tuple:
        """Parameters that make a run this run."""
        return (
            "run_id",
            "start",
            "mu_s",
            "G_p",
            "sigma_3",
            "inertial_number",
            "strain_end",
            "windows",
            "energy_strain",
            "timestep_factor",
            "damping",
            "stiffness_scale",
            "density_scaling",
            "snapshots",
        )
