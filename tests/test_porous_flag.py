"""A free fluid that flows through a porous solid: Darcy's law and the load of the drag."""

import pytest
from running import Job, run_here

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.output.history import read_history

# [m/s], [m²], [Pa s], [m] of the plug, E_c [Pa]
U = 0.3
K = 1e-6
MU = 2.0
LENGTH = 1.0
MODULUS = 2e6

SCENE = f"""
title = "A plug at the end of a channel"

[mesh]
kind = "rectangle"
order = 2
x = {{ points = [0.0, 1.0, 2.0], cells = [4, 4] }}
y = {{ points = [0.0, 0.5], cells = [2] }}
regions = [{{ name = "plug", x = [1.0, 2.0] }}]

[model]
solid_inertia = false
fluid_inertia = false
viscosity = true
convection = false
moving_mesh = false

[time]
scheme = "steady"
end = 1.0
step = 1.0

[[material]]
region = "body"
fluid = {{ density = 1000.0, viscosity = {MU} }}

[[material]]
region = "plug"
porosity = 0.4
solid = {{ law = "linear_elastic", lambda = 1e6, mu = 0.5e6, density = 2000.0 }}
fluid = {{ density = 1000.0, viscosity = {MU} }}
permeability = {{ law = "constant", intrinsic = {K} }}

[[boundary]]
on = "left"
velocity = {{ x = {U}, y = 0.0 }}

[[boundary]]
on = ["bottom", "top"]
velocity = {{ y = 0.0 }}
displacement = {{ y = 0.0 }}

[[boundary]]
on = "right"
displacement = {{ x = 0.0 }}

[[probe]]
name = "inlet"
at = [0.0, 0.25]
quantities = ["p", "vf_x"]

[[probe]]
name = "face"
at = [1.0, 0.25]
quantities = ["u_x", "p", "vf_x"]

[coupling]
scheme = "quasi_direct"

[limits]
reynolds = "report"
strain = "report"
mesh_displacement = "report"
"""


def last(path, *overrides):
    """Run the plug and return the last row of its history."""
    scene = path / "plug.toml"
    scene.write_text(SCENE)
    run_here(Job(str(scene), str(path / "out"), overrides))
    return {name: values[-1] for name, values in read_history(path / "out" / "history.csv").items()}


def test_flow_through_a_plug_obeys_darcy_and_loads_the_solid(tmp_path):
    """Uniform flow: p falls by μ U L/K, the drag compresses the plug by μ U L²/(2 K E_c), both
    exact on quadratic triangles.
    """
    computed = last(tmp_path)
    drop = MU * U * LENGTH / K
    exact = {
        "inlet.p": drop,
        "face.p": drop,
        "face.u_x": drop * LENGTH / (2 * MODULUS),
        "face.vf_x": U,
        "inlet.vf_x": U,
    }
    for name, value in exact.items():
        print(
            f"{name}: computed {computed[name]:.9g}, exact {value:.9g}, error"
            f" {computed[name] / value - 1:.1e}"
        )
        assert computed[name] == pytest.approx(
            value, rel=1e-8
        )  # 100 times the coupling's 1e-6 over a drag of 6e5 Pa: round-off


def test_along_an_axis_of_the_plug_its_factor_counts(tmp_path):
    """Axes at 90°: along the channel the permeability is 0.2 K, and Darcy's drop five times that of
    K, exactly.
    """
    axes = "anisotropy=[1.0, 0.2]", "angle=90.0"
    computed = last(tmp_path, *(f"material.1.permeability.{key}" for key in axes))
    assert computed["inlet.p"] == pytest.approx(MU * U * LENGTH / (0.2 * K), rel=1e-8)
    assert computed["face.vf_x"] == pytest.approx(U, rel=1e-8)


def test_newton_solves_a_plug_with_turned_axes_at_once(tmp_path):
    """The equations are linear here: one step, and one for the round-off of the largest drag."""
    axes = "anisotropy=[1.0, 0.2]", "angle=30.0"
    computed = last(tmp_path, *(f"material.1.permeability.{key}" for key in axes))
    assert computed["coupling_iterations"] <= 2


def test_an_open_plug_is_not_there(tmp_path):
    """At K = 1e3 m² the drop is 1e-9 of that at 1e-6."""
    computed = last(tmp_path, "material.1.permeability.intrinsic=1e3")
    assert abs(computed["inlet.p"]) < 1e-2 and computed["face.vf_x"] == pytest.approx(U, rel=1e-8)


@pytest.mark.parametrize("scheme", ["weak", "one_way"])
def test_other_schemes_are_refused(tmp_path, scheme):
    (tmp_path / "plug.toml").write_text(SCENE)
    with pytest.raises(InputError, match="quasi_direct"):
        load_scene(str(tmp_path / "plug.toml"), [f"coupling.scheme={scheme}"])


BLOCK = """
[[material]]
region = "block"
solid = { law = "linear_elastic", lambda = 2e6, mu = 1e6, density = 2000.0 }
"""
BESIDE_A_BLOCK = (
    "mesh.y={points=[0.0, 0.5, 1.0], cells=[2, 2]}",
    "mesh.x={points=[0.0, 1.0, 2.0, 3.0], cells=[3, 3, 3]}",
    "mesh.regions=[{name='plug', x=[1.0, 2.0], y=[0.5, 1.0]}, {name='block', x=[1.0, 2.0],"
    " y=[0.0, 0.5]}]",
    "boundary.1={on=['bottom', 'top'], velocity={y=0.0}, displacement={x=0.0, y=0.0}}",
    "boundary.2={on='right'}",
    "model.moving_mesh=true",
    "limits.stabilization=report",
    "limits.slip=report",  # 3 % on these cells: the schemes are compared, and Darcy's drop
    "probe=[]",
    "force=[{name='block', on='interface of block'}, {name='plug', on='interface of plug'}]",
    "surface=[{name='out', on='right', quantities=['flow_rate']}]",
    "coupling.tolerance=1e-9",
    f"material.1.permeability.intrinsic={100 * K}",
)


def test_a_porous_solid_and_one_without_pores_in_one_flow(tmp_path):
    """Half of the channel is closed by a block without pores: all of the fluid flows through the
    plug above, whose Darcy pressure drop the block bears too, on half of the section.
    """
    scene = tmp_path / "plug.toml"
    scene.write_text(SCENE + BLOCK)
    ends = []
    for scheme in ("direct", "quasi_direct", "partitioned"):
        changes = (*BESIDE_A_BLOCK, f"coupling.scheme={scheme}")
        run_here(Job(str(scene), str(tmp_path / scheme), changes))
        history = read_history(tmp_path / scheme / "history.csv")
        ends.append({name: values[-1] for name, values in history.items()})
    direct, *others = ends
    for name in ("block.f_x", "plug.f_x", "out.flow_rate"):
        for other in others:
            assert other[name] == pytest.approx(direct[name], rel=1e-7), name
    assert direct["out.flow_rate"] == pytest.approx(U * 1.0, rel=1e-9)
    # twice the velocity goes through the plug; what the flow turns around the edge is in the rest
    drop = MU * 2 * U * LENGTH / (100 * K)
    assert direct["block.f_x"] == pytest.approx(drop * 0.5, rel=0.02)
