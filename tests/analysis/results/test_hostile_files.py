"""Files that one does not trust: opening one reads nothing else, executes nothing, and ends in one line."""

from __future__ import annotations

import json
import shutil

import h5py
import numpy as np
import pandas as pd
import pytest
import synthetic_results as synthetic
from hdf5_files import changed_on_purpose
from paths import DATA

from analysis.assembly import AssemblyError, make_assembly, read_assembly, write_assembly
from analysis.errors_and_files import GrainScatterError
from analysis.results.reader import ResultsError, read_results
from analysis.runs.archive import Archive, ArchiveError, run_summary, write_archive
from analysis.runs.run_file import RunFileError, read_run, read_snapshot
from analysis.tables import evaluate, write_tables

PROBE = next((DATA / "laptop" / "example_runs").glob("probe*.h5"))


def read_product(path):
    """All that the analysis takes from a product."""
    return run_summary(read_run(path))


def read_archive(path):
    archive = Archive(path)
    return archive.facts(), [archive[run_id] for run_id in archive]


def read_all_results(path):
    results = read_results(path)
    return results.response("eta", 0.04), results.state("critical", "eta", 0.04)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A good file of every kind: kind -> (path, a dataset in it, what reads it, its error)."""
    folder = tmp_path_factory.mktemp("good")
    write_assembly(folder / "assembly.h5", make_assembly(27, 1e-3, 0.1, 1))
    shutil.copy(PROBE, folder / "product.h5")
    write_archive(folder / "runs.h5", {"probe_x": read_product(PROBE)})
    shutil.copy(synthetic.example(), folder / "results.h5")
    return {
        "assembly": (folder / "assembly.h5", "radius", read_assembly, AssemblyError),
        "product": (folder / "product.h5", "snapshots/00/radius", read_product, RunFileError),
        "archive": (folder / "runs.h5", "runs/probe_x", read_archive, ArchiveError),
        "results": (folder / "results.h5", "families/coupled/0.04/states/critical/eta", read_all_results, ResultsError),
    }


def external_link(file, name, secret):
    file[name] = h5py.ExternalLink(str(secret), "/x")


def soft_link(file, name, secret):
    file[name] = h5py.SoftLink("/elsewhere")


def loop_of_soft_links(file, name, secret):
    file["a_loop"] = h5py.SoftLink(f"/{name}")
    file[name] = h5py.SoftLink("/a_loop")


def loop_of_groups(file, name, secret):
    file["new"] = 1.0
    file.create_group("again")["root"] = file["/"]


def external_storage(file, name, secret):
    file.create_dataset(name, (4,), "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])


def virtual(file, name, secret):
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource(str(secret), "x", (4,))
    file.create_virtual_dataset(name, layout)


def declared_as_a_tebibyte(file, name, secret):
    file.create_dataset(name, (1 << 37,), "f8", chunks=(1 << 20,), compression="gzip")


def declared_as_twenty_gibibytes(file, name, secret):
    file.create_dataset(name, (20 << 27,), "f8")


def opaque_pointers(file, name, secret):
    kind = h5py.h5t.create(h5py.h5t.OPAQUE, 8)
    kind.set_tag(b"NUMPY:|O8")
    h5py.h5d.create(file.id, name.encode(), kind, h5py.h5s.create_simple((4,)))


def opaque_attribute(file, name, secret):
    file[name] = 1.0
    kind = h5py.h5t.create(h5py.h5t.OPAQUE, 8)
    kind.set_tag(b"NUMPY:|O8")
    h5py.h5a.create(file.id, b"pointers", kind, h5py.h5s.create_simple((4,)))


def unknown_filter(file, name, secret):
    file.create_dataset(name, data=np.arange(4.0), compression="lzf")


def deep_groups(file, name, secret):
    file["/".join(["g"] * 40)] = 1.0


def another_byte_order(file, name, secret):
    file[name] = np.arange(4, dtype=">f8")


REFUSED = [
    (external_link, "is a link to another file, which is not followed"),
    (soft_link, "is a soft link, which is not followed"),
    (loop_of_soft_links, "is a soft link, which is not followed"),
    (loop_of_groups, "second name of another object, or a loop"),
    (external_storage, r"values lie in another file \(external storage\)"),
    (virtual, r"values lie in other files \(virtual dataset\)"),
    (declared_as_a_tebibyte, r"declares 1.1e\+12 bytes, more than"),
    (declared_as_twenty_gibibytes, r"declares 2.15e\+10 bytes, more than"),
    (opaque_pointers, "holds neither numbers nor texts"),
    (opaque_attribute, "attribute b?'pointers' holds neither numbers nor texts"),
    (unknown_filter, "packed by a filter that is not known here"),
    (deep_groups, "more than 16 groups below each other"),
    (another_byte_order, "numbers of another machine's kind"),
]


@pytest.mark.parametrize("kind", ["assembly", "product", "archive", "results"])
@pytest.mark.parametrize("change, words", REFUSED, ids=lambda value: getattr(value, "__name__", ""))
def test_what_reads_elsewhere_or_exhausts_the_memory_is_refused(good, tmp_path, kind, change, words):
    source, name, read, error = good[kind]
    path = copied(source, tmp_path, lambda file: (file.pop(name, None), change(file, name, tmp_path / "secret.h5")))
    with h5py.File(tmp_path / "secret.h5", "w") as secret:
        secret["x"] = np.full(4, 42.0)
    with pytest.raises(error, match=words) as told:
        read(path)
    assert str(path) in str(told.value) and "\n" not in str(told.value)


def copied(source, folder, change):
    """A copy of a file with a change, and a checksum that holds again."""
    path = shutil.copy(source, folder / source.name)
    if path.read_bytes().startswith(b"grain-scatter"):
        with changed_on_purpose(path) as file:
            change(file)
    else:
        with h5py.File(path, "r+") as file:
            change(file)
    return path


@pytest.mark.parametrize("kind", ["assembly", "product", "archive", "results"])
def test_the_good_files_are_read(good, kind):
    path, _, read, _ = good[kind]
    read(path)


@pytest.mark.parametrize("kind", ["archive", "results"])
@pytest.mark.parametrize("place", [0, 25, 100, 600, -3])
def test_a_changed_byte_is_found_by_the_files_own_checksum(good, tmp_path, kind, place):
    source, _, read, error = good[kind]
    data = bytearray(source.read_bytes())
    data[place] ^= 1
    path = tmp_path / source.name
    path.write_bytes(data)
    with pytest.raises(error, match="checksum|begins with other bytes"):
        read(path)


@pytest.mark.parametrize("kind", ["archive", "results"])
def test_files_of_earlier_versions_have_no_checksum_and_are_read(good, tmp_path, kind):
    source, _, read, _ = good[kind]
    (tmp_path / source.name).write_bytes(source.read_bytes()[512:])
    read(tmp_path / source.name)


def test_a_product_is_compared_with_the_checksum_beside_it(good, tmp_path):
    from campaign.folder import record_sum

    path = shutil.copy(PROBE, tmp_path / PROBE.name)
    record_sum(path)
    read_product(path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    for read in (read_run, read_snapshot):
        with pytest.raises(RunFileError, match="its bytes have changed since it was written"):
            read(path)


def remove(name):
    return lambda file: file.__delitem__(name)


def as_attribute(group, name, value):
    return lambda file: file[group].attrs.__setitem__(name, value)


def instead(name, value):
    def change(file):
        del file[name]
        file[name] = value

    return change


BAD_RESULTS = [
    (as_attribute("/", "settings", "{bad"), "settings is not JSON"),
    (as_attribute("/", "settings", "[1]"), "settings is a JSON list, want dict"),
    (as_attribute("/", "versions", '"text"'), "versions is a JSON str, want dict"),
    (as_attribute("/", "versions", 3.0), "versions is not JSON"),
    (as_attribute("/", "settings", "[" * 20000 + "]" * 20000), "settings is not JSON"),
    (as_attribute("inputs", "copulas", "{}"), "copulas is a JSON dict, want list"),
    (as_attribute("inputs", "marginals", "null"), "marginals is a JSON NoneType, want dict"),
    (as_attribute("inputs", "joint", "17"), "joint is a JSON int, want dict"),
    (as_attribute("/", "format", np.arange(3.0)), r"format array\("),
    (instead("points/mu_s", np.ones(3)), "table /points is ragged: mu_s has shape .3,., id .5,."),
    (instead("runs/status", np.ones((63, 2))), "table /runs is ragged: status has shape .63, 2."),
    (remove("runs/status"), "table /runs has no column 'status'"),
    (remove("points/id"), "table /points has no column 'id'"),
    (instead("runs/status", [b"\xff\xfe"] * 63), "not a readable results file"),
    (remove("inputs"), "not a readable results file"),
    (remove("families"), "not a readable results file"),
    (remove("strain"), "not a readable results file"),
    (instead("points", 1.0), "not a readable results file"),
    (remove("families/coupled/0.04/weight"), "not a readable results file .*'weight'"),
    (instead("families/coupled/0.04/responses/eta", 1.0), "not a readable results file"),
    (instead("families/coupled/dense", 1.0), "not a readable results file .*'dense'"),
]


@pytest.mark.parametrize("change, words", BAD_RESULTS)
def test_results_of_another_kind_end_in_one_line(good, tmp_path, change, words):
    def both(file):
        if "dense" in words:
            file["families/coupled/dense"] = 0.0
        change(file)

    with pytest.raises(ResultsError, match=words) as told:
        read_all_results(copied(good["results"][0], tmp_path, both))
    assert "\n" not in str(told.value) and "results.h5" in str(told.value)


@pytest.mark.parametrize("density", ["denser", "0.04", None, [0.04]])
def test_a_density_that_is_no_number_is_a_line_with_those_there_are(density):
    results = read_results(synthetic.example())
    for ask in (results.state, results.state_error):
        with pytest.raises(ResultsError, match="has no density .*, only 0.001 .dense., 0.04 .medium., 0.1 .loose."):
            ask("critical", "eta", density)


def entry(**changes):
    """A change of the JSON of the archive's one run: facts or parts replaced, or the whole text."""

    def change(file):
        data = file["runs/probe_x"]
        told = json.loads(data.attrs["told"])
        if "text" in changes:
            text = changes["text"]
        else:
            text = json.dumps(told | {name: value for name, value in changes.items() if name != "fact"}
                              | {"facts": told["facts"] | changes.get("fact", {})})  # fmt: skip
        from analysis.errors_and_files import digest

        data.attrs["told"] = text
        data.attrs["sha256"] = digest(text.encode())

    return change


