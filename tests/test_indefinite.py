"""Solids in 3-D whose tangents are indefinite: CG breaks down, GMRES goes on, and what buckles is
no equilibrium.
"""

import pytest
from running import (
    SCENES,
    Job,
    history,
    largest_difference,
    needs_mpirun,
    run_here,
    run_on,
    summary,
)

from porofsi_petsc.errors import ConvergenceError

BLOCK = str(SCENES / "pressed_block3d.toml")
# Newton's iteration passes tangents that are indefinite and ends in a state whose tangent is not.
PASSING = ("mesh.order=1", "material.0.solid.poisson=0.3", "boundary.1.traction.z=-2.6e5")


@needs_mpirun
def test_gmres_goes_on_where_cg_breaks_down(tmp_path):
    """To the same state on two ranks."""
    done = run_here(Job(BLOCK, str(tmp_path / "one"), PASSING))
    assert done["exit_code"] == 0 and done["fall_backs"]["gmres"] >= 1
    assert (tmp_path / "one/run.log").read_text().count("solved with GMRES (said once") == 1
    run_on(2, [Job(BLOCK, str(tmp_path / "two"), PASSING)], tmp_path)
    assert summary(tmp_path / "two")["fall_backs"]["gmres"] >= 1
    one, two = history(tmp_path / "one"), history(tmp_path / "two")
    assert largest_difference(two["A.u_z"], one["A.u_z"]) < 1e-5  # coupling tolerance 1e-6


def test_a_solid_that_buckles_is_no_equilibrium(tmp_path):
    """Quadratic, ν = 0.49: more than half as much again as Euler's load of a column of this
    height, π² E I/(4 h²) = 2.1e5 N.
    """
    with pytest.raises(
        ConvergenceError,
        match="the equilibrium of the solid is unstable, its tangent is indefinite",
    ):
        run_here(Job(BLOCK, str(tmp_path / "run"), ("boundary.1.traction.z=-3.2e5",)))
    held = ("boundary.1.displacement={ x = 0.0, y = 0.0 }", "boundary.1.traction.z=-3.2e5")
    done = run_here(Job(BLOCK, str(tmp_path / "held"), held))
    assert done["exit_code"] == 0 and done["fall_backs"]["gmres"] == 0


def test_a_solver_that_was_chosen_is_left_as_it_is(tmp_path):
    stop = (*PASSING, "coupling.on_failure=stop")
    with pytest.raises(
        ConvergenceError, match="solid_ .cg, gamg. failed with DIVERGED_INDEFINITE_MAT"
    ):
        run_here(Job(BLOCK, str(tmp_path / "run"), stop, petsc_options=("-solid_ksp_type", "cg")))


EULER = 2056.0  # π² E I/(4 L² h), I = h³/12, of the column below [Pa]
COLUMN = """
title = "A slender column under an axial load"
limits.strain = "report"
mesh.kind = "rectangle"
mesh.order = 2
mesh.diagonal = "alternating"
mesh.x = { points = [0.0, 0.1], cells = [2] }
mesh.y = { points = [0.0, 1.0], cells = [10] }
time = { scheme = "steady", end = 1.0, step = 1.0 }
boundary = [
    { on = "bottom", displacement = { x = 0.0, y = 0.0 } },
    { on = "top", traction = { y = -1.0 } },
    { on = ["left", "right"] },
]

[[material]]
region = "all"
solid = { law = "neo_hookean", young = 1e6, poisson = 0.0, density = 1000.0 }
"""


@pytest.mark.parametrize("factor, stands", [(0.9, True), (1.1, False), (15.0, False)])
def test_a_factorization_finds_what_buckles_too(factor, stands, tmp_path):
    """Euler's load is that of a column that is not shortened and has no shear: within 2 %."""
    (tmp_path / "column.toml").write_text(COLUMN)
    load = (f"boundary.1.traction.y={-factor * EULER}",)
    job = Job(str(tmp_path / "column.toml"), str(tmp_path / "run"), load)
    if stands:
        assert run_here(job)["exit_code"] == 0
        return
    with pytest.raises(ConvergenceError, match="the equilibrium of the solid is unstable"):
        run_here(job)
