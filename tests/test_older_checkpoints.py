"""Checkpoints of older versions: a run goes on as the version that wrote them did."""

from pathlib import Path

import numpy as np
import pytest
from running import SCENES, Job, history, run_here

from porofsi_petsc.kernels import stabilization

CHECKPOINTS = Path(__file__).parent / "checkpoints"
# Written half way, at `commit`, and the end of the same run there, by its column.  Version 0.1.0 at
# 16b8caa had tractions and open boundaries as fields of the phases.
PULSE = (
    "mesh.order=1",
    "mesh.x.cells=[4,2,4]",
    "mesh.y.cells=[4]",
    "figures.times=[]",
    "time.end=0.008",
)
FLAP = ("boundary.2.backflow=1.0", "time.end=0.06")
CASES = {
    "pulse2d": ("pulse2d", PULSE, {"A.u_x": 1.2361405679477509e-06, "B.p": 11881.277506985632}),
    "flap": (
        str(SCENES / "flap.toml"),
        FLAP,
        {"tip.u_x": 0.010257424775091154, "flap.f_x": 384.23572732610137},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_checkpoint_of_the_version_before_goes_on(name, tmp_path, monkeypatch):
    monkeypatch.setattr(stabilization, "VISCOUS_FACTOR", 4.0)  # as it was in that version
    scene, changes, expected = CASES[name]
    file = CHECKPOINTS / f"{name}_before_conditions.h5"
    run_here(Job(scene, str(tmp_path / "run"), changes, restart=str(file)))
    found = history(tmp_path / "run")
    for column, value in expected.items():
        print(f"{column}: {found[column][-1]!r}, of the version before {value!r}")
        # solvers of other versions of PETSc leave another round-off, below the coupling's tolerance
        assert np.isclose(found[column][-1], value, rtol=1e-6)
