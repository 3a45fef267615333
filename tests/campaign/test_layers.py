"""The layers of `campaign`: who may import whom, and what starts without numpy."""

import ast
import re
import subprocess
import sys

import pytest
from paths import ROOT

#: Each module may import those before it; the order is that of the docstring of the package.
LAYERS = ("files", "progress", "scope", "config_keys", "config_checks", "config_variables", "config", "folder",
          "run_one", "row", "plan", "cell", "choice", "prepare", "products", "estimate", "pace", "batches",
          "engine_local", "engine_slurm", "status", "evaluate", "sweep_values", "sweep", "compare", "prune", "commands",
          "pythons", "__main__")  # fmt: skip
#: Modules of `analysis` that need the standard library only, and may be imported when a module is loaded.
LIGHT = {"analysis", "analysis.errors_and_files", "analysis.quantities"}
SOURCES = {path.stem: ast.parse(path.read_text()) for path in (ROOT / "campaign").glob("*.py")}


def imports(node, at_load):
    """Modules imported below a node: when it is loaded (but for type checking), or inside its functions."""
    for child in ast.iter_child_nodes(node):
        inside = isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef))
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        if isinstance(child, ast.Import) and at_load is not None:
            yield from (alias.name for alias in child.names)
        if isinstance(child, ast.ImportFrom) and at_load is not None:
            names = [f"{child.module}.{alias.name}" for alias in child.names] if child.module == "campaign" else []
            yield from names or [child.module]
        if at_load and not inside:
            yield from imports(child, True)
        elif not at_load:
            yield from imports(child, False if inside or at_load is False else None)


def test_every_module_has_its_place_in_the_list():
    assert set(SOURCES) - {"__init__"} == set(LAYERS)
    lines = re.findall(r"^ {4}(\w+(?:, \w+)*)  ", ast.get_docstring(SOURCES["__init__"]), re.MULTILINE)
    assert ", ".join(lines).split(", ") == [name for name in LAYERS if name != "row"]


@pytest.mark.parametrize("name", LAYERS)
def test_a_module_imports_only_modules_before_it_and_only_light_ones_when_loaded(name):
    loaded, late = list(imports(SOURCES[name], True)), list(imports(SOURCES[name], None))
    before = {f"campaign.{module}" for module in LAYERS[: LAYERS.index(name)]}
    assert {module for module in loaded if module.startswith("campaign")} <= before
    assert not [module for module in late if module.startswith("campaign")], "hides a circle"
    heavy = {module for module in loaded if module.split(".")[0] not in {*sys.stdlib_module_names, "campaign"}}
    assert heavy <= LIGHT


@pytest.mark.parametrize("module", ["campaign.run_one", "campaign.row", "campaign.__main__"])
def test_the_supervisor_and_the_command_line_start_without_numpy(module):
    code = f"import sys, {module}; print([m for m in ('numpy', 'h5py', 'pandas', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
