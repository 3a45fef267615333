"""Packings without friction: what an undamped run says when it loses sigma_3; a damped one keeps its density."""

from __future__ import annotations

import numpy as np
import pytest
import yade_runs

from analysis.assembly import make_assembly, write_assembly
from analysis.runs.run_file import read_run
from campaign.run_one import _smaller_step_can_help

pytestmark = pytest.mark.yade


def test_a_run_without_friction_and_damping_is_refused_with_what_helps():
    said = yade_runs.scene("servo_words")
    hint = "; mu_s = 0.001 dissipates too little: use damping = 0.2 (dem.damping of a campaign)"
    assert said["slippery"] == "servo: |mean sigma_3 / target - 1| of a window = 0.02 > 0.01 at strain 0.02" + hint
    assert said["lost"].startswith("servo lost: ") and said["lost"].endswith(hint)
    assert said["damped"] == said["rough"] == said["slippery"].removesuffix(hint)
    assert said["a sample"] == ""
    assert not any(map(_smaller_step_can_help, said.values()))  # it is no instability of the integration


@pytest.mark.long
def test_a_damped_packing_without_friction_keeps_the_density_of_random_close_packing(tmp_path):
    """400 spheres, damping 0.2, 5 % strain: solid fraction 0.64 (Peyneau and Roux 2008), nearly without dilatancy."""
    write_assembly(tmp_path / "assembly.h5", make_assembly(400, 0.248e-3, 0.174, seed=1))
    for stage, row in (
        ("consolidate", {"assembly": "assembly.h5", "mu_iso": 0.001}),
        ("shear", {"start": "consolidate.h5", "mu_s": 0.001, "damping": 0.2, "strain_end": 0.05}),
    ):
        done = yade_runs.stage(stage, tmp_path, description=stage, **row)
        assert done.returncode == 0, done.stdout + done.stderr
    strain, e = (read_run(tmp_path / "shear.h5").record[k] for k in ("eps_a", "e"))
    solid = 1.0 / (1.0 + e)
    assert np.mean(solid[strain > 0.025]) == pytest.approx(0.64, abs=0.005)
    assert abs(solid[-1] / solid[0] - 1.0) < 0.01
