"""Inlets with a given flow rate: profiles against exact ones, the flow through the facets, what is
refused.
"""

import numpy as np
import pytest
from mpi4py import MPI
from running import SCENES, Job, history, run_here

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.exact import WomersleyPipe
from porofsi_petsc.fem.geometry import Rule, facet_measure
from porofsi_petsc.simulation.build import local_mesh
from porofsi_petsc.simulation.builder import materials_of
from porofsi_petsc.simulation.inflow import inflows
from porofsi_petsc.simulation.simulation import Simulation

SCENE = str(SCENES / "duct.toml")
RHO, MU = 2.0, 0.3  # of the scene
OMEGA = 2 * np.pi / 3
PIPE = ("mesh.axisymmetric=true", "mesh.x={points=[0, 1], cells=[3]}")
SIDES = (
    "boundary.0.on='bottom'",
    "boundary.1.on='top'",
    "boundary.2.on='right'",
    "surface=[]",
)
AXES = ", ".join(f"{axis}={{points=[0, 1], cells=[2]}}" for axis in "xyz")
BOX = (
    f"mesh={{kind='box', {AXES}, cell_type='%s', order=%d}}",
    "boundary.2={on=['front', 'back', 'bottom', 'top'], velocity={x=0, y=0, z=0}}",
)


def box(cell_type, order):
    """Return the changes to a cube that the fluid enters along x."""
    return BOX[0] % (cell_type, order), BOX[1]


MESHES = {
    "line": (),
    "linear line": ("mesh.order=1",),
    "serendipity": ("mesh.cell_type=serendipity",),
    "pipe": (*PIPE, *SIDES),
    "triangles": box("tetrahedron", 1),
    "quadratic triangles": box("tetrahedron", 2),
    "quadrilaterals": box("hexahedron", 2),
    "serendipity faces": box("serendipity", 2),
}


def given(*changes, comm=MPI.COMM_SELF):
    """Return mesh and `Essential`s of the inlet of the scene with changes."""
    scene = load_scene(SCENE, changes)
    mesh = local_mesh(scene, comm)
    found = inflows(
        scene,
        mesh,
        materials_of(scene, mesh),
        np.zeros(mesh.n_local, dtype=bool),
        lambda formula: formula,
    )
    return mesh, found


def inlet(*changes, t=0.0, comm=MPI.COMM_SELF):
    """Return mesh and velocity (n_local, d) of the scene with changes, zero elsewhere."""
    mesh, found = given(*changes, comm=comm)
    v = np.zeros((mesh.n_local, mesh.dim))
    for entry in found:
        nodes = np.unique(mesh.facets[entry.tag].nodes)
        v[nodes, entry.component] = entry.expression(t, mesh.X[nodes])
    return mesh, v


def flow(mesh, tag, v):
    """Return the flow that enters through a tag."""
    nodes = mesh.facets[tag].nodes[mesh.facets[tag].owned]
    facet = mesh.element.facet
    rule = Rule.of(facet, 2 * facet.order + facet.axisymmetric)
    through = np.einsum("fqi,qa,fai->", facet_measure(rule, mesh.X[nodes]), rule.N, v[nodes])
    return -mesh.comm.allreduce(float(through))


def of(profile):
    """Return the change that gives a flow with a profile, 0.6 + sin ωt."""
    rate = f"0.6 + sin({OMEGA}*t)"
    return f"boundary.0.inflow={{flow_rate='{rate}', profile='{profile}', period=3.0}}"


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("profile", ["plug", "parabolic", "womersley"])
def test_the_flow_through_the_facets_is_the_given_one(name, profile):
    for t in (0.0, 0.7):
        mesh, v = inlet(*MESHES[name], of(profile), t=t)
        tag = "bottom" if name == "pipe" else "left"
        Q = 0.6 + np.sin(OMEGA * t)
        assert flow(mesh, tag, v) == pytest.approx(Q, rel=1e-13)
        along = 1 if name == "pipe" else 0
        assert not np.delete(v, along, axis=1).any()


