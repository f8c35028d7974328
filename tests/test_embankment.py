"""An embankment on two layers: what a mesh at rest neglects does not grow when the mesh is
refined.
"""

import numpy as np
import pytest
from running import SCENES, Job, history, run_here
from test_mesh_read import blocks, write22

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.mesh import Mesh
from porofsi_petsc.mesh.topology import add_midside_nodes, boundary_facets, cell_facets

SETTLEMENT = (
    -0.05354
)  # [m] under the centre after 30 days, the same on two meshes of Gmsh with other time steps


def grid(x, y, nodes):
    """Return triangles of the rectangle cells of a grid, their nodes found or made at the points
    x[i, j], y[i, j].
    """
    index = np.array(
        [
            [
                nodes.setdefault((round(a, 9), round(b, 9)), len(nodes))
                for a, b in zip(*r, strict=True)
            ]
            for r in zip(x, y, strict=True)
        ]
    )
    a = index[:-1, :-1]
    b = index[:-1, 1:]
    c = index[1:, 1:]
    d = index[1:, :-1]
    return np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])


def write_mesh(path, h):
    """Write the quadratic mesh of cells of size h [m]: clay, sand and the trapezoid of the
    embankment.
    """
    nodes = {}
    columns = np.concatenate([np.arange(0, 10, h), np.linspace(10, 40, round(15 / h) + 1)])
    parts = [
        grid(*np.meshgrid(columns, np.linspace(*ends, round(n / h) + 1)), nodes)
        for *ends, n in ((-10, -4, 6), (-4, 0, 4))
    ]
    foot = np.arange(0, 10 + h / 2, h)
    levels = np.linspace(0, 3.5, round(3.5 / h) + 1)
    parts.append(
        grid(
            foot * (1 - levels[:, None] / 7),
            np.broadcast_to(levels[:, None], (len(levels), len(foot))),
            nodes,
        )
    )
    points, cells = add_midside_nodes(np.array(list(nodes)), np.concatenate(parts), ELEMENTS["T6"])
    region = np.repeat(range(3), [len(part) for part in parts])
    cell, local = boundary_facets(cells, ELEMENTS["T6"])
    facets = cell_facets(cells, ELEMENTS["T6"])[cell, local]
    x, y = points[facets[:, 2]].T
    sides = {
        "axis": x < 1e-9,
        "far": x > 40 - 1e-9,
        "base": y < -10 + 1e-9,
        "ground": np.abs(y) < 1e-9,
    }
    sides["slope"] = ~np.any(list(sides.values()), axis=0)
    tags = {name: facets[here] for name, here in sides.items()}
    write22(
        path,
        points,
        blocks(Mesh(points, cells, ELEMENTS["T6"], ("clay", "sand", "embankment"), region, tags)),
    )


@pytest.mark.parametrize("h", [2.0, 1.0])
def test_settlement_of_an_embankment_on_a_fixed_mesh_of_any_size(tmp_path, h):
    """Tolerance: steps of up to a day with backward Euler and cells of 2 m; both errors stay below
    half a percent.
    """
    write_mesh(tmp_path / "a.msh", h)
    done = run_here(
        Job(
            str(SCENES / "embankment.toml"),
            str(tmp_path / "run"),
            (f"mesh.path={tmp_path / 'a.msh'}",),
        )
    )
    assert history(tmp_path / "run")["centre.u_y"][-1] == pytest.approx(SETTLEMENT, rel=5e-3)
    strain, change = (done["neglected"][name]["value"] for name in ("strain", "mesh_displacement"))
    assert 0.005 < strain <= change * 1.01 < 0.02
