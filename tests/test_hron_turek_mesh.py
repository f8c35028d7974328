"""The shipped meshes of the channel and of the ring, and the channel in blocks: geometry, names,
conformity and shape of the cells.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from launching import environment
from mesh import hron_turek_blocks

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.topology import facet_multiplicity
from porofsi_petsc.mesh.write import write_mesh

MESHES = Path(__file__).resolve().parents[1] / "configs" / "meshes"
CHANNEL = ["hron_turek_0_p1", "hron_turek_0_p2", "hron_turek_1_p1"]
RING = ["ring_0_p2", "ring_1_p2"]
CENTRE, RADIUS, HALF, TIP = np.array([0.2, 0.2]), 0.05, 0.01, 0.6  # [m]


BLOCKS = ["Q4", "Q9", "Q8"]


def in_blocks(tmp_path, name, parts=("fluid", "beam"), level=0):
    """Return the channel in blocks of an element as it is read from its file."""
    write_mesh(tmp_path / "blocks.msh", hron_turek_blocks.channel(level, ELEMENTS[name], parts))
    return read_mesh(tmp_path / "blocks.msh", 2)


@pytest.fixture(params=[*CHANNEL, *BLOCKS])
def channel(request, tmp_path):
    if request.param in BLOCKS:
        return in_blocks(tmp_path, request.param)
    return read_mesh(MESHES / f"{request.param}.msh", 2)


@pytest.fixture(params=RING)
def ring(request):
    return read_mesh(MESHES / f"{request.param}.msh", 2)


def area(mesh, region):
    """Return the area of a region, ∫ det ∂x/∂ξ."""
    cells = mesh.cells[mesh.cell_region == mesh.regions.index(region)]
    xi, weights = mesh.element.cell.quadrature(2 * mesh.element.order)
    jacobian = np.einsum("eai,qaj->eqij", mesh.points[cells], mesh.element.gradient(xi))
    return (np.linalg.det(jacobian) @ weights).sum()


def smallest_angle(mesh):
    """Return the smallest angle of all cells [degrees]."""
    corners = mesh.points[mesh.cells[:, : mesh.element.n_vertices]]
    a = np.roll(corners, -1, axis=1) - corners
    b = np.roll(corners, 1, axis=1) - corners
    cosine = (a * b).sum(axis=2) / np.linalg.norm(a, axis=2) / np.linalg.norm(b, axis=2)
    return np.degrees(np.arccos(cosine)).min()


def radius(points, centre=(0.0, 0.0)):
    return np.linalg.norm(points - np.asarray(centre), axis=1)


def arc_error(r, mesh, tag):
    """Return the relative error of the area under an arc of radius r by chords, φ²/6 of the largest
    angle φ, and a bound of that by parabolas.
    """
    start, end = (mesh.points[mesh.facets[tag][:, i]] for i in (0, 1))
    largest = 2 * np.arcsin(radius(end - start).max() / (2 * r))
    return largest ** (2 * mesh.element.order) / 6


def test_the_channel_has_its_names_and_no_bad_cell(channel):
    assert set(channel.regions) == {"fluid", "beam"}
    assert set(channel.facets) == {"inlet", "outlet", "walls", "cylinder", "root", "interface"}
    assert smallest_angle(channel) > 20


def test_the_areas_of_channel_and_beam_are_exact_up_to_the_arcs(channel):
    half_angle = np.arcsin(HALF / RADIUS)
    sector = half_angle * RADIUS**2 + HALF * np.sqrt(
        RADIUS**2 - HALF**2
    )  # of the disc, on which the beam stands
    beam = 2 * HALF * (TIP - CENTRE[0]) - sector
    fluid = 2.5 * 0.41 - np.pi * RADIUS**2 - beam
    error = np.pi * RADIUS**2 * arc_error(RADIUS, channel, "cylinder")
    assert area(channel, "fluid") == pytest.approx(fluid, abs=error)
    assert area(channel, "beam") == pytest.approx(
        beam, abs=sector * arc_error(RADIUS, channel, "root")
    )


def test_cylinder_and_root_lie_on_the_circle_and_close_it(channel):
    for tag in ("cylinder", "root"):
        assert radius(channel.points[channel.facets[tag]].reshape(-1, 2), CENTRE) == pytest.approx(
            RADIUS, rel=1e-12
        )
    ends = np.concatenate([channel.facets[tag][:, :2] for tag in ("cylinder", "root")])
    assert np.array_equal(np.bincount(ends.ravel())[np.unique(ends)], np.full(len(ends), 2))


def test_the_interface_is_the_wetted_boundary_of_the_beam_with_the_point_a(channel):
    nodes = channel.facets["interface"]
    points = channel.points[nodes]
    sides = np.isclose(abs(points[..., 1] - CENTRE[1]), HALF, rtol=0, atol=1e-12).all(axis=1)
    tip = np.isclose(points[..., 0], TIP, rtol=0, atol=1e-12).all(axis=1)
    assert (sides ^ tip).all()
    length = np.linalg.norm(points[:, 1] - points[:, 0], axis=1).sum()
    assert length == pytest.approx(
        2 * (TIP - CENTRE[0] - np.sqrt(RADIUS**2 - HALF**2)) + 2 * HALF, rel=1e-12
    )
    assert (
        np.isclose(channel.points[np.unique(nodes[tip])], [TIP, CENTRE[1]], rtol=0, atol=1e-12)
        .all(axis=1)
        .any()
    )


def test_fluid_and_beam_share_the_interface_and_nothing_else(channel):
    of = {
        name: np.unique(channel.cells[channel.cell_region == i])
        for i, name in enumerate(channel.regions)
    }
    assert np.array_equal(
        np.intersect1d(of["fluid"], of["beam"]), np.unique(channel.facets["interface"])
    )
    outer = sum(
        len(channel.facets[tag]) for tag in ("inlet", "outlet", "walls", "cylinder", "root")
    )
    assert (facet_multiplicity(channel.cells, channel.element) == 1).sum() == outer


def test_a_level_halves_the_sizes():
    coarse, fine = (read_mesh(MESHES / f"hron_turek_{level}_p1.msh", 2) for level in (0, 1))
    for tag in ("inlet", "cylinder", "root", "interface"):
        assert len(fine.facets[tag]) == 2 * len(coarse.facets[tag])


def test_a_part_of_the_blocks_has_its_own_boundaries_and_a_level_half_of_the_sizes(tmp_path):
    fluid, beam = (in_blocks(tmp_path, "Q4", (name,)) for name in ("fluid", "beam"))
    fine = in_blocks(tmp_path, "Q4", ("beam",), 1)
    assert set(fluid.facets) == {"inlet", "outlet", "walls", "cylinder", "interface"}
    assert set(beam.facets) == {"root", "interface"} and beam.regions == ("beam",)
    for tag in beam.facets:
        assert len(fine.facets[tag]) == 2 * len(beam.facets[tag])


def test_a_level_below_zero_doubles_the_sizes(tmp_path):
    """Two elements over the thickness of the beam, its tip in two with the point A between them."""
    pytest.importorskip("gmsh")
    path = tmp_path / "coarse.msh"
    words = [
        sys.executable,
        "-m",
        "mesh.hron_turek",
        "--level",
        "-1",
        "--order",
        "2",
        "--output",
        path,
    ]
    subprocess.run(words, env=environment(), check=True, capture_output=True)
    coarse = read_mesh(path, 2)
    fine = read_mesh(MESHES / "hron_turek_0_p2.msh", 2)
    for tag in ("root", "interface"):
        assert len(fine.facets[tag]) == 2 * len(coarse.facets[tag])
    assert (coarse.points == (TIP, CENTRE[1])).all(axis=1).any() and smallest_angle(coarse) > 20


def test_the_quarter_ring_has_its_names_radii_and_areas(ring):
    assert set(ring.regions) == {"ring", "fluid"}
    cuts = {f"{region}_{side}" for region in ring.regions for side in ("bottom", "left")}
    assert set(ring.facets) == {"inside", "interface", "wall"} | cuts
    for tag, r in (("inside", 0.95), ("interface", 1.05), ("wall", 1.5)):
        assert radius(ring.points[ring.facets[tag]].reshape(-1, 2)) == pytest.approx(r, rel=1e-12)
    error = arc_error(1.5, ring, "wall") * np.pi / 4 * (1.5**2 + 1.05**2)
    assert area(ring, "ring") == pytest.approx(np.pi / 4 * (1.05**2 - 0.95**2), abs=error)
    assert area(ring, "fluid") == pytest.approx(np.pi / 4 * (1.5**2 - 1.05**2), abs=error)
    assert (
        smallest_angle(ring) > 3
    )  # in the thin rows at the interface and at the wall, 12 times as long as thick
