"""Refits of the inputs: none without a number of measurements, of pairs, of stated distributions."""

from __future__ import annotations

import numpy as np
import pytest
from other_inputs import joint_of

from analysis.inputs.measurements import measurements_behind, refitted_joints
from analysis.inputs.specified import joint_from_distributions

STATED = {"mu_s": {"family": "lognormal", "mean": 0.25, "cov": 0.3}, "G_p_GPa": {"value": 29.0}}
EMPTY = np.empty((0, 1))


def stated(pairs_behind):
    specified = joint_from_distributions(STATED)
    return {"specified": specified.to_dict(), "joint": specified.joint.to_dict(), "pairs_behind": pairs_behind}


def test_stated_distributions_are_refitted_to_samples_of_the_size_that_is_stated():
    assert measurements_behind(stated(0), EMPTY) == 0 and refitted_joints(stated(0), EMPTY, 5) == []
    assert measurements_behind(stated(40), EMPTY) == 40
    medians = [joint.marginals[0].params["median"] for joint in refitted_joints(stated(40), EMPTY, 400)]
    assert np.std(np.log(medians)) == pytest.approx(np.sqrt(np.log(1.09)) / np.sqrt(40), rel=0.1)


def test_measured_rows_are_resampled():
    joint = joint_of(("mu_s", "G_p", "nu"))
    rows, inputs = joint.sample(60, np.random.default_rng(1)), {"joint": joint.to_dict()}
    assert measurements_behind(inputs, rows) == 60 and measurements_behind(inputs, rows[:9]) == 0
    refitted = refitted_joints(inputs, rows, 30)
    means = np.array([[m.mean for m in one.marginals] for one in refitted])
    assert means.std(axis=0) == pytest.approx(rows.std(axis=0) / np.sqrt(60), rel=0.4)
    assert refitted_joints({"joint": {}}, rows, 5) == []
