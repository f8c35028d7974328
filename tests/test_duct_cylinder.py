"""Meshes of the duct with a cylinder: names, volume, symmetry, and that the script writes them."""

import sys
from pathlib import Path

import numpy as np
import pytest
from mesh import duct_cylinder
from mesh.duct_cylinder import CENTRE, HEIGHT, LENGTH, RADIUS, duct

from porofsi_petsc.elements.quadrature import quadrature
from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.topology import facet_multiplicity

MESHES = Path(__file__).resolve().parents[1] / "configs" / "meshes"
GROWTH = {4: 8.0, 10: 25.0}  # by cells over a quarter


@pytest.fixture(params=GROWTH)
def shipped(request):
    return MESHES / f"duct_cylinder_{request.param}_p2.msh", request.param


def test_the_script_writes_the_shipped_meshes(shipped, tmp_path, monkeypatch):
    path, cells = shipped
    new = tmp_path / "new.msh"
    words = ["make", f"--cells={cells}", f"--growth={GROWTH[cells]}", f"--output={new}"]
    monkeypatch.setattr(sys, "argv", words)
    duct_cylinder.main()
    again, kept = (read_mesh(file, 3) for file in (new, path))
    assert np.array_equal(again.cells, kept.cells)
    assert (
        np.abs(again.points - kept.points).max() < 1e-14
    )  # libraries round cos and sin differently


def test_an_odd_number_of_cells_is_refused(tmp_path, monkeypatch, capsys):
    """The plane of the axis would cut elements, and the mesh would have a lift of its own."""
    monkeypatch.setattr(
        sys, "argv", ["make", "--cells", "5", "--output", str(tmp_path / "odd.msh")]
    )
    with pytest.raises(SystemExit) as end:
        duct_cylinder.main()
    assert end.value.code == 2 and "even" in capsys.readouterr().err


def test_boundaries_are_all_named_once_and_the_volume_is_that_of_half_the_duct(shipped):
    path, cells = shipped
    mesh = read_mesh(path, 3)
    assert set(mesh.facets) == {"inlet", "outlet", "walls", "symmetry", "cylinder"}
    outside = (facet_multiplicity(mesh.cells, mesh.element) == 1).sum()
    assert sum(map(len, mesh.facets.values())) == outside
    xi, weights = quadrature(3, 4)
    tangents = np.einsum("eai,qaj->eqij", mesh.points[mesh.cells], mesh.element.gradient(xi))
    jacobian = np.linalg.det(tangents)
    assert jacobian.min() > 0
    angle = np.pi / 2 / cells  # of an arc; parabolas miss its area by less than angle^4/6
    cylinder = np.pi * RADIUS**2 * HEIGHT / 2
    expected = LENGTH * HEIGHT**2 / 2 - cylinder
    assert (jacobian @ weights).sum() == pytest.approx(expected, abs=cylinder * angle**4 / 6)


def test_the_mesh_of_the_cylinder_is_its_mirror_image_at_the_plane_of_the_axis():
    """Else the elements would make a lift: that of the flow is a six-hundredth of the drag."""
    mesh = duct(4, GROWTH[4])
    centres = mesh.points[mesh.facets["cylinder"][:, :3]].mean(axis=1)
    mirrored = centres * [1, -1, 1] + [0, 2 * CENTRE[1], 0]
    distances = np.linalg.norm(centres[:, None] - mirrored[None], axis=2)
    assert distances.min(axis=1).max() < 1e-12