BAD_ARCHIVES = [
    (remove("runs"), "group /runs is missing"),
    (remove("grains"), "group /grains is missing"),
    (instead("runs", 1.0), "group /runs is missing"),
    (instead("runs/probe_x", "text"), "not a readable archive of runs"),
    (lambda file: file["runs"].create_group("probe_y"), "not a readable archive of runs"),
    (as_attribute("runs/probe_x", "told", 3.0), "not a readable archive of runs"),
    (as_attribute("runs/probe_x", "sha256", "0"), "run probe_x has changed since it was written"),
    (entry(text="{bad"), "not a readable archive of runs"),
    (entry(text="[]"), "run probe_x: its JSON has no proper 'facts'"),
    (entry(text="17"), "run probe_x: its JSON has no proper 'facts'"),
    (entry(states=[1]), "no proper 'states'"),
    (entry(symbols="eta"), "no proper 'symbols'"),
    (entry(grains=None), "no proper 'grains'"),
    (entry(states={"states": {"probe": {"G_0": "stiff"}}, "errors": {}}), "G_0 of 'probe' is no number"),
    (entry(states={"states": 3, "errors": {}}), "its 'states' are no tables"),
    (entry(states={"states": {}, "errors": {}, "more": 1}), "not a readable archive of runs"),
    (entry(fact={"cpu_seconds": "long"}), "cpu_seconds = 'long' is not of the kind of nan"),
    (entry(fact={"reason": {}}), "reason = {} is not of the kind of ''"),
    (entry(fact={"steps": None}), "steps = None is not of the kind"),
]


