"""Metrics of one packing: known answers, identities, and moves that must change nothing."""

from dataclasses import replace

import numpy as np
import pytest
import snapshots

from analysis.micromechanics import metrics as mm
from analysis.micromechanics.snapshot import SnapshotError, check_snapshot
from analysis.micromechanics.stress_force_fabric import stress_force_fabric

SCALARS = ("e", "e_m", "Z", "Z_m", "Phi_dev", "p", "q", "eta", "I_G", "I_G_active", "I_G_stress", "f_sliding")


@pytest.mark.parametrize("kind", snapshots.LATTICE_FACTS)
def test_lattice_has_its_coordination_fabric_and_void_ratio(kind):
    s = snapshots.lattice(kind)
    _, Z, solid = snapshots.LATTICE_FACTS[kind]
    c = mm.coordination(mm.contact_count(s.N, s.contact_ids))
    assert (c.Z, c.Z_m, c.N_0, c.N_1) == (Z, Z, 0, 0)
    assert mm.void_ratio(s.radius, s.volume) == pytest.approx(1.0 / solid - 1.0, abs=1e-12)
    Phi = mm.fabric(s.normal)
    assert np.allclose(Phi, np.eye(3) / 3.0, atol=1e-12)
    assert mm.fabric_deviator(Phi) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("kind", snapshots.LATTICE_FACTS)
def test_lattice_under_pressure_has_that_stress_and_equal_particles(kind):
    s = snapshots.lattice(kind, p=100e3)
    assert np.allclose(mm.love_stress(s.branch, s.force, s.volume), 100e3 * np.eye(3), atol=1e-10 * 100e3)
    particle = mm.particle_stress(s)
    assert np.allclose(particle * mm.sphere_volume(s.radius)[:, None, None], 100e3 * np.eye(3) * s.volume / s.N)
    if kind == "fcc":
        assert np.linalg.norm(s.f_n, axis=1) == pytest.approx(100e3 * 1e-6 / (2 * np.sqrt(2)), rel=1e-10)


def test_rattlers_and_spheres_with_one_contact_by_hand():
    # A square 0-1-2-3 with a diagonal 0-2; 4 hangs on 3 alone; 5 and 6 touch only each other; 7 touches nothing.
    ids = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [3, 4], [5, 6]])
    count = mm.contact_count(8, ids)
    assert count.tolist() == [3, 2, 3, 3, 1, 1, 1, 0]
    c = mm.coordination(count)
    assert (c.N_c, c.N_0, c.N_1) == (7, 1, 3)
    assert c.Z == 14 / 8 and c.Z_m == (14 - 3) / (8 - 1 - 3)
    radius = np.arange(1.0, 9.0)
    solid = 4 / 3 * np.pi * radius**3
    assert mm.void_ratio(radius, 1e5) == pytest.approx(1e5 / solid.sum() - 1, rel=1e-14)
    assert mm.mechanical_void_ratio(radius, count, 1e5) == pytest.approx(1e5 / solid[:4].sum() - 1, rel=1e-14)


def test_known_contact_sets_have_known_anisotropy():
    axes = np.eye(3)[[0, 1, 2, 2, 2]]
    assert np.allclose(mm.fabric(axes), np.diag([0.2, 0.2, 0.6]))
    assert mm.fabric_deviator(mm.fabric(axes)) == pytest.approx(0.4, abs=1e-15)
    weighted = mm.fabric(axes, weight=np.array([3.0, 3.0, 1.0, 1.0, 1.0]))
    assert np.allclose(weighted, np.diag([3, 3, 3]) / 9)
    cone = np.array([[np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)] for t in (0.3,) for a in np.arange(5.0)])
    cone[:, :2] = 0.0
    assert mm.principal_values(mm.fabric(cone / np.linalg.norm(cone, axis=1)[:, None])) == pytest.approx([1, 0, 0])
    # PDF 1 + a (3 z^2 - 1) / 2 has Phi = 1/3 + 2 a / 15 * (1, -1/2, -1/2).
    assert mm.fabric_deviator(mm.fabric(snapshots.directed_contacts(20000, 0.5))) == pytest.approx(0.1, rel=1e-3)


def test_particle_stresses_add_up_to_loves_sum():
    s = snapshots.random_network(seed=4)
    love = mm.love_stress(s.branch, s.force, s.volume)
    summed = np.einsum("n,nij->ij", mm.sphere_volume(s.radius), mm.particle_stress(s)) / s.volume
    assert np.abs(summed - love).max() <= 1e-12 * np.abs(love).max()
    trace = np.trace(mm.particle_stress(s), axis1=1, axis2=2) / 3.0 * mm.sphere_volume(s.radius)
    assert np.allclose(mm.particle_p_volume(s), trace, rtol=1e-12, atol=1e-15 * np.abs(trace).max())


def test_two_pressed_spheres_by_hand():
    s = snapshots.hertzian(
        np.array([[0.0, 0, 0], [1.9, 0, 0]]), np.ones(2), 8 * np.eye(3), np.array([[0, 1]]), np.array([[1.9, 0, 0]])
    )
    f = s.f_n[0, 0]
    assert f > 0.0
    sigma = mm.love_stress(s.branch, s.force, s.volume)
    assert sigma[0, 0] == pytest.approx(f * 1.9 / 512, rel=1e-12) and np.count_nonzero(sigma) == 1
    assert mm.particle_stress(s)[:, 0, 0] == pytest.approx(f * 0.95 / (4 / 3 * np.pi), rel=1e-12)


