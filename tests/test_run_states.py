"""States of one run: what a probe's two signs decide."""

import h5py
import packings
import pytest

from analysis.run_states import probe_asymmetry, run_states
from analysis.runfile import read_run, read_snapshot
from analysis.stiffness import network_moduli


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
