"""`[reference]`: what has no exact solution is refused before anything is solved or written; errors
after a restart.
"""

import pytest
from running import Job, run_here, summary

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.simulation import check

pytestmark = pytest.mark.usefixtures("petsc")
SHORT = (
    "mesh.y.cells=[4]",
    "mesh.y.ratios=[1.0]",
    "time.end=0.2",
    "time.step=0.1",
    "time.growth=1.0",
)
STRIP = "reference={ solution = 'strip_footing', load = 1.0, length = 1e9, times = [1e-9] }"
WEIGHTLESS = (
    "reference={ solution = 'selfweight', length = 10.0 }",
    "body_force.solid.y='-10*minimum(t, 1)'",
)


@pytest.mark.parametrize(
    "changes, sentence",
    [
        (
            ("reference.length=1e-200",),
            r"\[reference.length\]: received 1e-200, expected 0 or a size",
        ),
        (("reference.length=11.0",), r"\[reference\]: .*leaves the mesh.* length and surface"),
        (("reference.surface=12.0",), r"\[reference\]: .*leaves the mesh.* length and surface"),
        (
            ("reference={ solution = 'drained', load = 1e9, length = 10.0 }",),
            r"\[reference\]: .*drained",
        ),
        ((STRIP,), r"\[reference\]: received 'strip_footing', .* too early for its integral"),
        (WEIGHTLESS, r"\[reference\]: .*selfweight.* zero"),
    ],
)
def test_what_has_no_solution_is_refused_before_the_run(tmp_path, changes, sentence):
    overrides = (*SHORT, "reference.times=[]", *changes)
    with pytest.raises(InputError, match=sentence):
        run_here(Job("terzaghi", str(tmp_path / "run"), overrides))
    assert not (tmp_path / "run").exists()
    with pytest.raises(InputError, match=sentence):
        check(load_scene("terzaghi", ("expect=[]", *overrides)))


def test_errors_are_those_of_their_times_after_a_restart(tmp_path):
    """A time that lies before the checkpoint and was not asked for then is not taken from a later
    state.
    """
    first = Job(
        "terzaghi",
        str(tmp_path),
        (*SHORT, "reference.times=[0.1]", "output.checkpoint_every=1", "time.end=0.3"),
    )
    run_here(first)
    later = (*SHORT, "reference.times=[0.1, 0.2, 0.4]", "time.end=0.5")
    run_here(Job("terzaghi", str(tmp_path), later, restart=str(tmp_path / "checkpoint.h5")))
    assert [round(record["at"], 9) for record in summary(tmp_path)["errors"]] == [
        0.1,
        0.3,
        0.4,
        0.5,
    ]


def test_another_solution_is_refused_at_a_restart(tmp_path):
    run_here(
        Job(
            "terzaghi",
            str(tmp_path),
            (*SHORT, "reference.times=[0.1]", "output.checkpoint_every=1"),
        )
    )
    other = (*SHORT, "reference.times=[0.1]", "reference.load=2e4", "time.end=0.4")
    with pytest.raises(InputError, match=r"\[reference.load\]: the checkpoint was written with"):
        run_here(Job("terzaghi", str(tmp_path), other, restart=str(tmp_path / "checkpoint.h5")))