def test_shared_lens_is_that_of_two_spheres():
    radius, ids = np.array([1.0, 0.6]), np.array([[0, 1]])
    d = 1.3
    x = (d**2 + 1.0 - 0.36) / (2 * d)
    caps = np.pi / 3 * ((1 - x) ** 2 * (2 + x) + (0.6 - (d - x)) ** 2 * (1.2 + (d - x)))
    assert mm.overlap_volume(radius, ids, np.array([1.6 - d])) == pytest.approx(caps, rel=1e-12)


def test_lens_is_negligible_at_full_stiffness_and_counted_once_when_asked():
    s = snapshots.lattice("fcc", p=100e3)
    shared = mm.overlap_volume(s.radius, s.contact_ids, s.overlap).sum()
    plain, exact = mm.void_ratio(s.radius, s.volume), mm.void_ratio(s.radius, s.volume, shared)
    assert 0.0 < exact - plain < 1e-6
    union = s.volume / (1.0 + exact)
    assert union == pytest.approx(mm.sphere_volume(s.radius).sum() - shared, rel=1e-14)


def test_sliding_contacts_are_counted_at_the_limit():
    s = snapshots.random_network(seed=2)
    share = np.linalg.norm(s.f_t, axis=1) / np.linalg.norm(s.f_n, axis=1)
    assert mm.sliding_fraction(s.f_n, s.f_t, 0.5) == pytest.approx(np.mean(share > 0.4), abs=1e-12)
    assert mm.sliding_fraction(s.f_n, s.f_t, 0.6) == 0.0
    none = np.zeros((1, 3))
    assert mm.sliding_fraction(none, none, 0.5) == 0.0


def test_force_distribution_is_a_pdf_with_mean_one():
    f = np.random.default_rng(1).exponential(3.0, 200_000)
    x, pdf = mm.force_distribution(f, bins=60, top=6.0)
    width = x[1] - x[0]
    assert np.sum(pdf) * width == pytest.approx(np.mean(f / f.mean() < 6.0), abs=1e-12)
    assert np.allclose(pdf[:20], np.exp(-x[:20]), rtol=0.05)
    vectors = np.column_stack([f, np.zeros_like(f), np.zeros_like(f)])
    assert np.allclose(mm.force_distribution(vectors)[1], mm.force_distribution(f)[1])


def rotation(rng):
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0 else Q[:, ::-1]


def recuts(rng):
    m = np.eye(3, dtype=int)
    for _ in range(2):
        i, j = rng.choice(3, 2, replace=False)
        m[:, j] += rng.choice([-1, 1]) * m[:, i]
    return m


@pytest.mark.parametrize("seed", range(8))
def test_no_move_changes_a_scalar(seed):
    rng = np.random.default_rng(seed)
    s = snapshots.random_network(N=int(rng.integers(90, 160)), seed=seed, sigma_ln=rng.uniform(0.0, 0.5))
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    Q = rotation(rng)
    moves = {
        "rotation": (snapshots.rotated(s, Q), Q @ axis),
        "shift": (snapshots.shifted(s, rng.normal(size=3) * s.cell.max()), axis),
        "permutation": (snapshots.permuted(s, rng.permutation(s.N)), axis),
        "cell": (snapshots.recut(s, recuts(rng)), axis),
    }
    before = mm.snapshot_metrics(s, 0.5, axis)
    anisotropy = stress_force_fabric(s, axis)
    for name, (moved, new_axis) in moves.items():
        check_snapshot(moved)
        after = mm.snapshot_metrics(moved, 0.5, new_axis)
        for symbol in SCALARS:
            assert after[symbol] == pytest.approx(before[symbol], rel=1e-10, abs=1e-10), (name, symbol)
        split = stress_force_fabric(moved, new_axis)
        for part in ("a_c", "a_n", "a_t", "a_b", "eta_predicted"):
            assert getattr(split, part) == pytest.approx(getattr(anisotropy, part), rel=1e-9, abs=1e-10), (name, part)
        counts = np.bincount(mm.contact_count(moved.N, moved.contact_ids))
        assert counts.tolist() == np.bincount(mm.contact_count(s.N, s.contact_ids)).tolist(), name


def test_turning_the_axis_without_the_packing_does_change_q():
    s = snapshots.random_network(seed=1)
    assert mm.snapshot_metrics(s)["q"] != pytest.approx(mm.snapshot_metrics(s, axis=(1, 0, 0))["q"], rel=1e-3)


def test_metrics_of_forceless_contacts_are_refused():
    s = snapshots.lattice("fcc", p=100e3)
    with pytest.raises(SnapshotError, match="mean stress p' = 0 Pa"):
        mm.snapshot_metrics(replace(s, f_n=0.0 * s.f_n))


def test_other_gradings_take_the_same_functions():
    # Two sizes as in rock salt: large spheres touch twelve of their own kind, small ones fill the holes between six.
    position, edge = snapshots.lattice_positions("fcc", 3, 1.0)
    holes = position + np.array([edge / 6.0, 0.0, 0.0])
    radius = np.repeat([0.5, 0.5 * (np.sqrt(2.0) - 1.0)], len(position)) * (1.0 + 1e-6)
    both = np.concatenate([position, holes])
    ids, branch = snapshots.contacts(both, radius, edge * np.eye(3))
    m = mm.snapshot_metrics(snapshots.hertzian(both, radius, edge * np.eye(3), ids, branch))
    assert m["Z"] == ((12 + 6) + 6) / 2
    w = np.array([1.0, (np.sqrt(2.0) - 1.0) ** 3])
    w /= w.sum()
    expected = np.exp(np.sqrt(w[0] * w[1]) * -np.log(np.sqrt(2.0) - 1.0))
    assert m["I_G"] == pytest.approx(expected, rel=1e-12) and m["I_G_active"] == pytest.approx(expected, rel=1e-12)
    assert m["I_G_stress"] > 1.0
