"""The record of a shear run from samples and contacts with known answers."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
import snapshots

from campaign.lammps import outputs, record, scene
from campaign.lammps.outputs import LammpsError
from campaign.lammps.proofs import shear_proofs
from campaign.lammps.scene import MEANS, SAMPLES

P = SimpleNamespace(mu_s=0.3, nu=0.2, sigma_3=1e5, d50=0.25e-3, rho=2670.0, N=4)


def samples(steps: int = 41, end: float = 0.02) -> dict[str, np.ndarray]:
    """A test at constant stress 100, 100, 200 kPa and constant volume in which z shortens by `end`."""
    strain = np.linspace(0.0, end, steps)
    values = {name: np.zeros(steps) for name in (*SAMPLES, *MEANS)}
    values |= {"eps_a": strain, "length_z": 1e-3 * np.exp(-strain), "Z": np.full(steps, 5.0)}
    values |= {f"length_{a}": 1e-3 * np.exp(0.5 * strain) for a in "xy"}
    values |= {"sigma_xx": np.full(steps, 1e5), "sigma_yy": np.full(steps, 1e5), "sigma_zz": np.full(steps, 2e5)}
    values |= {f"mean_{axes}": values[f"sigma_{axes}"] * (strain > 0.0) for axes in ("xx", "yy", "zz")}
    values |= {"active": np.full(steps, 4.0), "solid": np.full(steps, 5e-10)}
    values |= {"resultant": np.full(steps, 0.1), "rate_z": np.full(steps, -20.0), "step": 10.0 * np.arange(steps)}
    return values


def contact_lists(s: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    step = s["step"][::5]
    return {
        "step": step,
        "E_elastic": 1e-9 * step,
        "f_sliding": np.full(len(step), 0.4),
        "mean_f_n": np.full(len(step), 2.0),
        "count": np.full(len(step), 10),
    }


def made(edges=(0.01, 0.02)) -> dict[str, np.ndarray]:
    s = samples()
    return record.record(P, s, contact_lists(s), np.full(4, 0.3e-3), np.array(edges))


def test_a_window_closes_with_the_first_sample_at_its_edge():
    strain = np.array([0.0, 0.4, 0.9, 1.1, 1.5, 2.0, 2.5])
    assert record.windows_of(strain, np.array([1.0, 2.0, 3.0])).tolist() == [0, 1, 1, 1, 2, 2, 3]


def test_rows_are_means_of_their_windows_and_work_is_that_of_the_boundary():
    r = made()
    assert r["eps_a"] == pytest.approx([0.0, np.linspace(0.0, 0.02, 41)[1:21].mean(), 0.01525])
    assert r["W_boundary"][-1] == pytest.approx(1e-9 * (2e5 - 1e5) * 0.02)
    assert r["servo_max"] == pytest.approx(0.0) and r["F_unb"] == pytest.approx(0.05)
    assert r["Z_m"] == pytest.approx(5.0) and r["I"] == pytest.approx(20.0 * 0.25e-3 * np.sqrt(2670.0 / (4e5 / 3.0)))
    assert r["Phi"][0] == pytest.approx(np.eye(3) / 3.0) and r["f_sliding"] == pytest.approx(0.4)


def test_the_averaged_stress_does_not_lag_behind_the_strain():
    strain = np.linspace(0.0, 1.0, 11)
    means = np.concatenate([[0.0], 0.5 * (strain[1:] + strain[:-1])])  # of a stress that grows with the strain
    assert outputs.centred(means)[:-1] == pytest.approx(strain[:-1])


def test_friction_is_not_given_and_the_residual_is_what_the_balance_leaves():
    r = made()
    assert np.isnan(r["E_friction"]).all() and (r["E_damping"] == 0.0).all()
    assert r["E_residual"] == pytest.approx(r["W_boundary"] - (r["E_elastic"] - r["E_elastic"][0]))


def test_energy_of_a_lattice_is_that_of_its_springs():
    s = snapshots.lattice("fcc", 2, diameter=0.25e-3, p=1e5)
    rows = np.column_stack([s.contact_ids + 1, np.linalg.norm(s.f_n, axis=1), np.full(len(s.normal), 1e-6)])
    expected = (0.4 * np.linalg.norm(s.f_n, axis=1) * s.overlap + 1e-12 / (2.0 * s.k_t)).sum()
    assert record.energies(rows, s.radius, P, 25.7e9) == pytest.approx(expected, rel=1e-6)


def test_digits_of_a_list_tell_a_sliding_contact_from_one_that_sticks():
    digits = re.search(r"format float (%\S+)", scene.contacts(10))[1]
    f_n = np.random.default_rng(1).lognormal(-5.0, 1.0, 400)
    share = np.where(np.arange(400) % 2, 1.0, 0.99999)
    rows = [(1, 2, float(digits % f), float(digits % (P.mu_s * s * f))) for f, s in zip(f_n, share, strict=True)]
    lists = record.along_contacts([(0, np.array(rows))], np.full(2, 1e-4), P, 25e9)
    assert lists["f_sliding"] == pytest.approx(0.5) and lists["mean_f_n"] == pytest.approx(f_n.mean())


def test_a_list_that_lacks_contacts_is_found():
    s = samples()
    lists = contact_lists(s)
    assert record.check_contacts(s, lists, 4) == ""
    lists["count"][2] = 7
    assert record.check_contacts(s, lists, 4) == "list of contacts at step 100 has 7, not 10"


def test_energy_out_of_nothing_is_refused_and_no_balance_is_claimed():
    r = made()
    figures = shear_proofs(r, 0.05)
    assert np.isnan(figures["energy_error"]) and figures["friction_residual"] > 0.0
    with pytest.raises(LammpsError, match="energy out of nothing over the work put in = 0.5 > 0.1 at strain 0.0153"):
        shear_proofs(r | {"E_residual": -0.5 * r["W_boundary"]}, 0.05)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("I", 0.01, "not quasi-static: I = 0.01 > 0.0025"),
        ("servo_mean", 0.02, "of a window = 0.02 > 0.01"),
        ("servo_max", 0.06, "of a sample = 0.06 > 0.05"),
    ],
)
def test_each_limit_refuses(name, value, message):
    r = made()
    with pytest.raises(LammpsError, match=message):
        shear_proofs(r | {name: np.full(3, value)}, 0.05)


def test_stress_of_the_contacts_must_be_that_of_lammps():
    s = snapshots.lattice("fcc", 2, diameter=0.25e-3, p=1e5)
    snapshot = {"branch": s.branch, "f_n": s.f_n, "f_t": s.f_t, "cell": s.cell}
    assert outputs.check_stress(snapshot, "end", "STRESS end 1e5 1e5 1e5 0 0 0 height 1") < 1e-5
    with pytest.raises(LammpsError, match="stress of the contacts is off LAMMPS' own by 0.000"):
        outputs.check_stress(snapshot, "end", "STRESS end 1.001e5 1e5 1e5 0 0 0 height 1")


def test_files_that_were_cut_off_are_said_to_be_so(tmp_path):
    """What a full disk leaves of them; LAMMPS does not notice it."""
    head = "ITEM: TIMESTEP\n10\nITEM: NUMBER OF ENTRIES\n2\nITEM: ENTRIES x\n"
    rows = "1 2 0.125 0.25\n2 3 0.125 0.25\n"
    path = tmp_path / "contacts.txt"
    path.write_text(head + rows)
    assert [(step, list_.shape) for step, list_ in outputs.contact_lists(path)] == [(10, (2, 4))]
    for cut in (1, 5, 17, len(rows)):
        path.write_text((head + rows)[:-cut])
        with pytest.raises(LammpsError, match="contacts.txt is not whole"):
            list(outputs.contact_lists(path))
    path = tmp_path / "samples.txt"
    path.write_text(" ".join(["1"] * (len(SAMPLES) + 1)) + "\n1 2 3")
    with pytest.raises(LammpsError, match="samples.txt is not whole"):
        outputs.read_samples(path, ())