@pytest.mark.parametrize("change, words", BAD_ARCHIVES)
def test_an_archive_of_another_kind_ends_in_one_line(good, tmp_path, change, words):
    with pytest.raises(ArchiveError, match=words) as told:
        read_archive(copied(good["archive"][0], tmp_path, change))
    assert "\n" not in str(told.value) and "runs.h5" in str(told.value)


@pytest.mark.parametrize("kind", ["assembly", "product", "archive", "results"])
@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.999])
def test_a_truncated_file_ends_in_one_line(good, tmp_path, kind, share):
    source, _, read, error = good[kind]
    path = tmp_path / source.name
    path.write_bytes(source.read_bytes()[: int(share * source.stat().st_size)])
    with pytest.raises(error, match="truncated") as told:
        read(path)
    assert "\n" not in str(told.value)


BAD_PRODUCTS = [
    (instead("parameters", 1.0), "group /parameters is missing"),
    (instead("snapshots", 1.0), "group /snapshots is missing"),
    (as_attribute("/", "run_id", 3.0), "run_id = 3.0 is no text"),
    (as_attribute("/", "stage", np.arange(3.0)), "stage = array"),
    (instead("snapshots/00/radius", "text"), "radius holds no numbers"),
    (as_attribute("snapshots/00", "eps_a", "text"), "not a readable run file"),
    (as_attribute("/", "resumed", "often"), "resumed = 'often' is not within"),
]


