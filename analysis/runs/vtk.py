"""A snapshot of a run as VTK files for ParaView: spheres, contacts and the periodic cell.

    /usr/bin/python3 -m analysis.runs.vtk runs/demo/products/shear_....h5 end vtk/

In ParaView: show particles.vtp with the Glyph filter (sphere, scaled by `diameter`), contacts.vtp with the Tube filter
(radius by `force`), cell.vtp as a wireframe.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..micromechanics import metrics
from ..micromechanics.snapshot import Snapshot
from .run_file import Run, RunFileError, read_snapshot

TYPES = {"f": "Float64", "i": "Int64", "u": "UInt8"}


def write_vtk(source: str | Path | Run | Snapshot, folder: str | Path, k: int | str = -1) -> list[Path]:
    """Write particles.vtp, contacts.vtp and cell.vtp of a snapshot into a folder and return the three paths.

    source: path of a product, a Run, or a Snapshot; k: number, key or label ("end") of the snapshot.  Lengths in m,
    forces in N, stresses in Pa.  Particles are wrapped into the cell.  A contact is drawn from its first particle along
    the branch; one that crosses the boundary therefore extends beyond the cell.
    Raises run_file.RunFileError if the snapshot does not exist.
    """
    s = source if isinstance(source, Snapshot) else read_snapshot(source, k)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    content = {"particles": _particles(s), "contacts": _contacts(s), "cell": _cell(s)}
    paths = []
    for name, text in content.items():
        paths.append(folder / f"{name}.vtp")
        paths[-1].write_text(text, encoding="ascii")
    return paths


def wrapped(position: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Positions (N, 3) m moved by whole cell vectors (columns of cell (3, 3) m) into the cell."""
    fraction = np.linalg.solve(cell, position.T)
    return (cell @ (fraction - np.floor(fraction))).T


def _particles(s: Snapshot) -> str:
    count = metrics.contact_count(s.N, s.contact_ids)
    stress = metrics.particle_stress(s)
    fields = {
        "diameter": 2 * s.radius,
        "contacts": count,
        "active": (count >= 2).astype(np.uint8),
        "mean_stress": np.trace(stress, axis1=1, axis2=2) / 3,
        "axial_stress": stress[:, 2, 2],
    }
    return _poly_data(wrapped(s.position, s.cell), "Verts", np.arange(s.N)[:, None], point_fields=fields)


def _contacts(s: Snapshot) -> str:
    start = wrapped(s.position, s.cell)[s.contact_ids[:, 0]]
    ends = np.concatenate([start, start + s.branch])
    count = len(start)
    fields = {
        "force": np.linalg.norm(s.force, axis=1),
        "normal_force": np.linalg.norm(s.f_n, axis=1),
        "tangential_force": np.linalg.norm(s.f_t, axis=1),
        "overlap": s.overlap,
        "normal": s.normal,
    }
    lines = np.column_stack([np.arange(count), np.arange(count) + count])
    return _poly_data(ends, "Lines", lines, cell_fields=fields)


def _cell(s: Snapshot) -> str:
    corner = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    edges = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(corner[a] - corner[b]).sum() == 1]
    return _poly_data(corner @ s.cell.T, "Lines", np.array(edges))


def _poly_data(
    points: np.ndarray,
    kind: str,
    cells: np.ndarray,
    point_fields: Mapping[str, np.ndarray] | None = None,
    cell_fields: Mapping[str, np.ndarray] | None = None,
) -> str:
    """One piece of VTK XML PolyData, ASCII: points (P, 3), cells (C, n) of one kind, fields by name."""
    count = {"Verts": 0, "Lines": 0, "Strips": 0, "Polys": 0} | {kind: len(cells)}
    sizes = " ".join(f'NumberOf{name}="{number}"' for name, number in count.items())
    offsets = np.arange(1, len(cells) + 1) * cells.shape[1]
    parts = [
        '<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian">\n<PolyData>',
        f'<Piece NumberOfPoints="{len(points)}" {sizes}>',
        "<PointData>",
        *(_array(name, values) for name, values in (point_fields or {}).items()),
        "</PointData>",
        "<CellData>",
        *(_array(name, values) for name, values in (cell_fields or {}).items()),
        "</CellData>",
        "<Points>",
        _array("position", points),
        "</Points>",
        f"<{kind}>",
        _array("connectivity", cells.ravel()),
        _array("offsets", offsets),
        f"</{kind}>",
        "</Piece>\n</PolyData>\n</VTKFile>\n",
    ]
    return "\n".join(parts)


def _array(name: str, values: np.ndarray) -> str:
    """One DataArray element, ASCII: values (P,) or (P, n)."""
    shape = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    form = "%.9g" if values.dtype.kind == "f" else "%d"
    text = "\n".join(" ".join(form % v for v in row) for row in np.atleast_2d(values))
    return f'<DataArray type="{TYPES[values.dtype.kind]}" Name="{name}"{shape} format="ascii">\n{text}\n</DataArray>'


def main(arguments: Sequence[str]) -> int:
    """Command line: product, snapshot (number, key or label) and folder; returns 0 if the files were written."""
    if len(arguments) != 3:
        print("usage: python3 -m analysis.runs.vtk PRODUCT SNAPSHOT FOLDER", file=sys.stderr)
        return 2
    product, k, folder = arguments
    try:
        paths = write_vtk(product, folder, int(k) if k.lstrip("-").isdigit() and len(k.lstrip("-")) < 2 else k)
    except RunFileError as error:
        print(error, file=sys.stderr)
        return 1
    print("\n".join(map(str, paths)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
