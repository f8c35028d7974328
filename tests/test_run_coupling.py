"""The coupling iteration on whole runs: how many sweeps a step takes under every kind of loaded
surface.
"""

import pytest
from running import Job, run_here

from porofsi_petsc.errors import ConvergenceError

BLOCK = (
    "mesh.order=1",
    "mesh.x.cells=[4, 2, 4]",
    "mesh.y.cells=[4]",
    "time.end=0.005",
    "coupling.max_iterations=100",
)
LOAD = 'traction = { y = "-1e5*sin(25*pi*t)" }'
SURFACES = {
    "drained": (),
    "impermeable footing": (
        "boundary.2={ on = 'top', pressure = 0.0 }",
        f"boundary.3={{ on = 'strip', {LOAD} }}",
    ),
    "impermeable top, drained sides": (
        "boundary.0={ on = ['left', 'right'], displacement = { x = 0.0 }, pressure = 0.0 }",
        "boundary.2={ on = 'top' }",
        f"boundary.3={{ on = 'strip', {LOAD} }}",
    ),
    "closed": ("boundary.2={ on = 'top' }", f"boundary.3={{ on = 'strip', {LOAD} }}"),
}


def most_sweeps(directory, *overrides):
    """Return the largest number of sweeps in five steps of the block."""
    return run_here(Job("pulse2d", str(directory), (*BLOCK, *overrides)))["coupling_iterations"][
        "max"
    ]


@pytest.mark.parametrize("k", ["1e-2", "1e-5"])
def test_a_step_of_a_drained_block_takes_few_sweeps(tmp_path, k):
    assert most_sweeps(tmp_path, f"material.0.permeability.k={k}", *SURFACES["drained"]) <= 15


@pytest.mark.parametrize("k", ["1e-2", "1e-5"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("surface", [name for name in SURFACES if name != "drained"])
def test_a_step_under_an_impermeable_surface_takes_few_sweeps(tmp_path, surface, order, k):
    overrides = (f"mesh.order={order}", f"material.0.permeability.k={k}")
    assert most_sweeps(tmp_path, *SURFACES[surface], *overrides) <= 15


def test_a_permeability_below_double_precision_is_refused(tmp_path):
    """S v_f is 1e16 times every force: its round-off would pass for the fluid's balance."""
    with pytest.raises(ConvergenceError, match="too small for double precision"):
        most_sweeps(tmp_path, "material.0.permeability.k=1e-20")


@pytest.mark.parametrize("k", ["1e-8", "1e-12", "1e-14"])
@pytest.mark.parametrize("tangent", ["newton", "lagged"])
def test_vanishing_permeability_at_finite_strain_takes_few_sweeps(tmp_path, tangent, k):
    assert (
        most_sweeps(tmp_path, f"material.0.permeability.k={k}", f"coupling.tangent={tangent}") <= 15
    )


@pytest.mark.parametrize("k", ["1e-10", "1e-12"])
def test_a_held_load_at_vanishing_permeability_takes_few_sweeps(tmp_path, k):
    """From the second step on nothing moves, but v_s has the round-off of u/Δt, and the drag that
    of S u/Δt.
    """
    still = (
        "time.scheme=backward_euler",
        "model.solid_inertia=false",
        "model.fluid_inertia=false",
        "model.convection=false",
    )
    held = (
        "boundary.3={ on = 'strip', traction = { y = '-1e5' } }",
        "limits={ inertia = 'report', reynolds = 'report' }",
    )
    assert most_sweeps(tmp_path, *still, *held, f"material.0.permeability.k={k}") <= 15
