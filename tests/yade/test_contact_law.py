"""Two spheres in YADE against Hertz, Mindlin and Coulomb in closed form."""

import numpy as np
import pytest
import yade_runs

pytestmark = pytest.mark.yade


@pytest.fixture(scope="module")
def two():
    answer = yade_runs.scene("two_spheres")
    R = answer["R1"] * answer["R2"] / (answer["R1"] + answer["R2"])
    G, nu = answer["G_p"], answer["nu"]
    E_star = 2.0 * G * (1.0 + nu) / (2.0 * (1.0 - nu**2))
    return answer, R, E_star, G / (2.0 * (2.0 - nu))


def test_normal_force_is_hertz(two):
    answer, R, E_star, _ = two
    for row in answer["static"]:
        hertz = 4.0 / 3.0 * E_star * np.sqrt(R) * row["overlap"] ** 1.5
        # the overlap itself is a difference of positions near 1e-3 m: what 16 digits leave of it
        rounding = 1e-10 + 1.5 * 4e-19 / row["overlap"]
        assert row["F"] == pytest.approx(hertz, rel=rounding)
        assert row["k_n"] == pytest.approx(2.0 * E_star * np.sqrt(R * row["overlap"]), rel=rounding)


def test_tangential_stiffness_is_mindlin(two):
    answer, R, _, G_star = two
    for row in answer["static"]:
        rounding = 1e-10 + 4e-19 / row["overlap"]
        assert row["k_t"] == pytest.approx(8.0 * G_star * np.sqrt(R * row["overlap"]), rel=rounding)
        assert row["k_t"] / row["k_n"] == pytest.approx(2.0 * (1 - answer["nu"]) / (2 - answer["nu"]), rel=1e-10)


def test_tangential_force_follows_the_stiffness(two):
    """YADE measures the tangential displacement on the undeformed radii: a factor (R1 + R2) / (R1 + R2 - overlap)."""
    answer, R, _, G_star = two
    length = answer["R1"] + answer["R2"]
    expected = 8.0 * G_star * np.sqrt(R * 3e-8) * length / (length - 3e-8)
    assert answer["k_t_measured"] == pytest.approx(expected, rel=1e-6)


def test_sliding_is_at_the_coulomb_limit(two):
    assert two[0]["ratio"] == pytest.approx(two[0]["mu"], rel=1e-14)


def test_swap_reaches_contacts_that_carry_load(two):
    for row in two[0]["static"]:
        assert row["F_swapped"] == pytest.approx(2.0 * row["F"], rel=1e-12)
        assert row["k_t_swapped"] == pytest.approx(2.0 * row["k_t"], rel=1e-12)
        assert row["mu"] == 0.5


def test_cycle_below_sliding_returns_its_energy(two):
    assert abs(two[0]["cycle_work"]) < 1e-6 * abs(two[0]["cycle_stored"])


def test_collision_time_and_restitution_are_hertz(two):
    answer, R, E_star, _ = two
    m1, m2 = (answer["rho"] * 4.0 / 3.0 * np.pi * r**3 for r in (answer["R1"], answer["R2"]))
    m = m1 * m2 / (m1 + m2)
    duration = 2.868 * (m**2 / (R * E_star**2 * answer["v"])) ** 0.2
    assert answer["duration"] == pytest.approx(duration, rel=2e-3)
    assert answer["restitution"] == pytest.approx(1.0, abs=1e-6)
