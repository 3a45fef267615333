"""Snapshots as VTK files: parsed back with the standard library, the numbers are the snapshot's."""

from __future__ import annotations

import xml.etree.ElementTree as xml

import numpy as np
import pytest
import synthetic_results as synthetic

from analysis.micromechanics.snapshot import Snapshot
from analysis.runs import vtk
from analysis.runs.run_file import RunFileError, read_snapshot


def arrays(path):
    """Every DataArray of a file by name, and the sizes of its piece."""
    piece = xml.parse(path).getroot().find("PolyData/Piece")
    out = {}
    for array in piece.iter("DataArray"):
        values = np.array(array.text.split(), dtype=float)
        out[array.get("Name")] = values.reshape(-1, int(array.get("NumberOfComponents", 1))).squeeze()
    return out, {k: int(v) for k, v in piece.attrib.items()}


@pytest.fixture
def lattice():
    return Snapshot(**synthetic.snapshot(2.5e5))


def test_particles_carry_size_contacts_and_stress(lattice, tmp_path):
    values, size = arrays(vtk.write_vtk(lattice, tmp_path)[0])
    assert size["NumberOfPoints"] == size["NumberOfVerts"] == 27
    assert values["diameter"] == pytest.approx(2 * lattice.radius)
    assert set(values["contacts"]) == {6} and set(values["active"]) == {1}
    volume = 4 / 3 * np.pi * lattice.radius**3
    assert values["axial_stress"] @ volume / lattice.volume == pytest.approx(2.5e5, rel=1e-6)
    assert values["mean_stress"] @ volume / lattice.volume == pytest.approx(1.5e5, rel=1e-6)


def test_contacts_are_lines_of_one_branch_with_their_force(lattice, tmp_path):
    values, size = arrays(vtk.write_vtk(lattice, tmp_path)[1])
    assert size["NumberOfLines"] == 81 and size["NumberOfPoints"] == 162
    ends = values["connectivity"].astype(int).reshape(-1, 2)
    branch = values["position"][ends[:, 1]] - values["position"][ends[:, 0]]
    assert branch == pytest.approx(lattice.branch, abs=1e-12)
    assert values["force"].max() == pytest.approx(2.5e5 * synthetic.SPACING**2)
    assert list(values["offsets"]) == list(range(2, 164, 2))


def test_the_cell_has_twelve_edges_of_its_own_length(lattice, tmp_path):
    values, _ = arrays(vtk.write_vtk(lattice, tmp_path)[2])
    ends = values["connectivity"].astype(int).reshape(-1, 2)
    length = np.linalg.norm(values["position"][ends[:, 1]] - values["position"][ends[:, 0]], axis=1)
    assert len(length) == 12 and length == pytest.approx(3 * synthetic.SPACING)


def test_positions_are_wrapped_into_a_sheared_cell():
    cell = np.array([[2.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0]])
    inside = cell @ np.array([0.2, 0.9, 0.5])
    outside = inside + cell @ np.array([-3.0, 2.0, 1.0])
    assert vtk.wrapped(outside[None], cell)[0] == pytest.approx(inside)


def test_from_the_command_line(tmp_path, capsys):
    points = synthetic.representative_points(2)
    plan = synthetic.plan_rows(tmp_path, points, densities=(0.04,))
    row = next(row for row in plan.itertuples() if row.stage == "shear")
    synthetic.write_run(row)
    assert vtk.main([row.product, "end", str(tmp_path / "vtk")]) == 0
    values, _ = arrays(tmp_path / "vtk" / "particles.vtp")
    assert values["diameter"] == pytest.approx(2 * read_snapshot(row.product, "end").radius)
    assert vtk.main([row.product, "nowhere", str(tmp_path)]) == 1
    assert "nowhere" in capsys.readouterr().err
    with pytest.raises(RunFileError, match="no snapshot 9"):
        vtk.write_vtk(row.product, tmp_path, 9)
