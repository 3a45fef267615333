"""`compare` and `export` on the command line: what they take, where they write, what they refuse."""

import shutil
from pathlib import Path

import pytest
import synthetic_results

from campaign import __main__ as command_line
from campaign.__main__ import main


@pytest.fixture
def results(tmp_path):
    return Path(shutil.copy(synthetic_results.small_example(), tmp_path / "results.h5"))


def refused(capsys, *words):
    assert main(list(words)) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    return said.err


def test_a_results_file_a_folder_and_a_campaign_file_stand_for_the_same(tmp_path, results, monkeypatch, capsys):
    (tmp_path / "mine.toml").write_text("")
    monkeypatch.setattr(command_line, "RUNS", tmp_path / "runs")
    (tmp_path / "runs" / "mine").mkdir(parents=True)
    shutil.copy(results, tmp_path / "runs" / "mine")
    monkeypatch.setattr("campaign.compare.export", lambda path, target: str(path))
    for source in (results, tmp_path, tmp_path / "mine.toml"):
        assert main(["export", str(source), "--to", "x"]) == 0
    assert capsys.readouterr().out.split() == [
        str(results), str(tmp_path / "results.h5"), str(tmp_path / "runs" / "mine" / "results.h5")]  # fmt: skip


def test_export_writes_a_folder(tmp_path, results, capsys):
    assert main(["export", str(results), "--to", str(tmp_path / "csv")]) == 0
    assert capsys.readouterr().out.startswith(f"{tmp_path / 'csv'}: 8 tables in SI units")


def test_what_cannot_be_written_is_refused_in_one_line(tmp_path, results, capsys):
    assert "export needs --to FOLDER or --to FILE.xlsx" in refused(capsys, "export", str(results))
    assert "is neither a folder nor a file *.xlsx" in refused(capsys, "export", str(results), "--to", "x.ods")
    (tmp_path / "f").write_text("")
    assert "is a file" in refused(capsys, "export", str(results), "--to", str(tmp_path / "f"))
    (tmp_path / "d.xlsx").mkdir()
    assert "is a folder" in refused(capsys, "export", str(results), "--to", str(tmp_path / "d.xlsx"))
    assert "at least 2" in refused(capsys, "compare", str(results))
    assert "is a file, not a folder" in refused(
        capsys, "compare", str(results), str(results), "--to", str(tmp_path / "f")
    )


def test_a_file_that_is_no_results_file_is_named(tmp_path, results, capsys):
    assert f"{tmp_path / 'none.h5'}: no such results file" in refused(
        capsys, "compare", str(results), str(tmp_path / "none.h5"), "--to", str(tmp_path / "out")
    )
    (tmp_path / "empty").mkdir()
    assert "empty/results.h5: no such" in refused(capsys, "export", str(tmp_path / "empty"), "--to", "x")
    assert not (tmp_path / "out").exists()


def test_a_page_to_explore_without_plotly_is_refused_before_anything_is_computed(results, capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    said = refused(capsys, "report", str(results), "--interactive")
    assert "--interactive needs plotly, which is not installed (Debian: python3-plotly; PyPI: plotly)" in said
    assert {p.name for p in results.parent.iterdir()} == {"results.h5"}
