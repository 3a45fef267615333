"""The tables and attributes of results.h5 as they are in the file, with checks of their format."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd

from ..errors_and_files import one_line
from ..inputs.variables import NEEDED
from ..points.representative_points import RepresentativePoints
from ..quantities import DIRECTIONS, DRAINED, PATHS
from .values import ResultsError

FORMAT, FORMAT_VERSION = "campaign-results", 6
#: A file has the earliest version that suffices, so that earlier readers can read it: drained compression with mu_s and
#: G_p as the random variables, or with any variables.
VERSION_OF_PAIRS, VERSION_OF_INPUTS = 4, 5
#: Versions that can be read.  In version 3 all points have the first packing of the campaign, and the others are
#: replicates at some points, from which the offset of the first one was estimated and subtracted.
READABLE = (3, VERSION_OF_PAIRS, VERSION_OF_INPUTS, FORMAT_VERSION)
#: Columns of the table of runs whose name in the file means another quantity in a product: there `drift_eta` is the
#: slope over the last 10 % of strain, here the fitted relative change over the critical part.
RENAMED_RUN_COLUMNS = {f"drift_{symbol}": f"critical_drift_{symbol}" for symbol in ("eta", "e", "p")}


#: Columns without which a table of the file is of no use.
POINT_COLUMNS = ("probability", "id")
RUN_COLUMNS = ("run_id", "stage", "family", "mu_iso", "point", "packing", "status", "reason")


def read_fields(path: Path, file: h5py.File) -> dict[str, Any]:
    """Return the fields of `reader.Results` from an open file; raises ResultsError if the file cannot be used."""
    attrs = plain_attributes(file.attrs)
    name, version = (one_line(repr(attrs.get(key))) for key in ("format", "format_version"))
    if name != repr(FORMAT) or version not in map(repr, READABLE):
        older = version in map(repr, range(1, READABLE[0])) and name == repr(FORMAT)
        what_to_do = "; `analyse` on the campaign's folder makes the file again" if older else ""
        raise ResultsError(
            f"{path}: format {name} version {version}, want {FORMAT!r} version {FORMAT_VERSION}{what_to_do}"
        )
    path_of_test, direction = (attrs.get(name, usual) for name, usual in DRAINED._asdict().items())
    if path_of_test not in PATHS or direction not in DIRECTIONS:
        test = f"{one_line(repr(path_of_test))}, {one_line(repr(direction))}"
        raise ResultsError(f"{path}: the test ({test}) is none that is known: {', '.join((*PATHS, *DIRECTIONS))}")
    for name in ("versions", "settings"):
        attrs[name] = _json(path, name, attrs.get(name, "{}"), dict)
    kinds = {"marginals": dict, "copulas": list, "joint": dict, "warnings": list, "specified": dict, "names": list,
             "constants": dict, "pairs_behind": int}  # fmt: skip
    inputs = plain_attributes(file["inputs"].attrs)
    inputs |= {name: _json(path, name, text, kinds.get(name)) for name, text in inputs.items() if name != "source"}
    return {
        "path": path,
        "attrs": attrs,
        "strain": file["strain"][()],
        "densities": tuple(file["densities"][()].tolist()),
        "families": tuple(file["families"]),
        "points": points_of_table(file["points"], inputs.get("names", NEEDED), inputs.get("constants", {})),
        "runs": _frame(file["runs"], RUN_COLUMNS).rename(columns=RENAMED_RUN_COLUMNS),
        "pairs": file["inputs/pairs"][()],
        "inputs": inputs | {"points": plain_attributes(file["points"].attrs)},
        "diameters": file["grading/diameter"][()],
        "grading": plain_attributes(file["grading"].attrs),
    }


def points_of_table(group: h5py.Group, names: Sequence[str], constants: Mapping[str, float]) -> RepresentativePoints:
    """Return the points of a table whose random variables are `names`; the other variables are `constants`."""
    columns = _frame(group, (*names, *POINT_COLUMNS))
    x, number = columns[list(names)].to_numpy(float), columns["id"].to_numpy()
    return RepresentativePoints(
        x, columns["probability"].to_numpy(), id=number, names=tuple(names), constants=constants
    )


def _frame(group: h5py.Group, needed: tuple[str, ...]) -> pd.DataFrame:
    """The datasets (n,) of a group as columns.  Raises ResultsError if one is missing or of another length."""
    columns = {name: dataset[()] for name, dataset in group.items()}
    order = group.attrs.get("columns")
    names = list(columns) if order is None else [str(name) for name in order]
    if missing := [name for name in (*needed, *names) if name not in columns]:
        raise ResultsError(f"{group.file.filename}: the table {group.name} has no column {missing[0]!r}")
    shapes = {name: np.shape(columns[name]) for name in names}
    for name, shape in shapes.items():
        if len(shape) != 1 or shape != shapes[names[0]]:
            raise ResultsError(
                f"{group.file.filename}: the table {group.name} is ragged: {name} has shape {shape}, "
                f"{names[0]} {shapes[names[0]]}"
            )
    text = {n: [v.decode() for v in columns[n]] if columns[n].dtype.kind in "OS" else columns[n] for n in names}
    return pd.DataFrame(text)


def _json(path: Path, name: str, text: Any, kind: type | None) -> Any:
    """What a JSON text says.  Raises ResultsError if it is none, or not of the kind that it should be."""
    try:
        value = json.loads(text)
    except (ValueError, TypeError, RecursionError) as failure:
        raise ResultsError(f"{path}: {name} is not JSON ({one_line(failure)})") from failure
    if kind is not None and not isinstance(value, kind):
        raise ResultsError(f"{path}: {name} is a JSON {type(value).__name__}, want {kind.__name__}")
    return value


def plain_attributes(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes as plain Python values."""
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in attrs.items()}