@pytest.mark.parametrize("change, words", BAD_PRODUCTS)
def test_a_product_of_another_kind_ends_in_one_line(good, tmp_path, change, words):
    with pytest.raises(GrainScatterError, match=words) as told:
        read_product(copied(good["product"][0], tmp_path, change))
    assert "\n" not in str(told.value)


def test_an_assembly_of_other_lengths_or_signs_ends_in_one_line(good, tmp_path):
    source = good["assembly"][0]
    for change, words in (
        (instead("radius", 1.0), r"radius has shape \(\)"),
        (instead("radius", "text"), "not a readable assembly file"),
        (lambda file: file["radius"].__setitem__(3, -1.0), "radius holds -1 to .* want positive lengths"),
        (lambda file: file["cell"].__setitem__(0, np.nan), "cell holds nan to nan"),
        (lambda file: file["position"].__setitem__((0, 0), np.inf), "position holds values that are not finite"),
        (remove("cell"), "not a readable assembly file"),
    ):
        with pytest.raises(AssemblyError, match=words) as told:
            read_assembly(copied(source, tmp_path, change))
        assert "\n" not in str(told.value)


def test_cells_that_a_spreadsheet_would_run_are_neutralised(tmp_path):
    texts = ["=cmd|' /C calc'!A0", "+1+cmd", "-2+3", "@SUM(1)", "\tx", "\rx", "-1.5", "+2e3", "proof: a = b", ""]
    frame = pd.DataFrame({"reason": texts, "value": np.linspace(-1, 1, 10), "=bad": 1})
    path = write_tables({"runs": frame}, tmp_path)[0]
    back = pd.read_csv(path, keep_default_na=False, dtype=str, lineterminator="\n")
    assert back.columns.tolist() == ["reason", "value", "'=bad"]
    wanted = [f"'{text}" for text in texts[:6]] + texts[6:]
    assert back["reason"].tolist() == wanted
    assert back["value"].astype(float).tolist() == pytest.approx(frame["value"].tolist(), rel=1e-5)


def test_the_reason_of_a_failed_run_is_neutralised_in_the_table_of_runs(tmp_path):
    plan, points, info = synthetic.make_campaign(tmp_path, n=3)
    row = next(row for row in plan.itertuples() if row.stage == "shear")
    synthetic.fail_run(row, "=cmd|' /C calc'!A0")
    from analysis.results.build import build_results

    path = build_results(tmp_path, plan, points, info, max_lost_probability=1.0)
    written = write_tables(evaluate(path, ["runs"]), tmp_path)[0]
    cells = pd.read_csv(written).set_index("run_id")["reason"]
    assert cells[row.run_id] == "'=cmd|' /C calc'!A0"
    assert not cells.astype(str).str.startswith(("=", "+", "-", "@")).any()
