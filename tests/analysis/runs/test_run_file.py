"""Products are read as written, and what is broken is named."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
import snapshots

from analysis.micromechanics.snapshot import SnapshotError, check_snapshot
from analysis.quantities import RECORD
from analysis.runs.run_file import RunFileError, read_run, read_snapshot


@pytest.fixture
def product(tmp_path):
    first = replace(snapshots.lattice("fcc", 2, p=100e3), label="start")
    last = replace(snapshots.lattice("bcc", 2, p=100e3), label="end", eps_a=0.3)
    return snapshots.write_product(tmp_path / "r1.h5", snapshots=[first, last], record=snapshots.shear_record())


def test_product_is_read_as_written(product):
    run = read_run(product)
    assert (run.run_id, run.stage, run.path) == ("r1", "shear", product)
    assert run.parameters == {"mu_s": 0.25, "G_p": 25.7e9, "N": 8}
    assert run.timing["steps"] == 10 and run.proofs == {"max_inertial_number": 1e-3}
    assert run.attrs["exit_reason"] == "strain_end" and run.probe is None
    assert run.snapshots == (("00", 0.0, "start"), ("01", 0.3, "end"))
    assert set(run.record) == set(RECORD) and run.record["sigma"].shape == (12, 3, 3)
    assert run.record["eps_a"].tolist() == list(range(12))


def test_record_is_read_when_asked_for_and_only_then(product):
    run = read_run(product)
    with h5py.File(product, "a") as file:
        file["record/e"][3] = 77.0
    assert run.record["e"][3] == 77.0
    with h5py.File(product, "a") as file:
        file["record/e"][3] = 0.0
    assert run.record["e"][3] == 77.0


@pytest.mark.parametrize(("k", "label"), [(0, "start"), (1, "end"), (-1, "end"), ("01", "end"), ("start", "start")])
def test_snapshots_are_found_by_number_key_and_label(product, k, label):
    s = read_snapshot(product, k)
    assert s.label == label
    original = snapshots.lattice("fcc" if label == "start" else "bcc", 2, p=100e3)
    assert all(np.array_equal(getattr(s, name), getattr(original, name)) for name in snapshots.SNAPSHOT_ARRAYS)
    assert s.N == original.N
    assert s.volume == pytest.approx(np.prod(original.cell.diagonal()))


@pytest.mark.parametrize("k", [2, -3, "07", "middle"])
def test_missing_snapshot_is_named(product, k):
    with pytest.raises(RunFileError, match=f"no snapshot {k!r} among the 2"):
        read_snapshot(read_run(product), k)


def test_probe_product(tmp_path):
    path = snapshots.write_product(tmp_path / "p.h5", "probe", [snapshots.lattice("sc", 2, p=1e5)])
    run = read_run(path)
    assert run.probe["G_0"] == 170e6 and run.probe["d_sigma"].shape == (3, 3, 3) and len(run.record) == 0
    with pytest.raises(RunFileError, match="/record has no e$"):
        run.record["e"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "other"}, "not a run product"),
        ({"format_version": 9}, "format_version = 9, this reader knows 1"),
        ({"stage": "knead"}, "stage = 'knead'"),
        ({"complete": False}, "run r1 is not complete"),
    ],
)
def test_wrong_header_is_named(product, change, words):
    with h5py.File(product, "a") as file:
        file.attrs.update(change)
    with pytest.raises(RunFileError, match=f"r1.h5: .*{words}"):
        read_run(product)


@pytest.mark.parametrize("group", ["parameters", "timing", "proofs", "record", "snapshots"])
def test_missing_group_is_named(product, group):
    with h5py.File(product, "a") as file:
        del file[group]
    with pytest.raises(RunFileError, match=f"group /{group} is missing"):
        read_run(product)


def test_record_must_be_whole(product):
    with h5py.File(product, "a") as file:
        del file["record/e"]
        file["record/e"] = np.ones(11)
    with pytest.raises(RunFileError, match=r"/record/e has shape \(11,\), not \(12,\)"):
        read_run(product)
    with h5py.File(product, "a") as file:
        del file["record/e"]
    with pytest.raises(RunFileError, match="/record/e is missing"):
        read_run(product)


def test_record_must_be_finite(product):
    with h5py.File(product, "a") as file:
        file["record/Z"][5] = np.nan
    with pytest.raises(RunFileError, match=r"/record/Z\[5\] is not finite"):
        read_run(product).record["Z"]


def test_energies_may_end_before_the_record(product):
    with h5py.File(product, "a") as file:
        file["record/E_friction"][5:] = np.nan
        file["record/E_elastic"][5:8] = np.nan
    record = read_run(product).record
    assert np.isfinite(record["E_friction"]).sum() == 5
    with pytest.raises(RunFileError, match=r"/record/E_elastic\[5\] is not finite"):
        record["E_elastic"]


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.97])
def test_truncated_product_is_named(product, share):
    whole = product.read_bytes()
    product.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(RunFileError, match="r1.h5: truncated or not an HDF5 file"):
        read_run(product)


def test_absent_product_is_named(tmp_path):
    with pytest.raises(RunFileError, match="nowhere.h5: no such run file"):
        read_run(tmp_path / "nowhere.h5")


def spoiled(name, index, value):
    s = snapshots.lattice("fcc", 2, p=100e3)
    array = getattr(s, name).copy()
    array[index] = value
    return replace(s, **{name: array}, where="r1.h5: snapshot 00")


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (spoiled("position", (4, 1), np.nan), r"position\[4\] = .*nan.* is not finite \(1 such\)"),
        (spoiled("f_t", 7, np.inf), r"f_t\[7\] = .*inf.* is not finite \(3 such\)"),
        (spoiled("radius", 3, -1.0), r"radius\[3\] = -1.0 is not positive"),
        (spoiled("cell", 0, 0.0), "the cell's volume 0 m3 is not positive"),
        (spoiled("contact_ids", (5, 1), 32), r"contact_ids\[5\] = \[.*32\] is unknown \(ids run from 0 to 31\)"),
        (spoiled("contact_ids", (5, 0), -1), r"contact_ids\[5\] = \[-1 .*\] is unknown"),
        (spoiled("contact_ids", 6, 2), r"contact_ids\[6\] = \[2 2\] is a self-contact"),
        (spoiled("normal", 2, 0.9), r"normal\[2\] = .* is not a unit vector"),
    ],
)
def test_bad_snapshot_is_named(bad, words):
    with pytest.raises(SnapshotError, match=f"r1.h5: snapshot 00: {words}"):
        check_snapshot(bad)


def test_snapshot_without_contacts_or_with_odd_shapes_is_named(tmp_path):
    s = snapshots.lattice("fcc", 2, p=100e3)
    empty = {n: getattr(s, n)[:0] for n in ("contact_ids", "normal", "branch", "overlap", "f_n", "f_t", "k_n", "k_t")}
    path = snapshots.write_product(tmp_path / "e.h5", "probe", [replace(s, **empty)])
    with pytest.raises(SnapshotError, match="e.h5: snapshot 00: 32 particles and 0 contacts"):
        read_snapshot(path)
    with pytest.raises(SnapshotError, match=r"k_t has shape \(5,\), not \(192,\)"):
        check_snapshot(replace(s, k_t=s.k_t[:5]))
    with pytest.raises(SnapshotError, match=r"branch\[0\] = .* points against its normal"):
        check_snapshot(replace(s, branch=-s.branch))


def test_snapshot_that_lacks_an_array_is_named(product):
    with h5py.File(product, "a") as file:
        del file["snapshots/01/k_n"]
    with pytest.raises(SnapshotError, match="r1.h5: snapshot 01: dataset k_n is missing"):
        read_snapshot(product)