def test_poiseuilles_profiles_are_exact_on_quadratic_elements():
    mesh, v = inlet()
    y = mesh.X[:, 1]
    exact = np.where(mesh.X[:, 0] == 0, 6 * 0.6 * y * (1 - y), 0.0)
    assert np.abs(v[:, 0] - exact).max() < 1e-14
    mesh, v = inlet(*PIPE, *SIDES)
    exact = np.where(mesh.X[:, 1] == 0, 2 * 0.6 / np.pi * (1 - mesh.X[:, 0] ** 2), 0.0)
    assert np.abs(v[:, 1] - exact).max() < 1e-14


def test_a_square_duct_whole_and_by_symmetry():
    _, whole = inlet(*box("hexahedron", 2), "mesh.y.cells=[4]", "mesh.z.cells=[4]")
    # largest over mean speed, F. M. White, Viscous Fluid Flow, of the series
    assert whole[:, 0].max() / 0.6 == pytest.approx(2.0963, rel=2e-3)
    quarter = (
        box("hexahedron", 2)[0],
        "boundary=[{on='left', inflow={flow_rate=0.15}}, {on='right'},"
        " {on=['front', 'bottom'], velocity={x=0, y=0, z=0}},"
        " {on='back', velocity={y=0}}, {on='top', velocity={z=0}}]",
        "mesh.y.points=[0, 0.5]",
        "mesh.z.points=[0, 0.5]",
    )
    _, part = inlet(*quarter)
    assert part[:, 0].max() == pytest.approx(whole[:, 0].max(), rel=1e-12)


def test_womersleys_profile_is_that_of_bessel_functions():
    errors = []
    for cells in (6, 12):
        changes = (*PIPE, *SIDES, of("womersley"), f"mesh.x.cells=[{cells}]")
        mesh, v = inlet(*changes, t=0.4)
        r = mesh.X[mesh.X[:, 1] == 0]
        exact = 2 * 0.6 / np.pi * (1 - r[:, 0] ** 2)
        pipe = WomersleyPipe(RHO, MU, 1 / np.pi, 1.0, OMEGA)
        exact += pipe.velocity(0.4 - 0.75, r)[:, 1]  # cos ω(t - 3/4) = sin ωt
        errors.append(np.abs(v[mesh.X[:, 1] == 0, 1] - exact).max() / np.abs(exact).max())
    print(f"errors at the nodes {errors}, order {np.log2(errors[0] / errors[1]):.2f}")
    assert errors[1] < 1e-4 and errors[0] / errors[1] > 6


def test_a_table_of_one_period_is_repeated(tmp_path):
    (tmp_path / "beat.csv").write_text("t,Q\n0,1\n0.5,3\n1,1\n")
    table = f"flow_rate={{table='{tmp_path / 'beat.csv'}'}}"
    for profile in ("parabolic", "womersley"):
        change = f"boundary.0.inflow={{{table}, profile='{profile}', period=1.0}}"
        for t in (0.25, 7.25):
            mesh, v = inlet(change, t=t)
            assert flow(mesh, "left", v) == pytest.approx(2.0, rel=1e-12)


def test_a_run_has_the_flow_at_both_ends_and_goes_on(tmp_path):
    every = "output.checkpoint_every=1"
    run_here(Job(SCENE, str(tmp_path / "whole"), ()))
    run_here(Job(SCENE, str(tmp_path / "half"), ("time.end=0.05", every)))
    rest = Job(SCENE, str(tmp_path / "rest"), (), restart=str(tmp_path / "half/checkpoint.h5"))
    run_here(rest)
    found, again = (history(tmp_path / name) for name in ("whole", "rest"))
    Q = 0.6 + found["t"][1:]
    assert np.allclose(found["inlet.flow_rate"][1:], -Q, rtol=1e-12)
    assert np.allclose(found["outlet.flow_rate"][1:], Q, rtol=1e-9)
    assert again["outlet.flow_rate"][-1] == found["outlet.flow_rate"][-1]


