"""Measures the structure of a folder of Python packages: files, import arrows, floors, circles.

    python3 tests/support/structure.py [FOLDER]        (default: analysis and campaign of this repository)

A room is a package below the folder, or a file that lies flat in it.  An arrow leads from a room to another one that it
imports, anywhere in its files.  A room stands one floor above the highest room that it imports; rooms of a circle share
a floor.  A leading arrow back up is one of a circle.
"""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from pathlib import Path


def files(folder: Path) -> dict[str, Path]:
    """Dotted name below the folder -> file, for every Python file; "" is the folder's own `__init__`."""
    paths = {}
    for path in sorted(folder.rglob("*.py")):
        parts = list(path.relative_to(folder).with_suffix("").parts)
        paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return paths


def file_arrows(folder: Path) -> dict[str, set[str]]:
    """Dotted name -> names of the files of the same folder that it imports, relatively or by the folder's name."""
    paths, root = files(folder), folder.name
    return {name: {target for node in ast.walk(ast.parse(path.read_text("utf-8")))
                   for target in _targets(node, name, path, root, paths) if target not in (name, "")}
            for name, path in paths.items()}  # fmt: skip


def _targets(node: ast.AST, name: str, path: Path, root: str, paths: dict[str, Path]) -> list[str]:
    """The files that one import statement takes names from."""
    if isinstance(node, ast.Import):
        wanted = [alias.name.removeprefix(f"{root}.") for alias in node.names if alias.name.startswith(f"{root}.")]
        return [target for target in wanted if target in paths]
    if not isinstance(node, ast.ImportFrom):
        return []
    module = node.module or ""
    if node.level:
        package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
        package = [part for part in package if part]
        base = package[: len(package) - node.level + 1]
        module = ".".join([*base, *([module] if module else [])])
    elif module == root or module.startswith(f"{root}."):
        module = module[len(root) + 1 :]
    else:
        return []
    below = [f"{module}.{alias.name}".strip(".") for alias in node.names]
    return [target if target in paths else module for target in below]


def room(name: str) -> str:
    """The package or the flat file that a file belongs to."""
    return name.split(".")[0]


def room_arrows(folder: Path) -> dict[str, set[str]]:
    """Room -> the rooms that it imports."""
    arrows: dict[str, set[str]] = defaultdict(set)
    for name, targets in file_arrows(folder).items():
        if name:
            arrows[room(name)] |= {room(target) for target in targets} - {room(name), ""}
    return dict(arrows)


def circles(arrows: dict[str, set[str]]) -> list[set[str]]:
    """Groups of more than one room that reach each other."""
    reach = {name: _reach(name, arrows) for name in arrows}
    groups = {frozenset({name} | {other for other in reach[name] if name in reach.get(other, ())}) for name in arrows}
    return [set(group) for group in groups if len(group) > 1]


def _reach(start: str, arrows: dict[str, set[str]]) -> set[str]:
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        for target in arrows.get(waiting.pop(), ()):
            if target not in seen:
                seen.add(target)
                waiting.append(target)
    return seen


def floors(arrows: dict[str, set[str]]) -> dict[str, int]:
    """Room -> floor, 1 for a room that imports no other."""
    together = {name: group for group in circles(arrows) for name in group}
    level: dict[str, int] = {}

    def floor(name: str) -> int:
        if name not in level:
            group = together.get(name, {name})
            below = {target for member in group for target in arrows.get(member, ())} - group
            height = 1 + max((floor(target) for target in below), default=0)
            level.update(dict.fromkeys(group, height))
        return level[name]

    return {name: floor(name) for name in arrows}


def measure(folder: Path) -> dict[str, object]:
    """The numbers of one folder."""
    paths, arrows = files(folder), room_arrows(folder)
    flat = [path for path in paths.values() if path.parent == folder]
    packages = {p.name: len(list(p.rglob("*.py"))) for p in sorted(folder.iterdir()) if (p / "__init__.py").exists()}
    return {
        "files flat": len(flat),
        "files per package": packages,
        "rooms": len(arrows),
        "arrows": sum(map(len, arrows.values())),
        "floors": max(floors(arrows).values()),
        "circles": [sorted(group) for group in circles(arrows)],
        "file arrows": sum(map(len, file_arrows(folder).values())),
    }


if __name__ == "__main__":
    root = Path(__file__).resolve().parents[2]
    for place in [Path(p) for p in sys.argv[1:]] or [root / "analysis", root / "campaign"]:
        print(place.name)
        for name, value in measure(place).items():
            print(f"  {name}: {value}")
