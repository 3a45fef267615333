"""Stiffness from probes and from the static contact network, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import snapshots

from analysis.micromechanics import stiffness

NONE = {n: slice(0) for n in ("contact_ids", "normal", "branch", "overlap", "f_n", "f_t", "k_n", "k_t")}


@pytest.mark.parametrize("p", [10e3, 100e3, 10e6])
@pytest.mark.parametrize("nu", [0.0, 0.2, 0.4])
def test_fcc_network_has_the_closed_form(p, nu):
    s = snapshots.lattice("fcc", 3, diameter=1e-3, p=p, nu=nu)
    C = stiffness.network_stiffness(s)
    expected = snapshots.closed_form_fcc(s.k_n[0], s.k_t[0], 1e-3)
    assert np.mean(C[:3, :3]) == pytest.approx(expected["K"], rel=1e-6)
    assert np.diag(C)[3:] == pytest.approx(expected["C44"], rel=1e-6)
    assert (C[0, 0] - C[0, 1]) / 2 == pytest.approx(expected["C_prime"], rel=1e-6)
    assert np.abs(C[:3, 3:]).max() < 1e-6 * C[0, 0]
    moduli = stiffness.network_moduli(s)
    assert pytest.approx((expected["C_prime"], expected["K"]), rel=1e-6) == (moduli.G_0, moduli.K_0)
    assert moduli.active == s.N and moduli.residual < 1e-10


def test_relaxation_puts_layers_in_series():
    # Simple cubic, four layers, every other gap along z softer: springs in series along z.
    s = snapshots.lattice("sc", 4, diameter=1.0, p=1e5)
    upward = np.abs(s.normal[:, 2]) > 0.5
    lower = np.minimum(*np.round(s.position[s.contact_ids, 2]).astype(int).T) + np.where(
        np.ptp(np.round(s.position[s.contact_ids, 2]), axis=1) > 1, 3, 0
    )
    soft = upward & (lower % 2 == 0)
    assert np.sum(soft) == s.N / 2
    k_n, k_t = np.where(soft, 0.25, 1.0), np.where(soft, 0.1, 0.5)
    C = stiffness.network_stiffness(replace(s, k_n=k_n, k_t=k_t))
    assert C[2, 2] == pytest.approx(2 / (1 / 0.25 + 1 / 1.0), rel=1e-9)
    assert C[0, 0] == pytest.approx(1.0, rel=1e-9)
    stiff = stiffness.network_stiffness(replace(s, k_n=k_n, k_t=k_t), affine=True)
    assert stiff[2, 2] == pytest.approx((0.25 + 1.0) / 2, rel=1e-9)


def test_turning_of_grains_is_free():
    # Simple cubic shear: a grain that turns half the shear angle loads all four contacts alike, C44 = k_t / (2 D).
    s = snapshots.lattice("sc", 3, diameter=1.0, p=1e5)
    C = stiffness.network_stiffness(replace(s, k_n=np.ones(len(s.k_n)), k_t=np.full(len(s.k_n), 0.5)))
    assert np.diag(C)[3:] == pytest.approx(0.25, rel=1e-9)
    # Twice as stiff across one family of contacts: in series with the other through the grain's turn.
    along_x = np.abs(s.normal[:, 0]) > 0.5
    C = stiffness.network_stiffness(replace(s, k_n=np.ones(len(s.k_n)), k_t=np.where(along_x, 1.0, 0.5)))
    assert C[5, 5] == pytest.approx(1.0 * 0.5 / (1.0 + 0.5), rel=1e-9)


def test_relaxed_network_agrees_with_dense_least_squares():
    s = snapshots.random_network(60, seed=3)
    kept, _ = stiffness.without_rattlers(s)
    strain = stiffness.SHEAR
    # The relaxed state minimises the springs' energy: solve it with dense algebra from single-contact motions.
    B = stiffness._compatibility(kept).toarray().reshape(len(kept.k_n), 3, -1)
    along = kept.normal[:, :, None] * kept.normal[:, None, :]
    root = np.sqrt(kept.k_n)[:, None, None] * along + np.sqrt(kept.k_t)[:, None, None] * (np.eye(3) - along)
    A = np.einsum("cij,cjm->cim", root, B).reshape(3 * len(root), -1)
    b = np.einsum("cij,cj->ci", root, kept.branch @ strain).ravel()
    energy = np.sum((A @ np.linalg.lstsq(A, b, rcond=1e-12)[0] - b) ** 2)
    assert energy > 1e-3 * np.sum(b**2)
    sigma = stiffness.network_response(s, strain[None])[0][0]
    assert np.sum(sigma * strain) * s.volume == pytest.approx(energy, rel=1e-6, abs=1e-9 * np.sum(b**2))


def test_rattlers_are_left_out_again_and_again():
    # A chain that hangs on the lattice by one end falls off grain by grain; the lattice stays as stiff.
    s = snapshots.lattice("fcc", 2, diameter=1.0, p=1e5)
    n = s.N
    chain = np.array([[n, n + 1], [n + 1, n + 2], [n + 2, 0]])
    more = replace(
        s,
        position=np.vstack([s.position, np.zeros((4, 3))]),
        radius=np.append(s.radius, [0.5] * 4),
        contact_ids=np.vstack([s.contact_ids, chain]),
        **{k: np.concatenate([getattr(s, k), getattr(s, k)[:3]]) for k in NONE if k != "contact_ids"},
    )
    kept, active = stiffness.without_rattlers(more)
    assert active == n and len(kept.contact_ids) == len(s.contact_ids)
    assert pytest.approx(stiffness.network_moduli(s).G_0, rel=1e-9) == stiffness.network_moduli(more).G_0
    bare = replace(more, **{k: getattr(more, k)[-3:] for k in NONE})
    with pytest.raises(stiffness.StiffnessError, match="no particle of 36 has two contacts"):
        stiffness.network_moduli(bare)


@pytest.mark.parametrize("seed", range(3))
def test_no_move_changes_the_network(seed):
    rng = np.random.default_rng(seed)
    s = snapshots.lattice("fcc", 2, diameter=1e-3, p=1e6)
    position = s.position + 2e-7 * rng.normal(size=s.position.shape)
    s = snapshots.hertzian(position, s.radius, s.cell, *snapshots.contacts(position, s.radius, s.cell))
    before = stiffness.network_moduli(s)
    relaxed_share = before.G_0 / stiffness.network_moduli(s, affine=True).G_0
    assert relaxed_share < 1.0 - 1e-6
    for moved in (
        snapshots.shifted(s, rng.normal(size=3)),
        snapshots.permuted(s, rng.permutation(s.N)),
        snapshots.recut(s, np.array([[1, 1, 0], [0, 1, 0], [0, 0, 1]])),
    ):
        after = stiffness.network_moduli(moved)
        assert pytest.approx((before.G_0, before.K_0), rel=1e-8) == (after.G_0, after.K_0)
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    Q *= np.sign(np.linalg.det(Q))
    turned, _, _ = stiffness.network_response(snapshots.rotated(s, Q), (Q @ stiffness.SHEAR @ Q.T)[None])
    straight, _, _ = stiffness.network_response(s, stiffness.SHEAR[None])
    assert Q.T @ turned[0] @ Q == pytest.approx(straight[0], rel=1e-7, abs=1e-7 * np.abs(straight).max())


def test_probe_increments_give_moduli():
    G, K = 170e6, 190e6
    for d_eps in (1e-5 * stiffness.SHEAR, -1e-6 * stiffness.SHEAR, 1e-5 * np.diag([0.1, 0.2, 0.9])):
        mean = np.trace(d_eps) / 3 * np.eye(3)
        d_sigma = 2 * G * (d_eps - mean) + 3 * K * mean
        assert stiffness.shear_modulus(d_sigma, d_eps) == pytest.approx(G, rel=1e-12)
        if abs(np.trace(d_eps)) > 1e-12:
            assert stiffness.bulk_modulus(d_sigma, d_eps) == pytest.approx(K, rel=1e-12)
    with pytest.raises(stiffness.StiffnessError, match="holds no axisymmetric shear"):
        stiffness.shear_modulus(d_sigma, np.eye(3))
    with pytest.raises(stiffness.StiffnessError, match="holds no volume change"):
        stiffness.bulk_modulus(d_sigma, stiffness.SHEAR)


def test_effective_medium_is_the_affine_limit_of_an_isotropic_network():
    # Walton's closed form against the affine solve of the random-direction average: same springs, no relaxation.
    rng = np.random.default_rng(5)
    n = snapshots.directed_contacts(20000, 0.0)
    R, nu, G_p, p, Z, phi = 1e-3, 0.2, 25.7e9, 100e3, 6.0, 0.6
    N = int(2 * len(n) / Z)
    volume = N * 4 / 3 * np.pi * R**3 / phi
    force = 3 * p * volume / (len(n) * 2 * R)
    overlap = snapshots.hertz_overlap(force, R, G_p, nu)
    ids = rng.permuted(np.tile(np.arange(N), int(Z) + 1)[: 2 * len(n)]).reshape(-1, 2)
    s = snapshots.hertzian(
        np.zeros((N, 3)), np.full(N, R + 0.5 * overlap), np.cbrt(volume) * np.eye(3), ids, 2 * R * n, G_p, nu
    )
    moduli = stiffness.network_moduli(s, affine=True)
    assert pytest.approx(stiffness.effective_medium(phi, Z, p, G_p, nu), rel=3e-3) == (moduli.G_0, moduli.K_0)
