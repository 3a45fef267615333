"""Oblique collisions of two spheres in YADE: Coulomb, momentum, and what the balanced inertia does to a collision."""

from __future__ import annotations

import numpy as np
import pytest
import yade_runs
from step_bound import balanced_inertia, own_inertia

pytestmark = pytest.mark.yade


@pytest.fixture(scope="module")
def scene():
    return yade_runs.scene("oblique")


@pytest.fixture(scope="module")
def collisions(scene):
    return {(row["angle"], row["balanced"]): row for row in scene["collisions"]}


def test_linear_and_angular_momentum_are_conserved(scene):
    for row in scene["collisions"]:
        assert row["momentum"] < 1e-13 and row["angular_momentum"] < 1e-12


@pytest.mark.parametrize("balanced", [False, True])
@pytest.mark.parametrize("angle", [60.0, 75.0])
def test_gross_sliding_transfers_mu_times_the_normal_impulse(collisions, angle, balanced):
    """J_t = mu J_n and no loss along the normal; the slip then falls by mu (1 + e_n) (1 + m r^2 / I) / tan(angle)."""
    row = collisions[angle, balanced]
    assert row["sliding"] == pytest.approx(1.0, abs=5e-4)
    assert row["normal_restitution"] == pytest.approx(1.0, abs=1e-4)
    lever = 1.0 if balanced else 2.5  # m r^2 / I
    slip = -(1.0 - 2.0 * row["mu"] * (1.0 + lever) / np.tan(np.radians(angle)))
    assert row["slip_restitution"] == pytest.approx(slip, abs=5e-4)


def test_balanced_inertia_changes_a_collision_that_does_not_slide_throughout(collisions):
    """Tangential restitution of the surfaces at 30 degrees and mu = 0.25: 0.14 becomes 0.59 (data/README.md)."""
    own, balanced = collisions[30.0, False], collisions[30.0, True]
    assert own["sliding"] < 0.95 and balanced["sliding"] < 0.95
    assert own["slip_restitution"] == pytest.approx(0.142, abs=2e-3)
    assert balanced["slip_restitution"] == pytest.approx(0.590, abs=2e-3)


def test_inertia_of_the_grains_is_as_documented(scene):
    """Own: solid spheres.  Balanced: masses in proportion to r^1.35 with the same sum, 2.5 times the spin inertia."""
    radius = np.array(scene["radius"])
    for row in scene["collisions"]:
        inertia = (balanced_inertia if row["balanced"] else own_inertia)(radius, scene["rho"])
        np.testing.assert_allclose((row["masses"], row["moments"]), inertia, rtol=1e-14)
