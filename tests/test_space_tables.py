"""Tables over position, and over time and position."""

import numpy as np
import pytest
from running import SCENES, Job, run_here

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config.expressions import Expression
from porofsi_petsc.errors import InputError

BAR = str(SCENES / "bar.toml")


def written(folder, names, rows):
    """Write a table and return its path."""
    path = folder / "table.csv"
    lines = [",".join(names), *(",".join(map(repr, map(float, row))) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def linear(points):
    """Return 1 + 2 x - 3 y + z, of the coordinates there are."""
    return 1 + points @ np.array([2.0, -3.0, 1.0])[: points.shape[1]]


def test_one_coordinate(tmp_path):
    path = written(tmp_path, "yv", [(0, 1), (1, 3), (3, 2)])
    found = Expression({"table": path, "over": "y", "factor": -2.0})
    X = np.array([[9.0, 0.0], [9.0, 0.5], [9.0, 2.0], [9.0, 3.0 + 1e-12]])
    assert np.allclose(found(5.0, X), [-2, -4, -5, -4])
    assert found.names == {"y"}
    assert not found.depends_on_time


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["grid", "scattered"])
def test_a_linear_field_is_exact(tmp_path, kind, dim):
    """On a full grid in any order, and on the cells of Delaunay of scattered points."""
    rng = np.random.default_rng(4)
    corners = np.array(np.meshgrid(*dim * [[0.0, 1.0]])).reshape(dim, -1).T
    if kind == "grid":
        axes = np.meshgrid(*dim * [[0.0, 0.3, 1.0]])
        points = rng.permutation(np.array(axes).reshape(dim, -1).T)
    else:
        points = np.vstack([corners, rng.random((12, dim))])
    names = "xyz"[:dim]
    path = written(tmp_path, [*names, "v"], np.column_stack([points, linear(points)]))
    found = Expression({"table": path, "over": list(names)})
    X = np.vstack([corners, rng.random((50, dim))])
    assert np.allclose(found(0.0, X), linear(X))


def test_time_and_one_coordinate(tmp_path):
    """Bilinear within, constant in time beyond the ends."""
    rows = [(t, y, t * y) for t in (0, 2) for y in (0, 1, 4)]
    path = written(tmp_path, "tyv", rows)
    found = Expression({"table": path, "over": ["t", "y"]})
    X = np.array([[0.0, 3.0], [0.0, 0.5]])
    assert np.allclose(found(1.0, X), [3, 0.5])
    assert np.allclose(found(7.0, X), [6, 1])
    assert found.names == {"t", "y"}


def test_a_place_outside_is_refused(tmp_path):
    path = written(tmp_path, "yv", [(0, 1), (0.5, 3)])
    table = f"boundary.2.traction={{y={{table='{path}', over='y'}}}}"
    message = (
        r"boundary.2.traction.y\]: table .*table.csv: received the point y = 1 \[m\] outside of its"
        r" points \(y from 0 to 0.5\); expected a table that covers"
    )
    with pytest.raises(InputError, match=message):
        run_here(Job(BAR, str(tmp_path / "run"), (table,)))


@pytest.mark.parametrize(
    ("names", "rows", "over", "message"),
    [
        ("yv", [(0, 1), (1, 2)], ["x"], "received the column 'y', expected 'x' there"),
        ("xyv", [(0, 0, 1), (1, 1, 2)], ["x", "y"], "of which no cells can be made"),
        ("xyv", [(0, 0, 1)] * 3, ["x", "y"], r"received the point \(0, 0\) twice"),
        ("tyv", [(0, 0, 1), (1, 1, 2), (2, 0, 1)], ["t", "y"], "no full grid of t and y"),
        ("xyv", [(0, 0, 1), (1, 0, 2)], ["x", "y"], "received one value of y"),
        ("xv", [(0, 0), (1, 0)], ["x", "y"], "received 2 columns, expected 2 coordinates and"),
        ("xv", [(1, 0), (0, 0)], ["x"], "line 3: received 0 after 1, expected strictly increasing"),
        ("xv", [(1, 0), (2, 0)], ["x", "x"], "with over ="),
    ],
)
def test_what_no_table_is(tmp_path, names, rows, over, message):
    path = written(tmp_path, names, rows)
    with pytest.raises(InputError, match=message):
        Expression({"table": path, "over": over})


def test_a_scene_with_tables_is_written_and_read_again(tmp_path):
    path = written(tmp_path, "xyv", [(x, y, 1) for x in (0, 1) for y in (0, 1)])
    change = f"boundary.2.traction={{y={{table='{path}', over=['x', 'y'], factor=2.0}}}}"
    run_here(Job(BAR, str(tmp_path / "run"), (change, "time.end=0.05")))
    again = load_scene(tmp_path / "run" / "scene.toml")
    (top,) = [boundary for boundary in again.boundary if boundary.on == ("top",)]
    assert np.allclose(top.traction.y(0.0, np.array([[0.1, 1.0]])), 2.0)


def test_no_third_coordinate_in_the_plane(tmp_path):
    path = written(tmp_path, "zv", [(0, 1), (1, 2)])
    with pytest.raises(InputError, match="expected no z"):
        Simulation.from_scene(BAR, overrides=(f"body_force.solid.x={{table='{path}', over='z'}}",))
