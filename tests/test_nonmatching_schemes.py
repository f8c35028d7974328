"""Sides of an interface with nodes of their own under Robin conditions and in one matrix: tangents,
one solution of all schemes, exact and published values, ranks and restart.
"""

import functools

import numpy as np
import pytest
from mpi4py import MPI
from running import ROOT, Job, history, largest_difference, needs_mpirun, run_here, run_on, state
from small_media import FD_STEP, FD_TOLERANCE, dense
from test_nonmatching import (
    FLAP,
    ROUND_OFF,
    axis,
    blocks,
    column,
    difference,
    flap_mesh,
    given,
    joined,
    pressure_load,
    renamed,
    run,
    transfer_of,
)

from porofsi_petsc import load_scene
from porofsi_petsc.fem.domain import Domain
from porofsi_petsc.fem.projection import NEGLIGIBLE
from porofsi_petsc.linalg.options import start
from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.generate import rectangle
from porofsi_petsc.mesh.mesh import Mesh
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation

DIRECT = ("coupling.scheme=direct",)
SCHEMES = {
    "dirichlet_neumann": (),
    "robin_neumann": ("coupling.interface=robin_neumann",),
    "robin_robin": ("coupling.interface=robin_robin",),
    "quasi_direct": ("coupling.scheme=quasi_direct",),
    "direct": DIRECT,
}
TIGHT = "coupling.tolerance=1e-11", "coupling.max_iterations=100"


# -- operators -------------------------------------------------------------------------------------

BLOCKS = [(2, 1, 3, 5), (2, 2, 6, 3), (3, 1, 3, 2), (3, 2, 2, 3)]


@pytest.mark.parametrize("dim, order, fluid, solid", BLOCKS)
def test_the_rows_of_the_tangent_are_those_of_the_transfer(dim, order, fluid, solid):
    """T of all displacements, one node after the other, against P of a random one."""
    mesh, transfer = transfer_of(blocks(dim, order, fluid, solid))
    u = np.random.default_rng(3).standard_normal((mesh.n_local, dim))
    held = np.zeros((mesh.n_local, dim), dtype=bool)
    domain = Domain(mesh)
    T, left_out = transfer.eliminated(held, None).transformation(domain, dim)
    nodes = domain.nodes
    found = (T @ u[nodes].ravel()).reshape(-1, dim)
    assert np.abs(found - transfer.to_fluid(u)[nodes]).max() < 100 * NEGLIGIBLE
    # no displacement of the solid or inside the fluid is left out, and none of the fluid's side in
    follows = np.repeat(transfer.follows[nodes], dim).astype(float)
    assert np.array_equal(left_out.diagonal(), follows)
    assert np.abs(T @ follows).max() == 0.0


@pytest.mark.parametrize("order", (1, 2))
@pytest.mark.parametrize("fluid, solid", [(1, 2), (2, 1)])
def test_a_pressure_on_the_solid_is_one_on_the_fluid(fluid, solid, order):
    """What drives a fluid with a Robin condition; around the corners of the flap too."""
    mesh, transfer = transfer_of(flap_mesh(fluid, solid, order))
    back = transfer.force_to_fluid(pressure_load(mesh, "wet_solid"))
    expected = pressure_load(mesh, "wet_fluid")
    assert np.abs(back - expected).max() < ROUND_OFF * np.abs(expected).max()


# -- tangents --------------------------------------------------------------------------------------


def beside(dim, order, fluid, solid):
    """Return `blocks` for the scene of the flap, with the boundaries "lid" and "outer" of the
    fluid, "flank" and "base" of the solid.
    """
    mesh = blocks(dim, order, fluid, solid)
    outer = mesh.facets["outer"]
    height = mesh.points[outer][..., -1].mean(axis=1)
    names = np.select(
        [height > 0.9, height > 0.0, height > -0.9], ["lid", "outer", "flank"], "base"
    )
    facets = mesh.facets | {name: outer[names == name] for name in np.unique(names)}
    regions = tuple({"fluid": "body", "solid": "flap"}[name] for name in mesh.regions)
    return Mesh(mesh.points, mesh.cells, mesh.element, regions, mesh.cell_region, facets)


