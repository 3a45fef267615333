"""Writes the API page from the docstrings with pdoc: python3 tests/support/api_pages.py FOLDER (make docs)

Most names of the packages are imported when they are asked for; pdoc sees only what is there, so they are loaded first.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

#: The packages below `analysis` that the page documents, and its registry of quantities.
MODULES = ("quantities", "copulas", "pdem", "micromechanics", "inputs", "surrogates", "runs", "points", "results",
           "tables", "figures", "report")  # fmt: skip


def load() -> list[str]:
    """Load every public name of `analysis` and of its packages into their modules; returns the modules' names."""
    names = ["analysis", *(f"analysis.{name}" for name in MODULES)]
    for module in map(importlib.import_module, names):
        for name in getattr(module, "__all__", ()):
            setattr(module, name, getattr(module, name))
    return names


if __name__ == "__main__":
    import pdoc

    pdoc.render.configure(docformat="numpy", show_source=False)
    pdoc.pdoc(*load(), output_directory=Path(sys.argv[1]))
