"""What the scripts of YADE state of the paths of a shear test, read from their source without YADE."""

from __future__ import annotations

import ast

from paths import ROOT


def held_limits() -> dict[str, tuple[float, ...]]:
    """Path -> limits of a window's mean and of a sample of what the path holds, and of the energy error."""
    names = ("window_limit", "sample_limit", "energy_limit")
    return {path: tuple(stated[name] for name in names) for path, stated in _stated().items()}


def fewest() -> dict[str, int]:
    """Path -> number of spheres below which the limit of a sample grows, where there is one."""
    return {path: stated["fewest"] for path, stated in _stated().items() if stated["fewest"]}


def steady_limits() -> dict[str, dict[str, float]]:
    """Path -> what must be steady at a critical state, and its largest drift."""
    return {path: stated["steady"] for path, stated in _stated().items()}


def _stated() -> dict[str, dict]:
    """Path -> what the class of the path assigns; the other classes have the values of the drained one, their base."""
    tree = ast.parse((ROOT / "yade_scripts" / "paths.py").read_text("utf-8"))
    classes = {node.name: dict(_assigned(node)) for node in tree.body if isinstance(node, ast.ClassDef)}
    table = next(n for n in tree.body if isinstance(n, ast.Assign) and getattr(n.targets[0], "id", "") == "PATHS")
    named = {key.value: value.id for key, value in zip(table.value.keys, table.value.values, strict=True)}
    return {path: classes["Drained"] | classes[name] for path, name in named.items()}


def _assigned(node: ast.ClassDef):
    for each in node.body:
        if isinstance(each, ast.Assign):
            target, value = each.targets[0], ast.literal_eval(each.value)
            if isinstance(target, ast.Tuple):
                yield from zip((t.id for t in target.elts), value, strict=True)
            else:
                yield target.id, value
