"""A snapshot of a run as VTK files that ParaView opens: spheres, contacts and the periodic cell.

    /usr/bin/python3 -m analysis.vtk runs/demo/products/shear_....h5 end vtk/

In ParaView: particles.vtp with the Glyph filter (sphere, scaled by `diameter`), contacts.vtp with Tube (radius
by `force`), cell.vtp as a wireframe.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from analysis import micromechanics
from analysis.runfile import RunFileError, Snapshot, read_snapshot

TYPES = {"f": "Float64", "i": "Int64", "u": "UInt8"}


def write_vtk(source, folder, k=-1) -> list[Path]:
    """Write particles.vtp, contacts.vtp and cell.vtp of a snapshot into a folder; returns the three paths.

    source: a product's path, an open Run, or a Snapshot; k: the snapshot's number, key or label ("end").  Lengths in m,
    forces in N, stresses in Pa.  Particles are wrapped into the cell; a contact is drawn from its first particle along
    the branch, so one that crosses the boundary sticks out instead of spanning the cell.
    Raises runfile.RunFileError if there is no such snapshot.
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


def wrapped(position, cell):
    """Positions (N, 3) m moved by whole cell vectors (columns of cell) into the cell."""
    share = np.linalg.solve(cell, position.T)
    return (cell @ (share - np.floor(share))).T


def _particles(s):
    count = micromechanics.contact_count(s.N, s.contact_ids)
    stress = micromechanics.particle_stress(s)
    fields = {
        "diameter": 2 * s.radius, "contacts": count, "active": (count >= 2).astype(np.uint8),
        "mean_stress": np.trace(stress, axis1=1, axis2=2) / 3, "axial_stress": stress[:, 2, 2],
    }  # fmt: skip
    return _poly_data(wrapped(s.position, s.cell), "Verts", np.arange(s.N)[:, None], point_fields=fields)


def _contacts(s):
    start = wrapped(s.position, s.cell)[s.contact_ids[:, 0]]
    ends = np.concatenate([start, start + s.branch])
    count = len(start)
    fields = {
        "force": np.linalg.norm(s.force, axis=1), "normal_force": np.linalg.norm(s.f_n, axis=1),
        "tangential_force": np.linalg.norm(s.f_t, axis=1), "overlap": s.overlap, "normal": s.normal,
    }  # fmt: skip
    lines = np.column_stack([np.arange(count), np.arange(count) + count])
    return _poly_data(ends, "Lines", lines, cell_fields=fields)


def _cell(s):
    corner = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    edges = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(corner[a] - corner[b]).sum() == 1]
    return _poly_data(corner @ s.cell.T, "Lines", np.array(edges))


def _poly_data(points, kind, cells, point_fields=None, cell_fields=None):
    """One piece of VTK XML PolyData, ASCII: points (P, 3), cells (C, n) of one kind, fields by name."""
    count = {"Verts": 0, "Lines": 0, "Strips": 0, "Polys": 0} | {kind: len(cells)}
    sizes = " ".join(f'NumberOf{name}="{number}"' for name, number in count.items())
    offsets = np.arange(1, len(cells) + 1) * cells.shape[1]
    parts = [
        '<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian">\n<PolyData>',
        f'<Piece NumberOfPoints="{len(points)}" {sizes}>',
        "<PointData>", *(_array(name, values) for name, values in (point_fields or {}).items()), "</PointData>",
        "<CellData>", *(_array(name, values) for name, values in (cell_fields or {}).items()), "</CellData>",
        "<Points>", _array("position", points), "</Points>",
        f"<{kind}>", _array("connectivity", cells.ravel()), _array("offsets", offsets), f"</{kind}>",
        "</Piece>\n</PolyData>\n</VTKFile>\n",
    ]  # fmt: skip
    return "\n".join(parts)


def _array(name, values):
    values = np.asarray(values)
    shape = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    form = "%.9g" if values.dtype.kind == "f" else "%d"
    text = "\n".join(" ".join(form % v for v in row) for row in np.atleast_2d(values))
    return f'<DataArray type="{TYPES[values.dtype.kind]}" Name="{name}"{shape} format="ascii">\n{text}\n</DataArray>'


def main(arguments) -> int:
    """Command line: product, snapshot (number or label) and folder; 0 if written."""
    if len(arguments) != 3:
        print("usage: python3 -m analysis.vtk PRODUCT SNAPSHOT FOLDER", file=sys.stderr)
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
