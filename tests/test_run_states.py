"""States of one run: what a probe's two signs decide."""

import h5py
import numpy as np
import packings
import pytest

from analysis.run_states import contacts_at_limit, probe_asymmetry, run_states
from analysis.runfile import read_run, read_snapshot
from analysis.stiffness import network_moduli


def test_contacts_at_the_coulomb_limit_give_way_to_the_static_network_too(tmp_path):
    """Both signs may be soft alike, so that their agreement proves nothing."""
    path = packings.write_product(tmp_path / "p.h5", "probe", [packings.lattice("fcc", 2, p=1e5)])
    with h5py.File(path, "r+") as file:
        file["probe"].attrs["G_0_minus"] = 170e6
        file["parameters"].attrs["mu_s"] = 0.1
        snapshot = file["snapshots/00"]
        f_n, n = snapshot["f_n"][()], snapshot["normal"][()]
        across = np.cross(n, np.roll(n, 1, axis=1))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        snapshot["f_t"][...] = 0.1 * np.linalg.norm(f_n, axis=1, keepdims=True) * across
    run = read_run(path)
    assert contacts_at_limit(run) == 1.0
    assert run_states(run).states["probe"]["G_0"] == pytest.approx(network_moduli(read_snapshot(run, 0)).G_0, rel=1e-12)


@pytest.mark.parametrize(("minus", "slides"), [(168e6, False), (120e6, True)])
def test_a_sliding_probe_gives_way_to_the_static_network(tmp_path, minus, slides):
    path = packings.write_product(tmp_path / "p.h5", "probe", [packings.lattice("fcc", 2, p=1e5)])
    with h5py.File(path, "r+") as file:
        file["probe"].attrs["G_0_minus"] = minus
    run = read_run(path)
    found = run_states(run).states["probe"]
    network = network_moduli(read_snapshot(run, 0))
    expected = (network.G_0, network.K_0) if slides else (170e6, 180e6)
    assert (found["G_0"], found["K_0"]) == pytest.approx(expected, rel=1e-12)
    assert probe_asymmetry(run.probe) == pytest.approx(2 * (170e6 - minus) / (170e6 + minus))
