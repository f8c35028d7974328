"""Solids without pores that share nodes with porous media: exact column, tangents, schemes, a rigid
footing, ranks, restart and what is refused.
"""

import numpy as np
import pytest
from running import Job, fields, history, needs_mpirun, run_here, run_on
from small_media import BRINKMAN, DARCY, FD_TOLERANCE, VARIABLE, in_motion
from test_monolithic_tangents import block_errors

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError

pytestmark = pytest.mark.usefixtures("petsc")

# of small_media's block: the left half is dry
HALF = (
    "mesh.regions=[{name='dry', x=[0.0, 10.0]}]",
    "material=[{region='body', porosity=0.33,"
    " solid={law='neo_hookean', lambda=8.375e6, mu=5.583e6, density=2000},"
    " fluid={density=1000, specific_weight=1e4}, permeability={law='constant', k=1e-2}},"
    " {region='dry', solid={law='neo_hookean', young=3e7, poisson=0.3, density=2400}}]",
    "boundary=[{on=['left', 'right'], displacement={x=0}}, {on='strip', pressure=0},"
    " {on='bottom', displacement={y=0}}, {on='top', traction={y=-1e3}}]",
)

# Half of a footing, 1 m wide, on a layer of 4 m by 2 m that drains at its base.
FOOTING = (
    "mesh.x={points=[0.0, 1.0, 4.0], cells=[3, 4]}",
    "mesh.diagonal='alternating'",
    "surface=[]",
    "probe=[{name='edge', at=[1.0, 2.0], quantities=['u_y', 'p']}]",
    "figures.times=[]",
    "time={end=0.5, step=0.01, growth=1.5, rho_inf=0.0}",
)
SUPPORTS = (
    "{on=['left', 'right'], displacement={x=0}}, {on='bottom', displacement={y=0}, pressure=0}"
)
PLATE = (
    "mesh.y={points=[0.0, 2.0, 2.5], cells=[4, 1]}",
    "mesh.regions=[{name='clay', y=[0.0, 2.0]}, {name='fill', x=[0.0, 1.0], y=[2.0, 2.5]}]",
    "mesh.keep=['clay', 'fill']",  # what is beside the plate is the 'body'
    "material.1.solid={law='linear_elastic', young=1e13, poisson=0.2, density=2400}",
    f"boundary=[{SUPPORTS}, {{on='body', displacement={{}}}}, {{on='top', traction={{y=-1e4}}}}]",
)
RIGID = (
    "mesh.y={points=[0.0, 2.0], cells=[4]}",
    "mesh.regions=[]",
    "mesh.patches=[{name='footing', side='top', x=[0.0, 1.0]}]",
    "material=[{region='body', porosity=0.33,"
    " solid={law='linear_elastic', lambda=8.375e6, mu=5.583e6, density=2000},"
    " fluid={density=1000, specific_weight=1e4}, permeability={law='constant', k=1e-3}}]",
    f"boundary=[{SUPPORTS}, {{on='top', displacement={{}}}}, {{on='footing',"
    " displacement={x=0}, equal_displacement='y', traction={y=-1e4}}]",
)
DYNAMIC = (
    "model={solid_inertia=true, fluid_inertia=true, convection=true, moving_mesh=true,"
    " porosity='variable'}",
    "material.0.solid.law='neo_hookean'",
    "material.0.permeability.law='kozeny_carman'",
    "material.1.solid.law='neo_hookean'",
    "boundary.2.traction.y='where(t < 0.01, -1e6*sin(100*pi*t), 0)'",
    "mesh.y.cells=[4, 1]",
    "mesh.y.ratios=[1.0, 1.0]",
    "time={end=0.006, step=1e-3, rho_inf=0.3}",
)
COLUMN = ("mesh.y.cells=[4, 1]", "mesh.y.ratios=[5.0, 1.0]", "time.end=0.05", "time.step=0.01")


def columns(folder, *changes, scene="dry_fill", **more):
    """Return the history of a run."""
    run_here(Job(scene, str(folder), changes, **more))
    return history(folder)


def test_the_fill_shortens_at_once_and_keeps_its_stress(tmp_path):
    """q h/E_c in every step, and no pressure in its stress, also in the element on the joint."""
    found = columns(tmp_path, *COLUMN)
    shortened = found["joint.u_y"] - found["top.u_y"]
    exact = 1e4 * 2.0 / (16.75e6 + 2 * 11.166e6)
    # of the iteration, 1e-6 of the load
    np.testing.assert_allclose(shortened[1:], exact, rtol=1e-6)
    np.testing.assert_allclose(found["fill.stress_yy"][1:], -1e4, rtol=1e-6)
    np.testing.assert_allclose(found["base.f_y"][1:], -1e3, rtol=1e-6)


@pytest.mark.parametrize(
    ("mesh", "options"),
    [("T3", DARCY), ("T3", BRINKMAN + VARIABLE), ("Q9", BRINKMAN)],
    ids=["Darcy", "Brinkman, variable", "Q9"],
)
def test_direct_tangent_is_the_derivative_of_both_residuals(mesh, options):
    errors = block_errors(*in_motion(mesh, *HALF, *options, "coupling.scheme=direct"))
    assert max(errors.values()) < FD_TOLERANCE, errors


@pytest.fixture(scope="module")
def direct(petsc, tmp_path_factory):
    """Return the history of the direct scheme, with inertia on a moving mesh."""
    return columns(tmp_path_factory.mktemp("direct"), *DYNAMIC, "coupling.scheme='direct'")


