"""The examples in the docstrings of the names that `analysis` offers, run as they are written."""

from __future__ import annotations

import doctest
import importlib
import inspect
import shutil

import pytest
import synthetic_results as synthetic
from paths import DATA

import analysis
from analysis import figures


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder like a user's: data/ of the repository, and a small campaign of five points in runs/demo."""
    place = tmp_path_factory.mktemp("user")
    (place / "data").symlink_to(DATA)
    (place / "runs" / "demo").mkdir(parents=True)
    shutil.copy(synthetic.example(noise=0.02), place / "runs" / "demo" / "results.h5")
    return place


@pytest.mark.parametrize("name", analysis.__all__)
def test_the_example_of_a_name_holds(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    if name == "write_report":  # its figures are tested elsewhere; two will do
        monkeypatch.setattr(figures, "FIGURES", dict(list(figures.FIGURES.items())[:2]))
    scope = {other: getattr(analysis, other) for other in analysis.__all__}
    if name != "evaluate":
        scope["evaluate"] = lambda results: synthetic.frames(0.02)
    (example,) = doctest.DocTestFinder(recurse=False).find(getattr(analysis, name), name, globs=scope)
    assert example.examples, f"{name} has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said = []
    runner.run(example, out=said.append)
    assert runner.failures == 0, "".join(said)


def test_only_these_names_have_examples():
    """Numpydoc sections and examples are for the names of the facade, one sentence and shapes for all others."""
    offered = {getattr(analysis, name) for name in analysis.__all__}
    for home in {value.__module__ for value in offered}:
        module = importlib.import_module(home)
        for name, member in inspect.getmembers(module, inspect.isfunction):
            if member.__module__ == home and member not in offered:
                assert ">>>" not in (member.__doc__ or ""), f"{home}.{name}"


@pytest.mark.parametrize("name", analysis.__all__)
def test_every_name_has_the_sections_of_numpydoc(name):
    text = getattr(analysis, name).__doc__
    assert all(f"\n    {title}\n    {'-' * len(title)}\n" in text for title in ("Parameters", "Returns", "Examples"))
