"""The paths of a shear test in a real YADE: what each holds, how it ends, how a killed run goes on, its refusals."""

import h5py
import numpy as np
import pytest
import yade_runs

from analysis.assembly import make_assembly, write_assembly

pytestmark = pytest.mark.yade
N, SIGMA_3 = 150, 100e3
#: What a run needs beside its path. A small packing shears to 6 %, where what is held is held for most of the windows.
ROW = {"start": "probe.h5", "mu_s": 0.3, "G_p": 20e9, "inertial_number": 2.4e-3, "strain_end": 0.06}
PATHS = [
    (path, direction) for path in ("constant_p", "undrained", "drained") for direction in ("compression", "extension")
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A medium packing with its probe, and a loose one whose consolidation had the friction of its shear."""
    path = tmp_path_factory.mktemp("paths")
    write_assembly(path / "assembly.h5", make_assembly(N, 0.248e-3, 0.174, seed=3))
    for stage, name, row in (
        ("consolidate", "medium", {"assembly": "assembly.h5", "mu_iso": 0.04, "G_p": 25.7e9}),
        ("consolidate", "loose", {"assembly": "assembly.h5", "mu_iso": 0.5, "G_p": 25.7e9}),
        ("probe", "probe", {"start": "medium.h5", "mu_s": ROW["mu_s"], "G_p": ROW["G_p"]}),
    ):
        done = yade_runs.stage(stage, path, description=name, **row)
        assert done.returncode == 0, done.stdout + done.stderr
    return path


def sheared(folder, name, **row):
    """Attributes, proofs and record (eps_a, sigma, p, eta and the rest) of a run."""
    done = yade_runs.stage("shear", folder, description=name, **ROW | row)
    assert done.returncode == 0, done.stdout + done.stderr
    with h5py.File(folder / f"{name}.h5") as file:
        record = {key: data[()] for key, data in file["record"].items()}
        attrs, proofs = dict(file.attrs), dict(file["proofs"].attrs)
    axial, lateral = record["sigma"][:, 2, 2], 0.5 * (record["sigma"][:, 0, 0] + record["sigma"][:, 1, 1])
    record["p"] = (axial + 2 * lateral) / 3
    return attrs, proofs, record | {"eta": (axial - lateral) / record["p"], "lateral": lateral}


@pytest.mark.parametrize("path, direction", PATHS)
def test_a_path_holds_what_it_says_and_the_signs_are_a_laboratorys(folder, path, direction):
    attrs, proofs, record = sheared(folder, f"{path}_{direction}", path=path, direction=direction)
    sign = 1 if direction == "compression" else -1
    assert attrs["exit_reason"] == "strain_end"
    assert record["eps_a"][-1] == pytest.approx(sign * ROW["strain_end"], abs=0.004)
    assert np.all(np.diff(sign * record["eps_a"]) > 0) and np.all(sign * record["eta"][3:] > 0.3)
    late = np.abs(record["eps_a"]) > 0.01
    held = {"drained": record["lateral"] / SIGMA_3, "constant_p": record["p"] / SIGMA_3,
            "undrained": np.prod(record["cell"], axis=1) / np.prod(record["cell"][0])}[path]  # fmt: skip
    window, sample = {"drained": (0.01, 0.05), "constant_p": (0.002, 0.02), "undrained": (1e-9, 1e-9)}[path]
    # Means of edges are no edges of a mean volume: within a window of 1 % strain their product is off by some 1e-5.
    # The stress tensor of a window is the mean of twenty samples, `servo_mean` of p' that of all goals.
    assert np.abs(held[late] - 1).max() < {"drained": window, "constant_p": 0.01, "undrained": 1e-4}[path]
    assert np.abs(record["servo_mean"][late]).max() < window
    assert proofs["servo_mean_error"] < window and proofs["servo_max_error"] < sample
    assert proofs["max_inertial_number"] < 2.5e-3 and proofs["energy_error"] < 0.03
    if path == "undrained":
        np.testing.assert_allclose(record["e"], record["e"][0], rtol=1e-8)
        assert np.abs(record["eps_v"]).max() < 1e-9
    if path == "drained":
        other = record["sigma"][:, 2, 2] / record["lateral"]
        assert np.all((other[3:] > 1.3) if sign > 0 else (other[3:] < 0.8))


def test_the_inertial_number_stays_while_the_mean_stress_multiplies(folder):
    _, _, record = sheared(folder, "stiffer", path="undrained", strain_end=0.03)
    assert record["p"][-1] > 3 * SIGMA_3
    np.testing.assert_allclose(record["I"][5:], ROW["inertial_number"], rtol=0.2)


def test_an_undrained_test_ends_where_grains_would_crush(folder):
    attrs, _, record = sheared(folder, "stiff", path="undrained", strain_end=0.4, stiff_cap=400e3)
    assert attrs["exit_reason"] == "stiff" and "liquefied_from" not in attrs
    assert record["p"].max() < 1.2 * 400e3 and record["p"][-1] > 0.8 * 400e3 and record["eps_a"][-1] < 0.2


def test_a_loose_packing_liquefies_and_says_from_where(folder):
    attrs, _, record = sheared(folder, "liquefied", path="undrained", start="loose.h5", mu_s=0.5, strain_end=0.4)
    assert attrs["exit_reason"] == "liquefied" and 0 < attrs["liquefied_from"] < 0.02
    after = record["eps_a"] > attrs["liquefied_from"] + 0.002
    assert after.sum() >= 5 and np.all(record["p"][after] < 0.05 * SIGMA_3)
    assert record["eps_a"][-1] - attrs["liquefied_from"] == pytest.approx(0.01, abs=0.002)


@pytest.mark.parametrize("path", ["constant_p", "undrained"])
def test_a_killed_run_goes_on_with_what_it_held(folder, path):
    name = f"killed_{path}"
    row = ROW | {"path": path, "description": name, "checkpoint_seconds": 0.2, "strain_end": 0.04}
    yade_runs.stage_killed_when("shear", folder, folder / f"{name}.checkpoint", **row)
    assert (folder / f"{name}.checkpoint").exists() and not (folder / f"{name}.h5").exists()
    attrs, proofs, record = sheared(folder, name, path=path, checkpoint_seconds=120.0, strain_end=0.04)
    assert attrs["resumed"] == 1 and not (folder / f"{name}.checkpoint").exists()
    assert np.diff(record["eps_a"]).max() < 0.0051
    whole = sheared(folder, f"whole_{path}", path=path, strain_end=0.04)[2]
    late = record["eps_a"] > 0.02
    assert record["eta"][late].mean() == pytest.approx(whole["eta"][late].mean(), rel=0.1)


@pytest.mark.parametrize(
    "row, said",
    [
        ({"path": "undraind"}, "path = 'undraind' is none of drained, constant_p, undrained"),
        ({"direction": "up"}, "direction = 'up' is none of compression, extension"),
        ({"path": "constant_p", "stiffness_scale": 0.1}, "stiffness_scale = 0.1 with path = 'constant_p'"),
        ({"path": "undrained", "stiffness_scale": 0.1}, "stiffness_scale = 0.1 with path = 'undrained'"),
        ({"direction": "extension", "strain_end": 1.9}, "thin cell: strain_end = 1.9 cannot be reached"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(folder, row, said):
    done = yade_runs.stage("shear", folder, description="refused", **ROW | row)
    assert done.returncode == 1 and not (folder / "refused.h5").exists()
    (line,) = [line for line in done.stderr.splitlines() if "failed" in line]
    assert said in line