@pytest.mark.parametrize(
    "changes",
    [
        (),
        ("coupling.scheme='quasi_direct'",),
        ("coupling.tangent='newton'",),
        ("coupling={split='plain', mass_scaling='optimal', accelerator='iqn_ils'}",),
    ],
    ids=["partitioned", "quasi_direct", "newton", "scaled"],
)
def test_every_scheme_finds_the_same(tmp_path, direct, changes):
    """As the direct scheme, with inertia on a moving mesh, to the tolerance of the iteration."""
    found = columns(tmp_path / "other", *DYNAMIC, *changes)
    for name in ("top.u_y", "joint.u_y", "joint.p"):
        scale = np.abs(direct[name]).max()
        assert scale > 0
        assert np.abs(found[name] - direct[name]).max() < 1e-5 * scale


def test_a_stiff_plate_is_a_rigid_footing(tmp_path):
    """As nodes with a common settlement that do not slide; of E_soil/E_plate = 1e-6."""
    plate = columns(tmp_path / "plate", *FOOTING, *PLATE)
    rigid = columns(tmp_path / "rigid", *FOOTING, *RIGID)
    for name in ("edge.u_y", "edge.p"):
        np.testing.assert_allclose(plate[name][1:], rigid[name][1:], rtol=1e-4)


def test_a_surface_of_both_is_free_for_the_fluid_where_it_has_pores(tmp_path):
    """With inertia the block of the fluid has a condition on free surfaces, here on one of clay and
    plate, the split converges to the direct scheme.
    """
    dynamic = (*FOOTING, *PLATE, "model.solid_inertia=true", "model.fluid_inertia=true")
    ramp = ("boundary.3.traction.y='-1e4*minimum(t/0.01, 1)'", "time={end=0.01, step=2e-3}")
    ramp = (*ramp, "material.1.solid.young=1e9")
    one = columns(tmp_path / "split", *dynamic, *ramp)
    two = columns(tmp_path / "direct", *dynamic, *ramp, "coupling.scheme='direct'")
    for name in ("edge.u_y", "edge.p"):
        assert np.abs(one[name] - two[name]).max() < 1e-5 * np.abs(two[name]).max()


def test_there_is_no_fluid_at_nodes_without_pores(tmp_path):
    """Their rows of p and v_f in checkpoints and output are zero, whatever is given at t = 0."""
    given = "initial={pressure='1e3*(1 + y)', fluid_velocity={y=1e-9}}"
    columns(tmp_path / "run", *COLUMN, given, "output.checkpoint_every=1")
    found = fields(tmp_path / "run/checkpoint.h5")
    dry = _heights() > 10.0
    for name in ("fluid.p", "fluid.v", "fluid.p_collocated"):
        assert not found[name][dry].any()
        assert found[name][~dry].any()


def _heights():
    from mpi4py import MPI

    from porofsi_petsc.simulation.build import local_mesh

    mesh = local_mesh(load_scene("dry_fill", COLUMN), MPI.COMM_SELF)
    found = np.empty(mesh.n_owned)
    found[mesh.natural[: mesh.n_owned]] = mesh.X[: mesh.n_owned, 1]
    return found


def test_a_restart_is_the_whole_run(tmp_path):
    every = "output.checkpoint_every=1"
    whole = columns(tmp_path / "whole", *DYNAMIC, every)
    columns(tmp_path / "half", *DYNAMIC, every, "time.end=0.003")
    point = str(tmp_path / "half/checkpoint.h5")
    again = columns(tmp_path / "again", *DYNAMIC, every, restart=point)
    for name in ("top.u_y", "joint.p", "fill.stress_yy", "base.f_y"):
        assert again[name][-1] == whole[name][-1]


@needs_mpirun
def test_ranks_solve_like_one(tmp_path):
    """To the tolerance of the iteration."""
    direct = (*DYNAMIC, "coupling.scheme='direct'")
    runs = {"dynamic": DYNAMIC, "plate": (*FOOTING, *PLATE), "direct": direct}
    jobs = [Job("dry_fill", str(tmp_path / f"{name}2"), c) for name, c in runs.items()]
    run_on(2, jobs, tmp_path)
    for run, changes in runs.items():
        one = columns(tmp_path / run, *changes)
        two = history(tmp_path / f"{run}2")
        for name in set(one) - {"t", "coupling_iterations", "base.f_x"}:
            scale = np.abs(one[name]).max()
            assert np.abs(two[name] - one[name]).max() < 1e-5 * scale, (run, name)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (("boundary.2.pressure=0",), r"boundary.2.pressure\]: tag 'top' is on a solid without"),
        (("boundary.0.velocity.x=0",), r"boundary.0.velocity\]: tag 'left' is on a solid without"),
        (("boundary.2.flux=0.1",), r"boundary.2.flux\]: tag 'top' is on a solid without"),
        (("probe.0.quantities=['p']",), r"probe.0\]: received p at .* expected a point of the"),
        (("probe.2.quantities=['n_f']",), r"probe.2\]: received n_f at .* in the solid"),
        (("surface.0.on=['left']",), r"received 'flow_rate' on porous media and solids without"),
        (("surface.0.on=['top']",), r"received 'flow_rate' on 'top', behind which is the solid"),
        (
            (
                "mesh.regions.1.y=[11.0, 12.0]",
                "mesh.y.points=[0, 10, 11, 12]",
                "mesh.y.cells=[4, 1, 1]",
                "mesh.y.ratios=[1, 1, 1]",
                "mesh.keep=['clay', 'fill']",
                "boundary.2.on=['top', 'body']",
            ),
            "have no node in common",
        ),
    ],
)
def test_what_a_dry_region_has_not_is_refused(tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        columns(tmp_path / "run", *COLUMN, *changes)
