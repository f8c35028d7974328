"""Accelerators and mass scaling on whole runs: what they save, and that a restart goes on with what
is reused.
"""

import numpy as np
import pytest
from running import Job, run_here, state

from porofsi_petsc.errors import ConvergenceError

BLOCK = ("mesh.order=1", "mesh.x.cells=[4, 2, 4]", "mesh.y.cells=[4]", "time.end=0.01")
COLUMN = ("time.end=0.005", "time.step=1e-3", "time.growth=1.0", "coupling.accelerator=none")
QUASI_NEWTON = "coupling.accelerator=iqn_ils"


def sweeps(directory, scene, *overrides):
    """Return the iterations of a run, a dict with mean and max."""
    return run_here(Job(scene, str(directory), overrides, force=True))["coupling_iterations"]


def test_the_plain_split_converges_with_the_scaled_mass_where_it_diverges_without(tmp_path):
    """A compression wave: the error of the plain split grows by 1.4 in a sweep, the optimal factor
    is its exact answer.
    """
    plain = (
        *COLUMN,
        "coupling.split=plain",
        "coupling.max_iterations=40",
        "coupling.on_failure=stop",
    )
    with pytest.raises(ConvergenceError, match="40 iterations"):
        sweeps(tmp_path, "column_harmonic", *plain)
    assert sweeps(tmp_path, "column_harmonic", *plain, "coupling.mass_scaling=optimal")["max"] <= 8
    assert sweeps(tmp_path, "column_harmonic", *plain, "coupling.mass_scaling=4.0")["max"] <= 20


def test_a_larger_scaling_only_costs_sweeps(tmp_path):
    """Residuals are untouched: the scaled scheme ends in the solution of the corrected one."""
    tight = (*COLUMN, "coupling.tolerance=1e-11", "output.checkpoint_every=5")
    splits = {
        "corrected": (),
        "scaled": (
            "coupling.split=plain",
            "coupling.mass_scaling=8.0",
            "coupling.max_iterations=200",
        ),
    }
    u = {}
    for name, overrides in splits.items():
        sweeps(tmp_path / name, "column_harmonic", *tight, *overrides)
        u[name] = state(tmp_path / name / "checkpoint.h5")["solid.u"]
    # the tolerance 1e-11 of the forces times the condition of a step
    assert np.abs(u["scaled"] - u["corrected"]).max() < 1e-9 * np.abs(u["corrected"]).max()


def test_reused_columns_save_sweeps(tmp_path):
    reused, fresh = (
        sweeps(tmp_path, "pulse2d", *BLOCK, QUASI_NEWTON, f"coupling.reuse_steps={n}")
        for n in (4, 0)
    )
    assert reused["mean"] <= fresh["mean"] - 0.5


@pytest.mark.parametrize(
    "scene, overrides",
    [("pulse2d", ("coupling.tangent=newton",)), ("pulse2d_low_permeability", ())],
)
def test_a_restart_goes_on_with_the_reused_columns(tmp_path, scene, overrides):
    common = (*BLOCK, QUASI_NEWTON, *overrides)
    whole, first, second = (str(tmp_path / name) for name in ("whole", "first", "second"))
    run_here(Job(scene, whole, (*common, "output.checkpoint_every=10")))
    run_here(Job(scene, first, (*common, "output.checkpoint_every=6", "time.end=0.006")))
    run_here(
        Job(
            scene, second, (*common, "output.checkpoint_every=10"), restart=f"{first}/checkpoint.h5"
        )
    )
    ends = [state(tmp_path / name / "checkpoint.h5") for name in ("whole", "second")]
    assert any(name.startswith("accelerator.") for name in ends[0])
    assert ends[0].keys() == ends[1].keys()
    for name in ends[0]:
        assert np.array_equal(ends[0][name], ends[1][name]), name


def test_a_restart_with_another_accelerator_leaves_the_columns(tmp_path):
    run_here(
        Job(
            "pulse2d",
            str(tmp_path / "first"),
            (*BLOCK, QUASI_NEWTON, "output.checkpoint_every=6", "time.end=0.006"),
        )
    )
    restart = str(tmp_path / "first" / "checkpoint.h5")
    for name in ("aitken", "iqn_ils"):
        other = Job(
            "pulse2d",
            str(tmp_path / name),
            (*BLOCK, f"coupling.accelerator={name}", "coupling.reuse_steps=1"),
            restart,
        )
        assert run_here(other)["steps"] == 10