def in_motion(tmp_path, dim, *blocks_of):
    """Return a directly coupled medium on `beside` in its second step, away from the solution, and
    the rates of the step.
    """
    held = "displacement={x=0, y=0" + (", z=0}" if dim == 3 else "}")
    push = f"{{on='lid', traction={{{'xyz'[dim - 1]}='-2e4*t', x='1e3*t'}}}}"
    base = f"{{on='base', {held}}}, {{on='flank'}}"
    changes = (
        *given(tmp_path / "blocks.msh", beside(dim, *blocks_of)),
        f"boundary=[{push}, {base}, {{on='outer'}}]",
        "force=[]",
        "probe=[]",
        "stabilization.backflow=false",  # whose derivative by the mesh the tangent does not have
        *DIRECT,
    )
    changes = [text.replace("dim=2", f"dim={dim}") for text in changes]
    start()
    scene = load_scene(FLAP, changes)
    coupling = Simulation(scene, MPI.COMM_SELF).coupling
    clock = Clock(scene.time)
    schemes, rates = clock.next_schemes(scene.model)
    coupling.step(schemes, rates, clock.t, 1)
    coupling.accept()
    clock.advance(scene.time.step, clock.next_target())
    schemes, rates = clock.next_schemes(scene.model)
    coupling.step(schemes, rates, clock.t, 2)
    return coupling, rates


def residuals(coupling):
    """Return the residuals of u, v_f and p and the displacement of the mesh in the trial state,
    which takes the velocity of the solid along.
    """
    coupling.motion.follow(coupling.solid.end_displacement)
    mesh_state = coupling.mesh_state()
    coupling.fluid.follow(mesh_state)
    momentum, volume = fluid = coupling.fluid.residual(mesh_state)
    solid = coupling.solid.residual(coupling.flow(fluid))
    moved = mesh_state.displacement[: len(momentum.total)].copy()
    return np.column_stack([solid.total, momentum.total, volume.total]), moved


@pytest.mark.parametrize("dim, order, fluid, solid", [(2, 1, 3, 2), (2, 2, 2, 3), (3, 1, 2, 1)])
def test_the_direct_tangent_is_the_derivative_of_all_residuals(tmp_path, dim, order, fluid, solid):
    """Along random directions, with the motion of the mesh that belongs to that of the solid; the
    equation of the mesh has no residual on the way.
    """
    coupling, rates = in_motion(tmp_path, dim, order, fluid, solid)
    system, d = coupling.system, dim
    system.assemble(rates)
    matrix = dense(system.block.matrix.mat)
    free = ~system.block.mask
    of_solid = coupling.solid.domain.holds[:, None]
    follows = coupling.motion.setup.transfer.follows
    unknown = free & np.column_stack([of_solid & free[:, :d], free[:, d:]])
    base = np.column_stack([coupling.solid.unknowns, coupling.fluid.unknowns]).copy()
    sizes = FD_STEP * np.array([0.02] * d + [0.3] * d + [1e3])
    random = np.random.default_rng(7)
    for block in (slice(d), slice(d, 2 * d), slice(2 * d, None)):
        direction = np.zeros_like(base)
        direction[:, block] = (random.standard_normal(base.shape) * sizes * unknown)[:, block]
        found = []
        for sign in (1, -1):
            coupling.solid.unknowns, coupling.fluid.unknowns = base[:, :d], base[:, d:]
            coupling.solid.add(sign * direction[:, :d])
            coupling.fluid.add(sign * direction[:, d:])
            found.append(residuals(coupling))
        expected, moved = ((one - other) / 2 for one, other in zip(*found, strict=True))
        inside = free[:, :d] & ~of_solid & ~follows[:, None]
        direction[:, :d] += np.where(inside, moved, 0.0)
        image = (matrix @ direction.ravel()).reshape(base.shape)
        for rows in (slice(d), slice(d, 2 * d), slice(2 * d, None)):
            kept = unknown[:, rows]
            error = np.abs((image - expected)[:, rows][kept]).max()
            assert error < FD_TOLERANCE * np.abs(expected[:, rows][kept]).max()


# -- one solution of all schemes -------------------------------------------------------------------


@pytest.fixture(scope="module")
def direct(tmp_path_factory):
    """Return the directly coupled run of a flap of two meshes, solved once."""

    @functools.cache
    def solved(fluid, solid, order, end):
        path = tmp_path_factory.mktemp("direct")
        changes = given(path / "flap.msh", flap_mesh(fluid, solid, order))
        return run(path / "run", *changes, *TIGHT, *DIRECT, f"time.end={end}")

    return solved


SAME = [
    ("dirichlet_neumann", 2, 1, 1, 0.03),
    ("robin_neumann", 2, 1, 1, 0.03),
    ("robin_robin", 2, 3, 1, 0.03),
    ("robin_neumann", 1, 2, 2, 0.02),
    ("robin_robin", 1, 2, 2, 0.02),
    ("quasi_direct", 1, 2, 2, 0.02),
    ("robin_robin", 2, 1, 1, 0.14),
]