def test_a_closed_fluid_may_have_it():
    """What enters by a parabola leaves by one: no net flux, whatever the formula between nodes."""
    both = "boundary.1.inflow={flow_rate='-0.6 - t'}"
    Simulation(load_scene(SCENE, (both,)), MPI.COMM_SELF)
    with pytest.raises(InputError, match="a fluid closed all around"):
        Simulation(load_scene(SCENE, (both.replace("0.6", "0.5"),)), MPI.COMM_SELF)


@pytest.mark.parametrize(
    "change, message",
    [
        ("boundary.0.inflow.flow_rate='1 + y'", "expected a function of t alone"),
        ("boundary.0.inflow.profile='womersley'", "period.*expected the period"),
        ("boundary.0.inflow.harmonics=3", "harmonics.*expected none"),
        ("boundary.0.velocity.x=1.0", "velocity.x.*which excludes"),
        ("boundary.0.traction.x=1.0", "traction.x.*which excludes"),
        ("boundary.2.velocity={y=0}", "has no wall at its rim"),
        ("mesh.y.cells=[1]; mesh.order=1", "at rest on all its nodes"),
        ("boundary.2={on=['bottom', 'top'], velocity={x=2, y=0}, priority=1}", "goes before"),
    ],
)
def test_what_has_no_meaning_is_refused(change, message):
    changes = change.split("; ")
    with pytest.raises(InputError, match=message):
        given(*changes)


def test_a_bent_inlet_is_refused():
    bent = (
        "mesh.tag=[{name='bent', formula='0.6 - x - y'}]",
        "boundary=[{on='bent', inflow={flow_rate=1}}, {on='right'},"
        " {on=['left', 'top'], velocity={x=0, y=0}, priority=-1}]",
    )
    with pytest.raises(InputError, match="expected a plane surface"):
        given(*bent)


def test_every_part_of_an_inlet_has_a_wall():
    """Of two, the one between free sides has none."""
    parts = (
        "mesh.tag=[{name='two', of='left',"
        " formula='where((y < 0.25) | ((y > 0.5) & (y < 0.75)), 1, 0)'}]",
        "boundary=[{on='two', inflow={flow_rate=1, profile='%s'}}, {on=['left', 'right']},"
        " {on=['bottom', 'top'], velocity={x=0, y=0}}]",
        "surface=[]",
    )
    given(parts[0], parts[1] % "plug", parts[2])
    with pytest.raises(InputError, match="has no wall at its rim"):
        given(parts[0], parts[1] % "parabolic", parts[2])


def test_it_belongs_to_free_fluids():
    with pytest.raises(InputError, match=r"inflow\]: received one with porous materials"):
        load_scene("terzaghi", ("boundary.0.inflow={flow_rate=1}",))
    with pytest.raises(InputError, match="is on the solid, expected a surface of a free fluid"):
        scene = load_scene(str(SCENES / "piston.toml"), ("boundary.0.inflow={flow_rate=1}",))
        local_mesh(scene, MPI.COMM_SELF)
    with pytest.raises(InputError, match="womersley' with model.fluid_inertia = false"):
        load_scene(SCENE, (of("womersley"), "model.fluid_inertia=false", "time.scheme=steady"))


@pytest.mark.mpi
def test_every_rank_has_the_same_profile():
    changes = (*box("tetrahedron", 2), of("womersley"), "mesh.y.cells=[3]")
    mesh, v = inlet(*changes, t=0.3, comm=MPI.COMM_WORLD)
    whole, alone = inlet(*changes, t=0.3)
    place = np.argsort(whole.natural)
    here = mesh.natural
    on_inlet = np.unique(mesh.facets["left"].nodes)
    assert np.array_equal(v[on_inlet], alone[place[here[on_inlet]]])
