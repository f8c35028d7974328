"""What `porofsi check` says: numbers by hand, units that do not fit, no alarm on shipped scenes,
the same on several ranks.
"""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mixed import unit_grid
from running import SCENES, changes, complete, needs_mpirun

from porofsi_petsc import list_scenes, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.linalg.options import start
from porofsi_petsc.output.mesh_plot import draw_mesh
from porofsi_petsc.simulation import check

COLUMN, FLAP = (str(SCENES / f"{name}.toml") for name in ("column_supported", "flap"))
SHIPPED = {name: path for name, _, path in list_scenes()}
DYNAMIC = "model.solid_inertia=true", "model.fluid_inertia=true", "time.scheme=generalized_alpha"


def said(scene, *overrides):
    start()
    return check(load_scene(scene, overrides))


def test_consolidation_in_numbers():
    """E_c = E (1-ν)/((1+ν)(1-2ν)) = 1.2e8 Pa, c_v = E_c k/γ = 0.012 m²/s, √(c_v 0.5 s) = 0.0775 m,
    1 m to the top: 1/c_v.
    """
    text = said(COLUMN)
    assert "8 elements T3, 9 nodes, 45 unknowns, about 0.3 GB of memory" in text
    assert (
        "c_v = 0.012 m²/s, the first step drains 0.0775 m, all of it (1 m from a drained boundary)"
        " takes 83.3 s" in text
    )
    assert (
        "beside a drained boundary are 0.5 m apart or more, which does not resolve the first step"
        in text
    )
    assert "does not resolve" not in said(
        COLUMN, "mesh.x.cells=[6]", "mesh.y.cells=[6]"
    )  # 1/6 m < √6 0.0775 m
    assert "no boundary is drained" in said(COLUMN, 'boundary.2={on="top", traction={y=-1e5}}')


def test_consolidation_is_told_along_the_most_permeable_axis():
    text = said(COLUMN, "material.0.permeability.anisotropy=[0.1, 2.0]")
    assert "c_v = 0.024 m²/s along the most permeable axis" in text


def test_terms_steps_and_loads():
    text = said(
        COLUMN, "time.growth=2.0", "time.step=0.1", "time.max_step=0.4", 'model.convection="auto"'
    )
    assert "in 4 steps, growing by 2 from 0.1 s to 0.4 s" in text  # 0.1, 0.2, 0.4, 0.3
    assert "switched on when needed: convection" in text and "strain (up to 0.05)" in text
    assert "to t = 1 s in 2 steps of 0.5 s" in said(COLUMN)
    assert "then as time.error_tolerance asks" in said(COLUMN, "time.error_tolerance=1e-3")
    late = said(
        COLUMN, 'boundary.2.traction.y="-1e5*where(t > 0.999, 3, 1)"', "body_force.solid.y=-10"
    )
    assert "body force: solid up to 10 m/s²\nlargest load: 3e+05 Pa (traction on 'top')" in late
    heavy = said(
        COLUMN, "boundary.2.traction.y=0", "body_force.solid.y=-10", "body_force.fluid={x=-3, y=-4}"
    )
    assert (
        "solid up to 10 m/s², fluid up to 5 m/s²\nlargest load: 1.4e+04 Pa (weight)" in heavy
    )  # 0.7 * 2000 * 10 * 1 m


def test_waves_and_flow():
    """√(E_c/ρ) with ρ = 0.7 * 2000 + 0.3 * 1000 = 1700 kg/m³; the inflow of the flap is 20 y (0.4 -
    y) at most.
    """
    text = said(COLUMN, *DYNAMIC)
    assert (
        "waves of the solid: up to 266 m/s, Courant number 266 of the first step" in text
    )  # 266 * 0.5/0.5
    text = said(FLAP)
    assert (
        "velocity up to 0.8 m/s" in text
        and "Reynolds number 320 over the shortest side of its box (0.4 m)" in text
    )
    assert "largest load: 640 Pa (dynamic pressure of the flow)" in text