@pytest.mark.parametrize("scheme, fluid, solid, order, end", SAME)
def test_all_strong_schemes_have_one_solution(scheme, fluid, solid, order, end, direct, tmp_path):
    """On meshes of two sides; at 0.14 s the tip has moved by a quarter of the flap's height.
    Residuals of 1e-11 times a condition of some hundreds: 1e-8.
    """
    newton, expected = direct(fluid, solid, order, end)
    changes = given(tmp_path / "flap.msh", flap_mesh(fluid, solid, order))
    summary, found = run(tmp_path / "run", *changes, *TIGHT, *SCHEMES[scheme], f"time.end={end}")
    error = max(difference(found, expected).values())
    sweeps = summary["coupling_iterations"]["mean"]
    print(f"{scheme} {fluid}:{solid}, order {order}: {error:.1e}, {sweeps} sweeps")
    assert error < 1e-8
    assert newton["coupling_iterations"]["max"] <= 5
    if end > 0.1:
        assert expected["tip.u_x"][-1] > 0.25 * 0.2
    # what one side does the other gets: what is left is the work of the last residuals
    assert newton["energy"]["balance_error_relative"] < 1e-13
    assert summary["energy"]["balance_error_relative"] < 1e-10


def test_plates_that_hold_the_rim_of_the_interface_are_taken_along(tmp_path):
    """The flanks of the solid move alike, the corners of the interface among them: one solution in
    one matrix and in two.
    """
    lid, held = "{on='lid', traction={y='-2e3*t/0.01'}}", "displacement={x=0}"
    flank = "{on='flank', equal_displacement=['y']}"
    boundary = f"boundary=[{lid}, {{on='outer'}}, {{on='base', {held}}}, {flank}]"
    changes = (
        *given(tmp_path / "blocks.msh", beside(2, 2, 3, 2)),
        boundary,
        "force=[]",
        "probe=[{name='A', at=[0.3, 0], quantities=['u_x', 'u_y', 'p']}, {name='B', at=[1, 0],"
        " quantities=['u_x', 'u_y']}]",
        "time.end=0.02",
        *TIGHT,
    )
    one, two = (run(tmp_path / "run", *changes, *scheme) for scheme in (DIRECT, ()))
    names = [name for name in one[1] if name[:2] in ("A.", "B.")]
    assert max(difference(two[1], one[1], names).values()) < 1e-8
    assert one[1]["B.u_y"][-1] < -2e-5 and one[0]["coupling_iterations"]["max"] <= 5


@pytest.mark.parametrize("scheme", ["robin_neumann", "robin_robin", "quasi_direct", "direct"])
def test_equal_nodes_given_twice_are_the_shared_ones(scheme, tmp_path):
    """P is the identity then: the residuals of 1e-11 times a condition of some hundreds."""
    changes = *SCHEMES[scheme], *TIGHT, "time.end=0.03"
    shared = run(tmp_path / "shared", *changes)
    double = run(tmp_path / "double", *given(tmp_path / "flap.msh", flap_mesh(1, 1)), *changes)
    counts = [summary["coupling_iterations"]["mean"] for summary, _ in (shared, double)]
    assert max(difference(double[1], shared[1]).values()) < 1e-8
    assert abs(counts[0] - counts[1]) <= 1


# -- exact and published values --------------------------------------------------------------------


def squeezed(stress):
    """Return the elongation of a bar of Saint Venant and Kirchhoff that cannot widen, under a dead
    load [Pa]: (λ + 2μ)/2 (s² - 1) s = stress.
    """
    young, poisson = 1e5, 0.4  # of flap.toml
    modulus = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    roots = np.roots([1.0, 0.0, -1.0, -2 * stress / modulus])
    return roots[np.argmin(np.abs(roots - 1))].real - 1


@pytest.mark.parametrize("scheme, fluid, solid", [("direct", 3, 2), ("quasi_direct", 2, 3)])
def test_an_elastic_piston_in_space_yields_by_its_modulus(scheme, fluid, solid, tmp_path):
    """A column of fluid on one of solid, without inertia: exactly what its load asks for."""
    walls = "{on='walls', velocity={x=0, y=0}, displacement={x=0, y=0}}"
    lid, base = "{on='lid', traction={z='-5e4*t'}}", "{on='base', displacement={x=0, y=0, z=0}}"
    read, tags = given(tmp_path / "column.msh", column(fluid, solid))
    changes = (
        *(read.replace("dim=2", "dim=3"), tags),
        f"boundary=[{walls}, {lid}, {base}]",
        "probe=[{name='A', at=[0.5, 0.5, 0], quantities=['u_z', 'p']}]",
        *("model.solid_inertia=false", "model.fluid_inertia=false", "limits.inertia=report"),
        "limits.strain=report",
        "time.end=0.02",
    )
    rows = run(tmp_path / "run", *changes, *TIGHT, *SCHEMES[scheme])[1]
    expected = np.array([squeezed(-5e4 * t) for t in rows["t"]])
    print(f"{scheme}: u_z {rows['A.u_z'][-1]:.6f} m, expected {expected[-1]:.6f} m")
    assert expected[-1] < -4e-3
    assert np.abs(rows["A.u_z"] - expected).max() < 1e-9 * np.abs(expected).max()


