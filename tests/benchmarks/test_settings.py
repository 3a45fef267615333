"""Benchmarks have the settings of a campaign; data/benchmarks/README.md lists every other setting."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import types

import pandas as pd
import pytest
from paths import ROOT

from campaign.config_keys import Inputs, Pdem, Points
from campaign.evaluate import INPUT_BOOTSTRAP

FOLDER = ROOT / "tests" / "benchmarks"
README = ROOT / "data" / "benchmarks" / "README.md"
HEADING = "## Settings that are not those of a campaign"
#: What a campaign passes where this may differ from the default of the function.
CAMPAIGN = {
    "fit_joint": {"n_boot": Inputs().bootstrap, "copula_families": Inputs().copulas},
    "select": {"n_boot": Inputs().bootstrap, "families": Inputs().copulas},
    "bootstrap_test": {"n_boot": Inputs().bootstrap},
    "bootstrap_probabilities": {"n_boot": INPUT_BOOTSTRAP},
    "select_points": {"n": Points().n, "method": Points().method, "nested": Points().nested},
    "evolve": {"method": Pdem().method, "cells": Pdem().cells},
    "assess": {"stop_when": Pdem().stop_when},
}
#: Optional arguments that are data, not settings.
DATA = {"attrs", "dependence", "k", "mu_s", "packing", "rng", "seed", "weight"}


def deviations(text: str) -> dict[tuple[str, str], tuple[str, str]]:
    """(function, setting) -> (values here, value in a campaign) of the calls of the analysis in a module that differ.

    A value is read from the call or from a constant of the module; another one is given as its source text.
    """
    tree = ast.parse(text)
    names, constants = {}, {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "analysis":
            names |= {alias.asname or alias.name: _imported(node.module, alias.name) for alias in node.names}
    for node in tree.body:
        if isinstance(node, ast.Assign):
            _assign(constants, node)
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and (function := _function(node.func, names)) is not None:
            found |= _other_settings(node, function, constants)
    values = {}
    for name, setting, value, usual in sorted(found):
        values.setdefault((name, setting, usual), []).append(value)
    return {(name, setting): (", ".join(here), usual) for (name, setting, usual), here in values.items()}


def _imported(module, name):
    home = importlib.import_module(module)
    return getattr(home, name) if hasattr(home, name) else importlib.import_module(f"{module}.{name}")


def _assign(constants, node):
    target = node.targets[0]
    pairs = [(target, node.value)]
    if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
        pairs = zip(target.elts, node.value.elts, strict=True)
    for name, value in pairs:
        try:
            constants[name.id] = ast.literal_eval(value)
        except (ValueError, AttributeError):
            continue


def _function(node, names):
    """The function of the analysis that an expression names, or None."""
    if isinstance(node, ast.Attribute):
        home = _function(node.value, names) if not isinstance(node.value, ast.Name) else names.get(node.value.id)
        found = getattr(home, node.attr, None) if isinstance(home, types.ModuleType) else None
    else:
        found = names.get(node.id) if isinstance(node, ast.Name) else None
    return found if isinstance(found, (types.FunctionType, types.ModuleType)) else None


def _other_settings(node, function, constants):
    """{(function, setting, value here, value in a campaign)} of one call."""
    parameters = inspect.signature(function).parameters
    defaults = {name: p.default for name, p in parameters.items() if p.default is not p.empty}
    usual = defaults | CAMPAIGN.get(function.__name__, {})
    given = dict(zip(parameters, (_value(a, constants) for a in node.args), strict=False))
    used = [defaults | given | {k.arg: _value(k.value, constants) for k in node.keywords if k.arg}]
    for keyword in (k for k in node.keywords if k.arg is None):
        used = [one | more for one in used for more in _expanded(keyword.value, constants)]
    found = set()
    for name, value in (item for one in used for item in one.items()):
        there = usual.get(name, _Source("-"))
        if (name in usual or name not in parameters) and name not in DATA and _text(value) != _text(there):
            found.add((function.__name__, name, _text(value), _text(there)))
    return found


class _Source(str):
    """The source text of a value that is not a constant."""


def _value(node, constants):
    try:
        return ast.literal_eval(node)
    except ValueError:
        if isinstance(node, ast.Name) and node.id in constants:
            return constants[node.id]
        return _Source(ast.unparse(node))


def _text(value):
    return str(value) if isinstance(value, _Source) else repr(value)


def _expanded(node, constants):
    """The dictionaries that `**node` may stand for: a constant, or all values of TABLE in `**TABLE[key]`."""
    if isinstance(node, ast.Name) and isinstance(constants.get(node.id), dict):
        return [constants[node.id]]
    if isinstance(node, ast.Subscript) and isinstance(constants.get(getattr(node.value, "id", "")), dict):
        return list(constants[node.value.id].values())
    return [{"**": _Source(ast.unparse(node))}]


def listed() -> dict[tuple[str, str, str], tuple[str, str]]:
    """(script, function, setting) -> (values here, value in a campaign) of the table in the README."""
    lines = README.read_text("utf-8").split(HEADING)[1].split("\n## ")[0].splitlines()
    rows = [[cell.strip(" `") for cell in line.split("|")[1:6]] for line in lines if line.startswith("| `")]
    return {tuple(row[:3]): tuple(row[3:]) for row in rows}


def test_every_setting_that_no_campaign_uses_is_listed():
    found = {(path.name, *call): values for path in sorted(FOLDER.glob("*.py")) if not path.name.startswith("test_")
             for call, values in deviations(path.read_text("utf-8")).items()}  # fmt: skip
    assert listed() == found


@pytest.mark.parametrize("call, found", [
    ("evolution.evolve(h, p, t)", {}),
    ("evolution.evolve(h, p, t, cells=CELLS, method='exact')", {}),
    ("evolution.evolve(h, p, t, rule='spacing')", {("evolve", "rule"): ("'spacing'", "None")}),
    ("evolution.evolve(h, p, t, 'tvd')", {("evolve", "method"): ("'tvd'", "'exact'")}),
    ("evolution.evolve(h, p, t, cells=n)", {("evolve", "cells"): ("n", "400")}),
    ("evolution.evolve(h, p, t, **TABLE[k])", {("evolve", "rule"): ("'mesh'", "None")}),
    ("evolution.evolve(h, p, t, **options)", {("evolve", "**"): ("options", "-")}),
    ("fit_joint(pairs, n_boot=200, copula_families=('gaussian', 'student', 'frank', 'plackett'))", {}),
    ("fit_joint(pairs)", {("fit_joint", "n_boot"): ("1000", "200"), ("fit_joint", "copula_families"): (
        "None", "('gaussian', 'student', 'frank', 'plackett')")}),
])  # fmt: skip
def test_a_call_with_another_setting_is_found(call, found):
    head = "from analysis.pdem import evolution\nfrom analysis.inputs.joint import fit_joint\nCELLS = 400\n"
    assert deviations(head + "TABLE = {'a': {}, 'b': {'rule': 'mesh'}}\n" + call) == found


def test_the_errors_of_the_oscillator_are_those_of_the_table():
    """One figure per setting, the first one with the settings of a campaign: 200 points, 400 cells."""
    (row,) = [line for line in README.read_text("utf-8").splitlines() if line.startswith("| PDEM, random oscillator")]
    table = pd.read_csv(README.with_name("pdem_oscillator.csv"))
    worst = table[(table.points == 200) & (table.cells == Pdem().cells)].set_index("method").l1_worst
    assert re.findall(r"L1 (\d\.\d+)", row) == [f"{worst[name]:.3f}" for name in ("exact", "tvd", "exact, spacing")]
