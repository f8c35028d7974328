"""Over an interface: a run that goes on from its checkpoint is the uninterrupted one, and ranks do
not matter.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from running import (
    SCENES,
    Job,
    history,
    largest_difference,
    needs_mpirun,
    run_here,
    run_on,
    state,
    summary,
)

from porofsi_petsc import load_scene
from porofsi_petsc.simulation.build import local_mesh

FLAP = str(SCENES / "flap.toml")
SHORT = ("output.checkpoint_every=5", "time.end=0.1", "material.0.fluid.density=200.0")
ACCELERATORS = ("constant", "aitken", "anderson", "iqn_ils")
DIRICHLET = "coupling.interface=dirichlet_neumann"
CASES = {name: (DIRICHLET, f"coupling.accelerator={name}") for name in ACCELERATORS} | {
    "condensed": ("coupling.interface=condensed",),
    "condensed, nearly incompressible": (
        "material.1.solid.poisson=0.4999",
        "limits.locking=report",
    ),
    "condensed, newton": ("coupling.tangent=newton",),
    "none": (DIRICHLET, "coupling.accelerator=none", "material.0.fluid.density=20.0"),
    "newton": (DIRICHLET, "coupling.tangent=newton"),
    "neo-Hookean mesh": ("mesh_motion.law=neo_hookean",),
    "weak": ("coupling.scheme=weak", "material.0.fluid.density=1.0"),
    "one-way": ("coupling.scheme=one_way",),
    "Robin-Neumann": ("coupling.interface=robin_neumann",),
    "Robin-Robin": ("coupling.interface=robin_robin",),
    "quasi-direct": ("coupling.scheme=quasi_direct",),
    "direct": ("coupling.scheme=direct",),
    "quadratic": (DIRICHLET, "mesh.order=2", "mesh.x.cells=[2, 1, 3]", "mesh.y.cells=[2, 2]"),
    "growing steps": (DIRICHLET, "time.growth=1.1", "time.max_step=0.02"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_run_continued_in_its_middle_is_the_whole_one(case, tmp_path):
    """To the last bit of every row and of the state: lagged tangents, reused vectors, mesh and
    forces are in the checkpoint.
    """
    whole = tmp_path / "whole"
    half = tmp_path / "half"
    run_here(Job(FLAP, str(whole), (*SHORT, *CASES[case])))
    middle = history(whole)["t"][5]
    run_here(Job(FLAP, str(half), (*SHORT, *CASES[case], f"time.end={middle}")))
    run_here(Job(FLAP, str(half), (*SHORT, *CASES[case]), restart=str(half / "checkpoint.h5")))
    assert (whole / "history.csv").read_text() == (half / "history.csv").read_text()
    expected = state(whole / "checkpoint.h5")
    computed = state(half / "checkpoint.h5")
    assert (
        expected.keys() == computed.keys()
        and {"mesh.u", "fluid.force", "solid.u"} <= expected.keys()
    )
    assert [name for name in expected if not np.array_equal(expected[name], computed[name])] == []
    assert summary(whole)["mesh_motion"] == summary(half)["mesh_motion"]


def edges_and_areas(points, cells):
    """Return squared edge lengths (E, 3) and areas (E,) of triangles."""
    corners = points[cells]
    edges = np.roll(corners, -1, axis=1) - corners
    return (edges**2).sum(axis=2), np.linalg.det(edges[:, :2]) / 2


def test_the_worst_elements_of_the_run_are_in_its_summary(tmp_path):
    """While the flap bends to one side they are those of the last mesh; 4√3 area / Σ edge² is the
    mean ratio of a triangle.
    """
    reports = []
    for end in ("0.05", "0.1"):
        run_here(
            Job(
                FLAP,
                str(tmp_path),
                (*SHORT, f"time.end={end}", "output.checkpoint_every=1"),
                force=True,
            )
        )
        scene = load_scene(FLAP)
        u = state(tmp_path / "checkpoint.h5")["mesh.u"]
        mesh = local_mesh(scene, MPI.COMM_SELF)
        cells = mesh.cells[mesh.cell_region == mesh.regions.index("body")]
        _, before = edges_and_areas(mesh.X, cells)
        lengths, after = edges_and_areas(mesh.X + u[mesh.natural], cells)
        shape = 4 * np.sqrt(3) * after / lengths.sum(axis=1)
        reports.append(summary(tmp_path)["mesh_motion"])
        # sums of some products of coordinates
        assert reports[-1]["smallest_volume_ratio"] == pytest.approx(
            (after / before).min(), rel=1e-12
        )
        assert reports[-1]["worst_shape"] == pytest.approx(shape.min(), rel=1e-12)
    print(f"worst elements: {reports}")
    early, late = reports
    assert all(late[name] < 0.98 * early[name] for name in late)


def test_a_mesh_that_does_not_move_has_no_worst_element(tmp_path):
    run_here(Job(FLAP, str(tmp_path), ("coupling.scheme=one_way", "time.end=0.01")))
    assert set(summary(tmp_path)["mesh_motion"].values()) == {None}


RANKS = {
    "condensed": ("coupling.interface=condensed",),
    "iqn_ils, neo-Hookean mesh": (
        DIRICHLET,
        "coupling.accelerator=iqn_ils",
        "mesh_motion.law=neo_hookean",
    ),
    "Robin-Neumann": ("coupling.interface=robin_neumann",),
    "direct": ("coupling.scheme=direct",),
}
# The solutions of different numbers of ranks differ by round-off, the sweeps end at residuals of
# 1e-10 times a condition of some hundreds.
SAME = 1e-7


@needs_mpirun
def test_ranks_do_not_matter(tmp_path):
    """On 1, 2 and 3 ranks; of three one has no node of the solid."""
    jobs = {}
    for ranks in (1, 2, 3):
        folder = tmp_path / str(ranks)
        tight = (
            "coupling.tolerance=1e-10",
            "time.end=0.03",
            "output.checkpoint_every=3",
            "material.0.fluid.density=200.0",
        )
        jobs[ranks] = [
            Job(FLAP, str(folder / name), (*tight, *options)) for name, options in RANKS.items()
        ]
        if ranks > 1:
            run_on(ranks, jobs[ranks], tmp_path)
    for job in jobs[1]:
        run_here(job)
    for ranks in (2, 3):
        for mine, serial in zip(jobs[ranks], jobs[1], strict=True):
            a, b = (Path(job.directory) for job in (mine, serial))
            rows = history(a)
            expected = history(b)
            found = {
                name: largest_difference(rows[name], expected[name])
                for name in expected
                if name != "coupling_iterations"
            }
            arrays = state(a / "checkpoint.h5")
            others = state(b / "checkpoint.h5")
            # A sweep more or less, and a lagged tangent is renewed in another step; vectors are
            # reused as many as there were.
            fields = [
                name
                for name in others
                if "tangent" not in name and not name.startswith("accelerator")
            ]
            found |= {name: largest_difference(arrays[name], others[name]) for name in fields}
            mesh = summary(a)["mesh_motion"]
            of_one = summary(b)["mesh_motion"]
            found |= {name: abs(mesh[name] - value) for name, value in of_one.items()}
            worst = max(found, key=found.get)
            print(f"{ranks} ranks, {b.name}: largest difference {found[worst]:.1e} in {worst}")
            assert found[worst] < SAME