def beam(along, across):
    """Return the beam of Hron and Turek, with a number of cells: its root is the arc on the
    cylinder.
    """
    mesh = rectangle(axis(0.0, 1.0, cells=[along]), axis(0.19, 0.21, cells=[across]), 2)
    root = 0.2 + np.sqrt(0.05**2 - (mesh.points[:, 1] - 0.2) ** 2)
    mesh.points[:, 0] = root + mesh.points[:, 0] * (0.6 - root)
    wet = dict.fromkeys(("right", "top", "bottom"), "wet_solid")
    return renamed(mesh, "beam", left="root", **wet)


def test_fsi1_with_a_beam_of_its_own_mesh(tmp_path):
    """Within what the scene expects of common nodes, on 40 times 2 cells of the beam beside 56
    facets of the fluid on each side.
    """
    scene = load_scene("hron_turek_fsi1")
    fluid = read_mesh(ROOT / "configs/meshes/hron_turek_fluid_0_p2.msh", 2)
    facets = {"wet_fluid" if tag == "interface" else tag: f for tag, f in fluid.facets.items()}
    fluid = Mesh(fluid.points, fluid.cells, fluid.element, fluid.regions, fluid.cell_region, facets)
    changes = given(tmp_path / "apart.msh", joined(fluid, beam(40, 2)))
    force = "force=[{name='body', on=['cylinder', 'wet_fluid']}]"
    run_here(Job("hron_turek_fsi1", str(tmp_path / "run"), (*changes, force, *DIRECT)))
    rows = history(tmp_path / "run")
    for expected in scene.expect:
        error = rows[expected.quantity][-1] / expected.value - 1
        print(f"{expected.quantity}: {error:.2%} of Featflow's finest row")
        assert abs(error) < expected.tolerance


# -- restart, ranks --------------------------------------------------------------------------------

SHORT = "coupling.tolerance=1e-10", "time.end=0.02", "output.checkpoint_every=1"


@pytest.mark.parametrize("scheme", ["robin_robin", "direct"])
def test_a_run_continued_in_its_middle_is_the_whole_one(scheme, tmp_path):
    """To the last bit."""
    changes = *given(tmp_path / "flap.msh", flap_mesh(3, 2)), *SHORT, *SCHEMES[scheme]
    run(tmp_path / "whole", *changes)
    run(tmp_path / "half", *changes, "time.end=0.01")
    restart = str(tmp_path / "half/checkpoint.h5")
    run_here(Job(FLAP, str(tmp_path / "half"), changes, restart=restart))
    texts = [(tmp_path / name / "history.csv").read_text() for name in ("whole", "half")]
    assert texts[0] == texts[1]
    expected, computed = (state(tmp_path / name / "checkpoint.h5") for name in ("whole", "half"))
    assert [name for name in expected if not np.array_equal(expected[name], computed[name])] == []


@needs_mpirun
@pytest.mark.parametrize("scheme, ranks", [("robin_robin", 3), ("direct", 5)])
def test_ranks_do_not_matter(scheme, ranks, tmp_path):
    """Of five, one has no node of the interface; the solvers differ by round-off, the iterations
    end at 1e-10.
    """
    changes = *given(tmp_path / "flap.msh", flap_mesh(2, 1)), *SHORT, *SCHEMES[scheme]
    changes = *changes, "time.end=0.01"
    run(tmp_path / "one", *changes)
    run_on(ranks, [Job(FLAP, str(tmp_path / "some"), changes)], tmp_path)
    one, other = tmp_path / "one", tmp_path / "some"
    found = difference(history(other), history(one))
    arrays, others = state(one / "checkpoint.h5"), state(other / "checkpoint.h5")
    fields = [f for f in arrays if "tangent" not in f and not f.startswith("accelerator")]
    found |= {name: largest_difference(others[name], arrays[name]) for name in fields}
    worst = max(found, key=found.get)
    print(f"{scheme} on {ranks} ranks: {found[worst]:.1e} in {worst}")
    assert found[worst] < 1e-7
