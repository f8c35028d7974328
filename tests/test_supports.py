"""Bodies that nothing holds are refused before a run, with the motion they can make; those that are
held or fly are not.
"""

from dataclasses import replace

import numpy as np
import pytest
from running import SCENES, by_command_line, changes, needs_mpirun

from porofsi_petsc import load_scene
from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.errors import InputError
from porofsi_petsc.mesh import Mesh
from porofsi_petsc.simulation.build import serial_mesh
from porofsi_petsc.simulation.supports import require_supports

COLUMN, FLAP = (str(SCENES / f"{name}.toml") for name in ("column_supported", "flap"))
FREE_SIDES = 'boundary.0={on=["left", "right"]}'
FREE_BASE = 'boundary.1={on="bottom"}'
BOX = (
    'mesh={kind="box", x={points=[0,1], cells=[1]}, y={points=[0,2], cells=[1]}, z={points=[0,3],'
    " cells=[2]}}"
)


def on_sides(dim=2, **held):
    """Return the change of [[boundary]] to all sides with these displacements,
    side=component(s).
    """
    sides = ("left", "right", "bottom", "top", "front", "back")[: 2 * dim]
    entries = [
        f'{{on="{side}", displacement={{{", ".join(f"{c}=0.0" for c in held.get(side, ""))}}}}}'
        for side in sides
    ]
    entries[3] = entries[3][:-1] + ", pressure=0.0}"
    return f"boundary=[{', '.join(entries)}]"


def refused(motion, *overrides, scene=COLUMN, what="skeleton"):
    with pytest.raises(
        InputError,
        match=rf"\[\[boundary\]\]: nothing holds the {what} {motion}: region '.*' at \(.*\) m can",
    ):
        serial_mesh(load_scene(scene, overrides))


def test_free_translations_are_named():
    refused("in y", FREE_BASE)
    refused("in x", FREE_SIDES)
    refused("in x and y", FREE_SIDES, FREE_BASE)
    refused("in x, y and z", BOX, on_sides(3))
    refused("in x and z", BOX, on_sides(3, front="y", back="y"))


def test_free_rotations_are_named_with_their_axis():
    """u = ω × X vanishes in the component held on each side, for the axis named."""
    refused(r"against turning about \(0, 0\)", on_sides(left="y", bottom="x"))
    refused(r"against turning about \(1, 1\)", on_sides(right="y", top="x"))
    turning = on_sides(3, front="x", left="y", bottom="z")
    refused(r"against turning about an axis along z through \(0, 0, 1.5\)", BOX, turning)
    refused(
        r"against turning about an axis along x through \(0.5, 2, 3\)",
        BOX,
        on_sides(3, right="x", back="z", top="y"),
    )


def test_what_is_held_by_few_nodes_or_by_inclined_ones_is_accepted():
    """One facet of 200 stops the sliding; the bottom held in both components stops all."""
    fine = (
        "mesh.x={points=[0, 0.005, 1], cells=[1, 199]}",
        'mesh.patches=[{name="pin", side="bottom", x=[0, 0.005]}]',
    )
    pinned = on_sides(bottom="y")[:-1] + ', {on="pin", displacement={x=0.0, y=0.0}}]'
    serial_mesh(load_scene(COLUMN, (*fine, pinned)))
    serial_mesh(load_scene(COLUMN, (on_sides(bottom="xy"),)))
    serial_mesh(load_scene(COLUMN, (BOX, on_sides(3, front="y", left="x", bottom="z"))))


def squares(*corners):
    """Return a mesh of unit squares at lower left corners; nodes at one place are one; tag: "base"
    of the first.
    """
    points = np.concatenate(
        [np.add(corner, [(0, 0), (1, 0), (1, 1), (0, 1)]) for corner in corners]
    ).astype(float)
    points, node = np.unique(points, axis=0, return_inverse=True)
    quads = node.reshape(-1, 4)
    cells = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Mesh(
        points, cells, ELEMENTS["T3"], ("body",), np.zeros(len(cells), int), {"base": quads[:1, :2]}
    )


def require(mesh, **held):
    scene = load_scene(
        COLUMN, ('boundary=[{on="base", displacement={x=0.0, y=0.0}, pressure=0.0}]',)
    )
    require_supports(scene, mesh, {"body": "porous"}, "here")


def test_parts_must_be_held_each_and_a_hinge_does_not_stop_turning():
    require(squares((0, 0), (1, 0)))
    with pytest.raises(InputError, match=r"in x and y: region 'body' at \(5.\d+, 5.\d+\) m"):
        require(squares((0, 0), (5, 5)))
    with pytest.raises(
        InputError, match=r"against turning about \(1, 1\): region 'body' at \(1.\d+, 1.\d+\) m"
    ):
        require(squares((0, 0), (1, 1)))
    ring = (0, 0), (1, 1), (0, 2), (-1, 1)
    with pytest.raises(InputError, match="against turning"):
        require(squares(*ring))
    require(squares(*ring, (0, 1)))


def test_a_tag_that_is_not_on_the_solid_does_not_hold_it():
    mesh = squares((0, 0), (1, 0))
    cut = replace(mesh, regions=("water", "body"), cell_region=np.array([0, 1, 0, 1]))
    scene = load_scene(
        FLAP, ("model.solid_inertia=false", 'boundary=[{on="base", displacement={x=0.0, y=0.0}}]')
    )
    with pytest.raises(InputError, match="nothing holds the solid in x and y"):
        require_supports(scene, cut, {"water": "fluid", "body": "solid"}, "here")


def test_bodies_with_inertia_and_those_in_one_matrix_with_a_viscous_fluid_are_free_to_move():
    dynamic = (
        "model.solid_inertia=true",
        "model.fluid_inertia=true",
        "time.scheme=generalized_alpha",
    )
    serial_mesh(load_scene(COLUMN, (FREE_SIDES, FREE_BASE, *dynamic)))
    dragged = "model.fluid_inertia=true", "time.scheme=generalized_alpha"
    serial_mesh(load_scene(COLUMN, (FREE_SIDES, FREE_BASE, *dragged)))
    refused("in y", FREE_BASE, 'model.solid_inertia="auto"', "time.scheme=generalized_alpha")
    adrift = (
        "model.solid_inertia=false",
        'boundary.1={on=["bottom", "top"], velocity={x=0.0, y=0.0}}',
    )
    refused("in x and y", *adrift, scene=FLAP, what="solid")
    steady = "model.fluid_inertia=false", "time.scheme=steady", "coupling.scheme=direct"
    refused("in x and y", *adrift, *steady, scene=FLAP, what="solid")
    serial_mesh(load_scene(FLAP, (*adrift, "coupling.scheme=direct")))


@needs_mpirun
def test_a_run_on_two_ranks_says_so_once(tmp_path):
    result = by_command_line(COLUMN, tmp_path, *changes([FREE_BASE]), ranks=2)
    assert result.returncode == 2, result.stderr
    assert result.stderr.count("nothing holds the skeleton in y") == 1
    assert (
        'or set model.solid_inertia = true and time.scheme = "generalized_alpha"' in result.stderr
    )
