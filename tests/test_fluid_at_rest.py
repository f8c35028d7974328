"""A free fluid at rest: all terms of its volume balance are the round-off of forces that cancel,
and the iteration must end.
"""

import numpy as np
import pytest
from running import SCENES, Job, history, run_here

SCENE = str(SCENES / "free_fluid.toml")  # density 2 kg/m³, 1 m high
REST = (
    "model.moving_mesh=false",
    "time.end=0.2",
    "probe=[{name='m', at=[0.5, 0.5], quantities=['vf_x', 'vf_y', 'p']}]",
)
WALL = "velocity={x=0, y=0}"
ALL = "['left', 'right', 'bottom', 'top']"
THREE = "['left', 'right', 'bottom']"
WEIGHT = "body_force.fluid.y=-9.81"
# name -> changes and the pressure in the middle [Pa]: by depth below the open top, zero in the mean
# of a closed box
CASES = {
    "weight in an open box": (
        (f"boundary=[{{on={THREE}, {WALL}}}, {{on='top'}}]", WEIGHT),
        2.0 * 9.81 / 2,
    ),
    "weight in a closed box": ((f"boundary=[{{on={ALL}, {WALL}}}]", WEIGHT), 0.0),
    "pressure on the open end": (
        (f"boundary=[{{on={THREE}, {WALL}}}, {{on='top', traction={{y=-100}}}}]",),
        100.0,
    ),
}


@pytest.mark.parametrize("scheme", ["time.rho_inf=0.5", "time.scheme=steady"])
@pytest.mark.parametrize("case", CASES)
def test_a_fluid_at_rest_is_in_balance(tmp_path, case, scheme):
    changes, pressure = CASES[case]
    steady = (
        ("model.solid_inertia=false", "model.fluid_inertia=false") if "steady" in scheme else ()
    )
    run_here(Job(SCENE, str(tmp_path), (*REST, *changes, *steady, scheme)))
    rows = history(tmp_path)
    # round-off of a hundred pascals, and of forces of 10 N over an impedance of the order of 10 N
    # s/m
    assert np.abs(rows["m.p"][1:] - pressure).max() < 1e-9
    assert max(np.abs(rows[f"m.vf_{axis}"]).max() for axis in "xy") < 1e-12