def test_only_what_has_a_meaning_is_told():
    """No time in a steady step, no fluid to stabilize in a solid; a porous flag drains into the
    flow around it.
    """
    steady = said(SHIPPED["schaefer_turek_2d1"])
    assert (
        "Courant" not in steady
        and "Reynolds number 123" in steady
        and "pspg" in steady
        and "undrained" not in steady
    )
    assert not re.search("Courant|pspg|supg|lsic|undrained", said(SHIPPED["cook_membrane"]))
    flag = said(SHIPPED["porous_flag"])
    assert "no boundary is drained" not in flag and "undrained" in flag
    # half the thickness of the beam, 0.01 m, and a little more where no node lies opposite
    assert re.search(r"all of it \(0\.010\d+ m from a drained boundary\) takes", flag)


def test_a_modulus_in_another_unit_is_told():
    sentence = r"exceeds Young's modulus of 'body', 100 Pa, 1e\+03 times: compare their units"
    assert re.search(sentence, said(COLUMN, "material.0.solid.young=100"))
    assert "units" not in said(COLUMN)


def test_a_formula_that_fails_at_one_time_is_left_to_the_run():
    assert "largest load: 1e+05 Pa" in said(
        COLUMN, 'boundary.2.traction.y="-1e5*where(t > 0.5, 1, 0) + 0*log(t)"'
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_are_described_without_an_alarm(name):
    text = said(SHIPPED[name])
    assert "solved: " in text and "of memory" in text and "units" not in text
    assert not re.search(r"\b(nan|inf)\b", text)


def test_the_shapes_of_cells_in_numbers():
    """Triangles with two legs at a right angle: 2 det(M)^(1/2)/tr M = √3/2; a square is 1, a
    rectangle 2 a b/(a² + b²).
    """
    assert "cells: mean ratio 0.87 on average, at worst 0.87 at (" in said(COLUMN)
    assert "ratio 1.00 on average, at worst 1" in said(COLUMN, "mesh.cell_type=quadrilateral")
    long = said(COLUMN, "mesh.cell_type=quadrilateral", "mesh.x.cells=[4]", "mesh.y.cells=[2]")
    assert "mean ratio 0.80 on average, at worst 0.8 at (0.125, 0.25) m" in long


@pytest.mark.parametrize("dim", [2, 3])
def test_a_picture_of_the_mesh(tmp_path, dim):
    """All cells, or the sides of a cube that face the eye from the front and from behind."""
    cells = unit_grid(dim, 3)
    mesh = replace(cells, regions=("body", "core"), cell_region=np.arange(len(cells.cells)) % 2)
    figure = Figure()
    draw_mesh(figure, mesh)
    panels = [[c for c in ax.collections if isinstance(c, PolyCollection)] for ax in figure.axes]
    drawn = [[len(c.get_paths()) for c in panel] for panel in panels]
    assert drawn == ([[9]] if dim == 2 else [[27]] * 4)
    assert legend(figure) == [*mesh.facets, *mesh.regions]
    many = tuple(f"group_{i}" for i in range(40))  # of which the boundaries must stay to be seen
    draw_mesh(figure := Figure(), replace(mesh, regions=many))
    assert legend(figure)[: len(mesh.facets)] == list(mesh.facets)
    start()
    check(load_scene(COLUMN), tmp_path / "mesh.png")
    assert (tmp_path / "mesh.png").read_bytes().startswith(b"\x89PNG")


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


@needs_mpirun
def test_the_text_does_not_depend_on_the_number_of_ranks():
    words = ["-m", "porofsi_petsc", "check", FLAP, *changes(["time.growth=1.1"])]

    one, two = (
        complete([*launch, sys.executable, *words]) for launch in ([], ["mpirun", "-n", "2"])
    )
    assert one.returncode == two.returncode == 0, two.stderr
    assert re.sub("about .* GB", "", one.stdout) == re.sub("about .* GB", "", two.stdout)


def test_the_picture_is_there_before_every_boundary_has_an_entry(tmp_path):
    """It shows the names that the entries need."""
    scene = load_scene("terzaghi", ["expect=[]", "surface=[]", "boundary=[]"])
    with pytest.raises(InputError, match="has no entry"):
        check(scene, tmp_path / "mesh.png")
    assert (tmp_path / "mesh.png").stat().st_size > 1000
