"""States of one run: when a probe gives way to the static network."""

import h5py
import numpy as np
import pytest
import snapshots

from analysis.micromechanics.stiffness import network_moduli
from analysis.runs.run_file import read_run, read_snapshot
from analysis.runs.states import contacts_pushed, run_states


def probe(folder, G_0, minus, turned, mu_s=0.1, strain=1e-9):
    """A probe of an fcc lattice whose contacts bear tangential forces of `turned` times the Coulomb limit, if any."""
    path = snapshots.write_product(folder / "p.h5", "probe", [snapshots.lattice("fcc", 2, p=1e5)])
    with h5py.File(path, "r+") as file:
        file["probe"].attrs.update(G_0=G_0, G_0_minus=minus, strain=strain)
        file["parameters"].attrs["mu_s"] = mu_s
        snapshot = file["snapshots/00"]
        f_n, n = snapshot["f_n"][()], snapshot["normal"][()]
        across = np.cross(n, np.roll(n, 1, axis=1))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        snapshot["f_t"][...] = turned * mu_s * np.linalg.norm(f_n, axis=1, keepdims=True) * across
    return read_run(path)


def test_a_probe_far_from_the_coulomb_limit_stands_unchecked(tmp_path):
    run = probe(tmp_path, 170e6, 168e6, turned=0.5)
    result = run_states(run)
    assert contacts_pushed(run) == 0.0 and np.isnan(result.checks["off"])
    assert result.states["probe"]["G_0"] == 170e6
    assert result.checks["asymmetry"] == pytest.approx(2 * 2e6 / 338e6)


@pytest.mark.parametrize(
    ("minus", "turned", "strain"), [(170e6, 1.0, 1e-9), (120e6, 0.5, 1e-9), (170e6, 0.99, 1e-5)],
    ids=["at the limit", "signs differ", "so near that the probe gets there"],
)  # fmt: skip
def test_a_probe_in_which_contacts_may_slide_gives_way_to_the_static_network(tmp_path, minus, turned, strain):
    run = probe(tmp_path, 170e6, minus, turned, strain=strain)
    network = network_moduli(read_snapshot(run, 0))
    result = run_states(run)
    moduli = result.states["probe"]
    assert (moduli["G_0"], moduli["K_0"]) == pytest.approx((network.G_0, network.K_0), rel=1e-12)
    assert result.checks["off"] == pytest.approx(170e6 / network.G_0 - 1)


def test_a_checked_probe_that_agrees_with_the_network_stands(tmp_path):
    run = probe(tmp_path, 170e6, 170e6, turned=1.0)
    exact = network_moduli(read_snapshot(run, 0)).G_0
    run = probe(tmp_path, 0.995 * exact, 0.995 * exact, turned=1.0)
    result = run_states(run)
    assert contacts_pushed(run) == 1.0 and result.checks["off"] == pytest.approx(-0.005)
    assert result.states["probe"]["G_0"] == pytest.approx(0.995 * exact, rel=1e-12)


def test_grains_with_their_own_friction_are_always_checked(tmp_path):
    run = probe(tmp_path, 170e6, 170e6, turned=0.5)
    with h5py.File(run.path, "r+") as file:
        file["parameters"].attrs["heterogeneity"] = "grain"
    run = read_run(run.path)
    result = run_states(run)
    assert np.isnan(result.checks["pushed"]) and np.isfinite(result.checks["off"])
