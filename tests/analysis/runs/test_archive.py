"""The archive of runs: the same results without the products, and only what is needed is run again."""

import shutil

import h5py
import numpy as np
import pytest
import synthetic_results as synthetic
from campaign_cases import finish, make_small, needs_batch
from hdf5_files import changed_on_purpose

from analysis.results.build import build_results
from analysis.runs.archive import Archive, ArchiveError, run_summary, write_archive
from analysis.runs.run_file import read_run
from campaign.evaluate import archive
from campaign.folder import write_failure
from campaign.products import clear_the_way, run_statuses, stale


@pytest.fixture
def small(tmp_path):
    """A finished campaign, archived."""
    small = finish(make_small(tmp_path))
    archive(small.folder, small.rows)
    return small


def drop(small, *stages):
    for row in small.rows:
        if row.stage in stages:
            (small.folder / row.product).unlink()


def contents(path):
    """Everything in a results file but its time of making."""
    values = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: values.update({name: item[()] if isinstance(item, h5py.Dataset) else None}))
        values |= {f"@{name}": value for name, value in file.attrs.items() if name != "created"}
    return values


def test_results_without_products_are_those_with_them_bit_by_bit(tmp_path):
    plan, points, info = synthetic.make_campaign(tmp_path, n=4, packings=(1, 2), steady=(1,))
    with_products = contents(build_results(tmp_path, plan, points, info))
    products = list(plan["product"])
    runs = {row.run_id: run_summary(read_run(row.product)) for row in plan.itertuples()}
    write_archive(tmp_path / "runs.h5", runs)
    for path in products:
        tmp_path.joinpath(path).unlink()
    without = contents(build_results(tmp_path, plan, points, info))
    assert with_products.keys() == without.keys() and len(without) > 50
    for name, value in with_products.items():
        assert np.array_equal(value, without[name], equal_nan=np.asarray(value).dtype.kind == "f"), name


def test_archived_runs_are_done_with_what_they_cost(small):
    before = run_statuses(small.folder, small.rows)
    drop(small, "consolidate", "probe", "shear")
    after = run_statuses(small.folder, small.rows)
    assert {s.status for s in after.values()} == {"done"}
    last = small.rows[-1].run_id
    assert after[last].facts["archived"] and after[last].facts["cpu_seconds"] == before[last].facts["cpu_seconds"]
    assert small.total("done") == len(small.rows)


def test_what_a_missing_run_starts_from_is_missing_too(small):
    with changed_on_purpose(small.folder / "runs.h5") as file:
        del file["runs"][small.rows[-1].run_id]
    drop(small, "consolidate", "probe", "shear")
    by_id = {row.run_id: row for row in small.rows}
    last = small.rows[-1]
    chain = {last.run_id, last.start, by_id[last.start].start}
    assert {run_id for run_id, s in run_statuses(small.folder, small.rows).items() if s.status == "missing"} == chain


@needs_batch
def test_a_campaign_goes_on_from_its_archive_alone(small):
    with changed_on_purpose(small.folder / "runs.h5") as file:
        del file["runs"][small.rows[-1].run_id]
    shutil.rmtree(small.folder / "products")
    done = small.command("run")
    assert done.returncode == 0, done.stderr
    assert len(small.started()) == 3 and small.total("done") == len(small.rows)


def test_archiving_again_keeps_runs_whose_products_are_gone(small):
    whole = sorted(Archive(small.folder / "runs.h5"))
    drop(small, "probe")
    text = archive(small.folder, small.rows)
    assert sorted(Archive(small.folder / "runs.h5")) == whole and f"keeps {len(small.rows)} runs" in text


def test_spared_runs_do_not_call_for_their_starts(small):
    with changed_on_purpose(small.folder / "runs.h5") as file:
        del file["runs"][small.rows[-1].run_id]
    drop(small, "consolidate", "probe", "shear")
    spared = frozenset({small.rows[-1].run_id})
    words = {run_id: s.status for run_id, s in run_statuses(small.folder, small.rows, spared=spared).items()}
    assert words.pop(small.rows[-1].run_id) == "spared" and set(words.values()) == {"done"}


def test_a_start_that_fails_when_made_again_is_failed(small):
    with changed_on_purpose(small.folder / "runs.h5") as file:
        del file["runs"][small.rows[-1].run_id]
    drop(small, "consolidate", "probe", "shear")
    start = small.rows[-1].start
    write_failure(small.folder / "products", start, "equilibrium not reached")
    statuses = run_statuses(small.folder, small.rows)
    assert statuses[start].status == "failed" and statuses[small.rows[-1].run_id].status == "failed"
    _, again = clear_the_way(small.folder, small.rows, again=True, spared=frozenset())
    assert {row.stage for row in again} == {"consolidate", "probe", "shear"} and len(again) == 3


def test_archived_runs_of_another_plan_are_stale_and_changed_ones_are_refused(small):
    with changed_on_purpose(small.folder / "runs.h5") as file:
        file["runs"].move(small.rows[-1].run_id, "shear_of_another_plan")
        file["runs"][small.rows[-2].run_id].attrs["told"] += " "
    assert stale(small.folder, small.rows) == ["shear_of_another_plan"]
    with pytest.raises(ArchiveError, match=f"run {small.rows[-2].run_id} has changed"):
        Archive(small.folder / "runs.h5")[small.rows[-2].run_id]


def test_no_archive_holds_nothing_and_another_file_is_refused_by_name(tmp_path):
    assert len(Archive(tmp_path / "runs.h5")) == 0 and Archive(tmp_path / "runs.h5").facts() == {}
    (tmp_path / "runs.h5").write_text("no archive")
    with pytest.raises(ArchiveError, match="runs.h5: truncated or not an HDF5 file"):
        Archive(tmp_path / "runs.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs["format"] = "dem-run"
    with pytest.raises(ArchiveError, match="other.h5: format 'dem-run'"):
        Archive(tmp_path / "other.h5")
