"""Terms of the model that are "auto": switched on when they pass their bound, for good, as if the
step had begun with them.
"""

from dataclasses import replace

import pytest
from running import (
    Job,
    header,
    history,
    largest_difference,
    needs_mpirun,
    run_here,
    run_on,
    summary,
)
from test_run_restart import BLOCK, assert_identical, continued, kill

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.simulation.energy import Energy

SMALL = (*BLOCK, "time.end=0.02")
ALL = tuple(
    f'model.{name}="auto"'
    for name in ("solid_inertia", "fluid_inertia", "convection", "moving_mesh", "porosity")
)
STATIC = ("model.solid_inertia=false", "model.fluid_inertia=false")
LATE = {("solid_inertia", 11), ("fluid_inertia", 11)}


def auto(*names):
    """Return the changes that make terms of the model "auto"."""
    return tuple(f'model.{name}="auto"' for name in names)


def columns(directory):
    """Return the history without the iterations, which count how a step was reached."""
    return {
        name: values for name, values in history(directory).items() if name != "coupling_iterations"
    }


def assert_same_history(directory, expected, tolerance):
    rows = columns(directory)
    reference = columns(expected)
    assert {
        name: d
        for name in reference
        if (d := largest_difference(rows[name], reference[name])) > tolerance
    } == {}


def test_a_term_that_passes_its_bound_in_the_first_step_gives_the_run_with_it(tmp_path):
    """The load of the pulse is dynamic from the first step on: that step is done again with the
    inertia of both phases.
    """
    done = run_here(
        Job("pulse2d", str(tmp_path / "auto"), (*SMALL, *auto("solid_inertia", "fluid_inertia")))
    )
    run_here(Job("pulse2d", str(tmp_path / "true"), SMALL))
    assert [(r["term"], r["step"], r["t"]) for r in done["switched"]] == [
        ("solid_inertia", 1, 0.0),
        ("fluid_inertia", 1, 0.0),
    ]
    assert {"solid_inertia", "fluid_inertia"} <= set(
        done["modelled"]
    ) and "solid_inertia" not in done["neglected"]
    # The first tangent's wear is counted from another number of iterations: two ways to one answer,
    # coupling tolerance 1e-6.
    assert_same_history(tmp_path / "auto", tmp_path / "true", 1e-5)


def test_a_term_below_its_bound_stays_out(tmp_path):
    """Not one digit differs from the run without it."""
    done = run_here(
        Job("pulse2d", str(tmp_path / "auto"), (*SMALL, *auto("convection"), "limits.reynolds=1e6"))
    )
    run_here(
        Job(
            "pulse2d",
            str(tmp_path / "false"),
            (*SMALL, "model.convection=false", "limits.reynolds=report"),
        )
    )
    assert done["switched"] == [] and "convection" not in done["modelled"]
    assert (tmp_path / "auto/history.csv").read_text() == (
        tmp_path / "false/history.csv"
    ).read_text()


def test_a_term_is_switched_on_within_a_run_and_says_so_once(tmp_path):
    late = (*SMALL, *auto("moving_mesh"), "limits.mesh_displacement=2e-4")
    done = run_here(Job("pulse2d", str(tmp_path / "run"), late))
    (record,) = done["switched"]
    assert (
        record["term"] == "moving_mesh"
        and 1 < record["step"] < 20
        and record["size"] > record["bound"] == 2e-4
    )
    assert done["neglected"].keys() == {"porosity_change"}  # what it had left out is modelled now
    log = (tmp_path / "run/run.log").read_text()
    assert log.count("model.moving_mesh switched on at t =") == 1
    without = run_here(Job("pulse2d", str(tmp_path / "false"), (*SMALL, "model.moving_mesh=false")))
    before = without["neglected"]["mesh_displacement"]
    assert before["value"] > 2e-4  # the measure of the fixed mesh, which the switch looked at
    rows = history(tmp_path / "run")
    fixed = history(tmp_path / "false")
    assert list(rows["C.u_y"][: record["step"]]) == list(fixed["C.u_y"][: record["step"]])
    assert rows["C.u_y"][record["step"]] != fixed["C.u_y"][record["step"]]
    # what is not modelled up to the bound changes no more than the bound: a displacement of 2e-4
    # element sizes
    run_here(Job("pulse2d", str(tmp_path / "true"), SMALL))
    assert largest_difference(rows["C.u_y"], history(tmp_path / "true")["C.u_y"]) < 2e-4


def test_inertia_that_is_switched_on_late_goes_on_from_the_quasi_static_state(tmp_path):
    """A slow load, then a pulse of 0.1 s in short steps: the second run switches both phases on and
    follows the dynamic run.
    """
    load = "boundary.3.traction.y=-1e5*where(t<=0.5, 0.2*t, 0.1 + sin(10*pi*(t-0.5)))"
    common = (*BLOCK, load, "time.step=0.05", "limits.inertia=5.0", "output.checkpoint_every=5")
    ends = {}
    for name, terms in (
        ("auto", auto("solid_inertia", "fluid_inertia")),
        ("true", ()),
        ("false", STATIC),
    ):
        first = Job("pulse2d", str(tmp_path / name), (*common, *terms, "time.end=0.5"))
        assert not run_here(first)["switched"]
        bound = '"report"' if name == "false" else "0.1"
        second = (*common, *terms, "time.end=0.6", "time.step=0.01", f"limits.inertia={bound}")
        switched = run_here(continued(replace(first, overrides=second)))["switched"]
        assert {(r["term"], r["step"]) for r in switched} == (LATE if name == "auto" else set())
        ends[name] = history(tmp_path / name)["C.u_y"][-5:]
    # what is left at 0.5 s of the waves of the start, which the quasi-static state does not have:
    # 0.15 % of the pulse
    assert largest_difference(ends["auto"], ends["true"]) < 5e-3
    assert largest_difference(ends["false"], ends["true"]) > 0.3


