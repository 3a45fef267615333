"""The rules of the house: which package may import which, and what an import loads."""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest
from paths import ROOT
from structure import circles, files, measure, room_arrows

#: From the ground up: a package imports packages of the lines above its own only.
STOREYS = (
    {"errors_and_files", "quantities"},
    {"assembly", "copulas", "pdem", "micromechanics"},
    {"inputs", "surrogates", "runs"},
    {"points"},
    {"results"},
    {"tables", "figures"},
    {"report"},
)
#: Package -> modules outside the project that it must not import.
FORBIDDEN = {
    "copulas": {"h5py", "pandas", "matplotlib"}, "pdem": {"h5py", "pandas", "matplotlib"},
    "micromechanics": {"h5py", "pandas", "matplotlib"}, "inputs": {"h5py", "pandas", "matplotlib"},
    "points": {"h5py", "matplotlib"}, "surrogates": {"h5py", "pandas", "matplotlib"},
    "runs": {"pandas", "matplotlib"}, "results": {"matplotlib"}, "tables": {"h5py", "matplotlib"},
}  # fmt: skip


def test_arrows_lead_down_only():
    storey = {name: k for k, names in enumerate(STOREYS) for name in names}
    arrows = room_arrows(ROOT / "analysis")
    assert set(arrows) == set(storey)
    up = [(a, b) for a, targets in arrows.items() for b in targets if storey[b] >= storey[a]]
    assert up == [] and circles(arrows) == []


@pytest.mark.parametrize("folder, forbidden", [
    ("analysis", {"campaign", "yade_scripts", "yade"}), ("campaign", {"yade_scripts", "yade"}),
    ("yade_scripts", {"campaign"})])  # fmt: skip
def test_the_three_parts_meet_in_files_only(folder, forbidden):
    assert not imported(files(ROOT / folder).values()) & forbidden


@pytest.mark.parametrize("package", FORBIDDEN)
def test_a_package_keeps_to_its_libraries(package):
    assert not imported((ROOT / "analysis" / package).glob("*.py")) & FORBIDDEN[package]


def test_the_house_is_no_heap():
    found = measure(ROOT / "analysis")
    assert found["files flat"] <= 5 and found["arrows"] <= 40 and found["floors"] <= 7
    assert found["circles"] == [] and measure(ROOT / "campaign")["circles"] == []


@pytest.mark.parametrize("code, unloaded", [
    ("import analysis, analysis.quantities", {"numpy", "scipy", "h5py", "pandas", "matplotlib"}),
    ("from analysis import read_results; read_results('data/laptop/results.h5')", {"scipy.sparse", "matplotlib"}),
])  # fmt: skip
def test_an_import_loads_no_more_than_it_needs(code, unloaded):
    command = f"import sys; {code}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", command], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not unloaded & set(done.stdout.split())


def imported(paths):
    """First names of the modules outside the folder that its files import, anywhere but for type checks only."""
    nodes = [node for path in paths for node in walk_code(ast.parse(path.read_text("utf-8")))]
    names = [a.name for n in nodes if isinstance(n, ast.Import) for a in n.names]
    names += [n.module for n in nodes if isinstance(n, ast.ImportFrom) and n.module and not n.level]
    return {name.split(".")[0] for name in names}


@pytest.mark.parametrize("folder", ["analysis", "campaign"])
def test_public_functions_have_type_hints_and_a_docstring(folder):
    """Every argument and the result of every public function and method; mypy (make style) checks that they hold."""
    bare = []
    for name, path in files(ROOT / folder).items():
        if name.startswith("no_servers"):
            continue  # Python loads it at every start of YADE, so it imports no types
        tree = ast.parse(path.read_text("utf-8"))
        for scope in (tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))):
            bare += [f"{name}.{node.name}" for node in scope.body if isinstance(node, ast.FunctionDef)
                     and not node.name.startswith("_") and not hinted(node)]  # fmt: skip
    assert bare == []


def walk_code(node):
    """Every node below one, without the blocks that only a type checker reads."""
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield child
            yield from walk_code(child)


def hinted(node):
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    arguments = [a for a in arguments if a.arg not in ("self", "cls")]
    return all(a.annotation for a in arguments) and node.returns is not None and ast.get_docstring(node) is not None