def test_the_variable_porosity_takes_the_moving_mesh_along(tmp_path):
    tight = ("limits.porosity_change=1e-4", "limits.mesh_displacement=1.0")
    done = run_here(
        Job("pulse2d", str(tmp_path / "run"), (*SMALL, *auto("porosity", "moving_mesh"), *tight))
    )
    assert {r["term"] for r in done["switched"]} == {"porosity", "moving_mesh"}
    assert {r["measure"] for r in done["switched"]} == {"porosity_change"}
    assert "variable porosity" in done["modelled"] and done["neglected"] == {}


def test_the_viscous_term_is_switched_on_by_its_ratio_to_the_drag(tmp_path):
    thick = (*SMALL, *auto("viscosity"), "material.0.fluid.viscosity=1.0")
    ratio = run_here(Job("pulse2d", str(tmp_path / "out"), (*thick, "time.end=0.002")))[
        "neglected"
    ]["viscosity"]["value"]
    assert 0 < ratio < 0.1
    done = run_here(
        Job(
            "pulse2d",
            str(tmp_path / "in"),
            (*thick, "time.end=0.002", f"limits.viscosity={ratio / 2}"),
        )
    )
    assert [r["term"] for r in done["switched"]] == ["viscosity"] and done["energy"][
        "viscous_dissipation"
    ] > 0


def test_the_kinetic_energy_that_a_switch_adds_is_no_dissipation():
    """It counts as given at the start: neither the balance nor any dissipation changes."""
    energy = Energy()
    energy.start(0.0, 2.0)
    quiet = {"external": 3.0, "stored": 3.0, "drag": 0.0, "viscous": 0.0, "stabilization": 0.0}
    energy.add_step(1.0, quiet, 0.0, 5.0)
    energy.remodel(4.0, 5.0)
    energy.add_step(1.0, quiet, 6.0, 6.0)
    assert energy.balance_error == energy.time_scheme_dissipation == 0.0


@pytest.mark.parametrize("scheme", ["partitioned", "direct"])
def test_a_killed_run_continues_with_what_was_switched_on(tmp_path, scheme):
    """Killed after the switch and the checkpoint; the history, the state and the summary are those
    of the whole run.
    """
    late = (
        *SMALL,
        *ALL,
        "limits.mesh_displacement=2e-4",
        "limits.reynolds=1e-4",
        f"coupling.scheme={scheme}",
    )
    whole = Job("pulse2d", str(tmp_path / "whole"), late)
    run_here(whole)
    job = replace(whole, directory=str(tmp_path / "run"))
    kill(job, tmp_path)
    switched = header(tmp_path / "run/checkpoint.h5")["coupling"]["switched"]
    assert {"solid_inertia", "fluid_inertia", "moving_mesh"} <= {
        record["term"] for record in switched
    }
    run_here(continued(job))
    assert_identical(tmp_path / "run", tmp_path / "whole")
    before = summary(tmp_path / "whole")
    after = summary(tmp_path / "run")
    for key in ("switched", "modelled", "neglected", "energy", "coupling_iterations"):
        assert before[key] == after[key], key


@needs_mpirun
def test_the_switch_is_the_same_on_any_number_of_ranks(tmp_path):
    late = (*SMALL, *ALL, "limits.mesh_displacement=2e-4", "coupling.tolerance=1e-9")
    one = run_here(Job("pulse2d", str(tmp_path / "1"), late))
    run_on(2, [Job("pulse2d", str(tmp_path / "2"), late)], tmp_path)
    two = summary(tmp_path / "2")
    assert [(r["term"], r["step"]) for r in two["switched"]] == [
        (r["term"], r["step"]) for r in one["switched"]
    ]
    assert_same_history(
        tmp_path / "2", tmp_path / "1", 1e-7
    )  # hundred coupling tolerances: twenty steps


@pytest.mark.parametrize(
    "overrides, sentence",
    [
        (
            ("model.convection=auto", "limits.reynolds=report"),
            r"\[limits.reynolds\]: received 'report', expected a positive",
        ),
        (
            ("model.porosity=auto", "model.moving_mesh=false"),
            r"\[model.porosity\]: received 'auto' with model.moving_mesh",
        ),
        (
            ("model.viscosity=auto",),
            r"\[material.0.fluid.viscosity\]: received nothing, expected a number",
        ),
        (
            ("model.fluid_inertia=auto", "time.consistent_start=true"),
            r"\[time.consistent_start\]: received true with model.flu",
        ),
        (
            ("model.solid_inertia=auto", "time.consistent_start=true"),
            r"model.solid_inertia = 'auto'",
        ),
        (
            ("model.solid_inertia=auto", "time.scheme=backward_euler"),
            r"\[time.scheme\]: received 'backward_euler' with inertia",
        ),
    ],
)
def test_what_auto_cannot_be_combined_with(overrides, sentence):
    with pytest.raises(InputError, match=sentence):
        load_scene("pulse2d", overrides)
